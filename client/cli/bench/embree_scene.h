// EmbreeScene: triangles in Embree as its users have them: default build, one geometry.
//
// The arrays that it was built from are dropped: leaves hold copies of the corners,
// so that a ray reads the tree alone.
// Thread-safe once made.
#pragma once

#include <embree3/rtcore.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "client/cli/bench/store_triangles.h"
#include "storage/base/mapped_memory.h"
#include "storage/base/status.h"
#include "storage/import/scene_import.h"
#include "traversal/query.h"

namespace raymill::client {

class EmbreeScene {
 public:
  struct Config {
    std::string device = {};   ///< as rtcNewDevice() takes it, e.g. "isa=avx2"
    bool keep_arrays = false;  ///< vertices and indices stay in memory after the build
    bool robust = false;       ///< RTC_SCENE_FLAG_ROBUST
  };
  /// Of the triangles that `fill` hands to the sink; they are numbered in that order.
  static Result<EmbreeScene> create(const Config& config, const std::function<Status(storage::TriangleSink&)>& fill);
  /// Of placed objects: a scene of Embree each, and an instance for each place.
  static Result<EmbreeScene> create(const Config& config, const PlacedTriangles& scene);
  EmbreeScene(EmbreeScene&& other) noexcept;
  EmbreeScene& operator=(EmbreeScene&&) = delete;
  ~EmbreeScene();

  /// Whether the ray hits anything, by rtcIntersect1.
  [[nodiscard]] bool closest(const Ray& ray) const { return closest_hit(ray).primitive_id != kNoId; }
  /// t, u, v and the number of the triangle, by rtcIntersect1.
  [[nodiscard]] Hit closest_hit(const Ray& ray) const;
  /// Whether the ray hits anything, by rtcOccluded1.
  [[nodiscard]] bool any_hit(const Ray& ray) const;
  /// What Embree's own calls take and give.
  [[nodiscard]] RTCScene handle() const { return scene_; }
  static RTCRay embree_ray(const Ray& ray);
  static RTCRayHit embree_query(const Ray& ray);
  static Hit hit_of(const RTCRayHit& query);
  [[nodiscard]] std::uint64_t triangles() const { return triangles_; }
  [[nodiscard]] double build_seconds() const { return build_seconds_; }

 private:
  EmbreeScene() = default;
  Status make_device(const Config& config);
  /// The scene whose build began at `begin`.
  Status commit(std::chrono::steady_clock::time_point begin);

  storage::MappedMemory vertices_;
  storage::MappedMemory indices_;
  RTCDevice device_ = nullptr;
  RTCScene scene_ = nullptr;
  std::vector<RTCScene> objects_;
  std::uint64_t triangles_ = 0;
  double build_seconds_ = 0;
};

}  // namespace raymill::client
