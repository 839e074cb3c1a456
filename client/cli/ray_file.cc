#include "client/cli/ray_file.h"

#include <array>
#include <cassert>
#include <cstring>
#include <limits>
#include <utility>

#include "client/cli/npy.h"
#include "client/cli/random.h"
#include "traversal/ray_rounding.h"

namespace raymill::client {

namespace {

constexpr std::size_t kBufferBytes = 64 << 10;

using Origin = std::array<double, 3>;

Ray64 wide_ray(const std::array<double, 8>& v) {
  return {.org = {v[0], v[1], v[2]}, .tnear = v[3], .dir = {v[4], v[5], v[6]}, .tfar = v[7]};
}
void assign(Ray& ray, const std::array<float, 8>& v, const Origin& origin) {
  ray = {.org = {v[0], v[1], v[2]}, .tnear = v[3], .dir = {v[4], v[5], v[6]}, .tfar = v[7]};
  ray = origin == Origin{} ? ray : traversal::moved_ray(ray, origin);
}
void assign(Ray& ray, const std::array<double, 8>& v, const Origin& origin) {
  ray = traversal::round_ray(wide_ray(v), origin);
}
void assign(Ray64& ray, const std::array<float, 8>& v, const Origin& /*none*/) {
  ray = wide_ray({v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7]});
}
void assign(Ray64& ray, const std::array<double, 8>& v, const Origin& /*none*/) { ray = wide_ray(v); }

template <typename T, typename AnyRay>
void convert(std::span<const std::byte> raw, unsigned columns, const Origin& origin, std::span<AnyRay> rays) {
  const std::byte* row = raw.data();
  for (AnyRay& ray : rays) {
    std::array<T, 8> values;
    std::memcpy(values.data(), row, columns * sizeof(T));
    row += columns * sizeof(T);
    if (columns == 6) {
      values = {values[0], values[1], values[2], 0,
                values[3], values[4], values[5], std::numeric_limits<T>::infinity()};
    }
    assign(ray, values, origin);
  }
}

}  // namespace

Result<RayFileReader> RayFileReader::open(const std::string& path) {
  RAYMILL_ASSIGN_OR_RETURN(NpyRows rows, NpyRows::open(path, "rays"));
  const NpyHeader& header = rows.header();
  if (header.descr != "<f4" && header.descr != "<f8") {
    return rows.bad("rays are little-endian float32 or float64 ('<f4' or '<f8'), this file holds " +
                    header.descr.substr(0, 80));
  }
  if (header.shape.size() != 2 || (header.shape[1] != 6 && header.shape[1] != 8)) {
    return rows.bad("rays have the shape (N, 6) or (N, 8), this file has " + rows.shape_text());
  }
  const unsigned value_bytes = header.descr == "<f4" ? 4 : 8;
  const auto columns = static_cast<unsigned>(header.shape[1]);
  RAYMILL_RETURN_IF_ERROR(rows.begin(std::size_t{columns} * value_bytes));
  return RayFileReader(std::move(rows), columns, value_bytes);
}

Result<std::size_t> RayFileReader::read(std::span<Ray> rays) { return read_rows(rays); }
Result<std::size_t> RayFileReader::read64(std::span<Ray64> rays) { return read_rows(rays); }

template <typename AnyRay>
Result<std::size_t> RayFileReader::read_rows(std::span<AnyRay> rays) {
  std::size_t done = 0;
  while (done < rays.size()) {
    RAYMILL_ASSIGN_OR_RETURN(const auto raw, rows_.read(rays.size() - done));
    if (raw.empty()) {
      break;
    }
    const std::size_t step = raw.size() / (std::size_t{columns_} * value_bytes_);
    if (value_bytes_ == 4) {
      convert<float>(raw, columns_, origin_, rays.subspan(done, step));
    } else {
      convert<double>(raw, columns_, origin_, rays.subspan(done, step));
    }
    done += step;
  }
  return done;
}

Result<RayFileWriter> RayFileWriter::create(const std::string& path, std::uint64_t count,
                                            const std::uint64_t* shuffle_seed) {
  RAYMILL_ASSIGN_OR_RETURN(storage::AtomicFile file, storage::AtomicFile::create(path));
  RayFileWriter writer(std::move(file), count);
  writer.buffer_.reserve(kBufferBytes);
  writer.shuffled_ = shuffle_seed != nullptr;
  writer.seed_ = shuffle_seed != nullptr ? *shuffle_seed : 0;
  return writer;
}

Status RayFileWriter::set_origin(const std::array<double, 3>& origin) {
  assert(data_offset_ == 0);
  origin_ = origin;
  return begin();
}

Status RayFileWriter::begin() {
  const std::string header = npy_header(is_wide() ? "'<f8'" : "'<f4'", count_, 8);
  data_offset_ = header.size();
  return file_.write(std::as_bytes(std::span(header)));
}

Status RayFileWriter::append(std::span<const Ray> rays) {
  assert(rays.size() <= missing());
  if (data_offset_ == 0) {
    RAYMILL_RETURN_IF_ERROR(begin());
  }
  // Ray already has the file's layout: org, tnear, dir, tfar; and so has Ray64.
  static_assert(offsetof(Ray, tnear) == 12 && offsetof(Ray, dir) == 16 && offsetof(Ray, tfar) == 28);
  static_assert(offsetof(Ray64, tnear) == 24 && offsetof(Ray64, dir) == 32 && offsetof(Ray64, tfar) == 56);
  for (const Ray& ray : rays) {
    const Ray64 wide{.org = {origin_[0] + ray.org[0], origin_[1] + ray.org[1], origin_[2] + ray.org[2]},
                     .tnear = ray.tnear,
                     .dir = {ray.dir[0], ray.dir[1], ray.dir[2]},
                     .tfar = ray.tfar};
    const auto row = is_wide() ? std::as_bytes(std::span(&wide, 1)) : std::as_bytes(std::span(&ray, 1));
    if (!shuffled_) {
      buffer_.insert(buffer_.end(), row.begin(), row.end());
      ++written_;
      if (buffer_.size() == kBufferBytes) {
        RAYMILL_RETURN_IF_ERROR(flush());
      }
      continue;
    }
    const std::uint64_t place = permute(written_++, count_, seed_);
    RAYMILL_RETURN_IF_ERROR(file_.pwrite(row, data_offset_ + place * row.size()));
  }
  return {};
}

Status RayFileWriter::flush() {
  const Status status = file_.write(buffer_);
  buffer_.clear();
  return status;
}

Status RayFileWriter::commit() {
  assert(missing() == 0);
  if (data_offset_ == 0) {
    RAYMILL_RETURN_IF_ERROR(begin());
  }
  RAYMILL_RETURN_IF_ERROR(flush());
  return file_.commit();
}

}  // namespace raymill::client
