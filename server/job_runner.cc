#include "server/job_runner.h"

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <optional>
#include <span>
#include <system_error>
#include <utility>
#include <vector>

#include "server/limits.h"
#include "server/list_frames.h"
#include "storage/base/checksum.h"

namespace raymill::server {

namespace {

/// The next values of a frame. ZeroMQ promises no alignment: where there is none, `copy` holds them.
template <typename T>
std::span<const T> take(std::span<const std::byte>& frame, std::size_t count, std::vector<T>& copy) {
  const std::byte* const data = frame.data();
  frame = frame.subspan(count * sizeof(T));
  if (reinterpret_cast<std::uintptr_t>(data) % alignof(T) == 0) {
    return {reinterpret_cast<const T*>(data), count};
  }
  copy.resize(count);
  std::memcpy(copy.data(), data, count * sizeof(T));
  return copy;
}

/// What a frame of rays holds, and where it is copied to if it must be.
class RayFrame {
 public:
  Status push_to(Job& job, const TraceConfig& config, const Frame& frame) {
    std::span<const std::byte> bytes = bytes_of(frame);
    const std::size_t count = bytes.size() / ray_bytes(config);
    if (config.float64) {
      const auto pushed = take(bytes, count, wide_rays_);
      return job.push64(pushed, extras(bytes, count, config));
    }
    const auto pushed = take(bytes, count, rays_);
    return config.skips || config.masks ? job.push_with(pushed, extras(bytes, count, config)) : job.push(pushed);
  }

 private:
  RayExtras extras(std::span<const std::byte>& bytes, std::size_t count, const TraceConfig& config) {
    RayExtras brought;
    if (config.skips) {
      brought.skipped = take(bytes, count, skipped_);
    }
    if (config.masks) {
      brought.masks = take(bytes, count, masks_);
    }
    return brought;
  }

  std::vector<Ray> rays_;
  std::vector<Ray64> wide_rays_;
  std::vector<PrimitiveIds> skipped_;
  std::vector<std::uint32_t> masks_;
};
static_assert(sizeof(Ray64) == 64 && offsetof(Ray64, tnear) == 24 && offsetof(Ray64, tfar) == 56);
static_assert(sizeof(PrimitiveIds) == 8 && offsetof(PrimitiveIds, geometry_id) == 0);

Status cancelled_status() { return {ErrorCode::cancelled, "the job was cancelled"}; }

}  // namespace

JobRunner::JobRunner(JobSpec spec, StoreTable& stores, const Spool& spool, EventQueue& events)
    : spec_(std::move(spec)), stores_(stores), spool_(spool), events_(events), rows_limit_(spec_.rows_limit) {
  result_thread_ = std::thread([this] { run(); });
}

JobRunner::~JobRunner() {
  cancel();
  result_thread_.join();
}

void JobRunner::offer(Frame rays) {
  {
    const std::lock_guard lock(mutex_);
    chunks_.push_back(std::move(rays));
  }
  changed_.notify_all();
}

void JobRunner::finish() {
  {
    const std::lock_guard lock(mutex_);
    finished_ = true;
  }
  changed_.notify_all();
}

void JobRunner::accept_rows(std::uint64_t limit) {
  {
    const std::lock_guard lock(mutex_);
    rows_limit_ = std::max(rows_limit_, limit);
  }
  changed_.notify_all();
}

void JobRunner::cancel() {
  {
    const std::lock_guard lock(mutex_);
    cancelled_ = true;
    chunks_.clear();
    if (job_ != nullptr) {
      job_->cancel();
    }
  }
  changed_.notify_all();
}

std::uint64_t JobRunner::rays_done() const {
  const std::lock_guard lock(mutex_);
  return job_ != nullptr ? job_->progress().rays_done : rays_done_;
}

void JobRunner::run() {
  RunEnded end;
  end.status = trace(end.stats);
  end.total_rows = rows_given_;
  stores_.release(spec_.store);
  post(std::move(end));
}

Status JobRunner::trace(JobStats& stats) {
  RAYMILL_ASSIGN_OR_RETURN(const std::shared_ptr<Store> store, stores_.open(spec_.store));
  RAYMILL_ASSIGN_OR_RETURN(const std::unique_ptr<Job> job, store->trace(spec_.trace));
  {
    const std::lock_guard lock(mutex_);
    if (cancelled_) {
      return cancelled_status();
    }
    job_ = job.get();
  }
  std::thread push_thread;
  try {
    push_thread = std::thread([this, &job] { push_chunks(*job); });
  } catch (const std::system_error& error) {
    const std::lock_guard lock(mutex_);
    job_ = nullptr;
    return {ErrorCode::busy_retry, std::string("the server has no thread for the job: ") + error.what()};
  }
  post(RunStarted{});
  Status status = take_results(*job);
  {
    const std::lock_guard lock(mutex_);
    if (!push_status_.ok()) {
      status = push_status_;
    }
    cancelled_ = true;  // the push thread has nothing left to wait for
    rays_done_ = job->progress().rays_done;
    job_ = nullptr;
  }
  changed_.notify_all();
  if (!status.ok()) {
    job->cancel();
  }
  push_thread.join();
  stats = job->stats();
  return status;
}

void JobRunner::push_chunks(Job& job) {
  RayFrame copy;
  while (true) {
    std::optional<Frame> chunk;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [this] { return cancelled_ || finished_ || !chunks_.empty(); });
      if (cancelled_) {
        return;
      }
      if (!chunks_.empty()) {
        chunk.emplace(std::move(chunks_.front()));
        chunks_.pop_front();
      }
    }
    const Status status = chunk ? copy.push_to(job, spec_.trace, *chunk) : job.finish();
    if (!status.ok()) {
      fail_push(job, status);
      return;
    }
    if (!chunk) {
      return;
    }
    chunk.reset();  // before its place is given to the next one
    post(ChunkTaken{});
  }
}

