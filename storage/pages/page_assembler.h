// PageAssembler: makes a page's image from its share of the MBVH.
// Immutable after construction; assemble() is thread-safe.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "storage/base/aligned.h"
#include "storage/base/status.h"
#include "storage/build/mask_spool.h"
#include "storage/build/page_plan.h"
#include "storage/build/wide_tree.h"
#include "storage/pages/masked_section.h"
#include "storage/pages/page_image.h"
#include "storage/pages/proxy_maker.h"

namespace raymill::storage {

/// What each thing costs in the decoded page, for plan_pages. `ancestors`: nodes above the tree, which each page
/// copies. `proxies`: whether the store has them.
PageCost page_cost(unsigned width, std::uint32_t page_bytes, std::uint32_t ancestors = 0, bool proxies = false);
/// The same for a tree over instances, each of which stands in its place as a triangle would.
PageCost instance_page_cost(unsigned width, std::uint32_t page_bytes, std::uint32_t ancestors = 0,
                            bool proxies = false);

/// Adds what masks take to the cost of a page. `masks` must outlive it.
void add_mask_cost(const TreeMasks& masks, PageCost& cost);

/// A node above the tree that is assembled: what its ghosts in the tree's pages are made of.
struct OuterNode {
  WideNode node;
  std::array<ExternalRef, kMaxWidth> children;  ///< for each slot that holds a child
  std::array<Proxy, kMaxWidth> proxies;         ///< for each reference of kind proxied
};

/// The ids that a tree's pages have in the store. The root's page is numbered on its own, so that it can be referred to
/// before the tree is built.
struct PageNumbers {
  std::uint32_t root = 0;
  std::uint32_t others = 1;  ///< of the plan's page 1; the rest follow
  [[nodiscard]] std::uint32_t of(std::uint32_t page) const { return page == 0 ? root : others + page - 1; }
};

/// Where a tree stands in the store.
struct TreePlace {
  std::vector<OuterNode> ancestors;  ///< of the tree's root; the scene's root first
  PageNumbers numbers;
  const std::vector<std::uint32_t>* run_root_pages = nullptr;  ///< [run]: where an outer child's root is node 0
  std::span<const Instance> instances;                         ///< [triangle]: what stands for it; else empty
  const ProxyTable* proxies = nullptr;                         ///< of the tree; null: the store has none
  const TreeMasks* masks = nullptr;                            ///< of its triangles; none: they are opaque
  std::span<const MaskRef> mask_refs = {};                     ///< [mask] of the store
};

class PageAssembler {
 public:
  /// All must outlive the assembler.
  PageAssembler(const WideTree& tree, const PagePlan& plan, const TreePlace& place);

  /// How other pages refer to a node's child.
  [[nodiscard]] ExternalRef reference_to(std::uint32_t node, unsigned slot) const;
  /// What stands for that child, where the reference is proxied.
  [[nodiscard]] Proxy proxy_of(std::uint32_t node, unsigned slot) const;
  /// Vertex in its page of a triangle's corner: vertices are numbered by first use.
  [[nodiscard]] std::uint16_t vertex_of(std::size_t triangle, std::size_t corner) const {
    return vertex_of_corner_[triangle * 3 + corner];
  }
  /// What ghosts of a node are made of.
  [[nodiscard]] OuterNode outer_node(std::uint32_t node) const;

  /// The page's image. Errors: internal, when a quantised box would not hold its triangles.
  [[nodiscard]] Result<PageBuffer> assemble(std::uint32_t page) const;

 private:
  void number_vertices();

  const WideTree& tree_;
  const PagePlan& plan_;
  const TreePlace& place_;
  std::vector<std::uint16_t> local_index_;       // of each node in its page
  std::vector<std::uint16_t> vertex_of_corner_;  // [3 * triangle]
};

/// Depth-first walk of all pages' boxes: each decoded box holds every triangle below it inside its page. Used by
/// verify(). Errors: corrupt.
Status check_boxes(const std::byte* image);

}  // namespace raymill::storage
