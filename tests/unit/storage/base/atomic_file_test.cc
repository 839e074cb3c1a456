#include "storage/base/atomic_file.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <thread>
#include <vector>

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

TEST_F(AtomicFileTest, TemporaryOfAKilledProcessIsRemovedByTheNextOfItsTarget) {
  const std::string path = folder_ / "out.bin";
  const pid_t child = ::fork();
  if (child == 0) {
    auto file = AtomicFile::create(path);
    (void)file->write(bytes_of("half"));
    ::_exit(0);  // as SIGKILL does: no destructor runs
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_EQ(files(), 1U);
  {
    auto other = AtomicFile::create(folder_ / "out.bin2");
    ASSERT_TRUE(other);
    EXPECT_EQ(files(), 2U) << "another target's";
  }
  auto file = AtomicFile::create(path);
  ASSERT_TRUE(file);
  EXPECT_EQ(files(), 1U);
  EXPECT_TRUE(fs::exists(file->temporary_path()));
}

TEST_F(AtomicFileTest, TemporaryThatIsBeingWrittenIsLeftAlone) {
  const fs::path path = folder_ / "out.bin";
  auto first = AtomicFile::create(path);
  ASSERT_TRUE(first);
  ASSERT_TRUE(first->write(bytes_of("first")).ok());
  auto second = AtomicFile::create(path);
  ASSERT_TRUE(second);
  EXPECT_EQ(files(), 2U);
  AtomicFile moved = std::move(*first);
  auto third = AtomicFile::create(path);
  EXPECT_EQ(files(), 3U);
  ASSERT_TRUE(moved.commit().ok());
  EXPECT_EQ(contents(path), "first");
}

TEST_F(AtomicFileTest, OnlyWhatIsNamedAsATemporaryOfTheTargetIsRemoved) {
  const std::vector<std::string> kept = {"out.bin.tmp",       "out.bin.1-.tmp",    "out.bin.-1.tmp",
                                         "out.bin.1-2.tmp2",  "out.bin.1-2.tmp.x", "out.bin.a1-2.tmp",
                                         "out.bin.12.tmp",    "out.bi.1-2.tmp",    "out.bin2.1-2.tmp",
                                         "out.bin.x.1-2.tmp", "xout.bin.1-2.tmp"};
  for (const std::string& name : kept) {
    std::ofstream(folder_ / name) << "mine";
  }
  fs::create_directory(folder_ / "out.bin.3-4.tmp");
  std::ofstream(folder_ / "elsewhere") << "mine";
  fs::create_symlink(folder_ / "elsewhere", folder_ / "out.bin.5-6.tmp");
  std::ofstream(folder_ / "out.bin.999999-0.tmp") << "left";
  ASSERT_TRUE(AtomicFile::create(folder_ / "out.bin"));
  EXPECT_FALSE(fs::exists(folder_ / "out.bin.999999-0.tmp"));
  for (const std::string& name : kept) {
    EXPECT_TRUE(fs::exists(folder_ / name)) << name;
  }
  EXPECT_TRUE(fs::exists(folder_ / "out.bin.3-4.tmp"));
  EXPECT_TRUE(fs::is_symlink(folder_ / "out.bin.5-6.tmp"));
  EXPECT_EQ(contents(folder_ / "elsewhere"), "mine");
}

TEST_F(AtomicFileTest, AbandonedTemporariesAreFoundWithoutAFolderInTheName) {
  std::ofstream(folder_ / "out.bin.999999-0.tmp") << "left";
  const fs::path before = fs::current_path();
  fs::current_path(folder_);
  EXPECT_TRUE(AtomicFile::create("out.bin"));
  EXPECT_EQ(files(), 0U);
  fs::current_path(before);
}

// Creators that meet the removers of each other's temporaries: each file gets its name, none is lost or left.
TEST_F(AtomicFileTest, ManyWritersOfOneTargetDoNotRemoveEachOthersFiles) {
  const std::string path = folder_ / "out.bin";
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&, t] {
      const std::string text = "written by " + std::to_string(t);
      for (int i = 0; i < 200; ++i) {
        auto file = AtomicFile::create(path);
        ASSERT_TRUE(file) << file.status().message();
        ASSERT_TRUE(file->write(bytes_of(text)).ok());
        const Status status = file->commit();
        ASSERT_TRUE(status.ok()) << status.message();
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_EQ(contents(path).size(), std::string("written by 0").size());
  EXPECT_EQ(files(), 1U);
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
