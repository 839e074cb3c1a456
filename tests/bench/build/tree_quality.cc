// raymill-tree-quality: what a builder's choices are worth, counted.
//
//   raymill-tree-quality STORE RAYS.npy [--trees LIST] [--most-rays 30000] [--widths 4,8]
//
// A tree is QUALITY:LEAF:BLOCK:PASSES, e.g. medium:8:4:0, which is what `raymill build` makes of a run: the quality of
// Embree's builder (low, medium, high with spatial splits), triangles of a leaf at most, triangles that the builder
// counts as one, passes of reinsertion. Each is built over all triangles of the store at once and traversed for the
// closest hit, nearest child first, with the boxes of float32 nodes; nodes, leaves and triangles are counted, so the
// figures are the same on any machine. The first tree gives the hits that those of the others are held against. Prints
// a line of JSON for each tree. Exit codes: 0; 1 hits differ between trees without spatial splits; 2 it could not be
// run.
#include <array>
#include <bit>
#include <cmath>
#include <cstdio>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "client/cli/bench/store_triangles.h"
#include "tests/bench/build/trial_tree.h"
#include "tests/bench/tool.h"
#include "tests/support/tool.h"
#include "traversal/slab.h"

namespace raymill::bench {
namespace {

using storage::Aabb;
using storage::Triangle;
using storage::Vec3f;

struct Options {
  std::string store, rays;
  std::vector<std::string> trees = {"medium:8:4:0", "medium:8:8:0", "medium:8:1:0", "medium:4:4:0",
                                    "medium:2:1:0", "medium:1:1:0", "low:8:4:0",    "high:8:4:0",
                                    "medium:8:4:1", "medium:8:4:2", "high:8:4:1"};
  std::size_t most_rays = 30000;
  std::vector<unsigned> widths = {4, 8};
};

Result<TreeChoice> parse_choice(const std::string& text) {
  TreeChoice choice;
  std::istringstream words(text);
  std::string quality;
  std::getline(words, quality, ':');
  char colon = 0;
  words >> choice.leaf >> colon >> choice.block >> colon >> choice.reinsertions;
  const bool known = quality == "low" || quality == "medium" || quality == "high";
  if (!words || !words.eof() || !known || choice.leaf < 1 || choice.leaf > 8 || choice.block < 1) {
    return {ErrorCode::invalid_argument, text + ": a tree is QUALITY:LEAF:BLOCK:PASSES, e.g. medium:8:4:0"};
  }
  choice.quality = quality == "low" ? Quality::low : quality == "high" ? Quality::high : Quality::medium;
  return choice;
}

struct Answer {
  float t = std::numeric_limits<float>::infinity();
  std::uint32_t triangle = ~0U;
};

struct Counters {
  std::uint64_t nodes = 0, leaves = 0, triangles = 0;
};

struct Interval {
  float entry, exit;
};

class Tracer {
 public:
  Tracer(const TrialTree& tree, std::span<const TrialNode> nodes, std::span<const Triangle> triangles)
      : tree_(tree), nodes_(nodes), triangles_(triangles) {}

  Answer trace(const Ray& ray, Counters& counters) {
    for (int axis = 0; axis < 3; ++axis) {
      rdir_[static_cast<unsigned>(axis)] = 1 / ray.dir[static_cast<unsigned>(axis)];
    }
    Answer best;
    best.t = std::min(ray.tfar, std::numeric_limits<float>::max());
    stack_.assign(1, {ray.tnear, 0, 0});
    while (!stack_.empty()) {
      const Entry at = stack_.back();
      stack_.pop_back();
      if (at.distance > best.t) {
        continue;
      }
      if (at.count > 0) {
        ++counters.leaves;
        counters.triangles += at.count;
        for (std::uint32_t i = at.child; i < at.child + at.count; ++i) {
          offer(ray, tree_.references[i], best);
        }
        continue;
      }
      ++counters.nodes;
      push_children(ray, nodes_[at.child], best.t);
    }
    if (best.triangle == ~0U) {
      best.t = std::numeric_limits<float>::infinity();
    }
    return best;
  }

 private:
  struct Entry {
    float distance;
    std::uint32_t child, count;
  };

  // The rule of traversal/slab.h, from `least` on.
  [[nodiscard]] Interval meet(const Ray& ray, const Aabb& box, float least) const {
    float entry = least, exit = std::numeric_limits<float>::infinity();
    for (unsigned axis = 0; axis < 3; ++axis) {
      const bool back = std::signbit(ray.dir[axis]);
      const auto at = static_cast<int>(axis);
      const float near = ((back ? box.upper : box.lower)[at] - ray.org[axis]) * rdir_[axis];
      const float far = ((back ? box.lower : box.upper)[at] - ray.org[axis]) * rdir_[axis];
      entry = near > entry ? near : entry;
      exit = far < exit ? far : exit;
    }
    return {entry, exit + std::fabs(exit) * traversal::kExitPad};
  }

  void push_children(const Ray& ray, const TrialNode& node, float tfar) {
    const std::size_t bottom = stack_.size();
    for (unsigned slot = 0; slot < node.children; ++slot) {
      const Interval its = meet(ray, node.boxes[slot], ray.tnear);
      if (its.entry <= std::min(its.exit, tfar)) {
        stack_.push_back({its.entry, node.child[slot], node.count[slot]});
      }
    }
    std::stable_sort(stack_.begin() + static_cast<std::ptrdiff_t>(bottom), stack_.end(),
                     [](const Entry& a, const Entry& b) { return a.distance > b.distance; });
  }

