// A store on disk: opened, read, and damaged in every part.
#include "storage/io/store_file.h"

#include <gtest/gtest.h>

#include <cstring>
#include <nlohmann/json.hpp>

#include "storage/base/checksum.h"
#include "tests/support/rays.h"
#include "tests/support/stores.h"

namespace raymill {
namespace {

using storage::Ledger;
using storage::PageEntry;
using storage::PageId;
using storage::StoreFile;
using storage::StoreFooter;
using storage::StoreHeader;
using tests::Random;
using tests::TempFolder;

class StoreFileTest : public testing::Test {
 protected:
  StoreFileTest() {
    Random random(1);
    path_ = tests::build_store(folder_, "scene.mill", {tests::soup(random, 1500), tests::grid(8, 0.1F)});
    bytes_ = tests::read_file(path_);
    std::memcpy(&footer_, bytes_.data() + bytes_.size() - sizeof footer_, sizeof footer_);
  }
  // A copy of the store with `change` made to its bytes.
  template <typename Change>
  std::string changed(Change&& change) {
    std::string bytes = bytes_;
    change(bytes);
    const std::string path = folder_ / "changed.mill";
    tests::write_file(path, bytes);
    return path;
  }
  std::string flipped(std::uint64_t offset) {
    return changed([&](std::string& bytes) { bytes[offset] = static_cast<char>(bytes[offset] ^ 4); });
  }
  ErrorCode open(const std::string& path) { return StoreFile::open(path, ledger_).status().code(); }

