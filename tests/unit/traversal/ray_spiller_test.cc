// Rays in memory that is too small for them, whatever their pages are doing.
#include "traversal/ray_spiller.h"

#include <gtest/gtest.h>

#include <chrono>
#include <deque>
#include <mutex>
#include <thread>

#include "tests/support/instances.h"
#include "tests/support/rays.h"
#include "traversal/store_tracer.h"

namespace raymill::traversal {
namespace {

using storage::Ledger;
using storage::PageId;

// A disk that gives the pages it is asked for one by one, as it is told to.
class Held {
 public:
  void set_reader(storage::PageReader* reader) { reader_ = reader; }
  void start(PageId page) {
    {
      const std::lock_guard lock(mutex_);
      if (holds_) {
        asked_.push_back(page);
        return;
      }
    }
    reader_->start(page);
  }
  std::size_t asked() {
    const std::lock_guard lock(mutex_);
    return asked_.size();
  }
  // Gives the page that was asked for first of those that are held.
  void give_one() {
    std::unique_lock lock(mutex_);
    const PageId page = asked_.front();
    asked_.pop_front();
    lock.unlock();
    reader_->start(page);
  }
  void give_all() {
    std::unique_lock lock(mutex_);
    holds_ = false;
    lock.unlock();
    while (asked() > 0) {
      give_one();
    }
  }

 private:
  std::mutex mutex_;
  std::deque<PageId> asked_;
  bool holds_ = true;
  storage::PageReader* reader_ = nullptr;
};

class HeldReader : public storage::PageReader {
 public:
  HeldReader(std::shared_ptr<Held> held, std::unique_ptr<PageReader> disk)
      : held_(std::move(held)), disk_(std::move(disk)) {
    held_->set_reader(disk_.get());
  }
  [[nodiscard]] unsigned depth() const override { return disk_->depth(); }
  void start(PageId page) override { held_->start(page); }
  void release(const storage::PageArrival& arrival) override { disk_->release(arrival); }
  [[nodiscard]] std::uint64_t reads() const override { return disk_->reads(); }
  [[nodiscard]] std::string_view name() const override { return disk_->name(); }

 private:
  std::shared_ptr<Held> held_;
  std::unique_ptr<PageReader> disk_;
};

Result<std::unique_ptr<storage::PageReader>> make_held_reader(std::shared_ptr<Held> held,
                                                              Result<std::unique_ptr<storage::PageReader>> disk) {
  RAYMILL_RETURN_IF_ERROR(disk.status());
  return std::unique_ptr<storage::PageReader>(std::make_unique<HeldReader>(std::move(held), std::move(*disk)));
}

// An object in many places. Beside the scene's page and that of the object's root there are as many as are read at
// once.
tests::PlacedScene few_pages(tests::Random& random) {
  tests::PlacedScene scene;
  scene.objects = {{tests::soup(random, 700, 0.3F)}};
  for (int i = 0; i < 20; ++i) {
    scene.places.push_back({0, tests::random_matrix(random, 1)});
  }
  return scene;
}

bool until(const std::function<bool()>& condition) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::minutes(1);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > end) {
      return false;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}

// Rays wait as small records at pages that are there and as large ones, inside the object, at pages that are being
// read. No page is absent, and memory has no room for all rays as large ones.
TEST(RaySpiller, RaysThatGrowGoToDiskFromPagesThatAreThere) {
  tests::Random random(5);
  const tests::TempFolder folder;
  BuildConfig build = tests::small_pages();
  build.page_bytes = 32 << 10;
  const std::string path = tests::build_placed(folder, "scene.mill", few_pages(random), build);
  Ledger ledger(gibibytes(1));
  auto file = storage::StoreFile::open(path, ledger);
  ASSERT_TRUE(file.ok()) << file.status().message();
  const std::uint32_t page_count = (*file)->page_count();
  ASSERT_EQ(page_count, 4U);
  const StoreShare share{least_share_bytes(**file, 1, 1), 1, 1};
  TraceConfig asked;
  asked.fields = Field::all;
  const auto plan = plan_budget(**file, share);
  ASSERT_TRUE(plan.ok());
  const std::uint32_t chunks = plan_job(*plan, page_count, {.fields = asked.fields}).waiting.pool_chunks;
  ASSERT_LT(chunks, 4000U);
  std::vector<Ray> rays;  // as many as push() takes while no page is there: half of the memory
  for (std::uint32_t i = 0; i < chunks / 2 * RayPool::records_per_chunk(RecordLayout::kLeastBytes); ++i) {
    rays.push_back(tests::ray_towards(random.in_box(-5, 5), random.in_box(-1, 1)));
  }
  const tests::Traced plenty = tests::trace(path, rays);
  ASSERT_TRUE(plenty.status.ok()) << plenty.status.message();

  const auto held = std::make_shared<Held>();
  StoreTracer::Config config;
  config.share = share;
  config.isa = runnable_isas().back();
  config.spill_directory = folder.path();
  config.make_reader = [held](auto store, storage::ReaderKind kind, unsigned depth, Ledger& of, auto done) {
    return make_held_reader(held, storage::make_page_reader(std::move(store), kind, depth, of, std::move(done)));
  };
  auto tracer = StoreTracer::create(std::move(*file), config, ledger);
  ASSERT_TRUE(tracer.ok()) << tracer.status().message();
  auto job = (*tracer)->start(asked, *tracer);
  ASSERT_TRUE(job.ok()) << job.status().message();

  ASSERT_TRUE((*job)->push(rays).ok());
  for (int of_scene_and_object = 0; of_scene_and_object < 2; ++of_scene_and_object) {
    ASSERT_TRUE(until([&] { return held->asked() > 0; }));
    held->give_one();
  }
  EXPECT_TRUE(until([&] { return (*job)->stats().ray_spill_bytes > 0 || !(*job)->status().ok(); }));
  held->give_all();
  ASSERT_TRUE((*job)->finish().ok());
  std::vector<Hit> hits;
  while (const auto chunk = (*job)->next()) {
    for (std::size_t i = 0; i < chunk->size(); ++i) {
      hits.push_back(chunk->hit(i));
    }
  }
  ASSERT_TRUE((*job)->status().ok()) << (*job)->status().message();
  ASSERT_EQ(hits.size(), plenty.hits.size());
  for (std::size_t i = 0; i < hits.size(); ++i) {
    ASSERT_TRUE(tests::same_bits(hits[i], plenty.hits[i])) << "ray " << i;
  }
}

}  // namespace
}  // namespace raymill::traversal
