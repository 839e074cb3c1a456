// EngineJob: the public Job over a TraceJob.
//
// push() writes rays straight into the root page's queue; next() hands out the window's chunks in order. Waiting
// happens on the job's own condition. push() and next() may run in two threads.
#pragma once

#include <memory>
#include <mutex>
#include <vector>

#include "traversal/service.h"
#include "traversal/store_tracer.h"
#include "traversal/trace_job.h"

namespace raymill::traversal {

class EngineJob final : public Job {
 public:
  EngineJob(std::shared_ptr<StoreTracer> tracer, std::shared_ptr<TraceJob> job);
  ~EngineJob() override;

  Status push(std::span<const Ray> rays) override;
  Status push_with(std::span<const Ray> rays, const RayExtras& extras) override;
  Status finish() override;
  std::optional<HitChunk> next() override;
  [[nodiscard]] Status status() const override;
  [[nodiscard]] JobProgress progress() const override;
  [[nodiscard]] JobStats stats() const override;
  void cancel() override;

 private:
  class ChunkOwner;
  struct Piece;
  /// Rays whose numbers follow each other.
  struct Numbered {
    std::span<const Ray> rays;
    RayExtras extras;  // of these rays, and more after them
    std::uint32_t first_number = 0;
  };
  Status push_all(std::span<const Ray> rays, const RayExtras& extras);
  Result<Numbered> take_in(std::span<const Ray> rays);
  Status make_room(std::unique_lock<std::mutex>& lock);
  Piece pack(const Numbered& some, std::span<const std::uint32_t> order, std::size_t first, std::size_t count);
  Status enqueue(const Piece& piece);
  Status push_piece(const Numbered& some, std::span<const std::uint32_t> order, std::size_t first, std::size_t count);
  std::optional<HitChunk> next_piece(std::unique_lock<std::mutex>& lock);
  void fail(std::unique_lock<std::mutex>& lock, const Status& status);
  void end(std::unique_lock<std::mutex>& lock, const Status& status);

  std::shared_ptr<StoreTracer> tracer_;
  std::shared_ptr<TraceJob> job_;
  std::vector<std::byte> records_;  // of one piece of a push
  RayOrder order_;
};

}  // namespace raymill::traversal
