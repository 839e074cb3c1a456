// build() and StoreWriter: the two ways into a StoreBuilder.
#include "storage/io/build_store.h"

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <new>
#include <thread>
#include <utility>

#include "storage/import/scene_import.h"
#include "storage/import/transform.h"
#include "storage/import/triangle_filter.h"
#include "storage/import/vdb_import.h"
#include "storage/io/store_builder.h"

namespace raymill {
namespace {

using namespace storage;

// As many workers as were asked for, also where that is more than there are cores; never fewer than others use.
std::size_t most_workers(unsigned threads) {
  return std::max(std::size_t{threads != 0 ? threads : std::max(1U, std::thread::hardware_concurrency())},
                  static_cast<std::size_t>(tbb::this_task_arena::max_concurrency()));
}

Result<BuildReport> build_scenes(const BuildConfig& config) {
  if (config.scenes.empty()) {
    return {ErrorCode::invalid_argument, "build needs at least one scene file and an output"};
  }
  const tbb::global_control workers(tbb::global_control::max_allowed_parallelism, most_workers(config.threads));
  RAYMILL_ASSIGN_OR_RETURN(const std::unique_ptr<StoreBuilder> builder, StoreBuilder::create(config));
  for (std::size_t i = 0; i < config.scenes.size(); ++i) {
    builder->set_import_fraction(double(i) / double(config.scenes.size()));
    RAYMILL_ASSIGN_OR_RETURN(const bool holds_volumes, is_vdb(config.scenes[i]));
    if (holds_volumes) {
      RAYMILL_RETURN_IF_ERROR(builder->add_volumes(config.scenes[i]));
      continue;
    }
    RAYMILL_RETURN_IF_ERROR(
        import_scene(config.scenes[i], {config.scene_index}, builder->ledger(), *builder, builder->import_report()));
  }
  return builder->finish();
}

Status no_memory() {
  return {ErrorCode::budget_exceeded, "the machine has no memory left for this build; lower --memory or free some"};
}

}  // namespace

Result<BuildReport> build(const BuildConfig& config) {
  try {
    return build_scenes(config);
  } catch (const std::bad_alloc&) {
    return no_memory();
  }
}

class StoreWriter::Impl {
 public:
  explicit Impl(BuildConfig config_in)
      : config(std::move(config_in)),
        workers(tbb::global_control::max_allowed_parallelism, most_workers(config.threads)) {}

  Status open() {
    RAYMILL_ASSIGN_OR_RETURN(builder, StoreBuilder::create(config));
    return {};
  }

  const BuildConfig config;
  const tbb::global_control workers;
  std::unique_ptr<StoreBuilder> builder;
  Status failure;  // of an earlier call
};

StoreWriter::StoreWriter(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
StoreWriter::StoreWriter(StoreWriter&&) noexcept = default;
StoreWriter& StoreWriter::operator=(StoreWriter&&) noexcept = default;
StoreWriter::~StoreWriter() = default;

Result<StoreWriter> StoreWriter::create(const BuildConfig& config) {
  if (!config.scenes.empty() || config.scene_index) {
    return {ErrorCode::invalid_argument, "a StoreWriter reads no scene files; call build() for them"};
  }
  auto impl = std::make_unique<Impl>(config);
  RAYMILL_RETURN_IF_ERROR(impl->open());
  return StoreWriter(std::move(impl));
}

namespace {

Status check(const MeshView& mesh) {
  const auto fault = [&](const std::string& what) {
    return Status(ErrorCode::invalid_argument, "mesh '" + std::string(mesh.name) + "': " + what);
  };
  if (mesh.positions.size() % 3 != 0) {
    return fault("positions come in threes, " + std::to_string(mesh.positions.size()) + " were given");
  }
  const std::size_t vertices = mesh.positions.size() / 3;
  const std::size_t corners = mesh.indices.empty() ? vertices : mesh.indices.size();
  if (corners % 3 != 0) {
    return fault("triangles have three corners, " + std::to_string(corners) + " were given");
  }
  const auto beyond =
      std::find_if(mesh.indices.begin(), mesh.indices.end(), [&](std::uint32_t index) { return index >= vertices; });
  if (beyond != mesh.indices.end()) {
    return fault("index " + std::to_string(*beyond) + " is not one of " + std::to_string(vertices) + " vertices");
  }
  return {};
}

}  // namespace

Status StoreWriter::add(const MeshView& mesh) {
  RAYMILL_RETURN_IF_ERROR(impl_->failure);
  RAYMILL_RETURN_IF_ERROR(check(mesh));
  StoreBuilder& builder = *impl_->builder;
  ImportReport& report = builder.import_report();
  GeometryInfo& geometry = report.geometries.emplace_back();
  geometry.node = geometry.mesh = mesh.name;
  const Transform transform = mesh.world_from_mesh ? Transform{*mesh.world_from_mesh} : Transform();
  const auto corner = [&](std::size_t i) {
    const std::size_t vertex = mesh.indices.empty() ? i : mesh.indices[i];
    const Vec3f p{mesh.positions[vertex * 3], mesh.positions[vertex * 3 + 1], mesh.positions[vertex * 3 + 2]};
    return mesh.world_from_mesh ? round_once(transform.apply({p.x, p.y, p.z})) : p;
  };
  try {
    TriangleWriter out(builder, report);
    out.begin_geometry();
    const std::size_t corners = mesh.indices.empty() ? mesh.positions.size() / 3 : mesh.indices.size();
    for (std::size_t i = 0; i < corners && impl_->failure.ok(); i += 3) {
      impl_->failure = out.add({corner(i), corner(i + 1), corner(i + 2)});
    }
    if (impl_->failure.ok()) {
      impl_->failure = out.flush();
    }
  } catch (const std::bad_alloc&) {
    impl_->failure = no_memory();
  }
  return impl_->failure;
}

Result<BuildReport> StoreWriter::finish() {
  RAYMILL_RETURN_IF_ERROR(impl_->failure);
  impl_->failure = {ErrorCode::invalid_argument, "the store is finished; nothing can be added to it"};
  const std::unique_ptr<StoreBuilder> builder = std::move(impl_->builder);  // its memory and files end with the call
  try {
    return builder->finish();
  } catch (const std::bad_alloc&) {
    return no_memory();
  }
}

}  // namespace raymill
