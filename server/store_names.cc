#include "server/store_names.h"

#include <algorithm>
#include <filesystem>
#include <system_error>

#include "server/limits.h"

namespace raymill::server {

namespace {

namespace fs = std::filesystem;

constexpr std::string_view kSuffix = ".mill";
constexpr int kMostFolders = 8;

Status refuse(std::string_view name, const char* why) {
  std::string shown(name.substr(0, 80));
  std::replace_if(
      shown.begin(), shown.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20; }, '?');
  return {ErrorCode::invalid_argument,
          "store name '" + shown + "' " + why + "; give a name below the server's stores directory"};
}

}  // namespace

Result<std::string> canonical_store_name(std::string_view name) {
  if (name.empty() || name.size() > kMostNameBytes) {
    return refuse(name, "is empty or too long");
  }
  if (name.front() == '/') {
    return refuse(name, "is an absolute path");
  }
  if (std::any_of(name.begin(), name.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7F; })) {
    return refuse(name, "holds a control character");
  }
  for (std::size_t begin = 0; begin <= name.size();) {
    const std::size_t end = std::min(name.find('/', begin), name.size());
    const std::string_view part = name.substr(begin, end - begin);
    if (part.empty() || part == "." || part == "..") {
      return refuse(name, "has an empty, '.' or '..' part");
    }
    begin = end + 1;
  }
  if (name.ends_with(kSuffix)) {
    name.remove_suffix(kSuffix.size());
    if (name.empty() || name.back() == '/') {
      return refuse(name, "is nothing but a suffix");
    }
  }
  return std::string(name);
}

Result<std::string> store_path(const std::string& stores_directory, const std::string& canonical_name) {
  std::error_code error;
  const fs::path root = fs::canonical(stores_directory, error);
  if (error) {
    return {ErrorCode::not_found, "the server's stores directory is not there any more: " + error.message()};
  }
  const fs::path file = fs::canonical(root / (canonical_name + std::string(kSuffix)), error);
  if (error) {
    return {ErrorCode::not_found, "no store '" + canonical_name + "' on this server"};
  }
  const auto mismatch = std::mismatch(root.begin(), root.end(), file.begin(), file.end());
  if (mismatch.first != root.end()) {
    return refuse(canonical_name, "is a link that leads out of it");
  }
  if (!fs::is_regular_file(file, error)) {
    return refuse(canonical_name, "is no regular file");
  }
  return file.string();
}

StoreNames list_stores(const std::string& stores_directory) {
  StoreNames found;
  std::error_code error;
  const fs::path root(stores_directory);
  for (fs::recursive_directory_iterator it(root, fs::directory_options::skip_permission_denied, error), end;
       !error && it != end; it.increment(error)) {
    if (it.depth() + 1 >= kMostFolders) {
      it.disable_recursion_pending();
    }
    const std::string relative = it->path().lexically_relative(root).generic_string();
    std::error_code ignored;
    if (!relative.ends_with(kSuffix) || !it->is_regular_file(ignored)) {
      continue;
    }
    auto name = canonical_store_name(relative);
    if (!name.ok() || !store_path(stores_directory, *name).ok()) {
      continue;
    }
    if (found.names.size() == kMostListedStores) {
      found.truncated = true;
      break;
    }
    found.names.push_back(std::move(*name));
  }
  std::sort(found.names.begin(), found.names.end());
  return found;
}

}  // namespace raymill::server