  TempFolder folder_;
  Ledger ledger_{gibibytes(1)};
  std::string path_, bytes_;
  StoreFooter footer_;
};

TEST_F(StoreFileTest, OpensAndAgreesWithItsBuild) {
  const auto opened = StoreFile::open(path_, ledger_);
  ASSERT_TRUE(opened) << opened.status().message();
  const StoreFile& file = **opened;
  EXPECT_EQ(file.footer().triangle_count, 1500u + 128);
  EXPECT_EQ(file.footer().geometry_count, 2u);
  EXPECT_EQ(file.positions_text(), "float32");
  EXPECT_EQ(ledger_.used_bytes(storage::Tag::directory), file.page_count() * sizeof(PageEntry));
  const auto verified = verify(path_);
  ASSERT_TRUE(verified) << verified.status().message();
  EXPECT_EQ(verified->pages, file.page_count());
  EXPECT_EQ(verified->triangles, 1500u + 128);
}

TEST_F(StoreFileTest, MetadataIsJsonWithEveryGeometry) {
  const auto opened = StoreFile::open(path_, ledger_);
  const auto metadata = (*opened)->read_metadata();
  ASSERT_TRUE(metadata);
  const auto json = nlohmann::json::parse(*metadata);
  EXPECT_EQ(json["geometries"].size(), 2u);
  EXPECT_EQ(json["geometries"][1]["triangles"], 128);
}

TEST_F(StoreFileTest, EveryBitOfTheHeaderCounts) {
  for (std::uint64_t offset = 0; offset < sizeof(StoreHeader); ++offset) {
    const ErrorCode expected = offset < 8    ? ErrorCode::corrupt
                               : offset < 12 ? ErrorCode::version_mismatch
                                             : ErrorCode::checksum_mismatch;
    EXPECT_EQ(open(flipped(offset)), expected) << "byte " << offset;
  }
}

TEST_F(StoreFileTest, EveryBitOfTheFooterCounts) {
  for (std::uint64_t i = 0; i < sizeof(StoreFooter); ++i) {
    const ErrorCode expected = i >= sizeof(StoreFooter) - 8 ? ErrorCode::corrupt : ErrorCode::checksum_mismatch;
    EXPECT_EQ(open(flipped(bytes_.size() - sizeof(StoreFooter) + i)), expected) << "byte " << i;
  }
}

TEST_F(StoreFileTest, DamagedDirectoryIsFoundAtOpen) {
  for (std::uint64_t i = 0; i < footer_.page_count * sizeof(PageEntry); i += 5) {
    EXPECT_EQ(open(flipped(footer_.directory_offset + i)), ErrorCode::checksum_mismatch);
  }
}

TEST_F(StoreFileTest, DamagedMetadataIsFoundWhenItIsRead) {
  const std::string path = flipped(footer_.metadata_offset + footer_.metadata_bytes / 2);
  EXPECT_EQ(open(path), ErrorCode::ok);
  EXPECT_EQ(verify(path).status().code(), ErrorCode::checksum_mismatch);
}

TEST_F(StoreFileTest, DamagedPageIsFoundByVerifyAndByTraceAndNamed) {
  Random random(2);
  const storage::Aabb all{{-2, -2, -2}, {2, 2, 2}};
  const auto rays = tests::random_rays(random, all, 3000);
  for (std::uint64_t page = 0; page < footer_.page_count; page += 3) {
    PageEntry entry;
    std::memcpy(&entry, bytes_.data() + footer_.directory_offset + page * sizeof entry, sizeof entry);
    const std::string path = flipped(entry.offset + entry.encoded_bytes / 2);
    const Status status = verify(path).status();
    EXPECT_EQ(status.code(), ErrorCode::checksum_mismatch);
    EXPECT_NE(status.message().find("page " + std::to_string(page)), std::string::npos) << status.message();
    EXPECT_EQ(tests::trace(path, rays).status.code(), ErrorCode::checksum_mismatch) << "page " << page;
    const auto inspected = inspect_page(path, static_cast<std::uint32_t>(page));
    ASSERT_TRUE(inspected) << "inspect shows what it can";
    EXPECT_NE(nlohmann::json::parse(*inspected)["checksum"], "ok");
  }
}

TEST_F(StoreFileTest, OtherVersionNamesBoth) {
  const Status status = StoreFile::open(changed([](std::string& bytes) {
                                          StoreHeader header;
                                          std::memcpy(&header, bytes.data(), sizeof header);
                                          header.format_version = 77;
                                          seal(header);
                                          std::memcpy(bytes.data(), &header, sizeof header);
                                        }),
                                        ledger_)
                            .status();
  EXPECT_EQ(status.code(), ErrorCode::version_mismatch);
  EXPECT_NE(status.message().find("77"), std::string::npos) << status.message();
  EXPECT_NE(status.message().find("build the store again"), std::string::npos) << status.message();
}

TEST_F(StoreFileTest, FooterOfAnotherBuildIsRefused) {
  BuildConfig config = tests::small_pages();
  config.codec = "lz4";
  const std::string other = tests::read_file(tests::build_store(folder_, "other.mill", {tests::grid(9)}, config));
  const std::string path =
      changed([&](std::string& bytes) { std::memcpy(bytes.data(), other.data(), sizeof(StoreHeader)); });
  EXPECT_EQ(open(path), ErrorCode::corrupt);
}

TEST_F(StoreFileTest, CutAnywhereIsRefused) {
  for (std::size_t size = 0; size < bytes_.size(); size += 1 + bytes_.size() / 97) {
    const ErrorCode code = open(changed([&](std::string& bytes) { bytes.resize(size); }));
    EXPECT_TRUE(code == ErrorCode::corrupt || code == ErrorCode::checksum_mismatch) << "cut to " << size;
  }
  EXPECT_EQ(open(changed([](std::string& bytes) { bytes += "x"; })), ErrorCode::corrupt);
}

TEST_F(StoreFileTest, WhatIsNoStoreIsSaidToBeNone) {
  EXPECT_EQ(open(folder_ / "nothing.mill"), ErrorCode::not_found);
  EXPECT_EQ(open(folder_.path()), ErrorCode::corrupt);
  EXPECT_EQ(open("/dev/null"), ErrorCode::corrupt);
  EXPECT_EQ(open(changed([](std::string& bytes) { bytes.clear(); })), ErrorCode::corrupt);
  const std::string text = changed([](std::string& bytes) { bytes.assign(5000, 'x'); });
  const Status status = StoreFile::open(text, ledger_).status();
  EXPECT_EQ(status.code(), ErrorCode::corrupt);
  EXPECT_NE(status.message().find("changed.mill"), std::string::npos) << status.message();
}

TEST_F(StoreFileTest, DirectoryThatTheBudgetCannotHoldIsRefused) {
  Ledger small(10);
  EXPECT_EQ(StoreFile::open(path_, small).status().code(), ErrorCode::budget_exceeded);
}

TEST_F(StoreFileTest, PagesAreReadWholeWhereverTheyStand) {
  const auto opened = StoreFile::open(path_, ledger_);
  const StoreFile& file = **opened;
  std::vector<std::byte, storage::AlignedAllocator<std::byte, storage::kDirectBlockBytes>> buffer(
      file.read_buffer_bytes());
  for (std::uint32_t page = 0; page < file.page_count(); ++page) {
    const auto encoded = file.read_page(PageId{page}, buffer);
    ASSERT_TRUE(encoded);
    const PageEntry& entry = file.entry(PageId{page});
    ASSERT_EQ(encoded->size(), entry.encoded_bytes);
    EXPECT_EQ(std::memcmp(encoded->data(), bytes_.data() + entry.offset, entry.encoded_bytes), 0);
    EXPECT_EQ(storage::checksum(*encoded), entry.checksum);
  }
}

}  // namespace
}  // namespace raymill
