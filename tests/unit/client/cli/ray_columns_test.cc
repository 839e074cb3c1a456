#include "client/cli/ray_columns.h"

#include <algorithm>
#include <vector>

#include "client/cli/npy.h"
#include "tests/unit/client/cli/folder.h"

namespace raymill::client {
namespace {

std::string column_file(const std::string& descr, std::uint32_t rows, unsigned columns, std::uint32_t missing = 0) {
  std::string text = npy_header(descr, rows, columns);
  for (std::uint32_t i = 0; i < rows * std::max(columns, 1U) - missing; ++i) {
    text.append(reinterpret_cast<const char*>(&i), sizeof i);
  }
  return text;
}

class RayColumnsTest : public FolderTest {};

TEST_F(RayColumnsTest, RowsAreThoseOfTheRays) {
  constexpr std::uint32_t kRays = 20'000;  // more than a buffer holds
  write("ids.npy", column_file("'<u4'", kRays, 2));
  write("masks.npy", column_file("'<u4'", kRays, 0));
  auto columns = RayColumns::open({path("ids.npy"), path("masks.npy")}, kRays, 12'000);
  ASSERT_TRUE(columns) << columns.status().message();
  columns->skip(1000);
  std::uint32_t ray = 1000;
  for (const std::size_t count : {1, 12'000, 6999}) {
    const auto extras = columns->read(count);
    ASSERT_TRUE(extras) << extras.status().message();
    ASSERT_EQ(extras->skipped.size(), count);
    ASSERT_EQ(extras->masks.size(), count);
    for (std::size_t i = 0; i < count; ++i, ++ray) {
      ASSERT_EQ(extras->skipped[i], (PrimitiveIds{2 * ray, 2 * ray + 1}));
      ASSERT_EQ(extras->masks[i], ray);
    }
  }
  EXPECT_EQ(ray, kRays);
  EXPECT_EQ(columns->read(1).status().code(), ErrorCode::bad_rays) << "more rays than rows";
}

TEST_F(RayColumnsTest, WhatIsNotAskedForIsEmpty) {
  auto columns = RayColumns::open({}, 5, 8);
  ASSERT_TRUE(columns);
  const auto extras = columns->read(5);
  ASSERT_TRUE(extras);
  EXPECT_TRUE(extras->skipped.empty() && extras->masks.empty());
}

TEST_F(RayColumnsTest, WhatIsNoSuchFileIsRefusedWithWhatItIs) {
  for (const auto& [bytes, reason] : {std::pair(column_file("'<i4'", 3, 2), "'<u4'"),
                                      {column_file("'<u4'", 3, 3), "(3, 3)"},
                                      {column_file("'<u4'", 3, 0), "shape (N, 2)"},
                                      {column_file("'<u4'", 4, 2), "4 rays, there are 3"},
                                      {column_file("'<u4'", 3, 2, 1), "20 bytes follow"},
                                      {std::string("1 2 3"), "not a .npy file"}}) {
    write("bad.npy", bytes);
    const auto columns = RayColumns::open({path("bad.npy"), ""}, 3, 8);
    ASSERT_FALSE(columns) << reason;
    EXPECT_EQ(columns.status().code(), ErrorCode::bad_rays);
    EXPECT_NE(columns.status().message().find(reason), std::string::npos) << columns.status().message();
  }
  write("bad.npy", column_file("'<u4'", 3, 2));
  EXPECT_EQ(RayColumns::open({"", path("bad.npy")}, 3, 8).status().code(), ErrorCode::bad_rays) << "masks are (N,)";
  EXPECT_EQ(RayColumns::open({path("none.npy"), ""}, 3, 8).status().code(), ErrorCode::not_found);
}

TEST_F(RayColumnsTest, MasksOfGeometriesAreReadWhole) {
  write("masks.npy", column_file("'<u4'", 30'000, 0));
  const auto masks = read_geometry_masks(path("masks.npy"));
  ASSERT_TRUE(masks) << masks.status().message();
  ASSERT_EQ(masks->size(), 30'000u);
  EXPECT_EQ(masks->back(), 29'999u);
}

}  // namespace
}  // namespace raymill::client
