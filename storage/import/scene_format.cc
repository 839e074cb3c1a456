#include "storage/import/scene_format.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstring>
#include <string>

#include "storage/import/message.h"
#include "storage/import/stl_layout.h"

namespace raymill::storage {

namespace {

constexpr std::size_t kHeadBytes = 1024;

bool is_space(char c) { return c == ' ' || c == '\t' || c == '\n' || c == '\r'; }

bool is_json(std::string_view head) {
  if (head.starts_with("\xEF\xBB\xBF")) {  // a byte order mark
    head.remove_prefix(3);
  }
  const auto* const first = std::find_if_not(head.begin(), head.end(), is_space);
  return first != head.end() && *first == '{';
}

bool is_ply(std::string_view head) { return head.size() > 3 && head.starts_with("ply") && is_space(head[3]); }

bool begins_with_solid(std::string_view head) {
  constexpr std::string_view kSolid = "solid";
  const auto same = [](char a, char b) { return std::tolower(static_cast<unsigned char>(a)) == b; };
  return head.size() > kSolid.size() &&
         std::equal(kSolid.begin(), kSolid.end(), head.begin(), [&](char b, char a) { return same(a, b); }) &&
         is_space(head[kSolid.size()]);
}

// Names in other encodings are text, control characters are not.
bool is_text(std::string_view head) {
  return std::none_of(head.begin(), head.end(), [](char c) { return c >= 0 && c < ' ' && !is_space(c) && c != '\f'; });
}

Result<SceneFormat> by_name(std::string_view name) {
  struct Ending {
    std::string_view text;
    SceneFormat format;
  };
  constexpr Ending kEndings[] = {{".gltf", SceneFormat::gltf},
                                 {".glb", SceneFormat::gltf},
                                 {".obj", SceneFormat::obj},
                                 {".ply", SceneFormat::ply},
                                 {".stl", SceneFormat::stl_binary}};
  std::string lower(name);
  std::transform(lower.begin(), lower.end(), lower.begin(), [](unsigned char c) { return std::tolower(c); });
  for (const Ending& ending : kEndings) {
    if (lower.ends_with(ending.text)) {
      return ending.format;
    }
  }
  return bad_scene("is no scene that Raymill knows by its first bytes or its name: .gltf, .glb, .ply, .obj, .stl");
}

}  // namespace

Result<std::uint64_t> stl_facets(const ByteSource& file) {
  if (file.size_bytes() < kStlHeaderBytes) {
    return bad_scene("holds only ", file.size_bytes(), " bytes; a binary STL has ", kStlHeaderBytes, " at least");
  }
  std::uint32_t facets = 0;
  RAYMILL_RETURN_IF_ERROR(file.read(kStlHeaderBytes - sizeof facets, std::as_writable_bytes(std::span(&facets, 1))));
  const std::uint64_t left_bytes = file.size_bytes() - kStlHeaderBytes;
  if (left_bytes != facets * kStlFacetBytes) {
    return bad_scene("its STL header promises ", facets, " facets of ", kStlFacetBytes, " bytes and ", left_bytes,
                     " bytes follow; the file is damaged or was cut short");
  }
  return std::uint64_t{facets};
}

Result<SceneFormat> detect_format(const ByteSource& file, std::string_view name) {
  std::string head(std::min<std::uint64_t>(kHeadBytes, file.size_bytes()), '\0');
  RAYMILL_RETURN_IF_ERROR(file.read(0, std::as_writable_bytes(std::span(head))));
  if (head.starts_with("glTF") || is_json(head)) {
    return SceneFormat::gltf;
  }
  if (is_ply(head)) {
    return SceneFormat::ply;
  }
  const auto facets = stl_facets(file);
  if (facets.ok() && *facets != 0) {
    return SceneFormat::stl_binary;
  }
  if (begins_with_solid(head)) {
    return is_text(head) ? SceneFormat::stl_text : SceneFormat::stl_binary;
  }
  return by_name(name);
}

}  // namespace raymill::storage
