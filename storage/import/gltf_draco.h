// GltfDraco: KHR_draco_mesh_compression by libdraco, behind checks of our own.
//
// Draco trusts its stream with sizes: a few bytes can ask for gigabytes. Here the stream's own counts are read first
// and claimed, and the attributes' storage is claimed between the connectivity and the attributes, where draco knows
// it and has not allocated it. Exceptions and failed statuses end here. Thread-confined.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "storage/base/ledger.h"
#include "storage/base/status.h"
#include "storage/import/transform.h"

namespace raymill::storage {

/// What of a stream is wanted.
struct DracoAttribute {
  std::uint32_t id = 0;
  std::uint32_t components = 3;  ///< 2 to 4
};

class DracoMesh {
 public:
  /// Decodes `stream`. Faces keep the decoder's order.
  /// Errors: bad_scene (not a Draco mesh, damaged, no such attribute), unsupported (a newer Draco), budget_exceeded.
  static Result<DracoMesh> decode(std::span<const std::byte> stream, const DracoAttribute& attribute, Ledger& ledger);
  /// Of positions.
  static Result<DracoMesh> decode(std::span<const std::byte> stream, std::uint32_t position_attribute_id,
                                  Ledger& ledger) {
    return decode(stream, DracoAttribute{position_attribute_id, 3}, ledger);
  }

  DracoMesh(DracoMesh&&) noexcept;
  DracoMesh& operator=(DracoMesh&&) noexcept;
  ~DracoMesh();

  [[nodiscard]] std::uint32_t point_count() const;
  [[nodiscard]] std::uint32_t face_count() const;
  /// Corners of a face; each below point_count().
  [[nodiscard]] std::array<std::uint32_t, 3> face(std::uint32_t face) const;
  /// The position of a point; integers as glTF's `normalized` says.
  [[nodiscard]] Vec3d position(std::uint32_t point, bool normalized) const;
  /// All components of a point's attribute; those that it has not are 0.
  [[nodiscard]] std::array<double, 4> values(std::uint32_t point, bool normalized) const;

 private:
  struct Body;
  explicit DracoMesh(std::unique_ptr<Body> body);
  std::unique_ptr<Body> body_;
};

}  // namespace raymill::storage
