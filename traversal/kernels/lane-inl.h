// A ray at work, compiled once per ISA: what the record of a waiting ray lacks and speed needs.
//
// The bitstack of a waiting ray (ray_state.h) is kept here as one mask for each level and one word of levels with a
// mask left. Beside each mask stand the node that it belongs to and the entry distances of its children, so that a pop
// is two look-ups and climbs no parent links, and a child that a hit has put out of reach is dropped before its memory
// is touched. None of that is part of the ray's state: for levels above the node where a waiting ray was taken up it is
// made again, by the parent links and the box test, when a pop first comes to them.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

#include "storage/pages/page_image.h"
#include "traversal/kernels/triangle-inl.h"
#include "traversal/ray_state.h"

namespace raymill::traversal::RAYMILL_ISA {

using storage::ExternalRef;
using storage::Node;
using storage::PageHeader;

/// A node, and what a ray needs of its page: offsets in the image.
template <int N>
struct alignas(32) Place {
  const Node<N>* node;
  const std::byte* image;
  std::uint32_t page;
  std::uint32_t externals, vertices, indices;

  [[nodiscard]] const Node<N>* node_at(std::uint32_t index) const {
    return reinterpret_cast<const Node<N>*>(image + storage::kNodesOffset) + index;
  }
  template <typename T>
  [[nodiscard]] const T* at(std::uint32_t offset) const {
    return reinterpret_cast<const T*>(image + offset);
  }
};

template <int N>
struct alignas(64) Lane {
  static constexpr unsigned kLevels = storage::kBitstackBits / N;

  RayFrame frame;
  float tnear, tfar;
  RayState* ray;
  // The step that is next: at `level`, in the child `slot` of its node where the step is a leaf or a reference.
  unsigned level;
  unsigned slot;
  unsigned top;          // levels above (less than) it have masks but no places yet
  unsigned floor;        // level of the root of the object that the ray is in; 0: it is in the world
  unsigned world_top;    // of the levels above the floor, what top is of the others
  std::uint32_t levels;  // bit for each level with a mask left
  ExternalRef ref;       // while it is followed
  LeafBlock leaf;        // while it is tested
  unsigned candidates;   // of its triangles
  Quotients quotients;   // of them, in mode fast
  // The best hit where its ids have not been looked up, else null.
  const std::byte* hit_image;
  std::uint32_t hit_triangle;
  std::uint32_t hit_base;  // of its geometry id
  std::array<std::uint8_t, kLevels> masks;
  // One past the deepest, for it is written before it is known whether the child is a node.
  std::array<Place<N>, kLevels + 1> places;
  std::array<std::array<float, N>, kLevels> entries;

  void set_mask(unsigned at, unsigned mask) {
    masks[at] = static_cast<std::uint8_t>(mask);
    levels |= static_cast<std::uint32_t>(mask != 0) << at;
  }

  /// `object_level`: of the store.
  void unpack(RayState& from, unsigned object_level) {
    ray = &from;
    frame = make_frame(from.org, from.dir);
    tnear = from.tnear;
    tfar = from.tfar;
    level = from.level;
    top = from.level;
    floor = from.object.inside ? object_level : 0;
    world_top = kLevels;
    levels = 0;
    hit_image = nullptr;
    if ((from.stack.words[0] | from.stack.words[1]) != 0) {
      for (unsigned at = 0; at < kLevels; ++at) {
        set_mask(at, from.stack.words[at / kLevelsPerWord] >> (at % kLevelsPerWord * N) & ((1U << N) - 1));
      }
    }
  }

  /// `resume` at node `node` of page `page` is all that is left to say.
  void pack(Resume resume, std::uint32_t page, std::uint16_t node) {
    ray->tfar = tfar;
    ray->stack = {};
    for (std::uint32_t rest = levels; rest != 0; rest &= rest - 1) {
      const auto at = static_cast<unsigned>(std::countr_zero(rest));
      ray->stack.words[at / kLevelsPerWord] |= std::uint64_t(masks[at]) << (at % kLevelsPerWord * N);
    }
    ray->resume = resume;
    ray->page = page;
    ray->node = node;
    ray->level = static_cast<std::uint8_t>(level);
  }

 private:
  static constexpr unsigned kLevelsPerWord = 64 / N;
};

}  // namespace raymill::traversal::RAYMILL_ISA
