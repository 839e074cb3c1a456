// EmbreePeer: the same triangles and rays, answered by Embree in robust mode. Thread-safe once made.
#pragma once

#include <embree3/rtcore.h>

#include <cstdint>
#include <optional>
#include <span>

#include "storage/base/status.h"
#include "storage/base/vec3.h"
#include "traversal/query.h"

namespace raymill::trial {

class EmbreePeer {
 public:
  static Result<EmbreePeer> create(std::span<const storage::Triangle> triangles);
  EmbreePeer(EmbreePeer&& other) noexcept;
  EmbreePeer& operator=(EmbreePeer&&) = delete;
  ~EmbreePeer();

  /// The place of the triangle that is hit first.
  [[nodiscard]] std::optional<std::uint32_t> closest(const Ray& ray) const;
  [[nodiscard]] bool any(const Ray& ray) const;

 private:
  EmbreePeer() = default;
  RTCDevice device_ = nullptr;
  RTCScene scene_ = nullptr;
};

}  // namespace raymill::trial
