// validate_image: a page of ours passes; a page with one field changed passes only where traversal can live with it.
#include "storage/pages/page_image.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "storage/pages/page_assembler.h"
#include "tests/support/kernel_harness.h"
#include "tests/support/rays.h"
#include "tests/support/trees.h"

namespace raymill::storage {
namespace {

using tests::Pages;
using tests::Random;
using tests::Scene;

Scene three_geometries() {
  Random random(1);
  return {tests::soup(random, 900), tests::grid(12, 0.1F), tests::soup(random, 700)};
}

TEST(PageImage, AssembledPagesAreValidAndTheirBoxesHold) {
  for (const unsigned width : {4u, 8u}) {
    const Pages pages = tests::build_pages(three_geometries(), width);
    ASSERT_GT(pages.images.size(), 3u);
    for (const PageBuffer& image : pages.images) {
      EXPECT_TRUE(validate_image(image, pages.rules).ok());
      EXPECT_TRUE(check_boxes(image.data()).ok());
    }
  }
}

TEST(PageImage, LayoutIsAlignedAndEndsWhereItSays) {
  const Pages pages = tests::build_pages(three_geometries(), 8);
  for (const PageBuffer& image : pages.images) {
    const PageHeader& header = PageView(image.data()).header();
    EXPECT_EQ(header.image_bytes, image.size());
    for (const std::uint32_t offset :
         {header.nodes_offset, header.externals_offset, header.vertices_offset, header.indices_offset,
          header.primitive_ids_offset, header.geometries_offset, header.geometry_indices_offset}) {
      EXPECT_EQ(offset % kPageAlignment, 0u);
      EXPECT_LE(offset, image.size());
    }
  }
}

TEST(PageImage, ZerosAndShortImagesAreRefused) {
  const Pages pages = tests::build_pages(three_geometries(), 8);
  const PageBuffer zeros(4096);
  EXPECT_EQ(validate_image(zeros, pages.rules).code(), ErrorCode::corrupt);
  EXPECT_EQ(validate_image({}, pages.rules).code(), ErrorCode::corrupt);
  const PageBuffer& image = pages.images[0];
  for (const std::size_t size : {std::size_t{1}, sizeof(PageHeader) - 1, sizeof(PageHeader), image.size() - 32}) {
    const PageBuffer cut(image.begin(), image.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_EQ(validate_image(cut, pages.rules).code(), ErrorCode::corrupt) << size;
  }
}

// Expects that the first page, changed by `change`, is refused with a message that holds `word`.
template <typename Change>
void expect_refused(const Pages& pages, std::size_t page, const char* word, Change&& change) {
  PageBuffer image = pages.images[page];
  auto& header = *reinterpret_cast<PageHeader*>(image.data());
  auto* nodes = reinterpret_cast<Node<8>*>(image.data() + header.nodes_offset);
  change(image, header, nodes);
  const Status status = validate_image(image, pages.rules);
  EXPECT_EQ(status.code(), ErrorCode::corrupt) << word;
  EXPECT_NE(status.message().find(word), std::string::npos) << status.message();
}

template <typename T>
T& at(PageBuffer& image, std::uint32_t offset) {
  return *reinterpret_cast<T*>(image.data() + offset);
}

TEST(PageImage, EachRuleHasItsRefusal) {
  const Pages pages = tests::build_pages(three_geometries(), 8);
  const std::size_t last = pages.images.size() - 1;  // a page with ghosts
  ASSERT_GT(PageView(pages.images[last].data()).header().ghost_count, 0);
  using Image = PageBuffer&;
  using Header = PageHeader&;
  using Nodes = Node<8>*;
  expect_refused(pages, 0, "known type", [](Image, Header h, Nodes) { h.magic ^= 1; });
  expect_refused(pages, 0, "known type", [](Image, Header h, Nodes) { h.page_type = 0; });
  expect_refused(pages, 0, "layout", [](Image, Header h, Nodes) { h.width = 4; });
  expect_refused(pages, 0, "layout", [](Image, Header h, Nodes) { h.geometry_index_bytes = 3; });
  expect_refused(pages, 0, "counts", [](Image, Header h, Nodes) { h.node_count = 0; });
  expect_refused(pages, 0, "counts", [](Image, Header h, Nodes) { ++h.triangle_count; });
  expect_refused(pages, 0, "counts", [](Image, Header h, Nodes) { h.vertices_offset += 32; });
  expect_refused(pages, 0, "counts", [](Image, Header h, Nodes) { h.image_bytes -= 32; });
  expect_refused(pages, last, "deeper", [](Image, Header, Nodes n) { n[0].level = 100; });
  expect_refused(pages, last, "parent", [](Image, Header, Nodes n) { n[0].parent = kNoParent; });
  expect_refused(pages, last, "parent", [](Image, Header, Nodes n) { n[0].parent = 60000; });
  expect_refused(pages, last, "parent", [](Image, Header, Nodes n) { n[0].parent = 0; });
  expect_refused(pages, last, "masks", [](Image, Header, Nodes n) { n[0].leaf = n[0].external = n[0].valid = 1; });
  expect_refused(pages, last, "masks", [](Image, Header h, Nodes n) { n[h.node_count].external = 0; });
  expect_refused(pages, last, "finite", [](Image, Header, Nodes n) { n[0].base[1] = std::nanf(""); });
  expect_refused(pages, last, "finite", [](Image, Header, Nodes n) { n[0].exponent[2] = -127; });
  expect_refused(pages, 0, "not there", [&](Image i, Header h, Nodes) {
    at<ExternalRef>(i, h.externals_offset).page = pages.rules.page_count;
  });
  expect_refused(pages, 0, "not there",
                 [](Image i, Header h, Nodes) { at<ExternalRef>(i, h.externals_offset).slot = 8; });
  expect_refused(pages, 0, "not there", [](Image i, Header h, Nodes) {
    at<ExternalRef>(i, h.externals_offset).kind = static_cast<ExternalKind>(2);
  });
  expect_refused(pages, last, "vertex", [](Image i, Header h, Nodes) {
    at<Vec3f>(i, h.vertices_offset).y = std::numeric_limits<float>::infinity();
  });
  expect_refused(pages, last, "corner", [](Image i, Header h, Nodes) {
    at<std::uint16_t>(i, h.indices_offset) = static_cast<std::uint16_t>(h.vertex_count);
  });
  expect_refused(pages, last, "geometry",
                 [](Image i, Header h, Nodes) { at<std::uint32_t>(i, h.geometries_offset) = 3; });
  expect_refused(pages, last, "leaf", [](Image, Header h, Nodes n) {
    for (std::uint32_t k = 0; k < h.node_count; ++k) {
      for (unsigned slot = 0; slot < 8; ++slot) {
        if ((n[k].leaf >> slot & 1) != 0) {
          n[k].count[slot] = 9;
        }
      }
    }
  });
}

// A local node that names a leaf of another page: two such references could send a ray round for ever.
TEST(PageImage, LeafReferenceOfALocalNodeIsRefused) {
  const Pages pages = tests::build_pages(three_geometries(), 8);
  PageBuffer image = pages.images[0];
  const PageHeader& header = PageView(image.data()).header();
  const auto* nodes = PageView(image.data()).nodes<8>();
  bool changed = false;
  for (std::uint32_t i = 0; i < header.node_count && !changed; ++i) {
    for (unsigned slot = 0; slot < 8 && !changed; ++slot) {
      if ((nodes[i].external >> slot & 1) != 0) {
        auto* refs = reinterpret_cast<ExternalRef*>(image.data() + header.externals_offset);
        refs[nodes[i].child[slot]] = {0, static_cast<std::uint16_t>(i), static_cast<std::uint8_t>(slot),
                                      ExternalKind::leaf};
        changed = true;
      }
    }
  }
  ASSERT_TRUE(changed);
  EXPECT_EQ(validate_image(image, pages.rules).code(), ErrorCode::corrupt);
}

// Every bit of every page flipped in turn: what is accepted must be harmless to a ray.
TEST(PageImage, FlippedBitsAreRefusedOrHarmless) {
  Random random(7);
  const Pages pages = tests::build_pages({tests::soup(random, 300), tests::soup(random, 200)}, 8);
  const std::vector<Ray> rays = tests::random_rays(random, pages.tree.bounds, 6);
  std::size_t accepted = 0, refused = 0;
  for (std::size_t page = 0; page < pages.images.size(); ++page) {
    tests::LoadedPages loaded = tests::load_pages(pages);
    for (std::size_t i = 0; i < pages.images[page].size(); i += 3) {
      const auto bit = static_cast<std::byte>(1U << random.below(8));
      loaded.images[page][i] ^= bit;
      if (validate_image(loaded.images[page], pages.rules).ok()) {
        ++accepted;
        (void)tests::run_kernel(loaded, rays, {.residency = tests::Residency::one_page});
      } else {
        ++refused;
      }
      loaded.images[page][i] ^= bit;
    }
  }
  EXPECT_GT(accepted, 0u);
  EXPECT_GT(refused, 0u);
}

TEST(PageImage, BoxThatDoesNotHoldItsTrianglesIsFound) {
  const Pages pages = tests::build_pages({tests::grid(3, 0.5F)}, 8);
  PageBuffer image = pages.images[0];
  auto* nodes = reinterpret_cast<Node<8>*>(image.data() + PageView(image.data()).header().nodes_offset);
  for (unsigned slot = 0; slot < 8; ++slot) {
    nodes[0].upper[0][slot] = nodes[0].lower[0][slot];
  }
  EXPECT_TRUE(validate_image(image, pages.rules).ok());
  EXPECT_EQ(check_boxes(image.data()).code(), ErrorCode::corrupt);
}

}  // namespace
}  // namespace raymill::storage
