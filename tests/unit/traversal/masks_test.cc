// Triangles that masks cut out: what a ray finds, whatever the schedule, the query and the machine.
#include "tests/support/masks.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <tuple>

#include "storage/import/mask_footprint.h"
#include "storage/pages/codec.h"
#include "storage/pages/mask_page.h"
#include "storage/pages/masked_section.h"
#include "storage/pages/page_encoder.h"
#include "tests/support/effort.h"
#include "tests/support/kernel_harness.h"
#include "tests/support/rays.h"

namespace raymill::tests {
namespace {

using namespace storage;
using traversal::Isa;

constexpr std::size_t kMaskedRays = kSanitized ? 300 : 1500;

struct MaskFixture {
  explicit MaskFixture(std::uint64_t seed, std::size_t triangles = 400) : random(seed) {
    scene = random_masked_scene(random, triangles);
    Aabb box;
    box.grow(Vec3f{-1, -1, -1});
    box.grow(Vec3f{1, 1, 1});
    rays = random_rays(random, box, kMaskedRays);
  }
  [[nodiscard]] std::string store(unsigned width, const std::string& codec = "zstd") const {
    BuildConfig config = small_pages();
    config.width = width;
    config.codec = codec;
    config.positions = codec == "draco" ? "lattice:0.000001" : "float32";
    return build_masked(folder, "masked" + std::to_string(width) + codec + ".mill", scene, config);
  }
  Random random;
  TempFolder folder;
  MaskedScene scene;
  std::vector<Ray> rays;
};

// Which ray crosses what, whatever the order in which it was found.
std::vector<std::tuple<std::uint32_t, float, std::uint32_t, std::uint32_t>> in_order(
    const std::vector<traversal::Crossing>& crossings) {
  std::vector<std::tuple<std::uint32_t, float, std::uint32_t, std::uint32_t>> out;
  for (const traversal::Crossing& crossing : crossings) {
    out.emplace_back(crossing.number, crossing.hit.t, crossing.hit.geometry_id, crossing.hit.primitive_id);
  }
  std::sort(out.begin(), out.end());
  return out;
}

TEST(MasksTest, HitsAreThoseOfTheTexturesThemselves) {
  const MaskFixture f(1);
  const LoadedPages pages = load_pages(f.store(8));
  std::size_t texels = 0;
  for (const Mode mode : {Mode::watertight, Mode::exact, Mode::fast}) {
    const KernelHits found = run_kernel(pages, f.rays, {.mode = mode, .batch_rays = 100});
    EXPECT_FALSE(found.corrupt);
    texels += found.counters.texels_read;
    std::size_t wrong = 0;
    for (std::size_t i = 0; i < f.rays.size(); ++i) {
      const Hit expected = nearest(f.scene, f.rays[i]);
      const bool same =
          found.hits[i].geometry_id == expected.geometry_id && found.hits[i].primitive_id == expected.primitive_id;
      wrong += same ? 0 : 1;
      EXPECT_TRUE(same || mode == Mode::fast)
          << text_of(f.rays[i]) << "\n  " << text_of(expected) << "\n  " << text_of(found.hits[i]);
    }
    EXPECT_LE(wrong, 2U) << "fast answers by float32 alone, but for the texel";
  }
  EXPECT_GT(texels, 100U);
}

TEST(MasksTest, EveryScheduleGivesTheSame) {
  const MaskFixture f(2);
  for (const unsigned width : {4U, 8U}) {
    const LoadedPages pages = load_pages(f.store(width));
    for (const Query query : {Query::closest, Query::any, Query::all}) {
      for (const Mode mode : {Mode::watertight, Mode::fast, Mode::exact}) {
        const KernelHits plain = run_kernel(pages, f.rays, {.query = query, .mode = mode, .batch_rays = 64});
        for (const Isa isa : traversal::runnable_isas()) {
          for (const Residency residency : {Residency::one_page, Residency::random}) {
            const KernelRun run{isa, query, mode, residency, 5, residency == Residency::random ? 64U : 8U};
            KernelHits other = run_kernel(pages, f.rays, run);
            ASSERT_FALSE(other.corrupt);
            for (std::size_t i = 0; i < f.rays.size(); ++i) {
              const bool same = query == Query::all ? plain.hits[i].count == other.hits[i].count
                                                    : same_bits(plain.hits[i], other.hits[i]);
              ASSERT_TRUE(same) << width << " wide, " << to_string(query) << ", " << to_string(mode) << ": "
                                << text_of(f.rays[i]);
            }
            EXPECT_EQ(in_order(plain.crossings), in_order(other.crossings));
          }
        }
      }
    }
  }
}

TEST(MasksTest, EveryBudgetAndQueryGivesTheSame) {
  const MaskFixture f(3, 4000);
  const std::string path = f.store(8);
  const Traced plenty = trace(path, f.rays);
  ASSERT_TRUE(plenty.status.ok()) << plenty.status.message();
  EXPECT_GT(plenty.stats.texels_read, 0U);
  const Traced least = trace_with_least_memory(path, f.rays, {});
  ASSERT_TRUE(least.status.ok()) << least.status.message();
  EXPECT_EQ(plenty.rows, least.rows);
  TraceSetup adversarial;
  adversarial.engine.adversarial = true;
  EXPECT_EQ(plenty.rows, trace(path, f.rays, adversarial).rows);
  TraceSetup expanded;
  expanded.engine.layout = "expanded";
  const Status refused = trace(path, f.rays, expanded).status;
  EXPECT_EQ(refused.code(), ErrorCode::unsupported);
  EXPECT_NE(refused.message().find("masks"), std::string::npos);
  TraceSetup first;
  first.trace.query = Query::all;
  first.trace.first = 1;
  std::vector<Hit> hits;
  std::copy_if(plenty.hits.begin(), plenty.hits.end(), std::back_inserter(hits),
               [](const Hit& hit) { return hit.t < std::numeric_limits<float>::infinity(); });
  const Traced firsts = trace(path, f.rays, first);
  ASSERT_EQ(firsts.hits.size(), hits.size());
  for (std::size_t i = 0; i < hits.size(); ++i) {
    EXPECT_TRUE(same_bits(firsts.hits[i], hits[i]));
  }
}

TEST(MasksTest, EveryCodecGivesThePagesBack) {
  const MaskFixture f(4);
  std::size_t masked = 0, tiles = 0;
  const LoadedPages pages = load_pages(f.store(8));
  for (const PageBuffer& image : pages.images) {
    for (const Codec codec : {Codec::raw, Codec::lz4, Codec::zstd}) {
      const bool of_masks = MaskPageView::is_mask_page(image.data());
      masked += MaskSectionView::has_masks(image.data()) ? 1 : 0;
      tiles += of_masks ? 1 : 0;
      const std::vector<std::byte> bytes =
          of_masks ? encode_mask_page(image, codec) : PageEncoder(codec, {}).encode(image);
      PageDecoder decoder(pages.rules, {}, codec);
      PageBuffer frame(pages.rules.page_bytes);
      const auto size = decoder.decode(bytes, frame);
      ASSERT_TRUE(size) << size.status().message();
      frame.resize(*size);
      EXPECT_EQ(frame, image) << to_string(codec);
      for (std::size_t cut = 0; cut < bytes.size(); cut += 1 + bytes.size() / 50) {
        EXPECT_FALSE(decoder.decode(std::span(bytes).first(cut), frame));
      }
    }
  }
  EXPECT_GT(masked, 0U);
  EXPECT_GT(tiles, 0U);
  EXPECT_TRUE(verify(f.store(8, "draco")).ok());
}

TEST(MasksTest, EachRuleHasItsRefusal) {
  const MaskFixture f(5);
  const LoadedPages pages = load_pages(f.store(8));
  const auto image = std::find_if(pages.images.begin(), pages.images.end(), [](const PageBuffer& page) {
    return MaskSectionView::has_masks(page.data()) && MaskSectionView(page.data()).section().alpha_count > 0;
  });
  ASSERT_NE(image, pages.images.end());
  const auto refused = [&](const char* word, auto&& change) {
    PageBuffer copy = *image;
    const PageHeader& header = PageView(copy.data()).header();
    const MaskOffsets at = mask_offsets(header, MaskSectionView(copy.data()).section());
    change(copy.data(), at);
    const Status status = validate_image(copy, pages.rules);
    EXPECT_EQ(status.code(), ErrorCode::corrupt) << word;
    EXPECT_NE(status.message().find(word), std::string::npos) << status.message();
  };
  using Offsets = const MaskOffsets&;
  const auto entry = [](std::byte* page, Offsets at) { return reinterpret_cast<MaskedTriangle*>(page + at.entries); };
  const auto mask = [](std::byte* page, Offsets at) { return reinterpret_cast<MaskRef*>(page + at.masks); };
  refused("counts", [](std::byte* p, Offsets at) { ++reinterpret_cast<MaskSection*>(p + at.section)->mask_count; });
  refused("counts",
          [](std::byte* p, Offsets at) { reinterpret_cast<MaskSection*>(p + at.section)->entry_count = ~0U; });
  refused("entry", [](std::byte* p, Offsets at) { *reinterpret_cast<std::uint16_t*>(p + at.indices) = 0xFFFE; });
  refused("past its table", [&](std::byte* p, Offsets at) { entry(p, at)->mask = 0x3FFE; });
  refused("past its table", [&](std::byte* p, Offsets at) { entry(p, at)->alpha = 0xFFFE; });
  refused("coordinate", [&](std::byte* p, Offsets at) { entry(p, at)->corners[1][0] = NAN; });
  refused("coordinate", [&](std::byte* p, Offsets at) { entry(p, at)->corners[2][1] = 1e9F; });
  refused("neither", [&](std::byte* p, Offsets at) { entry(p, at)->known = 3; });
  refused("impossible", [&](std::byte* p, Offsets at) { mask(p, at)->info.width = 0; });
  refused("impossible", [&](std::byte* p, Offsets at) { mask(p, at)->info.height = kMostMaskEdge + 1; });
  refused("impossible", [&](std::byte* p, Offsets at) { mask(p, at)->info.bits = 4; });
  refused("impossible", [&](std::byte* p, Offsets at) { mask(p, at)->info.cutoff = NAN; });
  refused("past the store", [&](std::byte* p, Offsets at) { mask(p, at)->first_page = pages.rules.page_count; });
  refused("alpha", [&](std::byte* p, Offsets at) { *reinterpret_cast<float*>(p + at.alphas) = 2; });
  PageRules without = pages.rules;
  without.masks = false;
  EXPECT_FALSE(validate_image(*image, without).ok()) << "a store without the feature has no masked pages";
}

// Whatever is known without a look at a texel is what the texel says.
TEST(MasksTest, WhatIsKnownOfAFaceIsTrue) {
  Random random(6);
  std::size_t opaque = 0, cut = 0, cells = 0;
  for (int i = 0; i < 200; ++i) {
    MaskedScene scene = random_masked_scene(random, 64);
    for (const MaskedScene::Geometry& geometry : scene.geometries) {
      for (const FaceMask& face : geometry.faces) {
        FaceMask judged = face;
        const MaskInfo& info = scene.maps[face.mask].info;
        judge_face(scene.maps[face.mask], face.mask, judged);
        const TexelRectangle box = texel_rectangle(face.corners, info.width, info.height);
        for (int k = 0; k < 20; ++k) {
          double u = double(random.uniform(0, 1)), v = double(random.uniform(0, 1));
          u = u + v > 1 ? 1 - u : u;
          v = u + v > 1 ? 1 - v : v;
          if (u + v > 1) {
            continue;
          }
          const bool counts_here = counts_at(scene, face, u, v);
          const TexelPoint at = texel_point(face.corners, u, v, info.width, info.height);
          const CellState state =
              cell_state(judged.known, box, std::int64_t(std::floor(at.x)), std::int64_t(std::floor(at.y)));
          opaque += judged.mask == FaceMask::kOpaque ? 1 : 0;
          cut += judged.mask == FaceMask::kCut ? 1 : 0;
          cells += state != CellState::look_up ? 1 : 0;
          ASSERT_TRUE(judged.mask != FaceMask::kOpaque || counts_here);
          ASSERT_TRUE(judged.mask != FaceMask::kCut || !counts_here);
          ASSERT_TRUE(state != CellState::opaque || counts_here);
          ASSERT_TRUE(state != CellState::cut || !counts_here);
        }
      }
    }
  }
  EXPECT_GT(opaque, 1000U);
  EXPECT_GT(cut, 1000U);
  EXPECT_GT(cells, 1000U);
}

}  // namespace
}  // namespace raymill::tests
