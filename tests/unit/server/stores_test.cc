// Store names, the table of open stores, and the spool: the parts of the server that deal with files.
#include <gtest/gtest.h>

#include <array>
#include <filesystem>

#include "server/job_table.h"
#include "server/spool.h"
#include "server/store_names.h"
#include "server/store_table.h"
#include "tests/unit/server/harness.h"

namespace raymill::server {
namespace {

TEST(StoreNames, HaveOneSpelling) {
  EXPECT_EQ(*canonical_store_name("city"), "city");
  EXPECT_EQ(*canonical_store_name("city.mill"), "city");
  EXPECT_EQ(*canonical_store_name("maps/old city.mill"), "maps/old city");
  for (const char* name :
       {"", ".", "..", "/city", "maps/../city", "maps//city", "maps/", "./city", ".mill", "a/.mill"}) {
    EXPECT_EQ(canonical_store_name(name).status().code(), ErrorCode::invalid_argument) << name;
  }
  EXPECT_FALSE(canonical_store_name(std::string_view("a\0b", 3)).ok());
  EXPECT_FALSE(canonical_store_name(std::string(5000, 'x')).ok());
}

TEST(StoreNames, LinksLeadOutOfTheDirectoryOnlyInVain) {
  const TemporaryFolder folder;
  folder.write("stores/city.mill", "x");
  folder.write("secret.mill", "x");
  const auto stores = folder.path() / "stores";
  std::filesystem::create_symlink("../secret.mill", stores / "out.mill");
  std::filesystem::create_symlink("city.mill", stores / "alias.mill");
  std::filesystem::create_directory(stores / "folder.mill");
  EXPECT_TRUE(store_path(stores.string(), "city").ok());
  EXPECT_TRUE(store_path(stores.string(), "alias").ok());
  EXPECT_EQ(store_path(stores.string(), "out").status().code(), ErrorCode::invalid_argument);
  EXPECT_EQ(store_path(stores.string(), "folder").status().code(), ErrorCode::invalid_argument);
  EXPECT_EQ(store_path(stores.string(), "none").status().code(), ErrorCode::not_found);
  EXPECT_EQ(list_stores(stores.string()).names, (std::vector<std::string>{"alias", "city"}));
}

TEST(StoreTable, ClosesTheLongestIdleForANewOneAndTheRestInTime) {
  const TemporaryFolder folder;
  for (const char* name : {"a.mill", "b.mill", "c.mill"}) {
    folder.write(name, name);
  }
  const auto state = std::make_shared<FakeState>();
  FakeService service(state);
  TimePoint now{};
  StoreTable table(service, {folder.path().string(), 2, std::chrono::milliseconds(1000)}, [&now] { return now; });
  ASSERT_TRUE(table.reserve("a") && table.reserve("b"));
  ASSERT_TRUE(table.open("a").ok() && table.open("b").ok());
  EXPECT_FALSE(table.reserve("c"));
  EXPECT_TRUE(table.reserve("a"));
  EXPECT_EQ(state->opens, 2);
  table.release("a");
  table.release("a");
  now += std::chrono::milliseconds(10);
  table.release("b");
  ASSERT_TRUE(table.reserve("c"));
  ASSERT_TRUE(table.open("c").ok());
  EXPECT_EQ(state->most_open_stores, 2);
  EXPECT_EQ(table.open_count(), 2u);
  now += std::chrono::milliseconds(995);
  EXPECT_EQ(table.close_idle(), std::chrono::milliseconds(5));
  EXPECT_EQ(state->open_stores, 2);
  now += std::chrono::milliseconds(5);
  table.close_idle();
  EXPECT_EQ(state->open_stores, 1);
  table.release("c");
}

TEST(StoreTable, AStoreThatCannotBeOpenedLeavesItsSlot) {
  const TemporaryFolder folder;
  folder.write("bad.mill", "corrupt");
  FakeService service(std::make_shared<FakeState>());
  StoreTable table(service, {folder.path().string(), 1, std::chrono::milliseconds(1000)}, [] { return TimePoint{}; });
  ASSERT_TRUE(table.reserve("bad"));
  EXPECT_EQ(table.open("bad").status().code(), ErrorCode::corrupt);
  table.release("bad");
  EXPECT_TRUE(table.reserve("other"));
}

TEST(Spool, KeepsWhatIsCommittedAndClearsWhatIsStale) {
  const TemporaryFolder folder;
  const std::string job = "00112233445566aa";
  const std::string stale = "raymill-spool-0123456789abcdef";
  folder.write(stale + "/lock", "");
  folder.write(stale + "/" + job + ".rows.part", "x");
  folder.write("raymill-spool-0123456789abcdee/lock", "");
  folder.write("raymill-spool-0123456789abcdee/precious.txt", "x");
  folder.write("raymill-spool-mine/lock", "x");
  {
    auto spool = Spool::create(folder.path().string(), random_id());
    ASSERT_TRUE(spool.ok()) << spool.status().message();
    EXPECT_FALSE(std::filesystem::exists(folder.path() / stale));
    EXPECT_TRUE(std::filesystem::exists(folder.path() / "raymill-spool-0123456789abcdee/precious.txt"));
    EXPECT_TRUE(std::filesystem::exists(folder.path() / "raymill-spool-mine/lock"));
    {
      auto writer = (*spool)->write(job);
      ASSERT_TRUE(writer.ok());
      const std::array<std::byte, 3> bytes{std::byte{1}, std::byte{2}, std::byte{3}};
      ASSERT_TRUE(writer->append(bytes).ok());
      ASSERT_TRUE(writer->commit().ok());
    }
    std::array<std::byte, 2> read{};
    ASSERT_TRUE((*spool)->read(job, 1, read).ok());
    EXPECT_EQ(read[1], std::byte{3});
    EXPECT_EQ((*spool)->read(job, 2, read).code(), ErrorCode::corrupt);
    { const auto dropped = (*spool)->write("ffffffffffffffff"); }
    EXPECT_FALSE(std::filesystem::exists((*spool)->folder() + "/ffffffffffffffff.rows.part"));
    // A second server beside it leaves it alone.
    const auto second = Spool::create(folder.path().string(), random_id());
    ASSERT_TRUE(second.ok());
    EXPECT_TRUE((*spool)->read(job, 1, read).ok());
    (*spool)->remove(job);
    EXPECT_EQ((*spool)->read(job, 0, read).code(), ErrorCode::io);
  }
  EXPECT_TRUE(std::filesystem::exists(folder.path() / "raymill-spool-mine/lock"));
}

}  // namespace
}  // namespace raymill::server
