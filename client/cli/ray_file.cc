#include "client/cli/ray_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cerrno>
#include <cstring>
#include <limits>
#include <utility>

#include "client/cli/npy.h"
#include "client/cli/random.h"
#include "client/cli/ray_rounding.h"
#include "storage/base/file_io.h"

namespace raymill::client {

namespace {

constexpr std::size_t kBufferBytes = 64 << 10;

Status bad_rays(const std::string& path, const std::string& what) { return {ErrorCode::bad_rays, path + ": " + what}; }

Status io_error(const std::string& path, int number) {
  return {number == ENOENT ? ErrorCode::not_found : ErrorCode::io,
          "cannot read " + path + ": " + std::strerror(number)};
}

// Reads up to bytes.size() at `offset`; fewer only at the end of the file.
Result<std::size_t> read_at(const std::string& path, int descriptor, std::uint64_t offset, std::span<std::byte> bytes) {
  const auto got = storage::read_fully(descriptor, bytes, offset);
  return got ? Result<std::size_t>(*got) : Result<std::size_t>(io_error(path, errno));
}

// As Python writes it: (3, 6), (18,).
std::string shape_text(const std::vector<std::uint64_t>& shape) {
  std::string text = "(";
  for (std::size_t i = 0; i < shape.size(); ++i) {
    text += (i == 0 ? "" : ", ") + std::to_string(shape[i]);
  }
  return text + (shape.size() == 1 ? ",)" : ")");
}

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

RayFileReader::RayFileReader(RayFileReader&& other) noexcept { *this = std::move(other); }

RayFileReader& RayFileReader::operator=(RayFileReader&& other) noexcept {
  std::swap(path_, other.path_);
  std::swap(descriptor_, other.descriptor_);
  std::swap(buffer_, other.buffer_);
  count_ = other.count_;
  next_ = other.next_;
  data_offset_ = other.data_offset_;
  columns_ = other.columns_;
  value_bytes_ = other.value_bytes_;
  return *this;
}

RayFileReader::~RayFileReader() {
  if (descriptor_ >= 0) {
    ::close(descriptor_);
  }
}

Result<RayFileReader> RayFileReader::open(const std::string& path) {
  RayFileReader file;
  file.path_ = path;
  // O_NONBLOCK: a pipe without a writer is refused below instead of waited for.
  file.descriptor_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  struct stat stat {};
  if (file.descriptor_ < 0 || ::fstat(file.descriptor_, &stat) != 0) {
    return io_error(path, errno);
  }
  if (!S_ISREG(stat.st_mode)) {
    return bad_rays(path, "rays are read from plain files only; this is a folder, a pipe or a device");
  }
  const auto file_bytes = static_cast<std::uint64_t>(stat.st_size);
  file.buffer_.resize(std::max(kBufferBytes, kMaxNpyHeaderBytes));
  RAYMILL_ASSIGN_OR_RETURN(const std::size_t begin_bytes, read_at(path, file.descriptor_, 0, file.buffer_));
  const auto parsed = parse_npy_header(std::span(file.buffer_).first(begin_bytes));
  if (!parsed) {
    return bad_rays(path, parsed.status().message());
  }
  const NpyHeader& header = *parsed;
  if (header.descr == "<f4" || header.descr == "<f8") {
    file.value_bytes_ = header.descr == "<f4" ? 4 : 8;
  } else {
    return bad_rays(path, "rays are little-endian float32 or float64 ('<f4' or '<f8'), this file holds " +
                              header.descr.substr(0, 80));
  }
  if (header.fortran_order) {
    return bad_rays(path, "rays are stored row by row (C order), this file is in Fortran order");
  }
  if (header.shape.size() != 2 || (header.shape[1] != 6 && header.shape[1] != 8)) {
    return bad_rays(path, "rays have the shape (N, 6) or (N, 8), this file has " + shape_text(header.shape));
  }
  file.count_ = header.shape[0];
  file.columns_ = static_cast<unsigned>(header.shape[1]);
  file.data_offset_ = header.data_offset;
  const std::uint64_t row_bytes = std::uint64_t{file.columns_} * file.value_bytes_;
  const std::uint64_t data_bytes = file_bytes - std::min<std::uint64_t>(file_bytes, header.data_offset);
  if (data_bytes / row_bytes != file.count_ || data_bytes % row_bytes != 0) {
    return bad_rays(path, "its header promises " + std::to_string(file.count_) + " rays of " +
                              std::to_string(row_bytes) + " bytes, " + std::to_string(data_bytes) + " bytes follow");
  }
  (void)::posix_fadvise(file.descriptor_, 0, 0, POSIX_FADV_SEQUENTIAL);
  return file;
}

std::string RayFileReader::identity() const {
  struct stat info {};
  ::fstat(descriptor_, &info);
  return std::to_string(info.st_size) + " bytes of " + std::to_string(info.st_mtim.tv_sec) + "." +
         std::to_string(info.st_mtim.tv_nsec);
}

Result<std::size_t> RayFileReader::read(std::span<Ray> rays) {
  const std::size_t row_bytes = std::size_t{columns_} * value_bytes_;
  const std::size_t buffer_rays = buffer_.size() / row_bytes;
  const auto total = static_cast<std::size_t>(std::min<std::uint64_t>(rays.size(), count_ - next_));
  for (std::size_t done = 0; done < total;) {
    const std::size_t step = std::min(buffer_rays, total - done);
    const auto raw = std::span(buffer_).first(step * row_bytes);
    RAYMILL_ASSIGN_OR_RETURN(const std::size_t got, read_at(path_, descriptor_, data_offset_ + next_ * row_bytes, raw));
    if (got < raw.size()) {
      return bad_rays(path_, "the file became shorter while it was read");
    }
    if (value_bytes_ == 4) {
      convert<float>(raw, columns_, rays.subspan(done, step));
    } else {
      convert<double>(raw, columns_, rays.subspan(done, step));
    }
    done += step;
    next_ += step;
  }
  return total;
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
