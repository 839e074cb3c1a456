#include "storage/build/binary_tree.h"

#include <embree3/rtcore.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cstring>
#include <new>
#include <span>
#include <string>
#include <utility>

namespace raymill::storage {
namespace {

// What Embree's callbacks allocate: a node with two children, or a leaf that names its triangles.
struct RawNode {
  bool leaf = false;
};
struct RawInner : RawNode {
  RawNode* children[2] = {nullptr, nullptr};
  RTCBounds boxes[2] = {};
};
struct RawLeaf : RawNode {
  std::uint32_t count = 0;
  std::uint32_t triangles[kMaxLeafTriangles] = {};
};

void* create_node(RTCThreadLocalAllocator allocator, unsigned /*child_count*/, void* /*user*/) {
  return new (rtcThreadLocalAlloc(allocator, sizeof(RawInner), 16)) RawInner;
}

void set_children(void* node, void** children, unsigned child_count, void* /*user*/) {
  for (unsigned i = 0; i < child_count; ++i) {
    static_cast<RawInner*>(node)->children[i] = static_cast<RawNode*>(children[i]);
  }
}

void set_bounds(void* node, const RTCBounds** bounds, unsigned child_count, void* /*user*/) {
  for (unsigned i = 0; i < child_count; ++i) {
    static_cast<RawInner*>(node)->boxes[i] = *bounds[i];
  }
}

void* create_leaf(RTCThreadLocalAllocator allocator, const RTCBuildPrimitive* primitives, std::size_t count,
                  void* /*user*/) {
  auto* leaf = new (rtcThreadLocalAlloc(allocator, sizeof(RawLeaf), 16)) RawLeaf;
  leaf->leaf = true;
  leaf->count = static_cast<std::uint32_t>(count);
  for (std::size_t i = 0; i < count; ++i) {
    leaf->triangles[i] = primitives[i].primID;
  }
  std::sort(leaf->triangles, leaf->triangles + count);
  return leaf;
}

// Copies Embree's tree into ours and the triangles into its leaf order, depth first, left before right.
class Flattener {
 public:
  Flattener(std::span<const Triangle> triangles, std::vector<BinaryNode>& nodes, std::vector<Triangle>& sorted)
      : triangles_(triangles), nodes_(nodes), sorted_(sorted) {}

  std::uint32_t flatten(const RawNode* raw) {
    const auto index = static_cast<std::uint32_t>(nodes_.size());
    nodes_.emplace_back();
    if (raw->leaf) {
      const auto* leaf = static_cast<const RawLeaf*>(raw);
      BinaryNode& node = nodes_[index];
      node.left = static_cast<std::uint32_t>(sorted_.size());
      node.count = leaf->count;
      for (std::uint32_t i = 0; i < leaf->count; ++i) {
        sorted_.push_back(triangles_[leaf->triangles[i]]);
        node.box.grow(bounds(sorted_.back()));
      }
      return index;
    }
    const auto* inner = static_cast<const RawInner*>(raw);
    const std::uint32_t left = flatten(inner->children[0]);
    const std::uint32_t right = flatten(inner->children[1]);
    BinaryNode& node = nodes_[index];
    node.left = left;
    node.right = right;
    node.box.grow(nodes_[left].box);
    node.box.grow(nodes_[right].box);
    return index;
  }

 private:
  std::span<const Triangle> triangles_;
  std::vector<BinaryNode>& nodes_;
  std::vector<Triangle>& sorted_;
};

// Embree's MEDIUM builder may use the array's spare capacity; it splits nothing without a callback.
void fill_primitives(std::span<const Triangle> triangles, std::vector<RTCBuildPrimitive>& primitives) {
  primitives.resize(triangles.size());
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    const Aabb box = bounds(triangles[i]);
    primitives[i] = {box.lower.x, box.lower.y, box.lower.z, 0,
                     box.upper.x, box.upper.y, box.upper.z, static_cast<unsigned>(i)};
  }
}

RTCBuildArguments build_arguments(RTCBVH bvh, std::vector<RTCBuildPrimitive>& primitives, unsigned per_leaf) {
  RTCBuildArguments arguments = rtcDefaultBuildArguments();
  arguments.byteSize = sizeof arguments;
  arguments.buildQuality = RTC_BUILD_QUALITY_MEDIUM;
  arguments.maxBranchingFactor = 2;
  // Binary depth; the collapse bounds the wide tree's depth whatever comes out here. Recursion below is as deep.
  arguments.maxDepth = 256;
  arguments.sahBlockSize = std::min(4U, per_leaf);
  arguments.minLeafSize = 1;
  arguments.maxLeafSize = per_leaf;
  arguments.traversalCost = 1;
  arguments.intersectionCost = 1;
  arguments.bvh = bvh;
  arguments.primitives = primitives.data();
  arguments.primitiveCount = primitives.size();
  arguments.primitiveArrayCapacity = primitives.size();
  arguments.createNode = create_node;
  arguments.setNodeChildren = set_children;
  arguments.setNodeBounds = set_bounds;
  arguments.createLeaf = create_leaf;
  return arguments;
}

}  // namespace

Result<EmbreeDevice> EmbreeDevice::create() {
  // No number of threads here: Embree would limit TBB to it for the whole process. Runs are built on one thread each.
  RTCDevice device = rtcNewDevice(nullptr);
  if (device == nullptr) {
    return {ErrorCode::internal, "Embree gave no device (error " + std::to_string(rtcGetDeviceError(nullptr)) + ")"};
  }
  return EmbreeDevice(device);
}

EmbreeDevice::EmbreeDevice(EmbreeDevice&& other) noexcept : device_(std::exchange(other.device_, nullptr)) {}

EmbreeDevice::~EmbreeDevice() {
  if (device_ != nullptr) {
    rtcReleaseDevice(device_);
  }
}

struct BinaryTreeBuilder::Scratch {
  std::vector<RTCBuildPrimitive> primitives;
  std::vector<Triangle> sorted;
};

BinaryTreeBuilder::BinaryTreeBuilder(const EmbreeDevice& device)
    : device_(&device), scratch_(std::make_unique<Scratch>()) {}
BinaryTreeBuilder::BinaryTreeBuilder(BinaryTreeBuilder&&) noexcept = default;
BinaryTreeBuilder::~BinaryTreeBuilder() = default;

Status BinaryTreeBuilder::build(std::vector<Triangle>& triangles, BinaryTree& tree, unsigned per_leaf) {
  fill_primitives(triangles, scratch_->primitives);
  RTCBVH bvh = rtcNewBVH(device_->get());
  const RTCBuildArguments arguments = build_arguments(bvh, scratch_->primitives, per_leaf);
  void* root = nullptr;
  // One thread for a run: Embree's parallel partition may order triangles by the number of threads.
  tbb::task_arena(1).execute([&] { root = rtcBuildBVH(&arguments); });
  if (root == nullptr) {
    const RTCError error = rtcGetDeviceError(device_->get());
    rtcReleaseBVH(bvh);
    return {ErrorCode::internal, "Embree could not build " + std::to_string(triangles.size()) + " triangles (error " +
                                     std::to_string(error) + ")"};
  }
  std::vector<Triangle>& sorted = scratch_->sorted;
  sorted.clear();
  sorted.reserve(triangles.size());
  tree.nodes.clear();
  Flattener(triangles, tree.nodes, sorted).flatten(static_cast<const RawNode*>(root));
  rtcReleaseBVH(bvh);
  triangles.swap(sorted);
  return {};
}

}  // namespace raymill::storage
