#include "tests/support/trees.h"

#include <gtest/gtest.h>

#include <cmath>

#include "storage/build/binary_tree.h"
#include "storage/build/collapse.h"
#include "storage/pages/page_assembler.h"

namespace raymill::tests {

storage::WideTree build_tree(const Scene& scene, unsigned width) {
  const auto device = storage::EmbreeDevice::create();
  EXPECT_TRUE(device.ok()) << device.status().message();
  std::vector<Triangle> triangles = triangles_of(scene);
  storage::BinaryTree binary;
  const Status status = storage::BinaryTreeBuilder(*device).build(triangles, binary);
  EXPECT_TRUE(status.ok()) << status.message();
  return storage::collapse(binary, std::move(triangles), width, {0, storage::max_levels(width)});
}

Pages build_pages(const Scene& scene, unsigned width, std::uint32_t page_bytes) {
  Pages pages{build_tree(scene, width), {}, {}, {}};
  auto plan = storage::plan_pages(pages.tree, storage::page_cost(width, page_bytes));
  EXPECT_TRUE(plan.ok()) << plan.status().message();
  pages.plan = std::move(*plan);
  const storage::TreePlace place;
  const storage::PageAssembler assembler(pages.tree, pages.plan, place);
  for (std::uint32_t page = 0; page < pages.plan.pages.size(); ++page) {
    auto image = assembler.assemble(page);
    EXPECT_TRUE(image.ok()) << image.status().message();
    pages.images.push_back(std::move(*image));
  }
  pages.rules = {width,       pages.tree.levels, 0, page_bytes, static_cast<std::uint32_t>(pages.images.size()),
                 scene.size()};
  return pages;
}

Scene snapped(const Scene& scene, int step_exponent) {
  Scene result = scene;
  for (Mesh& mesh : result) {
    for (Corners& corners : mesh) {
      for (Vec3f& p : corners) {
        for (int axis = 0; axis < 3; ++axis) {
          p[axis] = static_cast<float>(
              std::ldexp(std::nearbyint(std::ldexp(double(p[axis]), -step_exponent)), step_exponent) + 0.0);
        }
      }
    }
  }
  return result;
}

}  // namespace raymill::tests
