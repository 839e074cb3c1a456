// EngineJob: the public Job over a TraceJob.
//
// push() writes rays straight into the root page's queue, or into blocks for the expanded layout where there is one;
// next() hands out the window's chunks in order. Waiting
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
  Status push64(std::span<const Ray64> rays, const RayExtras& extras) override;
  Status finish() override;
  std::optional<HitChunk> next() override;
  [[nodiscard]] Status status() const override;
  [[nodiscard]] JobProgress progress() const override;
  [[nodiscard]] JobStats stats() const override;
  void cancel() override;

 private:
  class ChunkOwner;
  /// Rays as they are pushed, in one of two types, and how they come into the store's space.
  struct Pushed {
    std::span<const Ray> rays;
    std::span<const Ray64> rays64;
    std::array<double, 3> origin{};
    bool moves = false;  // the origin is not zero

    [[nodiscard]] std::size_t size() const { return rays.size() + rays64.size(); }
    [[nodiscard]] Pushed part(std::size_t first, std::size_t count) const;
    [[nodiscard]] Ray operator[](std::size_t index) const;
    /// What float32 leaves of a ray's org.
    [[nodiscard]] std::array<float, 3> rest(std::size_t index) const;
  };
  /// Rays whose numbers follow each other.
  struct Numbered {
    Pushed rays;
    RayExtras extras;  // of these rays, and more after them
    std::uint32_t first_number = 0;

    [[nodiscard]] PrimitiveIds skipped(std::uint32_t index) const {
      return extras.skipped.empty() ? PrimitiveIds() : extras.skipped[index];
    }
    [[nodiscard]] std::uint32_t mask(std::uint32_t index) const {
      return extras.masks.empty() ? kAllMask : extras.masks[index];
    }
  };
  struct Slice;
  [[nodiscard]] Pushed pushed(std::span<const Ray> rays, std::span<const Ray64> rays64) const;
  [[nodiscard]] Status check(const RayExtras& extras, std::size_t rays) const;
  Status push_all(const Pushed& rays, const RayExtras& extras);
  Result<Numbered> take_in(const Pushed& rays);
  [[nodiscard]] bool has_room() const;
  Status make_room(std::unique_lock<std::mutex>& lock);
  Status push_slice(const Slice& slice);
  Status push_fresh(const Slice& slice, std::unique_lock<std::mutex>& lock);
  Status push_records(const Slice& slice, std::unique_lock<std::mutex>& lock);
  std::uint32_t pack(const Slice& slice);
  Status account(std::size_t rays);
  void enqueue(std::uint32_t count);
  std::optional<HitChunk> next_piece(std::unique_lock<std::mutex>& lock);
  void fail(std::unique_lock<std::mutex>& lock, const Status& status);
  void end(std::unique_lock<std::mutex>& lock, const Status& status);

  std::shared_ptr<StoreTracer> tracer_;
  std::shared_ptr<TraceJob> job_;
  // Of one slice of a push:
  std::vector<std::byte> records_;
  std::vector<std::uint32_t> invalid_;  // numbers
  RayOrder order_;
};

}  // namespace raymill::traversal
