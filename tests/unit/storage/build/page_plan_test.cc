#include "storage/build/page_plan.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "storage/pages/page_assembler.h"
#include "tests/support/trees.h"

namespace raymill::storage {
namespace {

using tests::Random;
using tests::Scene;

void check(const WideTree& tree, const PagePlan& plan, std::uint32_t page_bytes, const std::string& why) {
  ASSERT_EQ(plan.page_of.size(), tree.nodes.size()) << why;
  std::vector<int> placed(tree.nodes.size());
  for (std::uint32_t page = 0; page < plan.pages.size(); ++page) {
    EXPECT_FALSE(plan.pages[page].empty()) << why;
    EXPECT_TRUE(std::is_sorted(plan.pages[page].begin(), plan.pages[page].end()))
        << why << ": parents stand before their children";
    for (const std::uint32_t node : plan.pages[page]) {
      ++placed[node];
      EXPECT_EQ(plan.page_of[node], page) << why;
    }
  }
  EXPECT_TRUE(std::all_of(placed.begin(), placed.end(), [](int n) { return n == 1; })) << why;
  const TreePlace place;
  const PageAssembler assembler(tree, plan, place);
  for (std::uint32_t page = 0; page < plan.pages.size(); ++page) {
    const auto image = assembler.assemble(page);
    ASSERT_TRUE(image) << why << ": " << image.status().message();
    EXPECT_LE(image->size(), page_bytes) << why << ", page " << page;
  }
}

TEST(PagePlan, PlacesEveryNodeOnceWithinTheLimit) {
  Random random(1);
  const std::pair<const char*, Scene> scenes[] = {
      {"one triangle", {tests::grid(1)}},
      {"soup", {tests::soup(random, 6000)}},
      {"many geometries",
       [&] {
         Scene scene;
         for (int i = 0; i < 700; ++i) {
           scene.push_back(tests::soup(random, 8));
         }
         return scene;
       }()},
      {"grid", {tests::grid(70, 0.1F)}},
      {"shells", {tests::nested_shells(10000)}},
      {"coincident", {tests::coincident(9000)}},
  };
  for (const auto& [name, scene] : scenes) {
    for (const unsigned width : {4u, 8u}) {
      const WideTree tree = tests::build_tree(scene, width);
      for (const std::uint32_t page_bytes : {kMinPageBytes, 20000u, 64u << 10, kMaxPageBytes}) {
        const auto plan = plan_pages(tree, page_cost(width, page_bytes));
        ASSERT_TRUE(plan) << plan.status().message();
        check(tree, *plan, page_bytes,
              std::string(name) + ", width " + std::to_string(width) + ", page " + std::to_string(page_bytes));
      }
    }
  }
}

TEST(PagePlan, RootIsTheFirstNodeOfItsPage) {
  Random random(2);
  const WideTree tree = tests::build_tree({tests::soup(random, 6000)}, 8);
  const auto plan = plan_pages(tree, page_cost(8, kMinPageBytes));
  ASSERT_TRUE(plan);
  EXPECT_EQ(plan->pages[plan->page_of[0]].front(), 0u);
}

TEST(PagePlan, PagesAreFull) {
  Random random(3);
  const WideTree tree = tests::build_tree({tests::grid(120, 0.2F)}, 8);
  const auto plan = plan_pages(tree, page_cost(8, 64u << 10));
  ASSERT_TRUE(plan);
  const TreePlace place;
  const PageAssembler assembler(tree, *plan, place);
  std::uint64_t bytes = 0;
  for (std::uint32_t page = 0; page < plan->pages.size(); ++page) {
    bytes += assembler.assemble(page)->size();
  }
  EXPECT_GT(double(bytes), 0.6 * 65536 * double(plan->pages.size()));
}

TEST(PagePlan, PageTooSmallForOneNodeIsRefusedWithAWayOut) {
  Random random(4);
  const WideTree tree = tests::build_tree({tests::soup(random, 3000)}, 8);
  PageCost cost = page_cost(8, 1024);
  const Status status = plan_pages(tree, cost).status();
  EXPECT_EQ(status.code(), ErrorCode::invalid_argument);
  EXPECT_NE(status.message().find("larger page size"), std::string::npos) << status.message();
}

TEST(PagePlan, IsAFunctionOfTheTree) {
  Random random(5);
  const WideTree tree = tests::build_tree({tests::soup(random, 4000)}, 4);
  const auto a = plan_pages(tree, page_cost(4, kMinPageBytes)), b = plan_pages(tree, page_cost(4, kMinPageBytes));
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->pages, b->pages);
}

}  // namespace
}  // namespace raymill::storage