  // Moeller, Trumbore 1997 in float64; t within the triangle's own box, so that hits do not depend on the tree.
  void offer(const Ray& ray, std::uint32_t index, Answer& best) const {
    const Triangle& triangle = triangles_[index];
    const auto minus = [](const auto& a, const Vec3f& b) {
      return std::array{double(a[0]) - b[0], double(a[1]) - b[1], double(a[2]) - b[2]};
    };
    const auto cross = [](const auto& a, const auto& b) {
      return std::array{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
    };
    const auto dot = [](const auto& a, const auto& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; };
    const auto e1 = minus(triangle.v[1], triangle.v[0]), e2 = minus(triangle.v[2], triangle.v[0]);
    const auto s = minus(ray.org, triangle.v[0]);
    const std::array dir{double(ray.dir[0]), double(ray.dir[1]), double(ray.dir[2])};
    const auto p = cross(dir, e2), q = cross(s, e1);
    const double inverse = 1 / dot(e1, p), u = dot(s, p) * inverse, v = dot(dir, q) * inverse;
    const Interval box = meet(ray, bounds(triangle), -std::numeric_limits<float>::infinity());
    if (!(u >= 0 && v >= 0 && u + v <= 1 && box.entry <= box.exit)) {
      return;
    }
    const float t = std::clamp(static_cast<float>(dot(e2, q) * inverse), box.entry, box.exit);
    if (t >= ray.tnear && (t < best.t || (t == best.t && index < best.triangle))) {
      best = {t, index};
    }
  }

  const TrialTree& tree_;
  std::span<const TrialNode> nodes_;
  std::span<const Triangle> triangles_;
  std::array<float, 3> rdir_{};
  std::vector<Entry> stack_;
};

struct Traced {
  Counters counters;
  std::vector<Answer> answers;
};

Traced trace_all(const TrialTree& tree, std::span<const TrialNode> nodes, std::span<const Triangle> triangles,
                 std::span<const Ray> rays) {
  Tracer tracer(tree, nodes, triangles);
  Traced traced;
  for (const Ray& ray : rays) {
    traced.answers.push_back(tracer.trace(ray, traced.counters));
  }
  return traced;
}

std::size_t count_different(std::span<const Answer> expected, std::span<const Answer> answers) {
  std::size_t different = 0;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    const bool same = std::bit_cast<std::uint32_t>(expected[i].t) == std::bit_cast<std::uint32_t>(answers[i].t) &&
                      expected[i].triangle == answers[i].triangle;
    different += same ? 0 : 1;
  }
  return different;
}

Result<bool> run(const Options& options) {
  TriangleCollector scene;
  RAYMILL_RETURN_IF_ERROR(client::read_store_triangles(options.store, scene));
  RAYMILL_ASSIGN_OR_RETURN(const auto rays, read_rays(options.rays, options.most_rays));
  RAYMILL_ASSIGN_OR_RETURN(const auto device, storage::EmbreeDevice::create());
  const auto ray_count = static_cast<double>(rays.size()), triangles = static_cast<double>(scene.all.size());
  std::vector<Answer> expected;
  bool all_alike = true;
  for (const std::string& name : options.trees) {
    RAYMILL_ASSIGN_OR_RETURN(const TreeChoice choice, parse_choice(name));
    const double begin = thread_seconds();
    RAYMILL_ASSIGN_OR_RETURN(const TrialTree tree, build_trial_tree(device, scene.all, choice));
    const double seconds = thread_seconds() - begin;
    for (const unsigned width : options.widths) {
      const std::vector<TrialNode> nodes = make_wide(tree, width);
      const Traced traced = trace_all(tree, nodes, scene.all, rays);
      expected = expected.empty() ? traced.answers : expected;
      const std::size_t different = count_different(expected, traced.answers);
      all_alike = all_alike && (choice.quality == Quality::high || different == 0);
      const nlohmann::json line = {{"tree", name},
                                   {"width", width},
                                   {"triangles", scene.all.size()},
                                   {"rays", rays.size()},
                                   {"references_per_triangle", static_cast<double>(tree.references.size()) / triangles},
                                   {"wide_nodes_per_triangle", static_cast<double>(nodes.size()) / triangles},
                                   {"sah_cost", sah_cost(nodes, tree.nodes[0].box)},
                                   {"nodes_per_ray", static_cast<double>(traced.counters.nodes) / ray_count},
                                   {"leaves_per_ray", static_cast<double>(traced.counters.leaves) / ray_count},
                                   {"triangles_per_ray", static_cast<double>(traced.counters.triangles) / ray_count},
                                   {"build_seconds", seconds},
                                   {"different", different}};
      std::printf("%s\n", line.dump().c_str());
      std::fflush(stdout);
    }
  }
  return all_alike;
}

int main(int argc, char** argv) {
  Options options;
  tests::Tool tool("raymill-tree-quality", "What a builder's choices are worth, counted.");
  tool.option("STORE", options.store, "The store that the triangles are taken from").required();
  tool.option("RAYS", options.rays, "Ray file").required();
  tool.option("--trees", options.trees, "QUALITY:LEAF:BLOCK:PASSES, separated by commas").separated_by(',');
  tool.option("--most-rays", options.most_rays, "Rays that are traced");
  tool.option("--widths", options.widths, "Children of a node, separated by commas").separated_by(',').between(2, 8);
  return tool.run(argc, argv, [&] { return run(options); });
}

}  // namespace
}  // namespace raymill::bench

int main(int argc, char** argv) { return raymill::bench::main(argc, argv); }
