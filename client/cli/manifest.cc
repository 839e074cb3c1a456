#include "client/cli/manifest.h"

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string_view>

namespace raymill::client {

namespace {

namespace fs = std::filesystem;

bool is_left_out(std::string_view line) {
  return line.find_first_not_of(" \t") == std::string_view::npos || line[0] == '#';
}

// "list.txt, line 7: ..."
Status fault(ErrorCode code, const std::string& path, std::size_t line, const std::string& what) {
  return {code, path + ", line " + std::to_string(line) + ": " + what};
}

Status look_for(const std::string& scene, const std::string& path, std::size_t line) {
  std::error_code error;
  const fs::file_status found = fs::status(scene, error);
  if (found.type() == fs::file_type::not_found) {
    return fault(ErrorCode::not_found, path, line, scene + " is not there");
  }
  if (error) {
    return fault(ErrorCode::io, path, line, scene + ": " + error.message());
  }
  if (fs::is_directory(found)) {
    return fault(ErrorCode::bad_scene, path, line, scene + " is a folder; list its scene files");
  }
  return {};
}

}  // namespace

Result<std::vector<std::string>> read_manifest(const std::string& path) {
  std::error_code ignored;
  if (fs::is_directory(path, ignored)) {
    return {ErrorCode::bad_scene,
            path + " is a folder; a manifest is a text file with the name of a scene on each line"};
  }
  std::ifstream in(path, std::ios::binary);
  if (!in) {
    return {errno == ENOENT || errno == ENOTDIR ? ErrorCode::not_found : ErrorCode::io,
            "cannot read " + path + ": " + std::strerror(errno)};
  }
  const fs::path folder = fs::path(path).parent_path();
  std::vector<std::string> scenes;
  std::vector<char> buffer(kMostManifestLineBytes + 2);  // with the line's end and getline's zero
  for (std::size_t number = 1; in.getline(buffer.data(), static_cast<std::streamsize>(buffer.size())); ++number) {
    // getline counts the line's end, which the last line may lack.
    std::string_view line(buffer.data(), static_cast<std::size_t>(in.gcount()) - (in.eof() ? 0 : 1));
    if (line.find('\0') != std::string_view::npos) {
      return fault(ErrorCode::bad_scene, path, number, "holds a zero byte; a manifest is text");
    }
    if (!line.empty() && line.back() == '\r') {
      line.remove_suffix(1);
    }
    if (is_left_out(line)) {
      continue;
    }
    if (scenes.size() == kMostManifestScenes) {
      return fault(ErrorCode::bad_scene, path, number,
                   "a manifest lists at most " + std::to_string(kMostManifestScenes) + " scenes");
    }
    scenes.push_back(folder / line);
    RAYMILL_RETURN_IF_ERROR(look_for(scenes.back(), path, number));
  }
  if (in.bad()) {
    return {ErrorCode::io, "cannot read " + path + ": " + std::strerror(errno)};
  }
  if (!in.eof()) {
    return {ErrorCode::bad_scene, path + ": a line is longer than " + std::to_string(kMostManifestLineBytes) +
                                      " bytes; a manifest has the name of a scene on each"};
  }
  if (scenes.empty()) {
    return {ErrorCode::bad_scene, path + ": lists no scene; a manifest has the name of one on each line"};
  }
  return scenes;
}

}  // namespace raymill::client
