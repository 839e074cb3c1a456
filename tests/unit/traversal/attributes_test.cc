// Attributes of hits: what a row gets, whatever the schedule, the memory and the machine; their pages, and what is
// refused.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>

#include "storage/import/triangle_filter.h"
#include "storage/io/store_builder.h"
#include "storage/io/store_file.h"
#include "storage/pages/attribute_page.h"
#include "storage/pages/codec.h"
#include "tests/support/rays.h"
#include "tests/support/stores.h"
#include "traversal/attribute_fetch.h"
#include "traversal/kernel.h"

namespace raymill::tests {
namespace {

using namespace storage;

constexpr AttributeSet kKeptAttributes = kAllAttributes;
constexpr std::size_t kEntryFloats = 3 * kMostCornerFloats;

// A scene whose geometry 1 lacks texture coordinates and whose geometry 2 has nothing.
struct AttributedScene {
  explicit AttributedScene(std::uint64_t seed = 1, std::size_t triangles = 700) : random(seed) {
    scene = {soup(random, triangles), soup(random, triangles / 2), soup(random, 40)};
    for (std::size_t i = 0; i < 2; ++i) {
      std::vector<float> entries;
      for (std::size_t k = 0; k < scene[i].size() * kEntryFloats; ++k) {
        // Repeated numbers, as corners that are shared have.
        entries.push_back(k % 11 < 5 ? random.uniform(-1, 1) : float(k % 7));
      }
      AttributeGeometry geometry;
      geometry.triangle_count = static_cast<std::uint32_t>(scene[i].size());
      geometry.present = i == 0 ? kKeptAttributes : bit_of(Attribute::normal) | bit_of(Attribute::color0);
      geometry.normal_columns = {{{1, 0.5F, 0}, {0, -0.25F, 0.125F}, {0.75F, 0, 1}}};
      all_entries.push_back(std::move(entries));
      geometries.push_back(geometry);
    }
    Aabb box;
    box.grow(Vec3f{-1, -1, -1});
    box.grow(Vec3f{1, 1, 1});
    rays = random_rays(random, box, 1500);
  }

  std::string store(const std::string& name, const std::function<void(BuildConfig&)>& change = {}) {
    BuildConfig config = small_pages();
    config.output = folder / name;
    config.attributes = "color0,uv1,uv0,normal";
    if (change) {
      change(config);
    }
    const Status status = build(config);
    EXPECT_TRUE(status.ok()) << status.message();
    return config.output;
  }
  Status build(const BuildConfig& config) {
    RAYMILL_ASSIGN_OR_RETURN(const auto builder, StoreBuilder::create(config));
    TriangleWriter writer(*builder, builder->import_report());
    for (std::size_t i = 0; i < scene.size(); ++i) {
      (void)builder->import_report().add_geometry();
      writer.begin_geometry();
      if (i < all_entries.size() && builder->attributes() != 0) {
        RAYMILL_ASSIGN_OR_RETURN(geometries[i].first_entry, builder->add_entries(all_entries[i]));
        RAYMILL_RETURN_IF_ERROR(builder->set_attributes(static_cast<std::uint32_t>(i), geometries[i]));
      }
      for (const Corners& corners : scene[i]) {
        RAYMILL_RETURN_IF_ERROR(writer.add(corners));
      }
      RAYMILL_RETURN_IF_ERROR(writer.flush());
    }
    return builder->finish().status();
  }

