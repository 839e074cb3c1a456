#include "storage/base/atomic_file.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

namespace raymill::storage {
namespace {

namespace fs = std::filesystem;

std::span<const std::byte> bytes_of(const std::string& text) { return std::as_bytes(std::span(text)); }

std::string contents(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

class AtomicFileTest : public testing::Test {
 protected:
  AtomicFileTest() : folder_(fs::path(testing::TempDir()) / ("atomic_file." + std::to_string(::getpid()))) {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  ~AtomicFileTest() override { fs::remove_all(folder_); }
  [[nodiscard]] std::size_t files() const {
    return static_cast<std::size_t>(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()));
  }
  fs::path folder_;
};

TEST_F(AtomicFileTest, NameAppearsOnlyWhenWhole) {
  const fs::path path = folder_ / "out.bin";
  auto file = AtomicFile::create(path);
  ASSERT_TRUE(file);
  ASSERT_TRUE(file->write(bytes_of("hello ")).ok());
  ASSERT_TRUE(file->write(bytes_of("world")).ok());
  ASSERT_TRUE(file->pwrite(bytes_of("J"), 0).ok());
  EXPECT_FALSE(fs::exists(path));
  ASSERT_TRUE(file->commit().ok());
  EXPECT_EQ(contents(path), "Jello world");
  EXPECT_EQ(files(), 1U);
}

TEST_F(AtomicFileTest, NothingIsLeftWithoutCommit) {
  {
    auto file = AtomicFile::create(folder_ / "out.bin");
    ASSERT_TRUE(file);
    ASSERT_TRUE(file->write(bytes_of("half")).ok());
    EXPECT_EQ(files(), 1U);
  }
  EXPECT_EQ(files(), 0U);
}

TEST_F(AtomicFileTest, OldFileStaysUntilCommit) {
  const fs::path path = folder_ / "out.bin";
  std::ofstream(path) << "old";
  {
    auto file = AtomicFile::create(path);
    ASSERT_TRUE(file);
    ASSERT_TRUE(file->write(bytes_of("new")).ok());
  }
  EXPECT_EQ(contents(path), "old");
  auto file = AtomicFile::create(path);
  ASSERT_TRUE(file);
  ASSERT_TRUE(file->write(bytes_of("new")).ok());
  ASSERT_TRUE(file->commit().ok());
  EXPECT_EQ(contents(path), "new");
}

TEST_F(AtomicFileTest, SymbolicLinkKeepsPointing) {
  fs::create_directory(folder_ / "real");
  std::ofstream(folder_ / "real" / "out.bin") << "old";
  fs::create_symlink(folder_ / "real" / "out.bin", folder_ / "link");
  auto file = AtomicFile::create(folder_ / "link");
  ASSERT_TRUE(file);
  ASSERT_TRUE(file->write(bytes_of("new")).ok());
  ASSERT_TRUE(file->commit().ok());
  EXPECT_TRUE(fs::is_symlink(folder_ / "link"));
  EXPECT_EQ(contents(folder_ / "real" / "out.bin"), "new");
}

TEST_F(AtomicFileTest, DeviceIsWrittenAndNeverReplaced) {
  auto file = AtomicFile::create("/dev/null");
  ASSERT_TRUE(file);
  EXPECT_EQ(file->temporary_path(), "/dev/null");
  ASSERT_TRUE(file->write(bytes_of("gone")).ok());
  ASSERT_TRUE(file->commit().ok());
  EXPECT_TRUE(fs::is_character_file("/dev/null"));
}

TEST_F(AtomicFileTest, FullDeviceIsDiskFull) {
  auto file = AtomicFile::create("/dev/full");
  ASSERT_TRUE(file);
  EXPECT_EQ(file->write(bytes_of("x")).code(), ErrorCode::disk_full);
}

TEST_F(AtomicFileTest, ErrorsNameThePath) {
  EXPECT_EQ(AtomicFile::create(folder_).status().code(), ErrorCode::invalid_argument);
  EXPECT_EQ(AtomicFile::create("").status().code(), ErrorCode::invalid_argument);
  const auto missing = AtomicFile::create(folder_ / "no" / "out.bin");
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.status().code(), ErrorCode::not_found);
  EXPECT_NE(missing.status().message().find("no/out.bin"), std::string::npos);
}

TEST_F(AtomicFileTest, LongestLegalNameWorks) {
  const fs::path path = folder_ / std::string(255, 'n');
  auto file = AtomicFile::create(path);
  ASSERT_TRUE(file);
  ASSERT_TRUE(file->commit().ok());
  EXPECT_TRUE(fs::exists(path));
}

}  // namespace
}  // namespace raymill::storage
