#include "client/cli/skip_file.h"

#include <cassert>
#include <cstddef>
#include <cstring>
#include <utility>

namespace raymill::client {

static_assert(sizeof(PrimitiveIds) == 8 && offsetof(PrimitiveIds, geometry_id) == 0, "as a row of the file");

Result<SkipFileReader> SkipFileReader::open(const std::string& path, std::uint64_t ray_count, std::size_t most_rays) {
  RAYMILL_ASSIGN_OR_RETURN(NpyRows rows, NpyRows::open(path, "ids"));
  const NpyHeader& header = rows.header();
  if (header.descr != "<u4") {
    return rows.bad("ids are little-endian uint32 ('<u4'), this file holds " + header.descr.substr(0, 80));
  }
  if (header.shape.size() != 2 || header.shape[1] != 2) {
    return rows.bad("ids have the shape (N, 2): geometry_id, primitive_id; this file has " + rows.shape_text());
  }
  if (header.shape[0] != ray_count) {
    return rows.bad("holds ids for " + std::to_string(header.shape[0]) + " rays, there are " +
                    std::to_string(ray_count));
  }
  RAYMILL_RETURN_IF_ERROR(rows.begin(sizeof(PrimitiveIds)));
  return SkipFileReader(std::move(rows), most_rays);
}

Result<std::span<const PrimitiveIds>> SkipFileReader::read(std::size_t rays) {
  assert(rays <= ids_.size());
  for (std::size_t done = 0; done < rays;) {
    RAYMILL_ASSIGN_OR_RETURN(const auto raw, rows_.read(rays - done));
    if (raw.empty()) {
      return rows_.bad("ends before the rays do");
    }
    std::memcpy(&ids_[done], raw.data(), raw.size());
    done += raw.size() / sizeof(PrimitiveIds);
  }
  return std::span<const PrimitiveIds>(ids_).first(rays);
}

}  // namespace raymill::client
