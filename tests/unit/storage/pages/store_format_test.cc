#include "storage/pages/store_format.h"

#include <gtest/gtest.h>

#include <limits>

namespace raymill::storage {
namespace {

constexpr std::uint64_t kFileBytes = 64 + 1000 + 50 + 24 + sizeof(StoreFooter);

StoreHeader good_header() {
  StoreHeader header;
  header.features = 1;
  header.page_bytes = kMinPageBytes;
  header.width = 8;
  header.codec = static_cast<std::uint8_t>(Codec::zstd);
  seal(header);
  return header;
}

StoreFooter good_footer(const StoreHeader& header) {
  StoreFooter footer;
  footer.header_checksum = header.checksum;
  footer.metadata_offset = 64 + 1000;
  footer.metadata_bytes = 50;
  footer.metadata_plain_bytes = 100;
  footer.directory_offset = 64 + 1000 + 50;
  footer.page_count = 1;
  footer.levels = 3;
  footer.max_encoded_bytes = 1000;
  footer.file_bytes = kFileBytes;
  seal(footer);
  return footer;
}

// The code that a header gives once `change` was made and it was sealed again.
template <typename Change>
ErrorCode header_with(Change&& change) {
  StoreHeader header = good_header();
  change(header);
  seal(header);
  return check(header).code();
}
template <typename Change>
ErrorCode footer_with(Change&& change) {
  const StoreHeader header = good_header();
  StoreFooter footer = good_footer(header);
  change(footer);
  seal(footer);
  return check(footer, header, kFileBytes).code();
}

TEST(StoreFormat, GoodHeaderAndFooterPass) {
  EXPECT_TRUE(check(good_header()).ok());
  EXPECT_TRUE(check(good_footer(good_header()), good_header(), kFileBytes).ok());
}

TEST(StoreFormat, EachKindOfBadHeaderHasItsCode) {
  EXPECT_EQ(header_with([](StoreHeader& h) { h.magic[0] = 'r'; }), ErrorCode::corrupt);
  EXPECT_EQ(header_with([](StoreHeader& h) { h.format_version = 2; }), ErrorCode::version_mismatch);
  EXPECT_EQ(header_with([](StoreHeader& h) { h.format_version = 0; }), ErrorCode::version_mismatch);
  EXPECT_EQ(header_with([](StoreHeader& h) { h.features |= 1U << 20; }), ErrorCode::unsupported);
  EXPECT_EQ(header_with([](StoreHeader& h) { h.width = 5; }), ErrorCode::corrupt);
  EXPECT_EQ(header_with([](StoreHeader& h) { h.page_bytes = kMaxPageBytes + 1; }), ErrorCode::corrupt);
  EXPECT_EQ(header_with([](StoreHeader& h) { h.page_bytes = 0; }), ErrorCode::corrupt);
  EXPECT_EQ(header_with([](StoreHeader& h) { h.codec = 4; }), ErrorCode::corrupt);
  EXPECT_EQ(header_with([](StoreHeader& h) { h.lattice = 2; }), ErrorCode::corrupt);
  EXPECT_EQ(header_with([](StoreHeader& h) { h.header_bytes = 128; }), ErrorCode::corrupt);
  for (const std::int32_t exponent : {201, -201, std::numeric_limits<std::int32_t>::min()}) {
    EXPECT_EQ(header_with([&](StoreHeader& h) { h.lattice_step_exponent = exponent; }), ErrorCode::corrupt);
  }
  EXPECT_EQ(header_with([](StoreHeader& h) { h.features |= static_cast<std::uint64_t>(Feature::origins); }),
            ErrorCode::corrupt)
      << "of what, where nothing is placed";
  constexpr auto kOrigin = static_cast<std::uint64_t>(Feature::origin);
  EXPECT_EQ(header_with([](StoreHeader& h) { h.features |= kOrigin; }), ErrorCode::corrupt) << "of zero";
  for (const std::int32_t exponent : {101, -101, std::numeric_limits<std::int32_t>::min()}) {
    EXPECT_EQ(header_with([&](StoreHeader& h) {
                h.features |= kOrigin;
                h.origin_steps = {1, 2, 3};
                h.origin_exponent = exponent;
              }),
              ErrorCode::corrupt);
  }
}

TEST(StoreFormat, OriginIsReadWhereTheStoreHasOne) {
  StoreHeader header = good_header();
  header.origin_steps = {7, 0, std::numeric_limits<std::int32_t>::min()};
  header.origin_exponent = -3;
  seal(header);
  EXPECT_TRUE(check(header).ok()) << "unused without the feature";
  EXPECT_TRUE(header.origin().is_zero());
  header.features |= static_cast<std::uint64_t>(Feature::origin);
  seal(header);
  EXPECT_TRUE(check(header).ok());
  EXPECT_EQ(header.origin().position(), (std::array<double, 3>{0.875, 0, -0x1p28}));
}

TEST(StoreFormat, OriginIsTheNearestThatCanBeCounted) {
  EXPECT_EQ(origin_near({6400000.3, -0.2, 12}, 0), (Origin{{6400000, 0, 12}, 0}));
  EXPECT_EQ(origin_near({6400000.3, -0.2, 12}, -30).exponent, -8) << "2^31 steps and no more";
  EXPECT_EQ(origin_near({0.2, 0, 0}, 0), Origin());
  EXPECT_EQ(origin_near({0x1p110, 0, 1}, 3), (Origin{{1 << 30, 0, 0}, 80}));
  EXPECT_TRUE(origin_near({1e300, 0, 0}, 3).is_zero()) << "beyond what can be written";
}

TEST(StoreFormat, UnsealedChangesAreChecksumMismatches) {
  StoreHeader header = good_header();
  header.width = 4;
  EXPECT_EQ(check(header).code(), ErrorCode::checksum_mismatch);
  StoreFooter footer = good_footer(good_header());
  footer.triangle_count = 1;
  EXPECT_EQ(check(footer, good_header(), kFileBytes).code(), ErrorCode::checksum_mismatch);
}

TEST(StoreFormat, FooterThatDoesNotFitTheFileIsCorrupt) {
  constexpr std::uint64_t kHuge = std::numeric_limits<std::uint64_t>::max();
  EXPECT_EQ(footer_with([](StoreFooter& f) { f.magic[7] = 0; }), ErrorCode::corrupt);
  EXPECT_EQ(footer_with([](StoreFooter& f) { f.header_checksum ^= 1; }), ErrorCode::corrupt);
  EXPECT_EQ(footer_with([](StoreFooter& f) { f.file_bytes += 1; }), ErrorCode::corrupt);
  EXPECT_EQ(footer_with([](StoreFooter& f) { f.page_count = 0; }), ErrorCode::corrupt);
  // 24 * (2^64 / 24 + 1) wraps to a small number.
  EXPECT_EQ(footer_with([](StoreFooter& f) { f.page_count = kHuge / 24 + 1; }), ErrorCode::corrupt);
  EXPECT_EQ(footer_with([](StoreFooter& f) { f.metadata_offset = kHuge; }), ErrorCode::corrupt);
  EXPECT_EQ(footer_with([](StoreFooter& f) { f.metadata_bytes = kHuge; }), ErrorCode::corrupt);
  EXPECT_EQ(footer_with([](StoreFooter& f) { f.directory_offset += 1; }), ErrorCode::corrupt);
  EXPECT_EQ(footer_with([](StoreFooter& f) { f.levels = 0; }), ErrorCode::corrupt);
  EXPECT_EQ(footer_with([](StoreFooter& f) { f.levels = 17; }), ErrorCode::corrupt);
  EXPECT_EQ(footer_with([](StoreFooter& f) { f.root_page = 1; }), ErrorCode::corrupt);
  EXPECT_EQ(footer_with([](StoreFooter& f) { f.root_node = kNoParent; }), ErrorCode::corrupt);
  EXPECT_EQ(footer_with([](StoreFooter& f) { f.bounds_min[2] = std::numeric_limits<float>::quiet_NaN(); }),
            ErrorCode::corrupt);
  EXPECT_EQ(footer_with([](StoreFooter& f) { f.max_encoded_bytes = 0xFFFFFFFF; }), ErrorCode::corrupt);
  EXPECT_EQ(footer_with([](StoreFooter& f) { f.metadata_plain_bytes = kHuge; }), ErrorCode::corrupt);
}

}  // namespace
}  // namespace raymill::storage
