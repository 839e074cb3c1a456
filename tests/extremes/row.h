// A row of the page: a setup that is known to break ray tracers, what is promised there, and how an answer is told.
// Immutable values.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "storage/io/build_store.h"
#include "tests/support/instances.h"
#include "tests/support/random.h"
#include "tests/support/rays.h"
#include "tests/support/scenes.h"
#include "tests/support/stores.h"
#include "tests/support/volumes.h"
#include "traversal/query.h"

namespace raymill::extremes {

using tests::Corners;
using tests::Mesh;
using tests::Random;
using tests::Scene;
using tests::Triangle;
using tests::Vec3f;

/// Somebody's hits of a row's rays.
struct Answers {
  std::span<const Triangle> triangles;  ///< as the store decodes them
  std::span<const Ray> rays;            ///< the first hits.size() of the row's
  std::span<const Hit> hits;
  std::span<const Hit> truth;  ///< by float64, of the first rays; it may be shorter
};

struct Row {
  std::string id;
  std::string setup;
  std::string promise;
  Scene scene = {};
  /// In place of `scene`: objects that are placed. Answers have its triangles as they are flattened.
  std::optional<tests::PlacedScene> placed = {};
  /// A level set; without a voxel it has `scene` beside it. OpenVDB is asked in Embree's place.
  std::optional<tests::TestVolume> volume = {};
  BuildConfig config = tests::small_pages();
  std::function<std::vector<Ray>(std::span<const Triangle>)> rays = {};
  /// A few words. They depend on the answers' bits alone.
  std::function<std::string(const Answers&)> tell = {};
  /// Whether the mode's answers are what is promised.
  std::function<bool(Mode, const Answers&)> keeps = {};
  /// Why Embree is not asked; empty: it is.
  std::string not_for_embree = {};
};

/// Single triangles, planes and boxes.
std::vector<Row> flat_rows();
/// Closed and curved meshes.
std::vector<Row> mesh_rows();
/// Ties, directions, invalid rays, deep trees.
std::vector<Row> answer_rows();
/// Objects that are placed by matrices of every kind.
std::vector<Row> placed_rows();

/// Level sets.
std::vector<Row> volume_rows();

/// Where the trilinear field first changes its sign, in float64, in a volume of 64 voxels a unit.
Hit volume_truth(const tests::TestVolume& volume, const Ray& ray);
/// The nearest hit in long double, the ray taken into each object's space without rounding.
Hit placed_truth(const tests::PlacedScene& scene, const Ray& ray);

// Ways to tell and to keep that rows share.

/// "3 of 7 hit".
std::string tell_hits(const Answers& answers);
/// "7 hit, 0 miss".
std::string tell_misses(const Answers& answers);
/// "0, 1, miss, NaN": of a few rays.
std::string tell_distances(const Answers& answers);

std::size_t count_hits(const Answers& answers);
/// Keeps where the words are these, whatever the mode.
std::function<bool(Mode, const Answers&)> always(std::string (*tell)(const Answers&), std::string words);
/// Every ray hits in watertight and exact; in fast any may miss.
bool all_hit_but_in_fast(Mode mode, const Answers& answers);
bool none_hits(Mode mode, const Answers& answers);

/// `count` rays from points of a box around `center` in directions of a box, not normalised.
std::vector<Ray> rays_from_inside(std::uint64_t seed, const Vec3f& center, float reach, std::size_t count);

}  // namespace raymill::extremes