  // By storage/ATTRIBUTES.md, in float64.
  [[nodiscard]] HitAttributes expected(const Hit& hit) const {
    HitAttributes out;
    if (hit.geometry_id >= geometries.size()) {
      return out;
    }
    const AttributeGeometry& geometry = geometries[hit.geometry_id];
    const float* entry = all_entries[hit.geometry_id].data() + hit.primitive_id * kEntryFloats;
    const auto at = [&](std::size_t i) {
      const double a = entry[i], b = entry[kMostCornerFloats + i], c = entry[2 * kMostCornerFloats + i];
      return a + double(hit.u) * (b - a) + double(hit.v) * (c - a);
    };
    std::array<double, 3> w{};
    for (std::size_t k = 0; k < 3; ++k) {
      for (std::size_t i = 0; i < 3; ++i) {
        w[k] += double(geometry.normal_columns[i][k]) * at(i);
      }
    }
    const double length = std::sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    for (std::size_t k = 0; k < 3; ++k) {
      out.shading_normal[k] = float(w[k] / length);
    }
    for (std::size_t k = 0; k < 2 && holds(geometry.present, Attribute::uv0); ++k) {
      out.uv0[k] = float(at(3 + k));
      out.uv1[k] = float(at(5 + k));
    }
    for (std::size_t k = 0; k < 4; ++k) {
      out.color0[k] = float(at(7 + k));
    }
    return out;
  }

