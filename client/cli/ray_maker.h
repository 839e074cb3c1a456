// Batches of rays for tests and benchmarks: what a camera sees, what leaves there, and random segments.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string_view>

#include "client/cli/batch.h"
#include "client/cli/camera.h"
#include "storage/base/status.h"
#include "traversal/service.h"

namespace raymill::client {

enum class RayKind : std::uint8_t { primary, ao, bounce, random, shadow };

Result<RayKind> parse_ray_kind(std::string_view name);
std::string_view to_string(RayKind kind);
/// What such rays are traced for: shadow and ao ask for any hit.
Query query_of(RayKind kind);

struct RayOrder {
  RayKind kind = RayKind::primary;
  std::uint64_t count = 0;  ///< from 1
  std::uint64_t seed = 1;
  double radius = 0;  ///< reach of ao rays, scene units; 0: a tenth of the bounds' diagonal
};

/// The most even 16:9 picture of at least `count` pixels: the camera's for so many rays.
Extent picture_of(std::uint64_t count);

/// Makes the rays of an order, the same ones for the same order, store and camera. Keeps references to all three.
/// Thread-confined.
class RayMaker {
 public:
  RayMaker(const RayOrder& order, const StoreInfo& info, const Camera& camera);

  using Sink = std::function<Status(std::span<const Ray>)>;
  /// The share that is made, the rays so far, and the bytes read for them.
  using Observer = std::function<void(double, std::uint64_t, std::uint64_t)>;
  /// Hands order.count rays to `sink`. `buffer` is where they are made; rays that leave hits are found by jobs of the
  /// store, whose figures go to `stats`.
  /// Errors: interrupted, the sink's, the jobs'; invalid_argument where the camera sees nothing.
  Status make(Store& store, std::span<Ray> buffer, const Sink& sink, const Observer& observer, RunStats& stats) const;

 private:
  [[nodiscard]] Ray primary(std::uint64_t index, std::uint64_t pass) const;
  [[nodiscard]] Ray segment(std::uint64_t index) const;
  [[nodiscard]] Ray secondary(const Ray& ray, const Hit& hit, std::uint64_t index, std::uint64_t pass) const;
  Status make_direct(std::span<Ray> buffer, const Sink& sink, const Observer& observer) const;
  Status make_secondary(Store& store, std::span<Ray> buffer, const Sink& sink, const Observer& observer,
                        RunStats& stats) const;

  const RayOrder& order_;
  const StoreInfo& info_;
  const Camera& camera_;
  Extent extent_;
  double diagonal_;
};

}  // namespace raymill::client
