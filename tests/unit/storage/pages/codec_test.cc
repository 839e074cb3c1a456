#include "storage/pages/codec.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <functional>
#include <span>
#include <vector>

#include "storage/pages/page_encoder.h"
#include "storage/pages/page_streams.h"
#include "tests/support/trees.h"

namespace raymill::storage {
namespace {

using tests::Pages;
using tests::Random;
using tests::Scene;

constexpr int kStep = -12;
constexpr PositionKind kLattice{true, kStep};
constexpr Codec kCodecs[] = {Codec::raw, Codec::lz4, Codec::zstd, Codec::draco};

struct CodecCase {
  const char* name;
  std::function<Scene()> make;
};

// Triangles that Draco's edgebreaker treats in its own way: twice the same, turned over, three on one edge, one vertex
// between two fans.
tests::Mesh non_manifold() {
  tests::Mesh mesh = tests::grid(6, 0.2F);
  const tests::Mesh again = mesh;
  mesh.insert(mesh.end(), again.begin(), again.end());
  for (const tests::Corners& c : again) {
    mesh.push_back({c[1], c[0], c[2]});
    mesh.push_back({c[1], c[2], c[0]});
    mesh.push_back({c[0], c[1], {0.5F, 0.5F, 3}});
  }
  return mesh;
}

std::vector<CodecCase> codec_cases() {
  return {
      {"grid", [] { return Scene{tests::grid(40, 0.2F)}; }},
      {"soup_of_many_geometries",
       [] {
         Random random(2);
         Scene scene;
         for (int i = 0; i < 400; ++i) {
           scene.push_back(tests::soup(random, 5));
         }
         return scene;
       }},
      {"duplicates_and_non_manifold",
       [] {
         return Scene{non_manifold(), tests::grid(6, 0.2F)};
       }},
      {"coincident",
       [] {
         return Scene{tests::coincident(500), tests::coincident(400)};
       }},
      {"shells", [] { return Scene{tests::nested_shells(800)}; }},
      {"needles",
       [] {
         Random random(3);
         return Scene{tests::needles(random, 900)};
       }},
      {"one_triangle", [] { return Scene{tests::coincident(1)}; }},
  };
}

class Codecs : public testing::TestWithParam<std::size_t> {};

TEST_P(Codecs, GiveTheImageBackBitForBit) {
  const CodecCase scene_case = codec_cases()[GetParam()];
  for (const unsigned width : {4u, 8u}) {
    for (const bool lattice : {false, true}) {
      const PositionKind kind = lattice ? kLattice : PositionKind{};
      const Pages pages =
          tests::build_pages(lattice ? tests::snapped(scene_case.make(), kStep) : scene_case.make(), width);
      for (const Codec codec : kCodecs) {
        if (codec == Codec::draco && !lattice) {
          continue;
        }
        PageDecoder decoder(pages.rules, kind, codec);
        PageEncoder encoder(codec, kind);
        PageBuffer frame(pages.rules.page_bytes);
        for (const PageBuffer& image : pages.images) {
          const std::vector<std::byte> encoded = encoder.encode(image);
          std::fill(frame.begin(), frame.end(), std::byte{0xAA});
          const auto size = decoder.decode(encoded, frame);
          ASSERT_TRUE(size) << scene_case.name << " " << to_string(codec) << ": " << size.status().message();
          ASSERT_EQ(*size, image.size());
          EXPECT_EQ(std::memcmp(frame.data(), image.data(), image.size()), 0)
              << scene_case.name << ", " << to_string(codec) << ", width " << width << ", lattice " << lattice;
          EXPECT_EQ(PageEncoder(codec, kind).encode(image), encoded) << "whatever was encoded before";
        }
      }
    }
  }
}

// Cut short, or with a byte changed: refused, or an image that passed validation. Never a crash, which the sanitizers
// would see.
TEST_P(Codecs, RefuseDamagedBytesOrGiveAValidImage) {
  const Scene scene = tests::snapped(codec_cases()[GetParam()].make(), kStep);
  Random random(9);
  for (const unsigned width : {4u, 8u}) {
    const Pages pages = tests::build_pages(scene, width);
    const PageBuffer& image = pages.images.back();
    for (const Codec codec : kCodecs) {
      PageDecoder decoder(pages.rules, kLattice, codec);
      PageBuffer frame(pages.rules.page_bytes);
      const std::vector<std::byte> encoded = PageEncoder(codec, kLattice).encode(image);
      for (std::size_t size = 0; size < encoded.size(); size += 1 + size / 8) {
        EXPECT_FALSE(decoder.decode(std::span(encoded).first(size), frame)) << "cut to " << size;
      }
      for (int i = 0; i < 300; ++i) {
        std::vector<std::byte> damaged = encoded;
        // The headers are short and matter most.
        const auto limit =
            static_cast<std::uint32_t>(i % 2 == 0 ? std::min<std::size_t>(64, damaged.size()) : damaged.size());
        damaged[random.below(limit)] ^= static_cast<std::byte>(1 + random.below(255));
        if (const auto size = decoder.decode(damaged, frame); size) {
          EXPECT_TRUE(validate_image(std::span(frame).first(*size), pages.rules).ok());
        } else {
          EXPECT_EQ(size.status().code(), ErrorCode::corrupt);
        }
      }
      EXPECT_TRUE(decoder.decode(encoded, frame)) << "a decoder outlives what it refused";
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Scenes, Codecs, testing::Range(std::size_t{0}, codec_cases().size()),
                         [](const auto& param) { return std::string(codec_cases()[param.param].name); });

TEST(Codec, NamesAreParsedBack) {
  for (const Codec codec : kCodecs) {
    EXPECT_EQ(parse_codec(to_string(codec)), codec);
  }
  EXPECT_FALSE(parse_codec("gzip"));
}

TEST(Codec, DracoIsTheSmallestOfASmoothMeshAndRawTheLargest) {
  const Pages pages = tests::build_pages(tests::snapped({tests::grid(40, 0.2F)}, kStep), 8);
  std::array<std::size_t, 4> bytes{};
  for (const PageBuffer& image : pages.images) {
    for (const Codec codec : kCodecs) {
      bytes[static_cast<std::size_t>(codec)] += PageEncoder(codec, kLattice).encode(image).size();
    }
  }
  EXPECT_LT(bytes[3], bytes[2]);
  EXPECT_LT(bytes[2], bytes[1]);
  EXPECT_LT(bytes[1], bytes[0]);
}

TEST(Codec, PageOfAnotherWidthOrTypeIsRefused) {
  const Pages pages = tests::build_pages({tests::grid(3)}, 8);
  std::vector<std::byte> encoded = PageEncoder(Codec::zstd, {}).encode(pages.images[0]);
  PageBuffer frame(pages.rules.page_bytes);
  PageRules rules = pages.rules;
  rules.width = 4;
  EXPECT_EQ(PageDecoder(rules, {}, Codec::zstd).decode(encoded, frame).status().code(), ErrorCode::corrupt);
  encoded[0] = encoded[1] = std::byte{0};
  EXPECT_EQ(PageDecoder(pages.rules, {}, Codec::zstd).decode(encoded, frame).status().code(), ErrorCode::corrupt);
}

TEST(Codec, PageLargerThanItsFrameIsRefused) {
  const Pages pages = tests::build_pages({tests::grid(30)}, 8);
  PageRules rules = pages.rules;
  rules.page_bytes = 1024;
  PageBuffer frame(rules.page_bytes);
  for (const Codec codec : {Codec::raw, Codec::lz4, Codec::zstd}) {
    const auto encoded = PageEncoder(codec, {}).encode(pages.images.back());
    EXPECT_EQ(PageDecoder(rules, {}, codec).decode(encoded, frame).status().code(), ErrorCode::corrupt);
  }
}

TEST(PageStreams, CoordinatesComeBackBitForBit) {
  Random random(4);
  for (int i = 0; i < 10000; ++i) {
    const auto bits = static_cast<std::uint32_t>(random.next());
    const float value = std::bit_cast<float>(bits);
    if (std::isfinite(value)) {
      EXPECT_EQ(std::bit_cast<std::uint32_t>(coordinate_value(coordinate_code(value, {}), {})), bits);
    }
  }
  for (const std::int32_t steps : {0, 1, -1, 16777216, -16777216}) {
    const float value = std::ldexp(float(steps), kStep);
    EXPECT_EQ(coordinate_value(coordinate_code(value, kLattice), kLattice), value);
  }
}

TEST(PageStreams, CodesOfFloatsAreInTheOrderOfTheValues) {
  const float values[] = {-3e38F, -1, -1e-40F, -0.0F, 0.0F, 1e-40F, 0.5F, 1, 2, 3e38F};
  for (std::size_t i = 0; i + 1 < std::size(values); ++i) {
    EXPECT_LT(coordinate_code(values[i], {}), coordinate_code(values[i + 1], {}));
  }
}

TEST(PlaneReader, StreamThatEndsEarlyFailsAndGivesZeros) {
  std::vector<std::byte> bytes;
  PlaneWriter writer(bytes);
  const std::vector<std::uint32_t> values{1, 0x01020304, 0xFFFFFFFF};
  writer.put(std::span<const std::uint32_t>(values));
  std::vector<std::uint32_t> back(3, 7);
  PlaneReader whole(bytes);
  whole.get(std::span(back));
  EXPECT_EQ(back, values);
  EXPECT_TRUE(whole.exhausted());
  PlaneReader cut{std::span(bytes).first(11)};
  cut.get(std::span(back));
  EXPECT_EQ(back, (std::vector<std::uint32_t>{0, 0, 0}));
  EXPECT_TRUE(cut.failed());
  EXPECT_FALSE(cut.exhausted());
}

}  // namespace
}  // namespace raymill::storage
