#include "storage/import/primitive_readers.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <utility>

#include "storage/import/message.h"

namespace raymill::storage {

PositionReader::PositionReader(GltfAccessor accessor, const Transform& world_from_node)
    : accessor_(std::move(accessor)),
      world_from_node_(world_from_node),
      raw_(kPieceCorners * accessor_.element_bytes()) {}

Result<PositionReader> PositionReader::open(GltfAccessor accessor, bool quantization,
                                            const Transform& world_from_node) {
  if (accessor.type() == ComponentType::uint32) {
    return bad_scene("accessors[", accessor.index(), "] holds positions as 32-bit integers, which glTF 2.0 forbids");
  }
  if (accessor.type() != ComponentType::float32 && !quantization) {
    return bad_scene("accessors[", accessor.index(),
                     "] holds positions as integers, which only KHR_mesh_quantization allows");
  }
  return PositionReader(std::move(accessor), world_from_node);
}

Status PositionReader::read(std::uint64_t first, std::span<Vec3f> out) {
  const std::uint32_t element_bytes = accessor_.element_bytes();
  for (std::size_t done = 0; done < out.size();) {
    const std::size_t taken = std::min(kPieceCorners, out.size() - done);
    RAYMILL_RETURN_IF_ERROR(accessor_.read(first + done, std::span(raw_).first(taken * element_bytes)));
    for (std::size_t i = 0; i < taken; ++i) {
      out[done + i] = place(raw_.data() + i * element_bytes);
    }
    done += taken;
  }
  return {};
}

Vec3f PositionReader::place(const std::byte* element) const {
  const std::uint32_t step = size_bytes(accessor_.type());
  const auto component = [&](std::uint32_t i) {
    return component_value(element + i * step, accessor_.type(), accessor_.normalized());
  };
  return round_once(world_from_node_.apply({component(0), component(1), component(2)}));
}

IndexReader::IndexReader(GltfAccessor accessor, std::uint64_t vertex_count)
    : accessor_(std::move(accessor)), vertex_count_(vertex_count), raw_(kPieceCorners * accessor_.element_bytes()) {}

Result<IndexReader> IndexReader::open(GltfAccessor accessor, std::uint64_t vertex_count) {
  const ComponentType type = accessor.type();
  const bool known = type == ComponentType::uint8 || type == ComponentType::uint16 || type == ComponentType::uint32;
  if (!known || accessor.normalized()) {
    return bad_scene("accessors[", accessor.index(), "] holds indices and must be of plain unsigned integers");
  }
  if (!accessor.has_view() && !accessor.sparse()) {
    return bad_scene("accessors[", accessor.index(), "] holds indices and has no bufferView to read them from");
  }
  return IndexReader(std::move(accessor), vertex_count);
}

Status IndexReader::read(std::uint64_t first, std::span<std::uint32_t> out) {
  RAYMILL_RETURN_IF_ERROR(accessor_.read(first, std::span(raw_).first(out.size() * accessor_.element_bytes())));
  switch (accessor_.type()) {
    case ComponentType::uint8:
      return convert<std::uint8_t>(first, out);
    case ComponentType::uint16:
      return convert<std::uint16_t>(first, out);
    default:
      return convert<std::uint32_t>(first, out);
  }
}

template <typename T>
Status IndexReader::convert(std::uint64_t first, std::span<std::uint32_t> out) const {
  for (std::size_t i = 0; i < out.size(); ++i) {
    T index;
    std::memcpy(&index, raw_.data() + i * sizeof index, sizeof index);
    if (index == std::numeric_limits<T>::max()) {
      return bad_scene("accessors[", accessor_.index(), "] holds the primitive restart value ", index, " at ",
                       first + i, ", which glTF 2.0 forbids");
    }
    if (index >= vertex_count_) {
      return bad_scene("accessors[", accessor_.index(), "] holds index ", index, " at ", first + i,
                       " and the primitive has only ", vertex_count_, " vertices");
    }
    out[i] = index;
  }
  return {};
}

}  // namespace raymill::storage
