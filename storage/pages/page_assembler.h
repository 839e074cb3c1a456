// PageAssembler: makes a page's image from its share of the MBVH.
// Immutable after construction; assemble() is thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "storage/base/aligned.h"
#include "storage/base/status.h"
#include "storage/build/page_plan.h"
#include "storage/build/wide_tree.h"

namespace raymill::storage {

/// What each thing costs in the decoded page, for plan_pages.
PageCost page_cost(unsigned width, std::uint32_t page_bytes);

class PageAssembler {
 public:
  /// Both must outlive the assembler.
  PageAssembler(const WideTree& tree, const PagePlan& plan);

  /// The page's image. Errors: internal, when a quantised box would not hold its triangles.
  [[nodiscard]] Result<PageBuffer> assemble(std::uint32_t page) const;

 private:
  const WideTree& tree_;
  const PagePlan& plan_;
  std::vector<std::uint16_t> local_index_;  // of each node in its page
};

/// Depth-first walk of all pages' boxes: each decoded box holds every triangle below it inside its page. Used by
/// verify(). Errors: corrupt.
Status check_boxes(const std::byte* image);

}  // namespace raymill::storage