  Random random;
  TempFolder folder;
  Scene scene;
  std::vector<std::vector<float>> all_entries;  // [geometry]
  std::vector<AttributeGeometry> geometries;
  std::vector<Ray> rays;
};

TraceSetup asking_for(Field fields = Field::all | Field::attributes) {
  TraceSetup setup;
  setup.trace.fields = fields;
  return setup;
}

TEST(AttributesTest, AHitHasWhatItsTriangleSays) {
  AttributedScene f;
  const Traced traced = trace(f.store("some.mill"), f.rays, asking_for());
  ASSERT_TRUE(traced.status.ok()) << traced.status.message();
  const HitLayout layout(Field::all | Field::attributes);
  ASSERT_EQ(layout.row_bytes(), 80U);
  std::map<std::uint32_t, std::size_t> hits;
  for (std::size_t i = 0; i < f.rays.size(); ++i) {
    const auto* row = reinterpret_cast<const std::byte*>(traced.rows.data()) + i * layout.row_bytes();
    std::vector<std::byte> should(layout.row_bytes());
    layout.write(traced.hits[i], f.expected(traced.hits[i]), should.data());
    ASSERT_EQ(std::memcmp(row, should.data(), should.size()), 0) << "ray " << i;
    ++hits[traced.hits[i].geometry_id];
  }
  EXPECT_GT(hits[0], 50U);
  EXPECT_GT(hits[1], 50U);
  EXPECT_GT(hits[2], 5U);
  EXPECT_EQ(traced.stats.attributes_read, hits[0] + hits[1]);
}

TEST(AttributesTest, EveryScheduleGivesTheSameRows) {
  AttributedScene f(2, 3000);
  const std::string path = f.store("eight.mill");
  for (const Mode mode : {Mode::watertight, Mode::fast, Mode::exact}) {
    TraceSetup setup = asking_for();
    setup.trace.mode = mode;
    const Traced plain = trace(path, f.rays, setup);
    ASSERT_TRUE(plain.status.ok()) << plain.status.message();
    TraceSetup adversarial = setup;
    adversarial.engine.adversarial = true;
    EXPECT_EQ(plain.rows, trace(path, f.rays, adversarial).rows) << to_string(mode);
    const Traced least = trace_with_least_memory(path, f.rays, setup);
    EXPECT_EQ(plain.rows, least.rows) << to_string(mode);
    EXPECT_GT(least.stats.evictions, 0U);
    for (const traversal::Isa isa : traversal::runnable_isas()) {
      TraceSetup other = setup;
      other.engine.isa = std::string(to_string(isa));
      other.engine.threads = 2;
      EXPECT_EQ(plain.rows, trace(path, f.rays, other).rows) << to_string(isa);
    }
    const std::string four = f.store("four.mill", [](BuildConfig& config) {
      config.width = 4;
      config.codec = "lz4";
      config.page_bytes = 32 << 10;
    });
    EXPECT_EQ(plain.rows, trace(four, f.rays, setup).rows);
  }
}

TEST(AttributesTest, OtherAnswersOfTheStoreStayAsTheyWere) {
  AttributedScene f(3);
  const std::string with = f.store("with.mill");
  const std::string without = f.store("without.mill", [](BuildConfig& config) { config.attributes.clear(); });
  const Traced plain = trace(without, f.rays);
  EXPECT_EQ(plain.rows, trace(with, f.rays).rows);
  TraceSetup expanded;
  expanded.engine.layout = "expanded";
  EXPECT_EQ(plain.rows, trace(with, f.rays, expanded).rows) << "the expanded layout passes over the pages";
  // Of each field alone, the others' order kept.
  for (const Field field : {Field::shading_normal, Field::uv0, Field::uv1, Field::color0}) {
    const Traced one = trace(with, f.rays, asking_for(field | Field::t));
    const Traced all = trace(with, f.rays, asking_for());
    const HitLayout narrow(field | Field::t), wide(Field::all | Field::attributes);
    for (std::size_t i = 0; i < f.rays.size(); ++i) {
      const auto* a = reinterpret_cast<const std::byte*>(one.rows.data()) + i * narrow.row_bytes();
      const auto* b = reinterpret_cast<const std::byte*>(all.rows.data()) + i * wide.row_bytes();
      HitAttributes x = narrow.read_attributes(a), y = wide.read_attributes(b), kept;
      // What was not asked for is NaN.
      if (field == Field::shading_normal) {
        kept.shading_normal = y.shading_normal;
      } else if (field == Field::uv0) {
        kept.uv0 = y.uv0;
      } else if (field == Field::uv1) {
        kept.uv1 = y.uv1;
      } else {
        kept.color0 = y.color0;
      }
      ASSERT_EQ(std::memcmp(&x, &kept, sizeof x), 0) << "ray " << i << ", " << to_string(field);
    }
  }
}

TEST(AttributesTest, WhatAStoreOrAQueryLacksIsRefusedInASentence) {
  AttributedScene f(4, 60);
  const std::string path = f.store("normals.mill", [](BuildConfig& config) { config.attributes = "normal"; });
  const auto refused = [&](const TraceSetup& setup, const char* words) {
    const Status status = trace(path, f.rays, setup).status;
    EXPECT_EQ(status.code(), ErrorCode::invalid_argument);
    EXPECT_NE(status.message().find(words), std::string::npos) << status.message();
  };
  refused(asking_for(Field::uv0), "--attributes normal,uv0");
  for (const Query query : {Query::any, Query::count, Query::all}) {
    TraceSetup setup = asking_for(Field::t | Field::shading_normal);
    setup.trace.query = query;
    refused(setup, "only the query closest");
  }
  TraceSetup expanded = asking_for(Field::shading_normal);
  expanded.engine.layout = "expanded";
  refused(expanded, "--layout auto");
  TraceSetup roughly = asking_for(Field::shading_normal);
  roughly.trace.tolerance = 1;
  refused(roughly, "within a tolerance");
}

TEST(AttributesTest, RecordsHoldWhatARayStillNeeds) {
  traversal::RayState ray;
  ray.has_hit = true;
  ray.tfar = ray.hit.t = 3;
  ray.hit.u = 0.25F;
  ray.hit.v = 0.5F;
  ray.hit.geometry_id = 7;
  ray.hit.primitive_id = 9;
  ray.number = 11;
  ray.attribute_step = traversal::AttributeStep::entry;
  ray.level = 5;
  ray.node = 40000;
  ray.corners = {{{1, 2, 3}, {4, 5, 6}, {7, 8, 9}}};
  for (const bool columns : {false, true}) {
    const traversal::RecordLayout layout(Field::uv | Field::ids, traversal::KeptCorners::none,
                                         {.normals = true, .texel = true, .columns = columns});
    std::vector<std::byte> record(layout.most_bytes());
    const std::size_t bytes = layout.pack(ray, record.data());
    EXPECT_EQ(bytes, 36U + 16 + (columns ? 36 : 0));
    EXPECT_EQ(layout.bytes(record.data()), bytes);
    traversal::RayState back;
    layout.unpack(record.data(), back);
    EXPECT_EQ(back.attribute_step, ray.attribute_step);
    EXPECT_EQ(back.level, ray.level);
    EXPECT_EQ(back.node, ray.node);
    EXPECT_EQ(back.hit.primitive_id, ray.hit.primitive_id);
    EXPECT_EQ(back.hit.t, ray.hit.t);
    EXPECT_FALSE(back.object.inside || back.left_object || back.texel.active());
    EXPECT_EQ(back.corners == ray.corners, columns);
    traversal::RayState first = ray;
    first.attribute_step = traversal::AttributeStep::geometry;
    first.level = 0;
    EXPECT_EQ(layout.pack(first, record.data()), 36U + 16);
    layout.unpack(record.data(), back);
    EXPECT_EQ(back.attribute_step, traversal::AttributeStep::geometry);
  }
}

TEST(AttributePage, EveryCodecGivesTheItemsBackAndDamageIsRefused) {
  Random random(5);
  constexpr std::uint32_t kAttributePageBytes = 16 << 10;
  for (const AttributeSet set : {1U, 2U, 6U, 15U}) {
    for (const AttributePageKind kind : {AttributePageKind::entries, AttributePageKind::geometries}) {
      const std::uint32_t count = attribute_items_per_page(kind, set, kAttributePageBytes);
      std::vector<std::byte> items(std::size_t{count} * attribute_item_bytes(kind, set));
      for (std::size_t i = 0; kind == AttributePageKind::entries && i < items.size(); ++i) {
        items[i] = static_cast<std::byte>(i / 64 % 3 == 0 ? random.below(256) : i / 256);
      }
      const std::vector<std::byte> image = make_attribute_page(kind, set, items);
      PageRules rules{8, 4, 0, kAttributePageBytes, 1, 3};
      rules.attributes = set;
      for (const Codec codec : {Codec::raw, Codec::lz4, Codec::zstd, Codec::draco}) {
        std::vector<std::byte> encoded = encode_attribute_page(image, codec);
        PageDecoder decoder(rules, {}, codec);
        PageBuffer frame(kAttributePageBytes);
        const auto size = decoder.decode(encoded, frame);
        ASSERT_TRUE(size.ok()) << size.status().message();
        ASSERT_EQ(*size, image.size());
        EXPECT_TRUE(std::equal(image.begin(), image.end(), frame.begin())) << to_string(codec) << " " << set;
        for (const std::size_t at : {2U, 3U, 4U, 8U, 12U, 24U, 28U}) {
          std::vector<std::byte> damaged = encoded;
          damaged[at] ^= std::byte{64};
          EXPECT_FALSE(decoder.decode(damaged, frame).ok() && codec != Codec::raw) << at;
        }
        encoded.pop_back();
        EXPECT_FALSE(decoder.decode(encoded, frame).ok());
        rules.attributes = 0;
        EXPECT_FALSE(PageDecoder(rules, {}, codec).decode(encode_attribute_page(image, codec), frame).ok());
        rules.attributes = set;
      }
    }
  }
}

TEST(AttributePage, NamesAreParsedEachOnceAndOthersRefused) {
  EXPECT_EQ(*parse_attributes("uv0,normal,uv0"), bit_of(Attribute::normal) | bit_of(Attribute::uv0));
  EXPECT_EQ(to_string_of(kAllAttributes), "normal,uv0,uv1,color0");
  for (const char* text : {"", "normal,", ",", "tangent", "Normal", "normal uv0"}) {
    EXPECT_EQ(parse_attributes(text).status().code(), ErrorCode::invalid_argument) << text;
  }
}

TEST(AttributePage, PlacesBeyondTheStoreAreNone) {
  const AttributePlaces places(2, 10, 16 << 10, 1000, 20);
  EXPECT_EQ(places.geometries_per_page, ((16U << 10) - 64) / 56);
  EXPECT_EQ(places.entries_page, 14U);
  EXPECT_EQ(places.entry(0)->page, 14U);
  EXPECT_EQ(places.entry(places.entries_per_page)->page, 15U);
  EXPECT_EQ(places.entry(std::uint64_t{6} * places.entries_per_page - 1)->page, 19U);
  EXPECT_FALSE(places.entry(std::uint64_t{6} * places.entries_per_page));
  EXPECT_FALSE(places.entry(~std::uint64_t{0}));
}

}  // namespace
}  // namespace raymill::tests
