// FutureDemand: where waiting rays go next, counted for each page. Eviction looks at it.
//
//   ray parks       its pending children's pages: +1     the children by the bitstack, their pages by the references of
//   ray is taken up the same pages:               -1     the ancestors (nodes or ghosts) in the page where the ray is
//
// A ray that left page A for page B waits at B, which is not there: its pending children are found in A when it parks,
// and in B when it is taken up. Both hold every ancestor of the node where it waits, with references to the same pages
// (storage/FORMAT.md, "Escape table"), so what was added is taken away again without anything being kept for the ray.
//
// Counted are one ray in kSampling, by its number: the counts steer nothing but the choice of a victim. Boxes beyond
// the hit so far are counted too. A ray in an object, or on its way out of one, is not: where it waits no page says
// what is pending above the instance. Nor is one that waits for a texel. Thread-safe: counts are atomic and lag by the
// batches under way.
#pragma once

#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "storage/pages/page_image.h"
#include "traversal/ray_state.h"

namespace raymill::traversal {

/// Whether the child's box begins beyond the ray's nearest hit: then the ray will not go there. The entry of slab.h.
template <int N>
bool beyond_hit(const storage::Node<N>& node, unsigned slot, const RayState& ray) {
  float entry = ray.tnear;
  for (int axis = 0; axis < 3; ++axis) {
    const float scale = std::bit_cast<float>(static_cast<std::uint32_t>(node.exponent[axis] + 127) << 23);
    const auto& near_q = std::signbit(ray.dir[axis]) ? node.upper[axis] : node.lower[axis];
    const float near =
        (storage::decode_plane(node.base[axis], scale, near_q[slot]) - ray.org[axis]) * (1 / ray.dir[axis]);
    entry = near > entry ? near : entry;  // NaN: no constraint
  }
  return entry > ray.tfar;
}

/// Calls visit(page) for the page of each child that is pending in the ray's bitstack, at the levels above and at
/// `node` of the image of `page`, from the deepest up, and that may lie before the hit so far. A page that several
/// neighbouring children stand in is named once for them.
template <int N, typename Visit>
void for_each_pending_page(const std::byte* image, std::uint32_t page, std::uint32_t node, const RayState& ray,
                           Visit&& visit) {
  constexpr unsigned kLevelsPerWord = 64 / N;
  const storage::PageView view(image);
  const storage::Node<N>* nodes = view.nodes<N>();
  const storage::ExternalRef* externals = view.externals();
  std::uint32_t last = index_of(storage::kNoPage);
  for (std::uint32_t at = node; at != storage::kNoParent; at = nodes[at].parent) {
    const storage::Node<N>& n = nodes[at];
    const std::uint64_t word = ray.stack.words[n.level / kLevelsPerWord];
    const auto mask = static_cast<unsigned>(word >> (n.level % kLevelsPerWord * N)) & n.valid;
    for (unsigned pending = mask; pending != 0; pending &= pending - 1) {
      const auto slot = static_cast<unsigned>(std::countr_zero(pending));
      if (ray.has_hit && beyond_hit(n, slot, ray)) {
        continue;
      }
      const bool elsewhere =
          (n.external >> slot & 1) != 0 && externals[n.child[slot]].kind != storage::ExternalKind::instance;
      const std::uint32_t there = elsewhere ? externals[n.child[slot]].page : page;
      if (there != last) {
        visit(there);
        last = there;
      }
    }
  }
}

class FutureDemand {
 public:
  using Count = std::atomic<std::int32_t>;
  static constexpr std::uint32_t kSampling = 16;
  static bool sampled(const RayState& ray) {
    return ray.number % kSampling == 0 && !ray.object.inside && !ray.left_object && !ray.texel.active();
  }

  /// One job's part of the counts; what is left of it when the job goes is taken away.
  class Share;

  FutureDemand(std::uint32_t page_count, unsigned width);
  /// Of the counts of all jobs and of so many shares.
  static std::uint64_t bytes(std::uint32_t page_count, unsigned shares) {
    return std::uint64_t(page_count) * sizeof(Count) * (1 + shares);
  }

  /// [page_count]: sampled rays that come to each page.
  [[nodiscard]] std::span<const Count> counts() const { return {counts_.get(), page_count_}; }

 private:
  const std::uint32_t page_count_;
  const unsigned width_;
  std::unique_ptr<Count[]> counts_;
};

class FutureDemand::Share {
 public:
  explicit Share(std::shared_ptr<FutureDemand> all);
  ~Share();
  Share(const Share&) = delete;
  Share& operator=(const Share&) = delete;

  /// Before the kernel: the rays, which stand in the page of `image`, wait no more.
  void taken_up(std::span<const RayState> rays, const std::byte* image);
  /// After it, while the kernel's pages stay: each ray, taken up in the page of `image`, waits again or is done.
  void put_back(std::span<const RayState> rays, std::uint32_t page, const std::byte* image);

 private:
  void count(const RayState& ray, const LeftNode& from, std::int32_t step);
  void add(std::uint32_t page, std::int32_t step);

  const std::shared_ptr<FutureDemand> all_;
  std::unique_ptr<Count[]> counts_;
};

}  // namespace raymill::traversal
