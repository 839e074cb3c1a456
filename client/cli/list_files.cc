#include "client/cli/list_files.h"

#include <limits>
#include <span>

#include "client/cli/npy.h"

namespace raymill::client {

std::string ListFiles::offsets_path(const std::string& hits_path) {
  constexpr std::string_view kEnding = ".npy";
  const bool ends = hits_path.ends_with(kEnding);
  return hits_path.substr(0, hits_path.size() - (ends ? kEnding.size() : 0)) + ".offsets.npy";
}

Result<ListFiles> ListFiles::create(const std::string& hits_path, const HitLayout& layout, std::uint64_t ray_count) {
  RAYMILL_ASSIGN_OR_RETURN(storage::AtomicFile hits, storage::AtomicFile::create(hits_path));
  if (hits.temporary_path() == hits.path()) {
    return {ErrorCode::invalid_argument, hits_path +
                                             ": is a pipe or a device; how many hits there are stands at the "
                                             "beginning and is known last, so name a plain file"};
  }
  RAYMILL_ASSIGN_OR_RETURN(storage::AtomicFile offsets, storage::AtomicFile::create(offsets_path(hits_path)));
  ListFiles files(std::move(hits), std::move(offsets), layout);
  // Room for any number of hits.
  const std::string header = npy_header(layout.numpy_descr(), std::numeric_limits<std::uint64_t>::max(), 0);
  files.header_bytes_ = header.size();
  RAYMILL_RETURN_IF_ERROR(files.hits_file_.write(std::as_bytes(std::span(header))));
  const std::string offsets_header = npy_header("'<u8'", ray_count + 1, 0);
  RAYMILL_RETURN_IF_ERROR(files.offsets_file_.write(std::as_bytes(std::span(offsets_header))));
  const std::uint64_t zero = 0;
  RAYMILL_RETURN_IF_ERROR(files.offsets_file_.write(std::as_bytes(std::span(&zero, 1))));
  return files;
}

Status ListFiles::write(const HitChunk& chunk) {
  RAYMILL_RETURN_IF_ERROR(hits_file_.write(chunk.rows()));
  const auto offsets = chunk.offsets();
  const std::size_t whole = offsets.size() - (chunk.goes_on() ? 1 : 0);
  ends_.clear();
  for (std::size_t i = 1; i < whole; ++i) {
    ends_.push_back(hits_ + offsets[i]);
  }
  hits_ += chunk.size();
  rays_done_ += ends_.size();
  return offsets_file_.write(std::as_bytes(std::span(ends_)));
}

Status ListFiles::commit() {
  const std::string header = npy_header(layout_.numpy_descr(), hits_, 0, header_bytes_);
  RAYMILL_RETURN_IF_ERROR(hits_file_.pwrite(std::as_bytes(std::span(header)), 0));
  RAYMILL_RETURN_IF_ERROR(offsets_file_.commit());
  return hits_file_.commit();
}

}  // namespace raymill::client
