// GltfAccessor: the elements of one accessor, read by range.
//
// open() checks all that reading relies on: types, strides, the view in its buffer, the elements in their view, and the
// same of a sparse overlay, whose indices must rise and stay below the count. Elements come out tightly packed whatever
// the stride; where there is no bufferView they are zero. Thread-confined.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/base/status.h"
#include "storage/import/gltf_buffers.h"

namespace tinygltf {
class Model;
struct BufferView;
}  // namespace tinygltf

namespace raymill::storage {

/// glTF component types, by their numbers in the file.
enum class ComponentType : std::uint16_t {
  int8 = 5120,
  uint8 = 5121,
  int16 = 5122,
  uint16 = 5123,
  uint32 = 5125,
  float32 = 5126,
};
std::uint32_t size_bytes(ComponentType type);

/// A component as a number. Normalised integers map to [-1, 1] or [0, 1] as glTF 2.0, 3.11 says:
/// max(c / 127, -1), c / 255, max(c / 32767, -1), c / 65535.
double component_value(const std::byte* bytes, ComponentType type, bool normalized);

class GltfAccessor {
 public:
  /// `accessor` must be an index of the document; `components` is what the caller needs (1 for SCALAR, 2 to 4
  /// for VEC2 to VEC4).
  /// Errors: bad_scene, and those of GltfBuffers::read for the sparse part.
  static Result<GltfAccessor> open(const tinygltf::Model& model, int accessor, std::uint32_t components,
                                   GltfBuffers& buffers, Ledger& ledger);

  [[nodiscard]] int index() const { return index_; }
  [[nodiscard]] std::uint64_t count() const { return count_; }
  [[nodiscard]] ComponentType type() const { return type_; }
  [[nodiscard]] bool normalized() const { return normalized_; }
  [[nodiscard]] bool sparse() const { return sparse_.has_value(); }
  [[nodiscard]] bool has_view() const { return view_ >= 0; }
  [[nodiscard]] std::uint32_t element_bytes() const { return components_ * size_bytes(type_); }

  /// Elements first .. first + out.size() / element_bytes(), which must lie below count().
  Status read(std::uint64_t first, std::span<std::byte> out);

 private:
  struct Sparse {
    BudgetReservation claim;
    std::vector<std::uint32_t> indices;  // rising
    std::vector<std::byte> values;
  };

  explicit GltfAccessor(GltfBuffers& buffers) : buffers_(&buffers) {}
  Status set_view(const tinygltf::Model& model, std::uint64_t byte_offset);
  Status read_sparse(const tinygltf::Model& model, Ledger& ledger);
  Status read_strided(std::uint64_t first, std::span<std::byte> out);
  void overlay(std::uint64_t first, std::span<std::byte> out) const;

  GltfBuffers* buffers_;
  int index_ = -1;
  int view_ = -1;
  int buffer_ = -1;
  std::uint64_t offset_ = 0;  // of element 0 in the buffer
  std::uint64_t count_ = 0;
  std::uint32_t stride_bytes_ = 0;
  std::uint32_t components_ = 0;
  ComponentType type_ = ComponentType::float32;
  bool normalized_ = false;
  std::optional<Sparse> sparse_;
};

/// Where a bufferView lies in its buffer, checked. Errors: bad_scene.
Result<ByteExtent> view_extent(const tinygltf::Model& model, int view, const GltfBuffers& buffers);

}  // namespace raymill::storage
