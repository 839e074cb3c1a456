#include "storage/import/gltf_accessor.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>

#include "storage/import/message.h"
#include "storage/import/tinygltf_config.h"

namespace raymill::storage {

namespace {

constexpr std::string_view kDamaged = "; the file is damaged or was cut short";

template <typename T>
T load(const std::byte* bytes) {
  T value;
  std::memcpy(&value, bytes, sizeof value);
  return value;
}

std::optional<ComponentType> component_type(int number) {
  switch (number) {
    case 5120:
    case 5121:
    case 5122:
    case 5123:
    case 5125:
    case 5126:
      return static_cast<ComponentType>(number);
    default:
      return std::nullopt;
  }
}

std::uint32_t load_index(const std::byte* bytes, ComponentType type) {
  switch (type) {
    case ComponentType::uint8:
      return load<std::uint8_t>(bytes);
    case ComponentType::uint16:
      return load<std::uint16_t>(bytes);
    default:
      return load<std::uint32_t>(bytes);
  }
}

}  // namespace

std::uint32_t size_bytes(ComponentType type) {
  switch (type) {
    case ComponentType::int8:
    case ComponentType::uint8:
      return 1;
    case ComponentType::int16:
    case ComponentType::uint16:
      return 2;
    case ComponentType::uint32:
    case ComponentType::float32:
      break;
  }
  return 4;
}

double component_value(const std::byte* bytes, ComponentType type, bool normalized) {
  switch (type) {
    case ComponentType::int8: {
      const double value = load<std::int8_t>(bytes);
      return normalized ? std::max(value / 127.0, -1.0) : value;
    }
    case ComponentType::uint8: {
      const double value = load<std::uint8_t>(bytes);
      return normalized ? value / 255.0 : value;
    }
    case ComponentType::int16: {
      const double value = load<std::int16_t>(bytes);
      return normalized ? std::max(value / 32767.0, -1.0) : value;
    }
    case ComponentType::uint16: {
      const double value = load<std::uint16_t>(bytes);
      return normalized ? value / 65535.0 : value;
    }
    case ComponentType::uint32:
      return load<std::uint32_t>(bytes);
    case ComponentType::float32:
      break;
  }
  return load<float>(bytes);
}

Result<ByteExtent> view_extent(const tinygltf::Model& model, int view, const GltfBuffers& buffers) {
  const tinygltf::BufferView& declared = model.bufferViews[static_cast<std::size_t>(view)];
  const std::uint64_t buffer_bytes = buffers.size_bytes(declared.buffer);
  if (declared.byteOffset > buffer_bytes || declared.byteLength > buffer_bytes - declared.byteOffset) {
    return bad_scene("bufferViews[", view, "] takes bytes ", declared.byteOffset, "..",
                     declared.byteOffset + declared.byteLength, " of buffers[", declared.buffer, "], which has ",
                     buffer_bytes, kDamaged);
  }
  return ByteExtent{declared.byteOffset, declared.byteLength};
}

Result<GltfAccessor> GltfAccessor::open(const tinygltf::Model& model, int accessor, std::uint32_t components,
                                        GltfBuffers& buffers, Ledger& ledger) {
  const tinygltf::Accessor& declared = model.accessors[static_cast<std::size_t>(accessor)];
  GltfAccessor opened(buffers);
  opened.index_ = accessor;
  opened.count_ = declared.count;
  opened.components_ = components;
  opened.normalized_ = declared.normalized;
  constexpr std::array<std::pair<int, const char*>, 4> kTypes{{{TINYGLTF_TYPE_SCALAR, "SCALAR"},
                                                               {TINYGLTF_TYPE_VEC2, "VEC2"},
                                                               {TINYGLTF_TYPE_VEC3, "VEC3"},
                                                               {TINYGLTF_TYPE_VEC4, "VEC4"}}};
  const auto& [wanted, name] = kTypes[components - 1];
  if (declared.type != wanted) {
    return bad_scene("accessors[", accessor, "] must be ", name, " to be used so");
  }
  const std::optional<ComponentType> type = component_type(declared.componentType);
  if (!type) {
    return bad_scene("accessors[", accessor, "].componentType is ", declared.componentType,
                     ", which glTF 2.0 does not know");
  }
  opened.type_ = *type;
  opened.view_ = declared.bufferView;
  if (opened.has_view()) {
    RAYMILL_RETURN_IF_ERROR(opened.set_view(model, declared.byteOffset));
  }
  if (declared.sparse.isSparse) {
    RAYMILL_RETURN_IF_ERROR(opened.read_sparse(model, ledger));
  }
  return opened;
}

Status GltfAccessor::set_view(const tinygltf::Model& model, std::uint64_t byte_offset) {
  RAYMILL_ASSIGN_OR_RETURN(const ByteExtent view, view_extent(model, view_, *buffers_));
  const tinygltf::BufferView& declared = model.bufferViews[static_cast<std::size_t>(view_)];
  buffer_ = declared.buffer;
  offset_ = view.offset + byte_offset;
  stride_bytes_ = declared.byteStride == 0 ? element_bytes() : static_cast<std::uint32_t>(declared.byteStride);
  if (stride_bytes_ < element_bytes()) {
    return bad_scene("accessors[", index_, "] has elements of ", element_bytes(), " bytes and bufferViews[", view_,
                     "] a byteStride of only ", stride_bytes_);
  }
  // No overflow: count < 2^32, stride < 2^8, offsets <= 2^53.
  const std::uint64_t used_bytes = count_ == 0 ? 0 : (count_ - 1) * stride_bytes_ + element_bytes();
  if (byte_offset > view.size_bytes || used_bytes > view.size_bytes - byte_offset) {
    return bad_scene("accessors[", index_, "] reads bytes ", byte_offset, "..", byte_offset + used_bytes,
                     " past its bufferViews[", view_, "] of ", view.size_bytes, " bytes", kDamaged);
  }
  return {};
}

Status GltfAccessor::read_sparse(const tinygltf::Model& model, Ledger& ledger) {
  const auto& declared = model.accessors[static_cast<std::size_t>(index_)].sparse;
  const auto sparse_count = static_cast<std::uint64_t>(declared.count);
  if (sparse_count > count_) {
    return bad_scene("accessors[", index_, "].sparse has ", sparse_count, " elements for an accessor of ", count_);
  }
  const std::optional<ComponentType> type = component_type(declared.indices.componentType);
  if (type != ComponentType::uint8 && type != ComponentType::uint16 && type != ComponentType::uint32) {
    return bad_scene("accessors[", index_, "].sparse.indices.componentType is ", declared.indices.componentType,
                     "; 5121, 5123 or 5125 is needed");
  }
  const auto extent = [&](int view, int byte_offset, std::uint64_t bytes, std::string_view part) -> Result<ByteExtent> {
    RAYMILL_ASSIGN_OR_RETURN(const ByteExtent all, view_extent(model, view, *buffers_));
    const auto start = static_cast<std::uint64_t>(byte_offset);
    if (model.bufferViews[static_cast<std::size_t>(view)].byteStride != 0) {
      return bad_scene("accessors[", index_, "].sparse.", part, " uses bufferViews[", view,
                       "], which has a byteStride; sparse data must be tightly packed");
    }
    if (start > all.size_bytes || bytes > all.size_bytes - start) {
      return bad_scene("accessors[", index_, "].sparse.", part, " reads bytes ", start, "..", start + bytes,
                       " past its bufferViews[", view, "] of ", all.size_bytes, " bytes", kDamaged);
    }
    return ByteExtent{all.offset + start, bytes};
  };
  RAYMILL_ASSIGN_OR_RETURN(const ByteExtent indices, extent(declared.indices.bufferView, declared.indices.byteOffset,
                                                            sparse_count * size_bytes(*type), "indices"));
  RAYMILL_ASSIGN_OR_RETURN(const ByteExtent values, extent(declared.values.bufferView, declared.values.byteOffset,
                                                           sparse_count * element_bytes(), "values"));
  Sparse sparse;
  RAYMILL_ASSIGN_OR_RETURN(sparse.claim,
                           ledger.claim(Tag::build, indices.size_bytes + sparse_count * 4 + values.size_bytes));
  std::vector<std::byte> raw(indices.size_bytes);
  RAYMILL_RETURN_IF_ERROR(buffers_->read(
      model.bufferViews[static_cast<std::size_t>(declared.indices.bufferView)].buffer, indices.offset, raw));
  sparse.indices.resize(sparse_count);
  for (std::size_t i = 0; i < sparse_count; ++i) {
    const std::uint32_t index = load_index(raw.data() + i * size_bytes(*type), *type);
    if (index >= count_ || (i > 0 && index <= sparse.indices[i - 1])) {
      return bad_scene("accessors[", index_, "].sparse.indices holds ", index, " at ", i,
                       "; they must rise and stay below ", count_);
    }
    sparse.indices[i] = index;
  }
  sparse.values.resize(values.size_bytes);
  RAYMILL_RETURN_IF_ERROR(buffers_->read(model.bufferViews[static_cast<std::size_t>(declared.values.bufferView)].buffer,
                                         values.offset, sparse.values));
  sparse_ = std::move(sparse);
  return {};
}

Status GltfAccessor::read(std::uint64_t first, std::span<std::byte> out) {
  if (!has_view()) {
    std::fill(out.begin(), out.end(), std::byte{0});
  } else if (stride_bytes_ == element_bytes()) {
    RAYMILL_RETURN_IF_ERROR(buffers_->read(buffer_, offset_ + first * stride_bytes_, out));
  } else {
    RAYMILL_RETURN_IF_ERROR(read_strided(first, out));
  }
  if (sparse_) {
    overlay(first, out);
  }
  return {};
}

Status GltfAccessor::read_strided(std::uint64_t first, std::span<std::byte> out) {
  std::array<std::byte, 16384> staging;  // strides are at most 252, so 65 elements at least
  const std::uint64_t piece = (staging.size() - element_bytes()) / stride_bytes_ + 1;
  while (!out.empty()) {
    const std::uint64_t taken = std::min<std::uint64_t>(piece, out.size() / element_bytes());
    const std::uint64_t span_bytes = (taken - 1) * stride_bytes_ + element_bytes();
    RAYMILL_RETURN_IF_ERROR(
        buffers_->read(buffer_, offset_ + first * stride_bytes_, std::span(staging).first(span_bytes)));
    for (std::uint64_t i = 0; i < taken; ++i) {
      std::memcpy(out.data() + i * element_bytes(), staging.data() + i * stride_bytes_, element_bytes());
    }
    first += taken;
    out = out.subspan(taken * element_bytes());
  }
  return {};
}

void GltfAccessor::overlay(std::uint64_t first, std::span<std::byte> out) const {
  const std::uint64_t end = first + out.size() / element_bytes();
  auto it = std::lower_bound(sparse_->indices.begin(), sparse_->indices.end(), first);
  for (; it != sparse_->indices.end() && *it < end; ++it) {
    const auto value = static_cast<std::size_t>(it - sparse_->indices.begin());
    std::memcpy(out.data() + (*it - first) * element_bytes(), sparse_->values.data() + value * element_bytes(),
                element_bytes());
  }
}

}  // namespace raymill::storage
