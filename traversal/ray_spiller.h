// RaySpiller: takes waiting rays of a tracer to disk when memory is short, and brings them back when it is their turn.
//
//   memory short        the group with the most rays in memory goes:          detach, store, retire
//   no more rays come   the group whose turn it is (group_turns.h) comes back:  begin_fetch, fetch, accept
//
// Rays go whose pages are not there. Those of other pages go as well where there is no room for another batch: a record
// may be several times as long when it comes back from one, so a job's memory can be full of rays that could run.
// A thread of its own does the transfers: a worker never waits for a disk. Thread-safe by the tracer's mutex.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <thread>

#include "storage/base/mapped_memory.h"
#include "traversal/trace_job.h"

namespace raymill::traversal {

class StoreTracer;

class RaySpiller {
 public:
  /// So many rays make a page worth reading at any time.
  static constexpr std::uint32_t kServedRays = 1024;
  /// With fewer chunks free no batch begins.
  static constexpr std::uint32_t kLeastRoom = 64;
  /// What push() needs for a piece.
  static constexpr std::uint32_t kPushChunks = 256;

  /// `buffer`: of an extent.
  RaySpiller(StoreTracer& tracer, storage::MappedMemory buffer);
  /// The tracer's mutex must be free; stop() alike, after which its thread is gone.
  ~RaySpiller();
  void stop();
  RaySpiller(const RaySpiller&) = delete;
  RaySpiller& operator=(const RaySpiller&) = delete;

  // Under the tracer's mutex:

  /// Something changed that may make it go on.
  void wake() { wake_.notify_one(); }
  /// False: looking would find nothing. Waking it for each batch costs more than the batch's bookkeeping.
  [[nodiscard]] bool may_have_work() const;
  [[nodiscard]] std::uint64_t rays_on_disk() const;

 private:
  /// Pages whose rays may go.
  enum class Pages : std::uint8_t { absent, all };
  struct Turn {
    std::shared_ptr<TraceJob> job;
    std::uint32_t group;
    Pages pages = Pages::absent;  ///< for rays that go
  };
  void run();
  [[nodiscard]] std::uint32_t chunks_needed(const TraceJob& job) const;
  [[nodiscard]] std::optional<Turn> next_out() const;
  [[nodiscard]] std::optional<std::uint32_t> fullest_group(const TraceJob& job, Pages pages) const;
  [[nodiscard]] bool may_go(storage::PageId page, Pages pages) const;
  [[nodiscard]] bool any_may_go(const TraceJob& job, std::uint32_t group, Pages pages) const;
  [[nodiscard]] std::optional<Turn> next_in();
  [[nodiscard]] std::optional<Turn> extent_of_active() const;
  [[nodiscard]] bool has_room_for(const Turn& turn) const;
  void send(const Turn& turn, std::unique_lock<std::mutex>& lock);
  void bring(const Turn& turn, std::unique_lock<std::mutex>& lock);
  void end_transfer(const Turn& turn, const Status& status);
  [[nodiscard]] std::span<std::byte> buffer() const { return {buffer_.data(), buffer_.size()}; }

  StoreTracer& tracer_;
  const storage::MappedMemory buffer_;
  std::condition_variable wake_;
  bool wants_room_ = false;  // for an extent of the active group
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace raymill::traversal
