// One SAH build by Embree over a span of triangles. Thread-compatible: one call per span at a time.
#pragma once

#include <span>
#include <vector>

#include "storage/base/status.h"
#include "storage/base/types.h"
#include "storage/base/vec3.h"
#include "storage/build/binary_tree.h"

struct RTCDeviceTy;

namespace raymill::storage {

/// Owns an Embree device that reports errors as Status.
class EmbreeDevice {
 public:
  static Result<EmbreeDevice> create();
  EmbreeDevice(EmbreeDevice&& other) noexcept;
  EmbreeDevice& operator=(EmbreeDevice&&) = delete;
  ~EmbreeDevice();
  [[nodiscard]] RTCDeviceTy* get() const { return device_; }

 private:
  explicit EmbreeDevice(RTCDeviceTy* device) : device_(device) {}
  RTCDeviceTy* device_;
};

/// Appends the run's tree to `nodes` (its root first) and reorders `triangles` into leaf order; leaves name triangles
/// by position in `triangles` plus `first_triangle`, children by position in `nodes`.
/// Equal spans give equal trees: the build runs on the calling thread alone.
Status build_run(const EmbreeDevice& device, std::span<Triangle> triangles, std::uint32_t first_triangle,
                 std::vector<BinaryNode>& nodes);

}  // namespace raymill::storage
