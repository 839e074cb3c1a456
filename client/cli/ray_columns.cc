#include "client/cli/ray_columns.h"

#include <cassert>
#include <cstddef>
#include <cstring>
#include <type_traits>
#include <utility>

namespace raymill::client {

static_assert(sizeof(PrimitiveIds) == 8 && offsetof(PrimitiveIds, geometry_id) == 0, "as a row of the file");

namespace {

// Checks for uint32 of the shape (N,) or (N, columns).
Status check(const NpyRows& rows, const std::string& what, std::uint64_t columns) {
  const NpyHeader& header = rows.header();
  if (header.descr != "<u4") {
    return rows.bad(what + " are little-endian uint32 ('<u4'), this file holds " + header.descr.substr(0, 80));
  }
  const bool fits =
      header.shape.size() == (columns > 1 ? 2U : 1U) && (header.shape.size() < 2 || header.shape[1] == columns);
  if (!fits) {
    return rows.bad(what + " have the shape " + (columns > 1 ? "(N, " + std::to_string(columns) + ")" : "(N,)") +
                    ", this file has " + rows.shape_text());
  }
  return {};
}

// The next rows, as many as `values` holds.
template <typename Row>
Status read_all(NpyRows& rows, std::span<Row> values) {
  for (std::size_t done = 0; done < values.size();) {
    RAYMILL_ASSIGN_OR_RETURN(const auto raw, rows.read(values.size() - done));
    if (raw.empty()) {
      return rows.bad("ends before the rays do");
    }
    std::memcpy(&values[done], raw.data(), raw.size());
    done += raw.size() / sizeof(Row);
  }
  return {};
}

}  // namespace

template <typename Row>
Result<RayColumn<Row>> RayColumn<Row>::open(const std::string& path, const std::string& what, std::uint64_t ray_count,
                                            std::size_t most_rays) {
  RAYMILL_ASSIGN_OR_RETURN(NpyRows rows, NpyRows::open(path, what));
  RAYMILL_RETURN_IF_ERROR(check(rows, what, sizeof(Row) / sizeof(std::uint32_t)));
  if (rows.count() != ray_count) {
    return rows.bad("holds " + what + " for " + std::to_string(rows.count()) + " rays, there are " +
                    std::to_string(ray_count));
  }
  RAYMILL_RETURN_IF_ERROR(rows.begin(sizeof(Row)));
  return RayColumn(std::move(rows), most_rays);
}

template <typename Row>
Result<std::span<const Row>> RayColumn<Row>::read(std::size_t rays) {
  assert(rays <= values_.size());
  RAYMILL_RETURN_IF_ERROR(read_all(rows_, std::span(values_).first(rays)));
  return std::span<const Row>(values_).first(rays);
}

template class RayColumn<PrimitiveIds>;
template class RayColumn<std::uint32_t>;

Result<RayColumns> RayColumns::open(const Paths& paths, std::uint64_t ray_count, std::size_t most_rays) {
  RayColumns columns;
  if (!paths.skip.empty()) {
    RAYMILL_ASSIGN_OR_RETURN(auto column, RayColumn<PrimitiveIds>::open(paths.skip, "ids", ray_count, most_rays));
    columns.skipped_.emplace(std::move(column));
  }
  if (!paths.masks.empty()) {
    RAYMILL_ASSIGN_OR_RETURN(auto column, RayColumn<std::uint32_t>::open(paths.masks, "masks", ray_count, most_rays));
    columns.masks_.emplace(std::move(column));
  }
  return columns;
}

void RayColumns::skip(std::uint64_t rays) {
  if (skipped_) {
    skipped_->skip(rays);
  }
  if (masks_) {
    masks_->skip(rays);
  }
}

std::string RayColumns::identity() const {
  return (skipped_ ? skipped_->identity() : "none") + ", " + (masks_ ? masks_->identity() : "none");
}

Result<RayExtras> RayColumns::read(std::size_t rays) {
  RayExtras extras;
  if (skipped_) {
    RAYMILL_ASSIGN_OR_RETURN(extras.skipped, skipped_->read(rays));
  }
  if (masks_) {
    RAYMILL_ASSIGN_OR_RETURN(extras.masks, masks_->read(rays));
  }
  return extras;
}

Result<std::vector<std::uint32_t>> read_geometry_masks(const std::string& path) {
  RAYMILL_ASSIGN_OR_RETURN(NpyRows rows, NpyRows::open(path, "masks"));
  RAYMILL_RETURN_IF_ERROR(check(rows, "masks", 1));
  RAYMILL_RETURN_IF_ERROR(rows.begin(sizeof(std::uint32_t)));
  std::vector<std::uint32_t> masks(rows.count());
  RAYMILL_RETURN_IF_ERROR(read_all(rows, std::span(masks)));
  return masks;
}

}  // namespace raymill::client
