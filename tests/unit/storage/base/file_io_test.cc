#include "storage/base/file_io.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <cerrno>

#include "tests/support/temp_folder.h"

namespace raymill::storage {
namespace {

using tests::TempFolder;

TEST(FileIo, WhatIsWrittenAtAnOffsetIsReadBackThere) {
  const TempFolder folder;
  const int file = open_nameless(folder.path());
  ASSERT_GE(file, 0);
  EXPECT_EQ(folder.files(), 0u) << "the file has no name";
  const std::array<std::byte, 3> written{std::byte{1}, std::byte{2}, std::byte{3}};
  ASSERT_TRUE(write_fully(file, written, 100'000));
  std::array<std::byte, 3> read{};
  EXPECT_EQ(read_fully(file, read, 100'000), 3u);
  EXPECT_EQ(read, written);
  EXPECT_EQ(read_fully(file, read, 100'001), 2u) << "the file ends there";
  EXPECT_EQ(read_fully(file, read, 200'000), 0u);
  ::close(file);
}

TEST(FileIo, ErrorsStayInErrno) {
  std::array<std::byte, 3> bytes{};
  errno = 0;
  EXPECT_EQ(read_fully(-1, bytes, 0), std::nullopt);
  EXPECT_EQ(errno, EBADF);
  errno = 0;
  EXPECT_FALSE(write_fully(-1, bytes, 0));
  EXPECT_EQ(errno, EBADF);
  errno = 0;
  EXPECT_EQ(open_nameless("/nowhere/at/all"), -1);
  EXPECT_EQ(errno, ENOENT);
}

TEST(FileIo, NoRoomIsToldFromOtherErrors) {
  for (const int full : {ENOSPC, EDQUOT, EFBIG}) {
    EXPECT_EQ(write_error(full), ErrorCode::disk_full);
  }
  EXPECT_EQ(write_error(EIO), ErrorCode::io);
}

}  // namespace
}  // namespace raymill::storage
