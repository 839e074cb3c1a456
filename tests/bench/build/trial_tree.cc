#include "tests/bench/build/trial_tree.h"

#include <embree3/rtcore.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <limits>
#include <new>
#include <numeric>
#include <string>
#include <utility>

namespace raymill::bench {
namespace {

using storage::Aabb;
using storage::BinaryNode;
using storage::Triangle;
using storage::Vec3f;

constexpr unsigned kMostLeaf = 8;
// References that spatial splits may add, for each triangle.
constexpr double kMostSplits = 1.0;

struct RawNode {
  Aabb box;
  RawNode* children[2] = {nullptr, nullptr};  // null: a leaf
  std::uint32_t count = 0;
  std::uint32_t triangles[kMostLeaf] = {};
};

void* create_node(RTCThreadLocalAllocator allocator, unsigned /*children*/, void* /*user*/) {
  return new (rtcThreadLocalAlloc(allocator, sizeof(RawNode), 16)) RawNode;
}

void set_children(void* node, void** children, unsigned count, void* /*user*/) {
  for (unsigned i = 0; i < count; ++i) {
    static_cast<RawNode*>(node)->children[i] = static_cast<RawNode*>(children[i]);
  }
}

// Boxes are the children's own.
void set_bounds(void* /*node*/, const RTCBounds** /*bounds*/, unsigned /*count*/, void* /*user*/) {}

void* create_leaf(RTCThreadLocalAllocator allocator, const RTCBuildPrimitive* primitives, std::size_t count,
                  void* /*user*/) {
  auto* leaf = new (rtcThreadLocalAlloc(allocator, sizeof(RawNode), 16)) RawNode;
  leaf->count = static_cast<std::uint32_t>(count);
  for (std::size_t i = 0; i < count; ++i) {
    const RTCBuildPrimitive& from = primitives[i];
    leaf->box.grow(Aabb{{from.lower_x, from.lower_y, from.lower_z}, {from.upper_x, from.upper_y, from.upper_z}});
    leaf->triangles[i] = from.primID;
  }
  return leaf;
}

RTCBounds rtc_bounds(const Aabb& box) {
  return {box.lower.x, box.lower.y, box.lower.z, 0, box.upper.x, box.upper.y, box.upper.z, 0};
}

Aabb intersection(const Aabb& a, const Aabb& b) { return {max(a.lower, b.lower), min(a.upper, b.upper)}; }

// The two parts of a reference's box that its triangle fills.
void split(const RTCBuildPrimitive* primitive, unsigned dimension, float position, RTCBounds* left, RTCBounds* right,
           void* user) {
  const auto axis = static_cast<int>(dimension);
  const Triangle& triangle = static_cast<const Triangle*>(user)[primitive->primID];
  Aabb parts[2];
  for (unsigned i = 0; i < 3; ++i) {
    const Vec3f &a = triangle.v[i], &b = triangle.v[(i + 1) % 3];
    if (a[axis] <= position) {
      parts[0].grow(a);
    }
    if (a[axis] >= position) {
      parts[1].grow(a);
    }
    if ((a[axis] < position) != (b[axis] < position) && a[axis] != b[axis]) {
      const float share = (position - a[axis]) / (b[axis] - a[axis]);
      Vec3f cut;
      for (int other = 0; other < 3; ++other) {
        cut[other] = a[other] + (b[other] - a[other]) * share;
      }
      cut[axis] = position;
      parts[0].grow(cut);
      parts[1].grow(cut);
    }
  }
  const Aabb whole{{primitive->lower_x, primitive->lower_y, primitive->lower_z},
                   {primitive->upper_x, primitive->upper_y, primitive->upper_z}};
  *left = rtc_bounds(intersection(parts[0], whole));
  *right = rtc_bounds(intersection(parts[1], whole));
}

std::uint32_t flatten(const RawNode* raw, TrialTree& tree) {
  const auto index = static_cast<std::uint32_t>(tree.nodes.size());
  tree.nodes.emplace_back();
  BinaryNode node;
  if (raw->count > 0) {
    node = {raw->box, static_cast<std::uint32_t>(tree.references.size()), 0, raw->count};
    tree.references.insert(tree.references.end(), raw->triangles, raw->triangles + raw->count);
  } else {
    node.left = flatten(raw->children[0], tree);
    node.right = flatten(raw->children[1], tree);
    node.box.grow(tree.nodes[node.left].box);
    node.box.grow(tree.nodes[node.right].box);
  }
  tree.nodes[index] = node;
  return index;
}

// Where nodes hang, and the search for better places.
class Reinserter {
 public:
  explicit Reinserter(std::vector<BinaryNode>& nodes) : nodes_(nodes), parent_(nodes.size()) {
    for (std::uint32_t i = 0; i < nodes_.size(); ++i) {
      if (nodes_[i].count == 0) {
        parent_[nodes_[i].left] = parent_[nodes_[i].right] = i;
      }
    }
  }

