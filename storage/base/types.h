// Ids and limits that the folders of storage share. Immutable values.
#pragma once

#include <cstdint>

namespace raymill::storage {

/// Position of a page in the page directory.
enum class PageId : std::uint32_t {};
constexpr PageId kNoPage{0xFFFFFFFFu};
constexpr std::uint32_t index_of(PageId page) { return static_cast<std::uint32_t>(page); }

/// Children of a node: 4 or 8. Leaves hold at most kMaxLeafTriangles, so one SIMD step of eight lanes tests a leaf.
constexpr unsigned kMaxWidth = 8;
constexpr unsigned kMaxLeafTriangles = 8;

/// Traversal keeps one bit for each child of each level: width x levels must fit the bitstack.
constexpr unsigned kBitstackBits = 128;
constexpr unsigned max_levels(unsigned width) { return kBitstackBits / width; }
static_assert(max_levels(8) == 16 && max_levels(4) == 32);

/// Limits of a page's decoded size. Indices inside a page have 16 bits: 1 MiB at the least 17 bytes a triangle (three
/// 16-bit indices, a primitive id, and at least half a vertex) stays below 65 536 triangles.
constexpr std::uint32_t kMinPageBytes = 16u << 10;
constexpr std::uint32_t kMaxPageBytes = 1u << 20;

}  // namespace raymill::storage
