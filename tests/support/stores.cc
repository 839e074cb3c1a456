#include "tests/support/stores.h"

#include <algorithm>

#include "storage/import/triangle_filter.h"
#include "storage/io/store_builder.h"

namespace raymill::tests {

std::string build_store(const TempFolder& folder, const std::string& name, const Scene& scene, BuildConfig config) {
  const std::string input = folder / (name + ".glb");
  write_file(input, glb(scene));
  config.scenes = {input};
  config.output = folder / name;
  const Result<BuildReport> report = build(config);
  EXPECT_TRUE(report.ok()) << report.status().message();
  return config.output;
}

Result<BuildReport> build_in_runs(const Scene& scene, const BuildConfig& config, std::uint64_t run_triangles) {
  RAYMILL_ASSIGN_OR_RETURN(const auto builder, storage::StoreBuilder::create(config, run_triangles));
  storage::ImportReport& report = builder->import_report();
  storage::TriangleWriter writer(*builder, report);
  for (const Mesh& mesh : scene) {
    storage::GeometryInfo& geometry = report.add_geometry();
    geometry.node = geometry.mesh = "mesh" + std::to_string(report.geometries.size());
    writer.begin_geometry();
    for (const Corners& corners : mesh) {
      RAYMILL_RETURN_IF_ERROR(writer.add(corners));
    }
    RAYMILL_RETURN_IF_ERROR(writer.flush());
  }
  return builder->finish();
}

Result<BuildReport> build_in_least_memory(const Scene& scene, BuildConfig& config, std::uint64_t run_triangles) {
  config.memory = storage::resident_bytes();
  const std::uint64_t most = config.memory + mebibytes(256);
  for (;; config.memory += kibibytes(256)) {
    Result<BuildReport> report = build_in_runs(scene, config, run_triangles);
    if (report || report.status().code() != ErrorCode::budget_exceeded || config.memory > most) {
      return report;
    }
  }
}

namespace {

// Appends a chunk of lists: the offsets of the rays that end in it.
void append_lists(const HitChunk& chunk, Traced& traced) {
  const auto offsets = chunk.offsets();
  EXPECT_EQ(chunk.first_ray(), traced.offsets.size() - 1) << "the ray that went on, or the next one";
  EXPECT_EQ(offsets.back(), chunk.size());
  const std::uint64_t before = traced.hits.size() - chunk.size();
  for (std::size_t i = 1; i + (chunk.goes_on() ? 1 : 0) < offsets.size(); ++i) {
    traced.offsets.push_back(before + offsets[i]);
  }
  ++traced.pieces;
}

}  // namespace

Traced run_job(Job& job, std::span<const Ray> rays, std::size_t push_rays, const RayExtras& extras) {
  Traced traced;
  const std::size_t piece = push_rays == 0 ? std::max<std::size_t>(rays.size(), 1) : push_rays;
  for (std::size_t i = 0; i < rays.size() && traced.status.ok(); i += piece) {
    const auto some = rays.subspan(i, std::min(piece, rays.size() - i));
    const RayExtras bring{.skipped = extras.skipped.empty() ? extras.skipped : extras.skipped.subspan(i, some.size()),
                          .masks = extras.masks.empty() ? extras.masks : extras.masks.subspan(i, some.size())};
    const bool brings = !bring.skipped.empty() || !bring.masks.empty();
    traced.status = brings ? job.push_with(some, bring) : job.push(some);
  }
  (void)job.finish();
  traced.offsets.push_back(0);
  while (auto chunk = job.next()) {
    EXPECT_TRUE(!chunk->offsets().empty() || chunk->first_ray() == traced.hits.size());
    for (std::size_t i = 0; i < chunk->size(); ++i) {
      traced.hits.push_back(chunk->hit(i));
    }
    if (!chunk->offsets().empty()) {
      append_lists(*chunk, traced);
    }
    traced.rows.append(reinterpret_cast<const char*>(chunk->rows().data()), chunk->rows().size());
  }
  traced.status = job.status();
  traced.stats = job.stats();
  return traced;
}

Traced trace(const std::string& path, std::span<const Ray> rays, const TraceSetup& setup) {
  Traced failed;
  auto engine = Engine::create(setup.engine);
  if (!engine) {
    failed.status = engine.status();
    return failed;
  }
  auto store = (*engine)->open(path);
  if (!store) {
    failed.status = store.status();
    return failed;
  }
  auto job = (*store)->trace(setup.trace);
  if (!job) {
    failed.status = job.status();
    return failed;
  }
  return run_job(**job, rays, setup.push_rays, {.skipped = setup.skipped, .masks = setup.masks});
}

void set_least_memory(const std::string& path, EngineConfig& config) {
  config.memory = gibibytes(64);
  std::uint64_t least = 0;
  if (auto engine = Engine::create(config); engine) {
    if (auto store = (*engine)->open(path); store) {
      if (const auto info = (*store)->info(); info) {
        least = info->least_memory_bytes;
      }
    }
  }
  EXPECT_GT(least, mebibytes(2));
  // What info() says is rounded up; and the process may have grown a little since.
  for (config.memory = least - mebibytes(2); config.memory < least + mebibytes(64); config.memory += kibibytes(64)) {
    if (auto engine = Engine::create(config); engine && (*engine)->open(path)) {
      return;
    }
  }
  ADD_FAILURE() << "no engine opens " << path << " with what it says it needs";
}

Traced trace_with_least_memory(const std::string& path, std::span<const Ray> rays, TraceSetup setup) {
  set_least_memory(path, setup.engine);
  const std::uint64_t least = setup.engine.memory;
  Traced traced;
  do {
    traced = trace(path, rays, setup);
    setup.engine.memory += kibibytes(64);
  } while (traced.status.code() == ErrorCode::budget_exceeded && setup.engine.memory < least + mebibytes(64));
  return traced;
}

void flip(const std::string& path, std::uint64_t offset, unsigned char bits) {
  std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
  file.seekg(static_cast<std::streamoff>(offset));
  const auto byte = static_cast<char>(file.get() ^ bits);
  file.seekp(static_cast<std::streamoff>(offset));
  file.put(byte);
  EXPECT_TRUE(file.good());
}

}  // namespace raymill::tests
