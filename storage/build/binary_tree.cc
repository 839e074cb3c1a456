#include "storage/build/binary_tree.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <numeric>
#include <span>

#include "storage/build/embree_run.h"

namespace raymill::storage {
namespace {

constexpr unsigned kBins = 32;

// Twice the centroid, which orders triangles as the centroid does.
float doubled_centroid(const Triangle& t, int axis) {
  const Aabb box = bounds(t);
  return box.lower[axis] * 0.5F + box.upper[axis] * 0.5F;
}

struct Split {
  int axis = 0;
  float position = 0;
  double cost = std::numeric_limits<double>::infinity();
};

struct Bin {
  Aabb box;
  std::uint64_t count = 0;
};

std::size_t bin_of(float centroid, float lower, float scale) {
  return static_cast<std::size_t>(std::clamp((centroid - lower) * scale, 0.0F, float(kBins - 1)));
}

Split best_split_on(std::span<const Triangle> triangles, int axis, float lower, float upper) {
  std::array<Bin, kBins> bins;
  const float scale = float(kBins) / (upper - lower);
  for (const Triangle& t : triangles) {
    Bin& bin = bins[bin_of(doubled_centroid(t, axis), lower, scale)];
    bin.box.grow(bounds(t));
    ++bin.count;
  }
  std::array<double, kBins> right_cost{};
  Bin right;
  for (unsigned i = kBins - 1; i > 0; --i) {
    right.box.grow(bins[i].box);
    right.count += bins[i].count;
    right_cost[i] = right.box.half_area() * double(right.count);
  }
  Split best;
  Bin left;
  for (unsigned i = 1; i < kBins; ++i) {
    left.box.grow(bins[i - 1].box);
    left.count += bins[i - 1].count;
    const double cost = left.box.half_area() * double(left.count) + right_cost[i];
    if (left.count > 0 && left.count < triangles.size() && cost < best.cost) {
      best = {axis, float(i), cost};
    }
  }
  return best;
}

// Splits by binned SAH over the centroids; by the median of the order given where no plane separates any two.
std::size_t partition(std::span<Triangle> triangles) {
  Vec3f lower{INFINITY, INFINITY, INFINITY}, upper{-INFINITY, -INFINITY, -INFINITY};
  for (const Triangle& t : triangles) {
    const Vec3f c{doubled_centroid(t, 0), doubled_centroid(t, 1), doubled_centroid(t, 2)};
    lower = min(lower, c);
    upper = max(upper, c);
  }
  Split best;
  for (int axis = 0; axis < 3; ++axis) {
    const float scale = float(kBins) / (upper[axis] - lower[axis]);
    if (lower[axis] < upper[axis] && std::isfinite(scale) && scale > 0) {
      const Split split = best_split_on(triangles, axis, lower[axis], upper[axis]);
      best = split.cost < best.cost ? split : best;
    }
  }
  if (!std::isfinite(best.cost)) {
    return triangles.size() / 2;
  }
  const float scale = float(kBins) / (upper[best.axis] - lower[best.axis]);
  const auto middle = std::partition(triangles.begin(), triangles.end(), [&](const Triangle& t) {
    return bin_of(doubled_centroid(t, best.axis), lower[best.axis], scale) < static_cast<std::size_t>(best.position);
  });
  return static_cast<std::size_t>(middle - triangles.begin());
}

// The partition's tree: inner nodes, and runs at its leaves, left to right.
struct Top {
  std::size_t first = 0;
  std::size_t count = 0;
  std::vector<Top> children;  // none: a run
};

Top partition_runs(std::span<Triangle> all, std::size_t first, std::size_t count) {
  Top top{first, count, {}};
  if (count <= kRunTriangles) {
    return top;
  }
  const std::size_t left = partition(all.subspan(first, count));
  top.children.resize(2);
  tbb::parallel_invoke([&] { top.children[0] = partition_runs(all, first, left); },
                       [&] { top.children[1] = partition_runs(all, first + left, count - left); });
  return top;
}

void collect_runs(const Top& top, std::vector<const Top*>& runs) {
  if (top.children.empty()) {
    runs.push_back(&top);
    return;
  }
  for (const Top& child : top.children) {
    collect_runs(child, runs);
  }
}

// Joins the runs' trees under the partition's nodes; takes the runs in the order of collect_runs.
std::uint32_t join(const Top& top, std::vector<std::vector<BinaryNode>>& run_nodes, std::size_t& next_run,
                   std::vector<BinaryNode>& nodes) {
  const auto index = static_cast<std::uint32_t>(nodes.size());
  if (top.children.empty()) {
    std::vector<BinaryNode>& run = run_nodes[next_run++];
    for (BinaryNode node : run) {
      if (node.count == 0) {
        node.left += index;
        node.right += index;
      }
      nodes.push_back(node);
    }
    run = {};
    return index;
  }
  nodes.emplace_back();
  const std::uint32_t left = join(top.children[0], run_nodes, next_run, nodes);
  const std::uint32_t right = join(top.children[1], run_nodes, next_run, nodes);
  nodes[index].left = left;
  nodes[index].right = right;
  nodes[index].box.grow(nodes[left].box);
  nodes[index].box.grow(nodes[right].box);
  return index;
}

}  // namespace

std::uint64_t binary_tree_build_bytes(std::uint64_t triangle_count, unsigned threads) {
  // A run under way: build primitives 32 B, Embree's nodes and scratch about 90 B, the sorted copy 44 B a triangle.
  constexpr std::uint64_t kRunBytesPerTriangle = 32 + 90 + 44;
  const std::uint64_t running = std::min<std::uint64_t>(triangle_count, std::uint64_t(kRunTriangles) * threads);
  // Leaves hold three triangles or more on average: 2/3 of a node a triangle, twice while the runs are joined.
  return running * kRunBytesPerTriangle + triangle_count * sizeof(BinaryNode) * 4 / 3;
}

Result<BinaryTree> build_binary_tree(std::vector<Triangle>& triangles, unsigned threads, Ledger& ledger) {
  const int parallelism =
      threads == 0 ? static_cast<int>(tbb::this_task_arena::max_concurrency()) : static_cast<int>(threads);
  RAYMILL_ASSIGN_OR_RETURN(
      const BudgetReservation reservation,
      ledger.claim(Tag::build, binary_tree_build_bytes(triangles.size(), static_cast<unsigned>(parallelism))));
  RAYMILL_ASSIGN_OR_RETURN(const EmbreeDevice device, EmbreeDevice::create());

  BinaryTree tree;
  Status status;
  tbb::task_arena arena(parallelism);
  arena.execute([&] {
    const Top top = partition_runs(triangles, 0, triangles.size());
    std::vector<const Top*> runs;
    collect_runs(top, runs);
    std::vector<std::vector<BinaryNode>> run_nodes(runs.size());
    std::vector<Status> statuses(runs.size());
    tbb::parallel_for(
        std::size_t{0}, runs.size(),
        [&](std::size_t i) {
          statuses[i] = build_run(device, std::span(triangles).subspan(runs[i]->first, runs[i]->count),
                                  static_cast<std::uint32_t>(runs[i]->first), run_nodes[i]);
        },
        tbb::simple_partitioner());
    for (const Status& run_status : statuses) {
      if (!run_status.ok()) {
        status = run_status;
        return;
      }
    }
    std::size_t next_run = 0;
    join(top, run_nodes, next_run, tree.nodes);
  });
  RAYMILL_RETURN_IF_ERROR(status);
  return tree;
}

}  // namespace raymill::storage
