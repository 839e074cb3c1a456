// Ties, directions, invalid rays, what is dropped, deep trees, barycentrics.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numeric>

#include "tests/extremes/row.h"

namespace raymill::extremes {
namespace {

using tests::ray;

bool same_answer(const Hit& a, const Hit& b) {
  return a.t == b.t && a.primitive_id == b.primitive_id && a.geometry_id == b.geometry_id;
}

// Of groups of rays that follow each other, those whose answers are all alike.
std::size_t groups_alike(const Answers& answers, std::size_t size,
                         const std::function<bool(std::size_t, std::size_t)>& alike) {
  std::size_t count = 0;
  for (std::size_t first = 0; first + size <= answers.hits.size(); first += size) {
    bool all = true;
    for (std::size_t i = first + 1; i < first + size; ++i) {
      all = all && alike(first, i);
    }
    count += all ? 1 : 0;
  }
  return count;
}

std::string tell_alike(std::size_t count, std::size_t groups) {
  return std::to_string(count) + " of " + std::to_string(groups) + " alike";
}

Row signed_zeros() {
  std::vector<Ray> rays;
  for (int number = 0; number < 27; ++number) {
    const int parts[3] = {number % 3 - 1, number / 3 % 3 - 1, number / 9 - 1};
    for (unsigned signs = 0; number != 13 && signs < 8; ++signs) {
      Ray r = ray({0.01F, 0.02F, -0.03F}, {});
      for (unsigned axis = 0; axis < 3; ++axis) {
        r.dir[axis] = parts[axis] == 0 && (signs >> axis & 1) != 0 ? -0.0F : float(parts[axis]);
      }
      rays.push_back(r);
    }
  }
  const auto alike = [](const Answers& answers) {
    return groups_alike(answers, 8, [&](auto i, auto j) {
      return same_answer(answers.hits[i], answers.hits[j]) && answers.hits[j].primitive_id != kNoId;
    });
  };
  return {.id = "E17",
          .setup = "dir with zeros of both signs, 26 directions x 8 signs, from inside a sphere",
          .promise = "the sign of a zero changes nothing, and each hits",
          .scene = {tests::sphere({}, 1, 12, 24)},
          .rays = [rays](auto) { return rays; },
          .tell = [alike](const Answers& answers) { return tell_alike(alike(answers), 26); },
          .keeps = [alike](Mode, const Answers& answers) { return alike(answers) == 26; }};
}

bool is_valid(const Ray& r) {
  bool valid = r.tnear <= r.tfar && r.dir != std::array<float, 3>{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    valid = valid && std::isfinite(r.org[axis]) && std::isfinite(r.dir[axis]);
  }
  return valid;
}

Row invalid_rays() {
  const auto told = [](const Answers& answers) {
    std::size_t invalid = 0, named = 0, wrong = 0;
    for (std::size_t i = 0; i < answers.hits.size(); ++i) {
      const bool is_named = std::isnan(answers.hits[i].t);
      invalid += is_valid(answers.rays[i]) ? 0 : 1;
      named += !is_valid(answers.rays[i]) && is_named ? 1 : 0;
      wrong += is_valid(answers.rays[i]) && is_named ? 1 : 0;
    }
    return std::array<std::size_t, 3>{invalid, named, wrong};
  };
  return {.id = "E18",
          .setup = "NaN, infinities, zero dir and crossed intervals among valid rays",
          .promise = "t = NaN for each invalid one and for no other",
          .scene = {tests::sphere({}, 1, 12, 24)},
          .rays =
              [](auto) {
                std::vector<Ray> rays = tests::hostile_rays();
                const std::vector<Ray> valid = rays_from_inside(18, {}, 0.5F, 200);
                rays.insert(rays.begin() + 5, valid.begin(), valid.end());
                return rays;
              },
          .tell =
              [told](const Answers& answers) {
                const auto [invalid, named, wrong] = told(answers);
                return std::to_string(named) + " of " + std::to_string(invalid) + " named, " + std::to_string(wrong) +
                       " wrongly";
              },
          .keeps =
              [told](Mode, const Answers& answers) {
                const auto [invalid, named, wrong] = told(answers);
                return invalid > 0 && named == invalid && wrong == 0;
              },
          .not_for_embree = "not asked: some builds of it abort"};
}

Row degenerate_triangles() {
  constexpr std::size_t kWhole = 300;
  constexpr float kNoNumber = std::numeric_limits<float>::quiet_NaN();
  constexpr float kBoundless = std::numeric_limits<float>::infinity();
  Random random(19);
  Scene scene{tests::soup(random, kWhole)};
  scene.push_back({{Vec3f{0, 0, 0}, {0, 0, 0}, {1, 0, 0}},
                   {Vec3f{0, 0, 0}, {1, 1, 1}, {2, 2, 2}},
                   {Vec3f{0, 0, 0}, {kNoNumber, 0, 0}, {0, 1, 0}},
                   {Vec3f{0, 0, 0}, {kBoundless, 0, 0}, {0, 1, 0}},
                   {Vec3f{0, 0, 0}, {1e38F, 0, 0}, {0, 1, 0}}});
  scene.emplace_back();
  return {.id = "E19",
          .setup = "triangles with NaN, inf, 1e38, equal corners and no area beside 300 whole ones; an empty mesh",
          .promise = "dropped and counted by the import, the rest intact",
          .scene = scene,
          .rays = [](auto) { return rays_from_inside(190, {}, 1, 2000); },
          .tell =
              [](const Answers& answers) {
                return std::to_string(answers.triangles.size()) + " triangles kept, " + tell_hits(answers);
              },
          .keeps = [](Mode, const Answers& answers) { return answers.triangles.size() == kWhole; }};
}

constexpr int kExponents[] = {0, -66, -30, -3, 5, 40, 66};

Row lengths_of_dir() {
  Random random(20);
  const Scene scene{tests::soup(random, 300)};
  const auto alike = [](const Answers& answers) {
    return groups_alike(answers, std::size(kExponents), [&](std::size_t i, std::size_t j) {
      Hit scaled = answers.hits[j];
      scaled.t = std::ldexp(scaled.t, kExponents[j - i]);
      return same_answer(answers.hits[i], scaled);
    });
  };
  return {.id = "E20",
          .setup = "dir of length 1e-20 to 1e20: 300 rays, each at seven powers of two",
          .promise = "t counts in lengths of dir, to the bit",
          .scene = scene,
          .rays =
              [](auto) {
                std::vector<Ray> rays;
                for (const Ray& base : rays_from_inside(200, {}, 2, 300)) {
                  for (const int exponent : kExponents) {
                    Ray scaled = base;
                    for (float& component : scaled.dir) {
                      component = std::ldexp(component, exponent);
                    }
                    rays.push_back(scaled);
                  }
                }
                return rays;
              },
          .tell = [alike](const Answers& answers) { return tell_alike(alike(answers), 300); },
          .keeps = [alike](Mode, const Answers& answers) { return alike(answers) == 300; },
          .not_for_embree = "not asked: some builds of it abort"};
}

Row coincident_geometries() {
  Random random(26);
  const Mesh base = tests::soup(random, 400, 0.4F);
  const auto later = [](const Answers& answers) {
    return std::count_if(answers.hits.begin(), answers.hits.end(),
                         [](const Hit& hit) { return hit.primitive_id != kNoId && hit.geometry_id > 0; });
  };
  return {.id = "E26",
          .setup = "five copies of a mesh, in different pages",
          .promise = "the first copy wins everywhere",
          .scene = {base, base, base, base, base},
          .rays = [](auto) { return rays_from_inside(260, {}, 2, 1500); },
          .tell =
              [later](const Answers& answers) {
                return tell_hits(answers) + ", " + std::to_string(later(answers)) + " a later copy";
              },
          .keeps = [later](Mode, const Answers& answers) { return later(answers) == 0; }};
}

std::string tell_as_truth(const Answers& answers) {
  std::size_t same = 0;
  const std::size_t count = std::min(answers.truth.size(), answers.hits.size());
  for (std::size_t i = 0; i < count; ++i) {
    same += answers.hits[i].primitive_id == answers.truth[i].primitive_id ? 1 : 0;
  }
  return std::to_string(same) + " of " + std::to_string(count) + " as float64";
}

Row deep_tree() {
  return {.id = "E28",
          .setup = "10000 triangles, each inside the next: the tree of such a scene is a chain",
          .promise = "built within the bitstack, every answer right",
          .scene = {tests::nested_shells(10000)},
          .rays = [](auto) { return rays_from_inside(28, {}, 1, 16); },
          .tell = tell_as_truth,
          .keeps =
              [](Mode mode, const Answers& answers) {
                const std::string all = std::to_string(answers.truth.size());
                return mode == Mode::fast || tell_as_truth(answers) == all + " of " + all + " as float64";
              }};
}

Row fan() {
  Mesh mesh;
  for (int i = 0; i < 32; ++i) {
    const double a = 0.19634954084936207 * i, b = 0.19634954084936207 * ((i + 1) % 32);
    mesh.push_back(
        {Vec3f{0, 0, 0}, {float(std::cos(a)), float(std::sin(a)), 0}, {float(std::cos(b)), float(std::sin(b)), 0}});
  }
  const auto tell = [](const Answers& answers) {
    return "t " + tell_distances(answers) + ", primitive " + std::to_string(answers.hits[0].primitive_id);
  };
  return {.id = "E29",
          .setup = "a vertex that 32 triangles share",
          .promise = "t = 1, the least primitive",
          .scene = {mesh},
          .rays =
              [](auto) {
                return std::vector<Ray>{ray({0, 0, 1}, {0, 0, -1})};
              },
          .tell = tell,
          .keeps = [tell](Mode, const Answers& answers) { return tell(answers) == "t 1, primitive 0"; }};
}

// The largest coordinate of the difference between the point of the barycentrics and that of t.
double worst_point(const Answers& answers) {
  double most = 0;
  for (std::size_t i = 0; i < answers.hits.size(); ++i) {
    const Hit& hit = answers.hits[i];
    const auto its = std::find_if(answers.triangles.begin(), answers.triangles.end(), [&](const Triangle& triangle) {
      return triangle.primitive_id == hit.primitive_id && triangle.geometry_id == hit.geometry_id;
    });
    for (int axis = 0; its != answers.triangles.end() && axis < 3; ++axis) {
      const double point =
          (1.0 - hit.u - hit.v) * its->v[0][axis] + double(hit.u) * its->v[1][axis] + double(hit.v) * its->v[2][axis];
      const auto k = static_cast<std::size_t>(axis);
      most = std::max(most, std::fabs(point - (answers.rays[i].org[k] + double(hit.t) * answers.rays[i].dir[k])));
    }
  }
  return most;
}

Row barycentrics() {
  Random random(34);
  return {.id = "E34",
          .setup = "500 triangles in [-1, 1]: the point of u and v against that of t",
          .promise = "at most 1e-5 apart",
          .scene = {tests::soup(random, 500)},
          .rays =
              [](auto) {
                Random draw(340);
                std::vector<Ray> rays;
                while (rays.size() < 2000) {
                  const Vec3f org = draw.in_box(-3, 3);
                  rays.push_back(tests::ray_towards(org, draw.in_box(-1, 1)));
                }
                return rays;
              },
          .tell =
              [](const Answers& answers) {
                char text[64];
                std::snprintf(text, sizeof text, "up to %.1e apart", worst_point(answers));
                return std::string(text);
              },
          .keeps = [](Mode, const Answers& answers) { return worst_point(answers) <= 1e-5; }};
}

}  // namespace

std::vector<Row> answer_rows() {
  return {signed_zeros(), invalid_rays(), degenerate_triangles(), lengths_of_dir(), coincident_geometries(),
          deep_tree(),    fan(),          barycentrics()};
}

}  // namespace raymill::extremes