void JobRunner::fail_push(Job& job, const Status& status) {
  {
    const std::lock_guard lock(mutex_);
    if (!cancelled_) {
      push_status_ = status;
      cancelled_ = true;  // the result thread may be waiting for a client that waits for this
    }
  }
  changed_.notify_all();
  job.cancel();
}

Status JobRunner::take_results(Job& job) {
  std::optional<SpoolWriter> spool;
  if (spec_.detached) {
    RAYMILL_ASSIGN_OR_RETURN(SpoolWriter writer, spool_.write(spec_.id));
    spool.emplace(std::move(writer));
  }
  while (true) {
    if (!spool) {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [this] { return cancelled_ || messages_sent_ < rows_limit_; });
    }
    std::optional<HitChunk> chunk = job.next();
    if (!chunk) {
      break;
    }
    if (gives_lists(spec_.trace.query)) {
      RAYMILL_RETURN_IF_ERROR(send_lists(*chunk));
      rows_given_ += chunk->offsets().size() - 1 - (chunk->goes_on() ? 1 : 0);
      continue;
    }
    RAYMILL_RETURN_IF_ERROR(spool ? spool->append(chunk->rows()) : send_rows(*chunk));
    rows_given_ += chunk->size();
  }
  RAYMILL_RETURN_IF_ERROR(job.status());
  {
    const std::lock_guard lock(mutex_);
    if (cancelled_) {
      return cancelled_status();
    }
  }
  return spool ? spool->commit() : Status();
}

Status JobRunner::wait_for_reader() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return cancelled_ || messages_sent_ < rows_limit_; });
  return cancelled_ ? cancelled_status() : Status();
}

Status JobRunner::send_rows(const HitChunk& chunk) {
  const std::size_t row_bytes = chunk.layout().row_bytes();
  // Longer rows, of attributes, are fewer to a message.
  const std::size_t most = spec_.chunk_rays * kMostRowBytes / std::max<std::size_t>(row_bytes, kMostRowBytes);
  for (std::size_t row = 0; row < chunk.size();) {
    RAYMILL_RETURN_IF_ERROR(wait_for_reader());
    // Copied, so that the engine has its memory back at once: how long a client takes is not its business.
    const std::size_t count = std::min(chunk.size() - row, most);
    const auto bytes = chunk.rows().subspan(row * row_bytes, count * row_bytes);
    RowsReady rows{.index = messages_sent_++,
                   .first_ray = chunk.first_ray() + row,
                   .rows = count,
                   .checksum = storage::checksum(bytes),
                   .frame = Frame(bytes.data(), bytes.size())};
    post(std::move(rows));
    row += count;
  }
  return {};
}

Status JobRunner::send_lists(const HitChunk& chunk) {
  ListCutter cutter(chunk, spec_.chunk_rays * kMostRowBytes);
  while (cutter.next()) {
    RAYMILL_RETURN_IF_ERROR(wait_for_reader());
    Frame frame(cutter.bytes());
    cutter.write(bytes_of(frame));
    RowsReady rows{.index = messages_sent_++,
                   .first_ray = chunk.first_ray() + cutter.first(),
                   .rows = cutter.rows(),
                   .rays = cutter.rays(),
                   .goes_on = cutter.goes_on(),
                   .checksum = storage::checksum(bytes_of(std::as_const(frame))),
                   .frame = std::move(frame)};
    post(std::move(rows));
  }
  return {};
}

}  // namespace raymill::server
