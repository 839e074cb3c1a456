#include "storage/base/block_store.h"

#include <gtest/gtest.h>
#include <sys/mount.h>
#include <sys/resource.h>

#include <cerrno>
#include <csignal>
#include <cstring>
#include <thread>

#include "tests/support/random.h"
#include "tests/support/temp_folder.h"

namespace raymill::storage {
namespace {

using tests::Random;
using tests::TempFolder;

constexpr std::uint64_t kSlabBytes = mebibytes(4);
constexpr std::size_t kSlabBlocks = kSlabBytes / kBlockBytes;

using Block = std::vector<std::byte>;

// A block's content is made from its number, so that one taken for another is seen.
Block block_of(std::uint64_t number, std::size_t bytes = kBlockBytes) {
  Random random(number);
  Block block(bytes);
  for (std::byte& b : block) {
    b = static_cast<std::byte>(random.next());
  }
  return block;
}

BlockId write(BlockStore& store, const Block& block) {
  const auto id = store.write(block);
  EXPECT_TRUE(id) << id.status().message();
  return id ? *id : BlockId{};
}

Block read(const BlockStore& store, BlockId id, std::size_t bytes = kBlockBytes) {
  Block block(bytes);
  const Status status = store.read(id, block);
  EXPECT_TRUE(status.ok()) << status.message();
  return block;
}

TEST(BlockStore, MemoryFirstThenAFileAndEveryBlockReadsBack) {
  const TempFolder folder;
  Ledger ledger(kSlabBytes + kSlabBytes / 2);
  BlockStore store(ledger, folder.path());
  std::vector<BlockId> ids;
  for (std::size_t i = 0; i < kSlabBlocks; ++i) {
    ids.push_back(write(store, block_of(i)));
  }
  EXPECT_EQ(store.memory_bytes(), kSlabBytes);
  EXPECT_EQ(store.file_bytes(), 0u);
  for (std::size_t i = kSlabBlocks; i < kSlabBlocks + 10; ++i) {
    ids.push_back(write(store, block_of(i)));
  }
  EXPECT_EQ(store.memory_bytes(), kSlabBytes);
  EXPECT_EQ(store.file_bytes(), 10 * kBlockBytes);
  for (std::size_t i = ids.size(); i-- > 0;) {
    EXPECT_EQ(read(store, ids[i]) == block_of(i), true) << "block " << i;
  }
}

TEST(BlockStore, ShortBlocksAndBeginningsOfBlocksReadBack) {
  const TempFolder folder;
  for (const std::uint64_t budget : {std::uint64_t{0}, kSlabBytes}) {
    Ledger ledger(budget);
    BlockStore store(ledger, folder.path());
    const BlockId empty = write(store, {});
    const BlockId one = write(store, block_of(1, 1));
    const BlockId some = write(store, block_of(2, 1000));
    const BlockId whole = write(store, block_of(3));
    EXPECT_TRUE(read(store, empty, 0).empty());
    EXPECT_EQ(read(store, one, 1), block_of(1, 1));
    EXPECT_EQ(read(store, some, 1000), block_of(2, 1000));
    EXPECT_EQ(read(store, whole, 77), block_of(3, 77));
  }
}

TEST(BlockStore, ReleasedBlocksAreUsedAgainSoTheFileHoldsNoMoreThanItsFullest) {
  const TempFolder folder;
  Ledger ledger(kSlabBytes);
  BlockStore store(ledger, folder.path());
  constexpr std::size_t kMostAlive = kSlabBlocks + 40;
  Random random(1);
  std::vector<std::pair<BlockId, std::uint64_t>> alive;
  for (std::uint64_t i = 0; i < 2000; ++i) {
    if (alive.size() == kMostAlive || (!alive.empty() && random.below(3) == 0)) {
      std::swap(alive[random.below(static_cast<std::uint32_t>(alive.size()))], alive.back());
      EXPECT_EQ(read(store, alive.back().first, 64), block_of(alive.back().second, 64));
      store.release(alive.back().first);
      alive.pop_back();
    } else {
      alive.emplace_back(write(store, block_of(i, 64)), i);
    }
  }
  EXPECT_EQ(store.memory_bytes(), kSlabBytes);
  EXPECT_LE(store.file_bytes(), 40 * kBlockBytes);
  for (const auto& [id, number] : alive) {
    EXPECT_EQ(read(store, id, 64), block_of(number, 64));
  }
}

TEST(BlockStore, MemoryThatIsToStayFreeStaysFree) {
  const TempFolder folder;
  Ledger ledger(4 * kSlabBytes);
  BlockStore store(ledger, folder.path());
  store.keep_free(2 * kSlabBytes + 1);
  for (std::size_t i = 0; i < 4 * kSlabBlocks; ++i) {
    write(store, block_of(i, 8));
  }
  EXPECT_EQ(store.memory_bytes(), kSlabBytes);
  EXPECT_EQ(store.file_bytes(), 3 * kSlabBytes);
  EXPECT_EQ(ledger.free_bytes(), 3 * kSlabBytes);
  store.keep_free(0);
  write(store, block_of(0, 8));
  EXPECT_EQ(store.memory_bytes(), 2 * kSlabBytes) << "memory that may be used again is used before the file";
}

TEST(BlockStore, ClaimsAreGivenBack) {
  const TempFolder folder;
  Ledger ledger(gibibytes(1));
  {
    BlockStore store(ledger, folder.path());
    for (std::size_t i = 0; i <= kSlabBlocks; ++i) {
      write(store, block_of(i, 8));
    }
    EXPECT_EQ(ledger.used_bytes(Tag::build), 2 * kSlabBytes);
  }
  EXPECT_EQ(ledger.used_bytes(Tag::build), 0u);
}

TEST(BlockStore, FileHasNoName) {
  const TempFolder folder;
  Ledger ledger(0);
  BlockStore store(ledger, folder.path());
  write(store, block_of(1));
  EXPECT_EQ(store.file_bytes(), kBlockBytes);
  EXPECT_EQ(folder.files(), 0u);
}

TEST(BlockStore, FolderIsLookedAtOnlyWhenAFileIsNeeded) {
  const TempFolder folder;
  Ledger ledger(kSlabBytes);
  BlockStore store(ledger, folder / "none");
  for (std::size_t i = 0; i < kSlabBlocks; ++i) {
    write(store, block_of(i, 8));
  }
  const auto refused = store.write(block_of(0, 8));
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.status().code(), ErrorCode::io);
  EXPECT_NE(refused.status().message().find(folder / "none"), std::string::npos) << refused.status().message();
}

TEST(BlockStore, BlocksAreReadAndReleasedByManyThreadsAtOnce) {
  const TempFolder folder;
  Ledger ledger(kSlabBytes);
  BlockStore store(ledger, folder.path());
  constexpr std::size_t kEach = 40, kThreads = 4;
  std::vector<BlockId> ids;
  for (std::size_t i = 0; i < kEach * kThreads; ++i) {
    ids.push_back(write(store, block_of(i, 500)));
  }
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < kThreads; ++t) {
    threads.emplace_back([&, t] {
      for (std::size_t i = t; i < ids.size(); i += kThreads) {
        EXPECT_EQ(read(store, ids[i], 500) == block_of(i, 500), true);
        store.release(ids[i]);
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  const std::uint64_t fullest = store.file_bytes();
  for (std::size_t i = 0; i < kEach * kThreads; ++i) {
    write(store, block_of(i, 8));
  }
  EXPECT_EQ(store.file_bytes(), fullest) << "each block was given back once";
}

TEST(BlockStore, BlocksAreReadWhileOthersAreWritten) {
  const TempFolder folder;
  Ledger ledger(gibibytes(1));
  BlockStore store(ledger, folder.path());
  const BlockId first = write(store, block_of(0));
  const Block expected = block_of(0, 100);
  std::thread writer([&] {
    for (std::size_t i = 1; i < 20 * kSlabBlocks; ++i) {
      write(store, {});
    }
  });
  for (int i = 0; i < 200; ++i) {
    ASSERT_EQ(read(store, first, 100) == expected, true);
  }
  writer.join();
}

// Ends the process with 0 where a store on a full disk says so and keeps what it had.
[[noreturn]] void fill(const std::string& folder) {
  Ledger ledger(0);
  BlockStore store(ledger, folder);
  std::vector<BlockId> ids;
  for (std::uint64_t i = 0; i < 100; ++i) {
    const auto id = store.write(block_of(i));
    if (id) {
      ids.push_back(*id);
      continue;
    }
    bool whole = !ids.empty();
    for (std::size_t k = 0; k < ids.size(); ++k) {
      whole = whole && read(store, ids[k]) == block_of(k);
    }
    const bool named = id.status().message().find(folder) != std::string::npos;
    std::exit(id.status().code() == ErrorCode::disk_full && named && whole ? 0 : 2);
  }
  std::exit(3);
}

[[noreturn]] void fill_with_a_limit(const std::string& folder) {
  rlimit limit{};
  limit.rlim_cur = limit.rlim_max = 5 * kBlockBytes / 2;
  if (std::signal(SIGXFSZ, SIG_IGN) == SIG_ERR || setrlimit(RLIMIT_FSIZE, &limit) != 0) {
    std::exit(4);
  }
  fill(folder);
}

TEST(BlockStoreDeathTest, FileThatMayNotGrowIsADiskThatIsFull) {
  const TempFolder folder;
  EXPECT_EXIT(fill_with_a_limit(folder.path()), testing::ExitedWithCode(0), "");
}

TEST(BlockStoreDeathTest, FullDiskIsSaidToBeFull) {
  const TempFolder folder;
  const std::string place = folder / "small";
  std::filesystem::create_directory(place);
  if (::mount("tmpfs", place.c_str(), "tmpfs", 0, "size=256k") != 0) {
    // Mounting takes root, which a container may not have.
    GTEST_SKIP() << "cannot mount a small file system: " << std::strerror(errno);
  }
  EXPECT_EXIT(fill(place), testing::ExitedWithCode(0), "");
  EXPECT_EQ(::umount(place.c_str()), 0);
}

}  // namespace
}  // namespace raymill::storage
