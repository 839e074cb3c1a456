// PagePlan: which nodes of the MBVH share a page.
//
//             root                 top part: nodes whose subtree is larger than a treelet,
//           /  |   \               cut greedily by surface area into pages of their own
//         [top part]
//        /    |     \              treelets: maximal subtrees up to kTreeletsPerPage-th of a page, packed depth first,
//     (T T T)(T T T)(T T)          so neighbours share a page and pages are full; a node of the top part whose
//      page 1 page 2 page 3        children all came into one page moves there too
//
// A page also carries copies (ghosts) of its treelets' ancestors: the escape table. Their size is counted here.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "storage/base/status.h"
#include "storage/build/wide_tree.h"

namespace raymill::storage {

/// Decoded bytes of each thing that a page holds; given by the page format.
struct PageCost {
  std::uint32_t page_bytes = 0;      ///< limit
  std::uint32_t header_bytes = 0;    ///< fixed part: alignment of all arrays, and ghosts of the nodes above the tree
  std::uint32_t node_bytes = 0;      ///< a node or a ghost
  std::uint32_t external_bytes = 0;  ///< a reference to a node of another page
  std::uint32_t triangle_bytes = 0;  ///< without its vertices
  std::uint32_t vertex_bytes = 0;    ///< a distinct position
  std::uint32_t geometry_bytes = 0;  ///< a distinct geometry id
  std::uint32_t mask_bytes = 0;      ///< a triangle's entry in the section of masks
  /// [triangle]: whether it has an entry of its own (TreeMasks::entry_of); empty: none has.
  std::span<const std::uint32_t> mask_entries = {};
};

constexpr std::uint32_t kTreeletsPerPage = 8;

struct PagePlan {
  /// Node indices; nodes of one page in depth-first order. The tree's root is the first node of page 0.
  std::vector<std::vector<std::uint32_t>> pages;
  std::vector<std::uint32_t> page_of;  ///< for each node
  /// [3 * triangle]: numbers of the corners' positions; in one page equal numbers mean equal positions.
  std::vector<std::uint16_t> corners;
};

/// Errors: invalid_argument when the page limit cannot hold a single node with its leaves and escape table.
Result<PagePlan> plan_pages(const WideTree& tree, const PageCost& cost);

}  // namespace raymill::storage
