// ExpandedTree: a store laid out for speed: one array of nodes, one of leaf blocks, no page borders.
//
// The compact layout (decoded pages) reaches a triangle through a reference, a page's header, indices and vertices,
// each a wait of its own, so that pages can come and go. Where a whole scene stays in memory that buys nothing: here a
// child is an index, and a leaf's corners stand side by side as the triangle tests load them.
//
//   node    boxes as in the page, bit for bit; a child is a node's index, or a block's first word and its triangles
//   block   of n triangles: 9 rows of n floats (x y z of corner 0, of 1, of 2), n primitive ids, n geometry ids
//
// About 52 bytes a triangle beside 24 of decoded pages (speed.md). The answers are the same bits: a triangle's test
// reads the same numbers, and no answer depends on the order of tests (kernel-inl.h).
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/base/mapped_memory.h"
#include "storage/io/store_file.h"
#include "storage/pages/page_image.h"

namespace raymill::traversal {

/// planes[axis][0] are the lower planes of the children's boxes, planes[axis][1] the upper ones, as decoded. Those of a
/// slot without a child are NaN, which no ray meets.
template <int N>
struct alignas(64) ExpandedNode {
  std::array<std::array<std::array<float, N>, 2>, 3> planes;
  std::array<std::uint32_t, N> child;  ///< a node's index; a leaf's: the first word of its block
  std::array<std::uint8_t, N> count;   ///< triangles of a leaf; 0: a node
  std::uint8_t valid;
  std::uint8_t leaves;  ///< of the valid ones
  std::uint8_t order;
  std::uint8_t level;
};
static_assert(sizeof(ExpandedNode<8>) == 256 && sizeof(ExpandedNode<4>) == 128);

/// Floats of a triangle in a block, its ids included.
constexpr std::uint32_t kBlockWords = 11;
constexpr std::uint32_t kCornerRows = 9;

class ExpandedTree {
 public:
  /// What a kernel reads.
  struct View {
    const void* nodes = nullptr;  ///< ExpandedNode<width>
    const float* blocks = nullptr;
    std::uint32_t root = 0;
    float coherent_width = 0;  ///< of origins of a packet's rays: a 32nd of the scene's longest side
  };
  /// Whether a store can be laid out so: nodes and words of blocks have 32-bit indices.
  static bool possible(const storage::StoreFile& store);
  /// What it claims, its making apart.
  static std::uint64_t bytes(const storage::StoreFile& store);

  [[nodiscard]] const View& view() const { return view_; }

 private:
  friend class TreeExpander;
  ExpandedTree() = default;
  storage::BudgetReservation claim_;
  storage::MappedMemory memory_;
  View view_;
};

/// Lays a store out anew from its decoded pages, in any order. Thread-safe but for finish().
class TreeExpander {
 public:
  /// Of the tables that are gone with it: at most.
  static std::uint64_t bytes(const storage::StoreFile& store);
  /// `store` must outlive it. Errors: budget_exceeded.
  static Result<std::unique_ptr<TreeExpander>> create(const storage::StoreFile& store, storage::Ledger& ledger);

  /// A page that was decoded and validated; each page once. Errors: corrupt (more nodes or triangles than the footer
  /// says).
  Status add(storage::PageId page, const std::byte* image);
  /// After all pages. Errors: corrupt (references do not fit each other).
  Result<std::unique_ptr<ExpandedTree>> finish();

 private:
  struct Patch {
    std::uint32_t node;
    std::uint32_t slot;
    storage::ExternalRef ref;
  };
  struct PageNodes {
    std::uint32_t first = 0;
    std::uint32_t count = 0;
  };

  explicit TreeExpander(const storage::StoreFile& store) : store_(store) {}
  template <int N>
  Status add_nodes(storage::PageId page, storage::PageView view);
  template <int N>
  Status resolve();
  [[nodiscard]] Status corrupt() const;
  template <int N>
  [[nodiscard]] ExpandedNode<N>* nodes() const {
    return reinterpret_cast<ExpandedNode<N>*>(tree_->memory_.data());
  }
  [[nodiscard]] float* blocks() const { return const_cast<float*>(tree_->view_.blocks); }

  const storage::StoreFile& store_;
  storage::BudgetReservation claim_;
  std::unique_ptr<ExpandedTree> tree_;
  std::atomic<std::uint64_t> nodes_used_ = 0, words_used_ = 0;
  std::vector<PageNodes> page_nodes_;
  std::mutex mutex_;  // of:
  std::vector<Patch> patches_;
};

}  // namespace raymill::traversal
