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
  Status finish() override;
  std::optional<HitChunk> next() override;
  [[nodiscard]] Status status() const override;
  [[nodiscard]] JobProgress progress() const override;
  [[nodiscard]] JobStats stats() const override;
  void cancel() override;

 private:
  class ChunkOwner;
  struct Piece;
  Status make_room(std::unique_lock<std::mutex>& lock);
  void pack(std::span<const Ray> rays, Piece& piece);
  Status enqueue(const Piece& piece);
  Status push_some(std::span<const Ray> rays);
  void end(std::unique_lock<std::mutex>& lock, const Status& status);

  std::shared_ptr<StoreTracer> tracer_;
  std::shared_ptr<TraceJob> job_;
  std::vector<std::byte> records_;  // of one piece of a push
};

}  // namespace raymill::traversal
