#include "tests/bench/seed/resident_rays.h"

#include <sys/mman.h>
#include <unistd.h>

#include <cstring>
#include <fstream>

#include "storage/base/mapped_memory.h"

namespace raymill::bench {
namespace {

Result<std::uint64_t> resident_bytes() {
  std::ifstream file("/proc/self/statm");
  std::uint64_t size_pages = 0, resident_pages = 0;
  if (!(file >> size_pages >> resident_pages)) {
    return {ErrorCode::io, "/proc/self/statm cannot be read"};
  }
  return resident_pages * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
}

}  // namespace

Result<ResidentRays> measure_resident_rays(const Algorithm& algorithm) {
  const std::uint64_t count = kResidentBytes / algorithm.record_bytes;
  RAYMILL_ASSIGN_OR_RETURN(const std::uint64_t before, resident_bytes());
  storage::MappedMemory records(count * algorithm.record_bytes);
  if (records.data() == nullptr) {
    return {ErrorCode::io, "the system gives no room for rays"};
  }
  std::memset(records.data(), 1, count * algorithm.record_bytes);
  RAYMILL_ASSIGN_OR_RETURN(const std::uint64_t after, resident_bytes());
  ResidentRays measured;
  measured.grown_bytes = after - before;
  measured.rays = static_cast<double>(count) * kResidentBytes / static_cast<double>(measured.grown_bytes);
  return measured;
}

}  // namespace raymill::bench
