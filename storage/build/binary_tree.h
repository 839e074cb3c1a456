// BinaryTree: the SAH BVH of one run, which the collapse makes wide.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "storage/base/status.h"
#include "storage/base/types.h"
#include "storage/base/vec3.h"

struct RTCDeviceTy;

namespace raymill::storage {

struct BinaryNode {
  Aabb box;
  std::uint32_t left = 0;   ///< node index; for a leaf the first triangle
  std::uint32_t right = 0;  ///< node index; unused in a leaf
  std::uint32_t count = 0;  ///< triangles of a leaf, 0 for an inner node
};

struct BinaryTree {
  std::vector<BinaryNode> nodes;  ///< nodes[0] is the root
};

/// Owns an Embree device that reports errors as Status. Thread-safe: builds may run side by side.
class EmbreeDevice {
 public:
  static Result<EmbreeDevice> create();
  EmbreeDevice(EmbreeDevice&& other) noexcept;
  EmbreeDevice& operator=(EmbreeDevice&&) = delete;
  ~EmbreeDevice();
  [[nodiscard]] RTCDeviceTy* get() const { return device_; }

 private:
  explicit EmbreeDevice(RTCDeviceTy* device) : device_(device) {}
  RTCDeviceTy* device_;
};

/// Embree's SAH builder, with memory that the next build uses again. Thread-confined.
class BinaryTreeBuilder {
 public:
  /// `device` must outlive the builder.
  explicit BinaryTreeBuilder(const EmbreeDevice& device);
  BinaryTreeBuilder(BinaryTreeBuilder&&) noexcept;
  ~BinaryTreeBuilder();

  /// Builds `tree` over `triangles`, which are put into leaf order, at most `per_leaf` to a leaf. Equal triangles give
  /// equal trees: the build runs on the calling thread alone. Errors: internal (Embree refused).
  Status build(std::vector<Triangle>& triangles, BinaryTree& tree, unsigned per_leaf = kMaxLeafTriangles);

 private:
  struct Scratch;
  const EmbreeDevice* device_;
  std::unique_ptr<Scratch> scratch_;
};

/// Memory that a builder and its result take at their peak, the triangles excluded.
constexpr std::uint64_t binary_tree_build_bytes(std::uint64_t triangle_count) {
  // Build primitives 32 B, Embree's nodes and scratch about 90 B, the sorted copy; leaves hold three triangles or more
  // on average: two thirds of a node a triangle.
  return triangle_count * (32 + 90 + sizeof(Triangle) + sizeof(BinaryNode) * 2 / 3);
}

}  // namespace raymill::storage
