// From triangles to a store file, and from a store file to hits, in one call each.
#pragma once

#include <string>
#include <vector>

#include "storage/io/build_store.h"
#include "tests/support/scenes.h"
#include "tests/support/temp_folder.h"
#include "traversal/engine.h"

namespace raymill::tests {

/// Everything a build may choose but its files; small pages, so that small scenes have many.
inline BuildConfig small_pages() {
  BuildConfig config;
  config.page_bytes = 16 << 10;
  config.threads = 1;
  config.memory = gibibytes(8);
  return config;
}

/// Builds FOLDER/name from the scene; fails the test where that does not work. Gives the store's path.
std::string build_store(const TempFolder& folder, const std::string& name, const Scene& scene,
                        BuildConfig config = small_pages());

/// Builds config.output with runs of at most `run_triangles`, so that small scenes have many; the scene is added as an
/// import would add it.
Result<BuildReport> build_in_runs(const Scene& scene, const BuildConfig& config, std::uint64_t run_triangles);
/// The same with the least memory, to within 256 KiB, that this process gets along with; config.memory is set to it.
Result<BuildReport> build_in_least_memory(const Scene& scene, BuildConfig& config, std::uint64_t run_triangles);

struct TraceSetup {
  TraceSetup() {
    engine.memory = gibibytes(8);
    engine.threads = 1;
    trace.fields = Field::all;
  }
  EngineConfig engine;
  TraceConfig trace;
  std::size_t push_rays = 0;          ///< rays of one push(); 0: all at once
  std::vector<PrimitiveIds> skipped;  ///< none, or one for each ray
  std::vector<std::uint32_t> masks;   ///< none, or one for each ray
};

struct Traced {
  Status status;
  std::vector<Hit> hits;
  std::vector<std::uint64_t> offsets;  ///< of lists: hits of ray i from offsets[i] to offsets[i + 1]
  std::uint64_t pieces = 0;            ///< chunks that they came in
  std::string rows;                    ///< as they stand in a hits file
  JobStats stats;
};

/// Runs all rays through a store by an engine of its own.
Traced trace(const std::string& path, std::span<const Ray> rays, const TraceSetup& setup = {});
/// Pushes, finishes and fetches on a job.
Traced run_job(Job& job, std::span<const Ray> rays, std::size_t push_rays = 0, const RayExtras& extras = {});

/// The same with the least memory that an engine of this process gets along with, found in small steps.
Traced trace_with_least_memory(const std::string& path, std::span<const Ray> rays, TraceSetup setup);
/// Sets setup.memory to the least, to within 64 KiB, under which this process opens the store now.
void set_least_memory(const std::string& path, EngineConfig& config);

/// Flips bits of one byte of a file.
void flip(const std::string& path, std::uint64_t offset, unsigned char bits = 1);

}  // namespace raymill::tests
