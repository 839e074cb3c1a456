#include "tests/unit/server/fake_service.h"

#include <algorithm>
#include <deque>
#include <fstream>
#include <iterator>
#include <utility>

namespace raymill::server {

namespace {

/// Rows of a HitChunk: no divisor of a chunk's rays, so that borders never match.
constexpr std::size_t kRowsPerChunk = 1000;
constexpr std::uint64_t kRaysBeforeFailure = 5000;

class RowsOwner final : public HitChunk::Owner {
 public:
  RowsOwner(std::vector<std::byte> bytes, std::shared_ptr<FakeState> state)
      : bytes_(std::move(bytes)), state_(std::move(state)) {
    ++state_->held_chunks;
  }
  ~RowsOwner() override { --state_->held_chunks; }
  [[nodiscard]] std::span<const std::byte> bytes() const { return bytes_; }

 private:
  std::vector<std::byte> bytes_;
  std::shared_ptr<FakeState> state_;
};

class FakeJob final : public Job {
 public:
  FakeJob(std::shared_ptr<FakeState> state, const TraceConfig& config, std::uint32_t store_bytes, bool failing)
      : state_(std::move(state)),
        layout_(config.query == Query::any ? Field::t : config.fields),
        store_bytes_(store_bytes),
        failing_(failing) {
    ++state_->live_jobs;
  }
  ~FakeJob() override { --state_->live_jobs; }

  Status push(std::span<const Ray> rays) override {
    {
      std::unique_lock lock(state_->mutex);
      state_->changed.wait(lock, [this] { return !state_->held || cancelled_; });
    }
    const std::lock_guard lock(mutex_);
    RAYMILL_RETURN_IF_ERROR(status_);
    for (const Ray& ray : rays) {
      rows_.resize(rows_.size() + layout_.row_bytes());
      layout_.write(expected_hit(static_cast<std::uint64_t>(ray.org[0]), store_bytes_),
                    rows_.data() + rows_.size() - layout_.row_bytes());
      if (rows_.size() == kRowsPerChunk * layout_.row_bytes()) {
        close_chunk();
      }
    }
    pushed_ += rays.size();
    state_->rays_traced += rays.size();
    if (failing_ && pushed_ > kRaysBeforeFailure) {
      status_ = {ErrorCode::io, "the disk of the fake store failed"};
    }
    changed_.notify_all();
    return status_;
  }

  Status finish() override {
    const std::lock_guard lock(mutex_);
    close_chunk();
    finished_ = true;
    changed_.notify_all();
    return status_;
  }

  std::optional<HitChunk> next() override {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return !chunks_.empty() || finished_ || !status_.ok(); });
    if (!status_.ok() || chunks_.empty()) {
      return std::nullopt;
    }
    auto owner = std::make_unique<RowsOwner>(std::move(chunks_.front()), state_);
    chunks_.pop_front();
    const auto bytes = owner->bytes();
    const std::uint64_t first = given_;
    given_ += bytes.size() / layout_.row_bytes();
    return HitChunk(next_index_++, first, layout_, bytes, std::move(owner));
  }

  [[nodiscard]] Status status() const override {
    const std::lock_guard lock(mutex_);
    return status_;
  }
  [[nodiscard]] JobProgress progress() const override {
    const std::lock_guard lock(mutex_);
    return {pushed_, pushed_};
  }
  [[nodiscard]] JobStats stats() const override {
    const std::lock_guard lock(mutex_);
    JobStats stats;
    stats.rays = pushed_;
    stats.hits = pushed_;
    stats.kernel = "fake";
    return stats;
  }
  void cancel() override {
    {
      const std::lock_guard lock(state_->mutex);
      cancelled_ = true;
    }
    state_->changed.notify_all();
    const std::lock_guard lock(mutex_);
    if (status_.ok()) {
      status_ = {ErrorCode::cancelled, "cancelled"};
    }
    changed_.notify_all();
  }

 private:
  void close_chunk() {
    if (!rows_.empty()) {
      chunks_.push_back(std::move(rows_));
      rows_.clear();
    }
  }

  const std::shared_ptr<FakeState> state_;
  const HitLayout layout_;
  const std::uint32_t store_bytes_;
  const bool failing_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<std::byte> rows_;
  std::deque<std::vector<std::byte>> chunks_;
  std::uint64_t pushed_ = 0;
  std::uint64_t given_ = 0;
  std::uint64_t next_index_ = 0;
  bool finished_ = false;
  bool cancelled_ = false;  ///< guarded by the state's mutex
  Status status_;
};

class FakeStore final : public Store {
 public:
  FakeStore(std::shared_ptr<FakeState> state, const std::string& text)
      : state_(std::move(state)),
        bytes_(static_cast<std::uint32_t>(text.size())),
        failing_(text.starts_with("failing")) {
    ++state_->opens;
    const int open = ++state_->open_stores;
    int most = state_->most_open_stores;
    while (open > most && !state_->most_open_stores.compare_exchange_weak(most, open)) {
    }
  }
  ~FakeStore() override { --state_->open_stores; }

  [[nodiscard]] Result<StoreInfo> info() const override {
    StoreInfo info;
    info.name = "fake";
    info.triangles = bytes_;
    info.features = {"none"};
    info.bounds_max = {1, 2, 3};
    info.metadata_json = R"({"geometries":[]})";
    return info;
  }
  Result<std::unique_ptr<Job>> trace(const TraceConfig& config) override {
    return std::unique_ptr<Job>(std::make_unique<FakeJob>(state_, config, bytes_, failing_));
  }

 private:
  const std::shared_ptr<FakeState> state_;
  const std::uint32_t bytes_;
  const bool failing_;
};

}  // namespace

Result<std::shared_ptr<Store>> FakeService::open(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  const std::string text((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  if (text.starts_with("corrupt")) {
    return {ErrorCode::corrupt, "the fake store is corrupt"};
  }
  return std::shared_ptr<Store>(std::make_shared<FakeStore>(state_, text));
}

std::vector<Ray> numbered_rays(std::uint64_t first, std::size_t count) {
  std::vector<Ray> rays(count);
  for (std::size_t i = 0; i < count; ++i) {
    rays[i].org[0] = static_cast<float>(first + i);
    rays[i].dir[2] = 1;
  }
  return rays;
}

Hit expected_hit(std::uint64_t number, std::uint32_t store_bytes) {
  Hit hit;
  hit.t = 2 * static_cast<float>(number) + 1;
  hit.primitive_id = static_cast<std::uint32_t>(number);
  hit.geometry_id = store_bytes;
  return hit;
}

}  // namespace raymill::server
