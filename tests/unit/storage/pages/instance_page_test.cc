// Pages with instances: what validate_image() demands of them, and that every codec keeps them.
#include <gtest/gtest.h>

#include <limits>

#include "storage/base/placement.h"
#include "storage/pages/codec.h"
#include "storage/pages/page_assembler.h"
#include "storage/pages/page_encoder.h"
#include "tests/support/instances.h"
#include "tests/support/kernel_harness.h"

namespace raymill::storage {
namespace {

struct Fixture {
  Fixture() {
    tests::Random random(3);
    pages = tests::load_pages(build_placed(folder, "placed.mill", tests::random_placed_scene(random, 200)));
    for (const PageBuffer& image : pages.images) {
      if (PageView(image.data()).header().instance_count > 0) {
        with_instances = image;
      }
    }
  }
  tests::TempFolder folder;
  tests::LoadedPages pages;
  PageBuffer with_instances;
};

TEST(InstancePages, EveryCodecGivesThemBack) {
  const Fixture f;
  ASSERT_FALSE(f.with_instances.empty());
  for (const Codec codec : {Codec::raw, Codec::lz4, Codec::zstd, Codec::draco}) {
    const PositionKind positions{codec == Codec::draco, -12};
    PageEncoder encoder(codec, positions);
    PageDecoder decoder(f.pages.rules, positions, codec);
    PageBuffer frame(f.pages.rules.page_bytes);
    const auto size = decoder.decode(encoder.encode(f.with_instances), frame);
    ASSERT_TRUE(size) << size.status().message();
    frame.resize(*size);
    EXPECT_EQ(frame, f.with_instances) << to_string(codec);
  }
}

TEST(InstancePages, EachRuleHasItsRefusal) {
  const Fixture f;
  ASSERT_TRUE(validate_image(f.with_instances, f.pages.rules).ok());
  ASSERT_TRUE(check_boxes(f.with_instances.data()).ok());
  const auto refused = [&f](const char* word, auto&& change) {
    PageBuffer image = f.with_instances;
    auto& header = *reinterpret_cast<PageHeader*>(image.data());
    auto* instances = reinterpret_cast<Instance*>(image.data() + instances_offset(header));
    auto* externals = reinterpret_cast<ExternalRef*>(image.data() + header.externals_offset);
    change(header, instances, externals);
    const Status status = validate_image(image, f.pages.rules);
    EXPECT_EQ(status.code(), ErrorCode::corrupt) << word;
    EXPECT_NE(status.message().find(word), std::string::npos) << status.message();
  };
  using Header = PageHeader&;
  using Instances = Instance*;
  using Refs = ExternalRef*;
  refused("counts", [](Header h, Instances, Refs) { ++h.instance_count; });
  refused("inverted", [](Header, Instances i, Refs) { i->world_from_object[4] = std::nan(""); });
  refused("inverted", [](Header, Instances i, Refs) { i->world_from_object = {}; });
  refused("inverted", [](Header, Instances i, Refs) {
    i->world_from_object[0] = i->world_from_object[4] = i->world_from_object[8] = 1e200;
  });
  refused("box", [](Header, Instances i, Refs) { i->lower.y = std::numeric_limits<float>::infinity(); });
  refused("box", [](Header, Instances i, Refs) { std::swap(i->lower, i->upper); });
  refused("not there", [&](Header, Instances i, Refs) { i->page = f.pages.rules.page_count; });
  refused("not there", [](Header, Instances i, Refs) { i->geometry_base = 0xFFFFFFFF; });
  refused("not there", [](Header h, Instances, Refs r) {
    for (std::uint32_t k = 0; k < h.external_count; ++k) {
      r[k].page = r[k].kind == ExternalKind::instance ? h.instance_count : r[k].page;
    }
  });
  PageRules without = f.pages.rules;
  without.object_level = 0;
  EXPECT_FALSE(validate_image(f.with_instances, without).ok()) << "a store without the feature has no instances";
  PageRules higher = f.pages.rules;
  higher.object_level = 1;
  EXPECT_FALSE(validate_image(f.with_instances, higher).ok()) << "an object holds no instances";
}

TEST(InstancePages, ABoxThatDoesNotHoldItsInstanceIsFound) {
  Fixture f;
  auto* instance = reinterpret_cast<Instance*>(f.with_instances.data() +
                                               instances_offset(PageView(f.with_instances.data()).header()));
  instance->upper.x += 100;
  EXPECT_EQ(check_boxes(f.with_instances.data()).code(), ErrorCode::corrupt);
}

TEST(Placements, BoxesHoldWhatIsPlaced) {
  tests::Random random(5);
  for (int i = 0; i < 200; ++i) {
    const auto m = tests::random_matrix(random, 1000);
    const Placement placement{m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10], m[12], m[13], m[14]};
    ASSERT_TRUE(invertible(placement));
    Aabb object;
    object.grow(random.in_box(-2, 2));
    object.grow(random.in_box(-2, 2));
    const Aabb box = placed_box(placement, object);
    for (int corner = 0; corner < 8; ++corner) {
      const double p[] = {double((corner & 1) != 0 ? object.upper.x : object.lower.x),
                          double((corner & 2) != 0 ? object.upper.y : object.lower.y),
                          double((corner & 4) != 0 ? object.upper.z : object.lower.z)};
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const double x = m[axis] * p[0] + m[4 + axis] * p[1] + m[8 + axis] * p[2] + m[12 + axis];
        EXPECT_LE(box.lower[static_cast<int>(axis)], x);
        EXPECT_GE(box.upper[static_cast<int>(axis)], x);
      }
    }
  }
  EXPECT_FALSE(invertible({1, 0, 0, 0, 1, 0, 0, 0, 0, 5, 5, 5})) << "flat";
  EXPECT_FALSE(invertible({1, 0, 0, 0, 1, 0, 1, 1, 1e-9, 0, 0, 0})) << "all but flat";
  EXPECT_FALSE(invertible({1, 0, 0, 0, 1, 0, 0, 0, 1, std::nan(""), 0, 0}));
  EXPECT_TRUE(invertible({1e-6, 0, 0, 0, 1e-6, 0, 0, 0, -1e-6, 0, 0, 0})) << "small and mirrored is not flat";
  EXPECT_TRUE(invertible({0x1p-40, 0, 0, 0, 1, 0, 0, 0, 0x1p+60, 0, 0, 0}));
  EXPECT_FALSE(invertible({0x1p-41, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0})) << "rays would be stretched beyond float32";
  EXPECT_FALSE(invertible({1, 0, 0, 0, 0x1p+61, 0, 0, 0, 1, 0, 0, 0})) << "rays would shrink to nothing";
  EXPECT_FALSE(invertible({0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}));
}

}  // namespace
}  // namespace raymill::storage
