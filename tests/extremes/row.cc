#include "tests/extremes/row.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

namespace raymill::extremes {

std::size_t count_hits(const Answers& answers) {
  return static_cast<std::size_t>(
      std::count_if(answers.hits.begin(), answers.hits.end(), [](const Hit& hit) { return std::isfinite(hit.t); }));
}

std::string tell_hits(const Answers& answers) {
  return std::to_string(count_hits(answers)) + " of " + std::to_string(answers.hits.size()) + " hit";
}

std::string tell_misses(const Answers& answers) {
  return std::to_string(answers.hits.size() - count_hits(answers)) + " of " + std::to_string(answers.hits.size()) +
         " miss";
}

std::string tell_distances(const Answers& answers) {
  std::string words;
  for (const Hit& hit : answers.hits) {
    char text[32];
    std::snprintf(text, sizeof text, "%.9g", hit.t == 0 ? 0.0 : double(hit.t));  // -0 is 0
    words += words.empty() ? "" : ", ";
    words += std::isinf(hit.t) ? "miss" : std::isnan(hit.t) ? "NaN" : text;
  }
  return words;
}

std::function<bool(Mode, const Answers&)> always(std::string (*tell)(const Answers&), std::string words) {
  return [tell, words = std::move(words)](Mode, const Answers& answers) { return tell(answers) == words; };
}

bool all_hit_but_in_fast(Mode mode, const Answers& answers) {
  return mode == Mode::fast || count_hits(answers) == answers.hits.size();
}

bool none_hits(Mode, const Answers& answers) { return count_hits(answers) == 0; }

std::vector<Ray> rays_from_inside(std::uint64_t seed, const Vec3f& center, float reach, std::size_t count) {
  Random random(seed);
  std::vector<Ray> rays;
  while (rays.size() < count) {
    const Vec3f offset = random.in_box(-reach, reach);
    const Vec3f org{center.x + offset.x, center.y + offset.y, center.z + offset.z};
    rays.push_back(tests::ray(org, random.in_box(-1, 1)));
  }
  return rays;
}

}  // namespace raymill::extremes
