#include "storage/import/scene_parts.h"

#include <utility>

namespace raymill::storage {

namespace {

// Of the scene's reach: what must be empty beside a part.
constexpr double kGapShare = 1.0 / 256;
// A part beyond it would not be placed within kPositionLimit.
constexpr double kMostReach = 0x1p+119;

using Range = std::pair<std::size_t, std::size_t>;

// Cuts a range of pieces wherever none of them lies for more than `gap` along an axis. Empty: there is no such place.
std::vector<Range> cut(std::vector<ScenePiece>& pieces, const Range& range, double gap) {
  std::vector<Range> apart;
  for (std::size_t axis = 0; axis < 3 && apart.empty(); ++axis) {
    const auto at = [&](std::size_t i) { return pieces.begin() + static_cast<std::ptrdiff_t>(i); };
    std::sort(at(range.first), at(range.second),
              [axis](const ScenePiece& a, const ScenePiece& b) { return a.box.lower[axis] < b.box.lower[axis]; });
    std::size_t begin = range.first;
    double end = pieces[range.first].box.upper[axis];
    for (std::size_t i = range.first; i < range.second; ++i) {
      if (pieces[i].box.lower[axis] - end > gap) {
        apart.emplace_back(begin, i);
        begin = i;
      }
      end = std::max(end, pieces[i].box.upper[axis]);
    }
    if (!apart.empty()) {
      apart.emplace_back(begin, range.second);
    }
  }
  return apart;
}

// A middle of a part's mesh, rounded otherwise, still lies in it; gaps are wider by far.
Extent grown(Extent box, double by) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    box.lower[axis] -= by;
    box.upper[axis] += by;
  }
  return box;
}

std::vector<ScenePart> parts_between(std::vector<ScenePiece>& pieces, double gap) {
  std::vector<ScenePart> parts;
  std::vector<Range> open;
  if (!pieces.empty()) {
    open.emplace_back(0, pieces.size());
  }
  while (!open.empty()) {
    const Range range = open.back();
    open.pop_back();
    const std::vector<Range> apart = cut(pieces, range, gap);
    if (!apart.empty()) {
      open.insert(open.end(), apart.begin(), apart.end());
      continue;
    }
    ScenePiece all{{}, false};
    for (std::size_t i = range.first; i < range.second; ++i) {
      all.box.join(pieces[i].box);
      all.gains = all.gains || pieces[i].gains;
    }
    if (all.gains && all.box.reach() > kNearReach && all.box.reach() < kMostReach && all.box.is_far()) {
      const int step = all.box.side() > 0 ? std::ilogb(all.box.side()) + 1 : -Origin::kMostExponent;
      parts.push_back({grown(all.box, gap / 4), origin_near(all.box.middle(), step)});
    }
  }
  return parts;
}

}  // namespace

std::vector<ScenePart> find_parts(std::vector<ScenePiece> pieces) {
  std::erase_if(pieces, [](const ScenePiece& piece) {
    return piece.box.empty() || !piece.box.finite() || !std::isfinite(piece.box.side());
  });
  double reach = 0;
  for (const ScenePiece& piece : pieces) {
    reach = std::max(reach, piece.box.reach());
  }
  std::vector<ScenePart> parts;
  if (reach <= kNearReach) {
    return parts;
  }
  double gap = reach * kGapShare;
  do {
    parts = parts_between(pieces, gap);
    gap *= 2;
  } while (parts.size() > kMostParts);
  std::erase_if(parts, [](const ScenePart& part) { return part.origin.is_zero(); });
  std::sort(parts.begin(), parts.end(),
            [](const ScenePart& a, const ScenePart& b) { return a.around.lower < b.around.lower; });
  return parts;
}

std::uint32_t part_of(std::span<const ScenePart> parts, const Extent& box) {
  if (box.empty()) {
    return kNoPart;
  }
  const std::array<double, 3> middle = box.middle();
  for (std::size_t i = 0; i < parts.size(); ++i) {
    bool inside = true;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      inside = inside && middle[axis] >= parts[i].around.lower[axis] && middle[axis] <= parts[i].around.upper[axis];
    }
    if (inside) {
      return static_cast<std::uint32_t>(i);
    }
  }
  return kNoPart;
}

}  // namespace raymill::storage
