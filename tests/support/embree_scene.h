// EmbreeScene: a scene file in Embree as its users have it: default build, one geometry.
//
// The arrays that it was built from are dropped: leaves hold copies of the corners,
// so that a ray reads the tree alone.
// Thread-safe once made.
#pragma once

#include <embree3/rtcore.h>

#include <cstdint>
#include <string>
#include <vector>

#include "storage/base/mapped_memory.h"
#include "storage/base/status.h"
#include "traversal/query.h"

namespace raymill::bench {

class EmbreeScene {
 public:
  struct Config {
    std::vector<std::string> scenes;
    std::string device = {};   ///< as rtcNewDevice() takes it, e.g. "isa=avx2"
    bool keep_arrays = false;  ///< vertices and indices stay in memory after the build
    bool robust = false;       ///< RTC_SCENE_FLAG_ROBUST
  };
  static Result<EmbreeScene> create(const Config& config);
  EmbreeScene(EmbreeScene&& other) noexcept;
  EmbreeScene& operator=(EmbreeScene&&) = delete;
  ~EmbreeScene();

  /// Whether the ray hits anything, by rtcIntersect1.
  [[nodiscard]] bool closest(const Ray& ray) const { return closest_hit(ray).primitive_id != kNoId; }
  /// t, u, v and the number of the triangle in the scenes' order, by rtcIntersect1.
  [[nodiscard]] Hit closest_hit(const Ray& ray) const;
  /// Whether the ray hits anything, by rtcOccluded1.
  [[nodiscard]] bool any_hit(const Ray& ray) const;
  [[nodiscard]] std::uint64_t triangles() const { return triangles_; }
  [[nodiscard]] double build_seconds() const { return build_seconds_; }

 private:
  EmbreeScene() = default;

  storage::MappedMemory vertices_;
  storage::MappedMemory indices_;
  RTCDevice device_ = nullptr;
  RTCScene scene_ = nullptr;
  std::uint64_t triangles_ = 0;
  double build_seconds_ = 0;
};

}  // namespace raymill::bench
