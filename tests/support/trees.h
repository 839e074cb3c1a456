// A scene's tree, page plan and page images, without a file between them.
#pragma once

#include <vector>

#include "storage/base/aligned.h"
#include "storage/build/page_plan.h"
#include "storage/build/wide_tree.h"
#include "storage/pages/page_image.h"
#include "tests/support/scenes.h"

namespace raymill::tests {

storage::WideTree build_tree(const Scene& scene, unsigned width);

struct Pages {
  storage::WideTree tree;
  storage::PagePlan plan;
  std::vector<storage::PageBuffer> images;
  storage::PageRules rules;
};
Pages build_pages(const Scene& scene, unsigned width, std::uint32_t page_bytes = 16 << 10);
/// The scene's positions on a lattice of 2^step_exponent.
Scene snapped(const Scene& scene, int step_exponent);

}  // namespace raymill::tests
