#include "client/cli/ray_file.h"

#include <array>
#include <cassert>
#include <cstring>
#include <limits>
#include <utility>

#include "client/cli/npy.h"
#include "client/cli/random.h"
#include "client/cli/ray_rounding.h"

namespace raymill::client {

namespace {

constexpr std::size_t kBufferBytes = 64 << 10;

Ray ray_of(const std::array<float, 8>& v) {
  return {.org = {v[0], v[1], v[2]}, .tnear = v[3], .dir = {v[4], v[5], v[6]}, .tfar = v[7]};
}
Ray ray_of(const std::array<double, 8>& v) {
  return round_ray({.org = {v[0], v[1], v[2]}, .tnear = v[3], .dir = {v[4], v[5], v[6]}, .tfar = v[7]});
}

template <typename T>
void convert(std::span<const std::byte> raw, unsigned columns, std::span<Ray> rays) {
  const std::byte* row = raw.data();
  for (Ray& ray : rays) {
    std::array<T, 8> values;
    std::memcpy(values.data(), row, columns * sizeof(T));
    row += columns * sizeof(T);
    if (columns == 6) {
      values = {values[0], values[1], values[2], 0,
                values[3], values[4], values[5], std::numeric_limits<T>::infinity()};
    }
    ray = ray_of(values);
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

Result<std::size_t> RayFileReader::read(std::span<Ray> rays) {
  std::size_t done = 0;
  while (done < rays.size()) {
    RAYMILL_ASSIGN_OR_RETURN(const auto raw, rows_.read(rays.size() - done));
    if (raw.empty()) {
      break;
    }
    const std::size_t step = raw.size() / (std::size_t{columns_} * value_bytes_);
    if (value_bytes_ == 4) {
      convert<float>(raw, columns_, rays.subspan(done, step));
    } else {
      convert<double>(raw, columns_, rays.subspan(done, step));
    }
    done += step;
  }
  return done;
}

Result<RayFileWriter> RayFileWriter::create(const std::string& path, std::uint64_t count,
                                            const std::uint64_t* shuffle_seed) {
  RAYMILL_ASSIGN_OR_RETURN(storage::AtomicFile file, storage::AtomicFile::create(path));
  const std::string header = npy_header("'<f4'", count, 8);
  RAYMILL_RETURN_IF_ERROR(file.write(std::as_bytes(std::span(header))));
  RayFileWriter writer(std::move(file), count);
  writer.data_offset_ = header.size();
  writer.buffer_.reserve(kBufferBytes / sizeof(Ray));
  writer.shuffled_ = shuffle_seed != nullptr;
  writer.seed_ = shuffle_seed != nullptr ? *shuffle_seed : 0;
  return writer;
}

Status RayFileWriter::append(std::span<const Ray> rays) {
  assert(rays.size() <= missing());
  // Ray already has the file's layout: org, tnear, dir, tfar.
  static_assert(offsetof(Ray, tnear) == 12 && offsetof(Ray, dir) == 16 && offsetof(Ray, tfar) == 28);
  for (const Ray& ray : rays) {
    if (!shuffled_) {
      buffer_.push_back(ray);
      ++written_;
      if (buffer_.size() == kBufferBytes / sizeof(Ray)) {
        RAYMILL_RETURN_IF_ERROR(flush());
      }
      continue;
    }
    const std::uint64_t place = permute(written_++, count_, seed_);
    RAYMILL_RETURN_IF_ERROR(file_.pwrite(std::as_bytes(std::span(&ray, 1)), data_offset_ + place * sizeof(Ray)));
  }
  return {};
}

Status RayFileWriter::flush() {
  const Status status = file_.write(std::as_bytes(std::span(buffer_)));
  buffer_.clear();
  return status;
}

Status RayFileWriter::commit() {
  assert(missing() == 0);
  RAYMILL_RETURN_IF_ERROR(flush());
  return file_.commit();
}

}  // namespace raymill::client
