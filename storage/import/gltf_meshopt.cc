#include "storage/import/gltf_meshopt.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <iterator>
#include <nlohmann/json.hpp>
#include <string>

#include "storage/base/quotes.h"
#include "storage/import/message.h"

namespace raymill::storage {

namespace {

// By their place in the enumerations.
constexpr std::string_view kMeshoptModes[] = {"ATTRIBUTES", "TRIANGLES", "INDICES"};
constexpr std::string_view kMeshoptFilters[] = {"NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL"};

template <typename Enum>
Result<Enum> parse_name(const nlohmann::json& extension, const char* key, std::span<const std::string_view> names,
                        const std::string& otherwise) {
  const auto name = extension.value(key, otherwise);
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) {
    return bad_scene(key, " is ", in_quotes(name.substr(0, 40)), ", which EXT_meshopt_compression does not know");
  }
  return static_cast<Enum>(found - names.begin());
}

// What the extension allows and the library asserts.
bool stride_allowed(const MeshoptView& view) {
  const std::uint32_t stride = view.stride_bytes;
  if (view.mode != MeshoptMode::attributes) {
    return stride == 2 || stride == 4;
  }
  switch (view.filter) {
    case MeshoptFilter::octahedral:
      return stride == 4 || stride == 8;
    case MeshoptFilter::quaternion:
      return stride == 8;
    case MeshoptFilter::none:
    case MeshoptFilter::exponential:
      break;
  }
  constexpr std::uint32_t kMostStrideBytes = 256;
  return stride != 0 && stride % 4 == 0 && stride <= kMostStrideBytes;
}

int decode_stream(const MeshoptView& view, const unsigned char* stream, std::size_t size, void* out) {
  switch (view.mode) {
    case MeshoptMode::triangles:
      return meshopt_decodeIndexBuffer(out, view.count, view.stride_bytes, stream, size);
    case MeshoptMode::indices:
      return meshopt_decodeIndexSequence(out, view.count, view.stride_bytes, stream, size);
    case MeshoptMode::attributes:
      break;
  }
  return meshopt_decodeVertexBuffer(out, view.count, view.stride_bytes, stream, size);
}

void undo_filter(const MeshoptView& view, void* out) {
  switch (view.filter) {
    case MeshoptFilter::none:
      break;
    case MeshoptFilter::octahedral:
      meshopt_decodeFilterOct(out, view.count, view.stride_bytes);
      break;
    case MeshoptFilter::quaternion:
      meshopt_decodeFilterQuat(out, view.count, view.stride_bytes);
      break;
    case MeshoptFilter::exponential:
      meshopt_decodeFilterExp(out, view.count, view.stride_bytes);
      break;
  }
}

}  // namespace

Result<MeshoptView> parse_meshopt(const nlohmann::json& extension) {
  MeshoptView view;
  view.buffer = extension["buffer"].get<int>();
  view.offset = extension.value("byteOffset", std::uint64_t{0});
  view.size_bytes = extension["byteLength"].get<std::uint64_t>();
  view.count = extension["count"].get<std::uint64_t>();
  view.stride_bytes = extension["byteStride"].get<std::uint32_t>();
  RAYMILL_ASSIGN_OR_RETURN(view.mode, parse_name<MeshoptMode>(extension, "mode", kMeshoptModes, ""));
  RAYMILL_ASSIGN_OR_RETURN(view.filter, parse_name<MeshoptFilter>(extension, "filter", kMeshoptFilters, "NONE"));
  if (view.filter != MeshoptFilter::none && view.mode != MeshoptMode::attributes) {
    return bad_scene("filter is for ATTRIBUTES only");
  }
  if (!stride_allowed(view)) {
    return bad_scene("byteStride is ", view.stride_bytes, ", which its mode and filter do not allow");
  }
  if (view.mode == MeshoptMode::triangles && view.count % 3 != 0) {
    return bad_scene("count is ", view.count, " and TRIANGLES come in threes");
  }
  return view;
}

Status decode_meshopt(const MeshoptView& view, std::span<const std::byte> stream, std::span<std::byte> out) {
  const auto* bytes = reinterpret_cast<const unsigned char*>(stream.data());
  if (decode_stream(view, bytes, stream.size(), out.data()) != 0) {
    return bad_scene("the meshopt stream does not decode to ", view.count, " elements of ", view.stride_bytes,
                     " bytes; the file is damaged, or by a newer meshoptimizer");
  }
  undo_filter(view, out.data());
  return {};
}

}  // namespace raymill::storage
