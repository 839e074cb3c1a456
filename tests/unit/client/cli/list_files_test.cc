#include "client/cli/list_files.h"

#include <cstring>
#include <vector>

#include "client/cli/npy.h"
#include "tests/unit/client/cli/folder.h"

namespace raymill::client {
namespace {

class ListFilesTest : public FolderTest {
 protected:
  // A chunk with a row {t} for each value.
  static HitChunk chunk(std::uint64_t first_ray, const std::vector<float>& t, const std::vector<std::uint32_t>& offsets,
                        bool goes_on) {
    HitChunk chunk(0, first_ray, HitLayout(Field::t), std::as_bytes(std::span(t)), nullptr);
    chunk.set_offsets(offsets, goes_on);
    return chunk;
  }
  // What follows the header; `shape` is the header's.
  template <typename T>
  std::vector<T> values(const std::string& name, std::vector<std::uint64_t>& shape) const {
    const std::string bytes = read(name);
    const auto header = parse_npy_header(std::as_bytes(std::span(bytes)));
    EXPECT_TRUE(header) << header.status().message();
    shape = header->shape;
    std::vector<T> found((bytes.size() - header->data_offset) / sizeof(T));
    std::memcpy(found.data(), bytes.data() + header->data_offset, found.size() * sizeof(T));
    return found;
  }
};

TEST_F(ListFilesTest, OffsetsSayWhoseTheRowsAre) {
  auto files = ListFiles::create(path("hits.npy"), HitLayout(Field::t), 5);
  ASSERT_TRUE(files) << files.status().message();
  // Ray 0 has two hits, 1 none, 2 five over three chunks, 3 one, 4 none.
  EXPECT_TRUE(files->write(chunk(0, {1, 2, 3}, {0, 2, 2, 3}, true)).ok());
  EXPECT_EQ(files->rays_done(), 2u);
  EXPECT_TRUE(files->write(chunk(2, {4, 5, 6}, {0, 3}, true)).ok());
  EXPECT_EQ(files->rays_done(), 2u);
  EXPECT_TRUE(files->write(chunk(2, {7, 8}, {0, 1, 2, 2}, false)).ok());
  EXPECT_EQ(files->rays_done(), 5u);
  ASSERT_TRUE(files->commit().ok());
  EXPECT_EQ(this->files(), 2u) << "no temporaries";
  std::vector<std::uint64_t> shape;
  EXPECT_EQ(values<std::uint64_t>("hits.offsets.npy", shape), (std::vector<std::uint64_t>{0, 2, 2, 7, 8, 8}));
  EXPECT_EQ(shape, std::vector<std::uint64_t>{6});
  EXPECT_EQ(values<float>("hits.npy", shape), (std::vector<float>{1, 2, 3, 4, 5, 6, 7, 8}));
  EXPECT_EQ(shape, std::vector<std::uint64_t>{8});
}

TEST_F(ListFilesTest, NothingIsLeftOfWhatIsNotCommitted) {
  {
    auto files = ListFiles::create(path("hits.npy"), HitLayout(Field::t), 1);
    ASSERT_TRUE(files);
    EXPECT_TRUE(files->write(chunk(0, {1}, {0, 1}, false)).ok());
    EXPECT_EQ(this->files(), 2u);
  }
  EXPECT_EQ(files(), 0u);
}

TEST_F(ListFilesTest, WhatIsNoPlainFileIsRefused) {
  EXPECT_EQ(ListFiles::create("/dev/null", HitLayout(Field::t), 1).status().code(), ErrorCode::invalid_argument);
}

TEST_F(ListFilesTest, OffsetsStandBesideTheHits) {
  EXPECT_EQ(ListFiles::offsets_path("a/hits.npy"), "a/hits.offsets.npy");
  EXPECT_EQ(ListFiles::offsets_path("hits"), "hits.offsets.npy");
  EXPECT_EQ(ListFiles::offsets_path(".npy"), ".offsets.npy");
}

}  // namespace
}  // namespace raymill::client
