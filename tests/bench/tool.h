// What the benches' tools share: the clock of a thread, rays and triangles from files.
#pragma once

#include <time.h>

#include <algorithm>
#include <span>
#include <string>
#include <vector>

#include "client/cli/ray_file.h"
#include "storage/import/scene_import.h"

namespace raymill::bench {

/// The CPU time of this thread: what else runs on the machine takes from it only through the caches.
inline double thread_seconds() {
  timespec time{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// Keeps all triangles.
class TriangleCollector final : public storage::TriangleSink {
 public:
  Status add(std::span<const storage::Triangle> triangles) override {
    all.insert(all.end(), triangles.begin(), triangles.end());
    return {};
  }
  std::vector<storage::Triangle> all;
};

/// The file's first rays, at most so many. Errors: RayFileReader's; invalid_argument (there are none).
inline Result<std::vector<Ray>> read_rays(const std::string& path, std::size_t most) {
  RAYMILL_ASSIGN_OR_RETURN(auto reader, client::RayFileReader::open(path));
  std::vector<Ray> rays(std::min<std::size_t>(reader.count(), most));
  RAYMILL_ASSIGN_OR_RETURN(const std::size_t count, reader.read(rays));
  if (count == 0) {
    return {ErrorCode::invalid_argument, path + ": holds no rays"};
  }
  rays.resize(count);
  return rays;
}

}  // namespace raymill::bench