  void pass() {
    std::vector<std::uint32_t> order(nodes_.size());
    std::iota(order.begin(), order.end(), 0U);
    std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
      const double area_a = area(a), area_b = area(b);
      return area_a != area_b ? area_a > area_b : a < b;
    });
    for (const std::uint32_t node : order) {
      if (node != 0 && parent_[node] != 0) {
        reinsert(node);
      }
    }
  }

 private:
  struct Place {
    double gain = 0;
    std::uint32_t beside = 0;  // 0: where it is
  };

  [[nodiscard]] double area(std::uint32_t node) const { return nodes_[node].box.half_area(); }
  [[nodiscard]] std::uint32_t sibling(std::uint32_t node) const {
    const BinaryNode& parent = nodes_[parent_[node]];
    return parent.left == node ? parent.right : parent.left;
  }
  [[nodiscard]] static Aabb together(const Aabb& a, const Aabb& b) {
    Aabb box = a;
    box.grow(b);
    return box;
  }

  // Goes up from the node; at each level looks below the sibling. `saved` is the area that ancestors lose without it.
  [[nodiscard]] Place best_place(std::uint32_t node) {
    const Aabb& box = nodes_[node].box;
    const double own = area(node);
    Place best;
    double saved = area(parent_[node]);
    std::uint32_t from = node;
    Aabb left_behind;
    for (;;) {
      const std::uint32_t other = sibling(from);
      search_.assign(1, {saved, other});
      while (!search_.empty()) {
        const auto [gain, at] = search_.back();
        search_.pop_back();
        if (gain - own <= best.gain) {
          continue;
        }
        const double with = together(nodes_[at].box, box).half_area();
        if (gain - with > best.gain) {  // beside its sibling, where it is now, it gains nothing
          best = {gain - with, at};
        }
        if (nodes_[at].count == 0) {
          const double below = gain - with + area(at);
          search_.push_back({below, nodes_[at].left});
          search_.push_back({below, nodes_[at].right});
        }
      }
      left_behind.grow(nodes_[other].box);
      const std::uint32_t up = parent_[from];
      if (from != node) {
        saved += area(up) - left_behind.half_area();
      }
      if (up == 0) {
        return best;
      }
      from = up;
    }
  }

  void reinsert(std::uint32_t node) {
    const std::uint32_t beside = best_place(node).beside;
    if (beside == 0 || beside == parent_[node]) {
      return;
    }
    // The parent goes along: its other child takes its place, and it becomes the parent of both.
    const std::uint32_t parent = parent_[node], stays = sibling(node), above = parent_[parent];
    replace(above, parent, stays);
    refit(above);
    replace(parent_[beside], beside, parent);
    nodes_[parent].left = beside;
    nodes_[parent].right = node;
    parent_[beside] = parent_[node] = parent;
    refit(parent);
  }

  void replace(std::uint32_t parent, std::uint32_t child, std::uint32_t by) {
    (nodes_[parent].left == child ? nodes_[parent].left : nodes_[parent].right) = by;
    parent_[by] = parent;
  }

  void refit(std::uint32_t node) {
    for (;; node = parent_[node]) {
      nodes_[node].box = together(nodes_[nodes_[node].left].box, nodes_[nodes_[node].right].box);
      if (node == 0) {
        return;
      }
    }
  }

  std::vector<BinaryNode>& nodes_;
  std::vector<std::uint32_t> parent_;
  std::vector<std::pair<double, std::uint32_t>> search_;
};

}  // namespace

