// FakeService: a tracer whose hits follow a formula, so that the server can be tested without one.
//
// The hit of a ray depends on nothing but the ray and the store: t = 2 org.x + 1, primitive_id = org.x, geometry_id =
// the length of the store's file. A file that begins with "corrupt" cannot be opened; one that begins with "failing"
// ends its jobs with io after a few rays. Like the engine it keeps unfetched results itself, without bound.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "traversal/service.h"

namespace raymill::server {

/// What a test sees of the fake, and how it holds it back. Thread-safe.
struct FakeState {
  std::atomic<int> opens = 0;  ///< so far
  std::atomic<int> open_stores = 0;
  std::atomic<int> most_open_stores = 0;
  std::atomic<int> live_jobs = 0;
  std::atomic<std::uint64_t> rays_traced = 0;
  std::atomic<std::uint64_t> held_chunks = 0;  ///< HitChunks that nobody has destroyed yet
  std::mutex mutex;
  std::condition_variable changed;
  bool held = false;  ///< push() waits while this is set

  void hold(bool value) {
    {
      const std::lock_guard lock(mutex);
      held = value;
    }
    changed.notify_all();
  }
};

class FakeService final : public Service {
 public:
  explicit FakeService(std::shared_ptr<FakeState> state) : state_(std::move(state)) {}
  Result<std::shared_ptr<Store>> open(const std::string& path) override;

 private:
  const std::shared_ptr<FakeState> state_;
};

/// Rays whose hits can be told: org.x counts up from `first`.
std::vector<Ray> numbered_rays(std::uint64_t first, std::size_t count);
/// The hit of a numbered ray in a store whose file has `store_bytes`.
Hit expected_hit(std::uint64_t number, std::uint32_t store_bytes);

}  // namespace raymill::server
