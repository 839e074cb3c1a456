// Pages with proxies: what validate_image() demands of them, that every codec keeps them, and what an opacity means.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "storage/pages/codec.h"
#include "storage/pages/page_assembler.h"
#include "storage/pages/page_encoder.h"
#include "storage/pages/proxy.h"
#include "tests/support/kernel_harness.h"
#include "tests/support/stores.h"

namespace raymill::storage {
namespace {

struct ProxiedPages {
  explicit ProxiedPages(const tests::Scene& scene) {
    BuildConfig config = tests::small_pages();
    config.proxies = true;
    config.positions = "lattice:0.000244140625";  // 2^-12: what draco needs
    pages = tests::load_pages(tests::build_store(folder, "s.mill", scene, config));
  }
  ProxiedPages() : ProxiedPages({tests::grid(60, 0.1F), tests::sphere({2, 0, 0}, 0.5F, 30, 30)}) {}
  tests::TempFolder folder;
  tests::LoadedPages pages;
};

std::vector<Proxy> proxies_of(const tests::LoadedPages& pages) {
  std::vector<Proxy> all;
  for (const PageBuffer& image : pages.images) {
    const PageView view(image.data());
    for (std::uint32_t i = 0; i < view.header().external_count; ++i) {
      if (view.externals()[i].kind == ExternalKind::proxied) {
        all.push_back(view.proxies()[i]);
      }
    }
  }
  return all;
}

TEST(ProxyPages, EveryCodecGivesThemBack) {
  const ProxiedPages f;
  ASSERT_GT(f.pages.images.size(), 4U);
  ASSERT_GT(proxies_of(f.pages).size(), 8U);
  for (const Codec codec : {Codec::raw, Codec::lz4, Codec::zstd, Codec::draco}) {
    const PositionKind positions{codec == Codec::draco, -12};
    PageEncoder encoder(codec, positions);
    PageDecoder decoder(f.pages.rules, positions, codec);
    for (const PageBuffer& image : f.pages.images) {
      PageBuffer frame(f.pages.rules.page_bytes);
      const auto size = decoder.decode(encoder.encode(image), frame);
      ASSERT_TRUE(size) << size.status().message();
      frame.resize(*size);
      ASSERT_EQ(frame, image) << to_string(codec);
    }
  }
}

TEST(ProxyPages, AReferenceIsProxiedExactlyWhereItCrossesAPageBorder) {
  const ProxiedPages f;
  std::size_t proxied = 0;
  for (std::uint32_t page = 0; page < f.pages.images.size(); ++page) {
    const PageView view(f.pages.images[page].data());
    for (std::uint32_t i = 0; i < view.header().node_count; ++i) {
      const Node<8>& node = view.nodes<8>()[i];
      for (unsigned slot = 0; slot < 8; ++slot) {
        if ((node.external >> slot & 1) != 0) {  // of a local node: its child stands elsewhere
          EXPECT_EQ(view.externals()[node.child[slot]].kind, ExternalKind::proxied);
          ++proxied;
        }
      }
    }
  }
  EXPECT_GT(proxied, 8U);
}

TEST(ProxyPages, EachRuleHasItsRefusal) {
  const ProxiedPages f;
  const auto with = std::find_if(f.pages.images.begin(), f.pages.images.end(), [](const PageBuffer& image) {
    const PageView view(image.data());
    return std::any_of(view.externals(), view.externals() + view.header().external_count,
                       [](const ExternalRef& ref) { return ref.kind == ExternalKind::proxied; });
  });
  ASSERT_NE(with, f.pages.images.end());
  ASSERT_TRUE(validate_image(*with, f.pages.rules).ok());
  const auto refused = [&](const char* word, auto&& change) {
    PageBuffer image = *with;
    auto& header = *reinterpret_cast<PageHeader*>(image.data());
    auto* externals = reinterpret_cast<ExternalRef*>(image.data() + header.externals_offset);
    const auto at = std::find_if(externals, externals + header.external_count,
                                 [](const ExternalRef& ref) { return ref.kind == ExternalKind::proxied; });
    auto* proxies = reinterpret_cast<Proxy*>(image.data() + instances_end(header));
    change(header, *at, proxies[at - externals]);
    const Status status = validate_image(image, f.pages.rules);
    EXPECT_EQ(status.code(), ErrorCode::corrupt) << word;
    EXPECT_NE(status.message().find(word), std::string::npos) << status.message();
  };
  using H = PageHeader&;
  using E = ExternalRef&;
  using P = Proxy&;
  refused("proxy", [](H, E, P p) { p.area[1] = 0x7F80; });  // infinity
  refused("proxy", [](H, E, P p) { p.area[2] = 0x8000; });  // less than zero
  refused("proxy", [](H, E, P p) { p.several = 2; });
  refused("proxy", [&](H, E, P p) { p.geometry_id = static_cast<std::uint32_t>(f.pages.rules.geometry_count); });
  refused("not there", [](H, E e, P) { e.kind = ExternalKind(4); });
  refused("not there", [&](H, E e, P) { e.page = f.pages.rules.page_count; });
  refused("type", [](H h, E, P) { h.page_type = kPageTypeTriangles; });
  PageRules without = f.pages.rules;
  without.proxies = false;
  EXPECT_FALSE(validate_image(*with, without).ok()) << "a store without the feature has none";
}

Proxy flat_proxy() {
  Proxy proxy;
  proxy.area = {0, 0, to_half_digits(1)};  // one sheet across z that fills its box
  proxy.coverage = {255, 255, 255};
  return proxy;
}

TEST(Opacity, IsTheShareOfRaysThatASheetStops) {
  const auto faces = face_areas({0, 0, 0}, {1, 1, 0});
  EXPECT_EQ(opacity(flat_proxy(), faces, {0, 0, 1}), 1);
  EXPECT_EQ(opacity(flat_proxy(), faces, {3, -2, -0.5F}), 1);
  EXPECT_EQ(opacity(flat_proxy(), faces, {1, 2, 0}), 0) << "in its plane";
  Proxy half = flat_proxy();
  half.coverage[2] = 128;
  EXPECT_NEAR(opacity(half, faces, {1, 2, -3}), 0.5, 0.01);
}

TEST(Opacity, OfABallIsWhatItsBoxShowsOfIt) {
  // In a page of its own below others, so that the ball's root is proxied.
  const ProxiedPages f({tests::sphere({0, 0, 0}, 1, 60, 60), tests::sphere({9, 0, 0}, 1, 60, 60)});
  double most = 0, sum = 0;
  const std::vector<Proxy> proxies = proxies_of(f.pages);
  ASSERT_GT(proxies.size(), 4U);
  for (const Proxy& proxy : proxies) {
    EXPECT_EQ(proxy.several, 0);
    for (const std::uint8_t covered : proxy.coverage) {
      most = std::max(most, covered / 255.0);
      sum += covered / 255.0;
    }
  }
  EXPECT_GT(most, 0.7);
  EXPECT_GT(sum / (3.0 * double(proxies.size())), 0.3);
}

}  // namespace
}  // namespace raymill::storage