Result<TrialTree> build_trial_tree(const storage::EmbreeDevice& device, std::span<const Triangle> triangles,
                                   const TreeChoice& choice) {
  const bool splits = choice.quality == Quality::high;
  std::vector<RTCBuildPrimitive> primitives(
      static_cast<std::size_t>(static_cast<double>(triangles.size()) * (splits ? 1 + kMostSplits : 1)));
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    const Aabb box = bounds(triangles[i]);
    primitives[i] = {box.lower.x, box.lower.y, box.lower.z, 0,
                     box.upper.x, box.upper.y, box.upper.z, static_cast<unsigned>(i)};
  }
  RTCBVH bvh = rtcNewBVH(device.get());
  RTCBuildArguments arguments = rtcDefaultBuildArguments();
  arguments.buildQuality = choice.quality == Quality::low      ? RTC_BUILD_QUALITY_LOW
                           : choice.quality == Quality::medium ? RTC_BUILD_QUALITY_MEDIUM
                                                               : RTC_BUILD_QUALITY_HIGH;
  arguments.maxBranchingFactor = 2;
  arguments.maxDepth = 256;
  arguments.sahBlockSize = choice.block;
  arguments.minLeafSize = 1;
  arguments.maxLeafSize = choice.leaf;
  arguments.traversalCost = 1;
  arguments.intersectionCost = 1;
  arguments.bvh = bvh;
  arguments.primitives = primitives.data();
  arguments.primitiveCount = triangles.size();
  arguments.primitiveArrayCapacity = primitives.size();
  arguments.createNode = create_node;
  arguments.setNodeChildren = set_children;
  arguments.setNodeBounds = set_bounds;
  arguments.createLeaf = create_leaf;
  arguments.splitPrimitive = splits ? split : nullptr;
  arguments.userPtr = const_cast<Triangle*>(triangles.data());
  void* root = nullptr;
  tbb::task_arena(1).execute([&] { root = rtcBuildBVH(&arguments); });
  TrialTree tree;
  if (root != nullptr) {
    flatten(static_cast<const RawNode*>(root), tree);
  }
  rtcReleaseBVH(bvh);
  if (root == nullptr) {
    return {ErrorCode::internal,
            "Embree could not build the tree (error " + std::to_string(rtcGetDeviceError(device.get())) + ")"};
  }
  improve(tree, choice.reinsertions);
  return tree;
}

void improve(TrialTree& tree, unsigned passes) {
  Reinserter reinserter(tree.nodes);
  for (unsigned i = 0; i < passes; ++i) {
    reinserter.pass();
  }
}

std::vector<TrialNode> make_wide(const TrialTree& tree, unsigned width) {
  struct Pending {
    std::uint32_t binary, parent;
    unsigned slot;
  };
  std::vector<TrialNode> nodes;
  std::vector<Pending> stack{{0, 0, 0}};
  while (!stack.empty()) {
    const Pending pending = stack.back();
    stack.pop_back();
    const auto index = static_cast<std::uint32_t>(nodes.size());
    nodes.emplace_back();
    if (index > 0) {
      nodes[pending.parent].child[pending.slot] = index;
    }
    std::vector<std::uint32_t> pieces{pending.binary};
    const auto area = [&](std::uint32_t piece) {
      return tree.nodes[piece].count == 0 ? tree.nodes[piece].box.half_area() : -1;
    };
    while (pieces.size() < width) {
      const auto largest = std::max_element(pieces.begin(), pieces.end(),
                                            [&](std::uint32_t a, std::uint32_t b) { return area(a) < area(b); });
      const BinaryNode& node = tree.nodes[*largest];
      if (node.count > 0) {
        break;
      }
      *largest = node.left;
      pieces.insert(largest + 1, node.right);
    }
    TrialNode& node = nodes[index];
    node.children = static_cast<unsigned>(pieces.size());
    for (unsigned slot = node.children; slot-- > 0;) {
      const BinaryNode& piece = tree.nodes[pieces[slot]];
      node.boxes[slot] = piece.box;
      node.count[slot] = piece.count;
      if (piece.count > 0) {
        node.child[slot] = piece.left;
      } else {
        stack.push_back({pieces[slot], index, slot});
      }
    }
  }
  return nodes;
}

double sah_cost(std::span<const TrialNode> nodes, const Aabb& root) {
  double cost = root.half_area();
  for (const TrialNode& node : nodes) {
    for (unsigned slot = 0; slot < node.children; ++slot) {
      cost += node.boxes[slot].half_area() * (node.count[slot] > 0 ? node.count[slot] : 1);
    }
  }
  return cost / root.half_area();
}

}  // namespace raymill::bench
