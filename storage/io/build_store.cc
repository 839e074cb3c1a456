// build() and StoreWriter: the two ways into a StoreBuilder.
#include "storage/io/build_store.h"

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <limits>
#include <new>
#include <optional>
#include <thread>
#include <type_traits>
#include <utility>

#include "storage/base/float_mode.h"
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
  RAYMILL_RETURN_IF_ERROR(builder->choose_origins());
  for (std::size_t i = 0; i < config.scenes.size(); ++i) {
    builder->set_import_fraction(double(i) / double(config.scenes.size()));
    RAYMILL_ASSIGN_OR_RETURN(const bool holds_volumes, is_vdb(config.scenes[i]));
    if (holds_volumes) {
      RAYMILL_RETURN_IF_ERROR(builder->add_volumes(config.scenes[i]));
      continue;
    }
    RAYMILL_RETURN_IF_ERROR(
        import_scene(config.scenes[i], builder->begin_scene(i), builder->ledger(), *builder, builder->import_report()));
  }
  return builder->finish();
}

Status no_memory() {
  return {ErrorCode::budget_exceeded, "the machine has no memory left for this build; lower --memory or free some"};
}

}  // namespace

Result<BuildReport> build(const BuildConfig& config) {
  const DefaultFloatMode float_mode;
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

  // An object's meshes, for the report of each place.
  struct Object {
    std::vector<GeometryInfo> geometries;
    Aabb box;
  };

  /// The mesh's positions are taken relative to `origin`.
  Status add(const MeshView& mesh, const std::array<double, 3>& origin, TriangleWriter& out);
  Result<std::uint32_t> add_object(std::span<const MeshView> meshes);
  Status place(std::uint32_t object, const Placement& placement);

  const BuildConfig config;
  const tbb::global_control workers;
  std::unique_ptr<StoreBuilder> builder;
  std::vector<Object> objects;
  std::optional<std::uint32_t> last_placed;  // whose geometries are the report's last
  Status failure;                            // of an earlier call
};

StoreWriter::StoreWriter(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
StoreWriter::StoreWriter(StoreWriter&&) noexcept = default;
StoreWriter& StoreWriter::operator=(StoreWriter&&) noexcept = default;
StoreWriter::~StoreWriter() = default;

Result<StoreWriter> StoreWriter::create(const BuildConfig& config) {
  if (!config.scenes.empty() || config.scene_index) {
    return {ErrorCode::invalid_argument, "a StoreWriter reads no scene files; call build() for them"};
  }
  if (!config.attributes.empty()) {
    return {ErrorCode::invalid_argument,
            "a StoreWriter's meshes have no attributes; leave BuildConfig::attributes out"};
  }
  const DefaultFloatMode float_mode;
  auto impl = std::make_unique<Impl>(config);
  RAYMILL_RETURN_IF_ERROR(impl->open());
  return StoreWriter(std::move(impl));
}

namespace {

Status check(const MeshView& mesh) {
  const auto fault = [&](const std::string& what) {
    return Status(ErrorCode::invalid_argument, "mesh '" + std::string(mesh.name) + "': " + what);
  };
  if (!mesh.positions.empty() && !mesh.positions64.empty()) {
    return fault("positions are given in float32 or in float64, not in both");
  }
  const std::size_t numbers = mesh.positions.size() + mesh.positions64.size();
  if (numbers % 3 != 0) {
    return fault("positions come in threes, " + std::to_string(numbers) + " were given");
  }
  const std::size_t vertices = numbers / 3;
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

Status StoreWriter::Impl::add(const MeshView& mesh, const std::array<double, 3>& origin, TriangleWriter& out) {
  Transform transform = mesh.world_from_mesh ? Transform{*mesh.world_from_mesh} : Transform();
  transform.move_back(origin);
  const bool moves = transform.m != Transform().m;
  const auto corner = [&](std::size_t i) {
    const std::size_t vertex = 3 * std::size_t{mesh.indices.empty() ? i : mesh.indices[i]};
    if (!mesh.positions64.empty()) {
      const double* p = &mesh.positions64[vertex];
      return round_once(moves ? transform.apply({p[0], p[1], p[2]}) : Vec3d{p[0], p[1], p[2]});
    }
    const float* p = &mesh.positions[vertex];
    return moves ? round_once(transform.apply({p[0], p[1], p[2]})) : Vec3f{p[0], p[1], p[2]};
  };
  const std::size_t vertices = (mesh.positions.size() + mesh.positions64.size()) / 3;
  const std::size_t corners = mesh.indices.empty() ? vertices : mesh.indices.size();
  for (std::size_t i = 0; i < corners; i += 3) {
    RAYMILL_RETURN_IF_ERROR(out.add({corner(i), corner(i + 1), corner(i + 2)}));
  }
  return out.flush();
}

// Counts and names stand in a report of their own until the object is placed.
Result<std::uint32_t> StoreWriter::Impl::add_object(std::span<const MeshView> meshes) {
  ImportReport report;
  TriangleWriter out(*builder, report);
  RAYMILL_RETURN_IF_ERROR(builder->begin_object());
  for (const MeshView& mesh : meshes) {
    GeometryInfo& geometry = report.add_geometry();
    geometry.node = geometry.mesh = mesh.name;
    geometry.primitive = geometry.geometry_id;
    out.begin_geometry();
    RAYMILL_RETURN_IF_ERROR(add(mesh, {}, out));
  }
  RAYMILL_ASSIGN_OR_RETURN(const InstanceSink::Object object, builder->end_object());
  for (const auto& [code, count] : report.counts) {
    builder->import_report().counts[code] += count;
  }
  objects.push_back({std::move(report.geometries), object.box});
  return object.number;
}

Status StoreWriter::Impl::place(std::uint32_t object, const Placement& placement) {
  ImportReport& report = builder->import_report();
  const std::vector<GeometryInfo>& geometries = objects[object].geometries;
  const std::uint64_t base = report.geometry_count;
  if (base + geometries.size() >= std::numeric_limits<std::uint32_t>::max()) {
    return {ErrorCode::unsupported, "the scene has 2^32 geometries or more, more than ids reach"};
  }
  if (last_placed != object) {
    report.geometries.insert(report.geometries.end(), geometries.begin(), geometries.end());
  }
  const auto entries = std::span(report.geometries).last(geometries.size());
  for (std::size_t i = 0; i < entries.size(); ++i) {
    GeometryInfo& entry = entries[i];
    const bool again = last_placed == object;
    entry.geometry_id = again ? entry.geometry_id : static_cast<std::uint32_t>(base + i);
    entry.copies += again ? 1 : 0;
    entry.stride = entry.copies > 1 ? static_cast<std::uint32_t>(entries.size()) : 1;
    entry.triangles += again ? geometries[i].triangles : 0;
    entry.kept += again ? geometries[i].kept : 0;
    report.triangles += geometries[i].triangles;
    report.kept += geometries[i].kept;
  }
  report.geometry_count += geometries.size();
  last_placed = object;
  if (objects[object].box.empty()) {
    return {};
  }
  return builder->place(
      {placement, object, static_cast<std::uint32_t>(base), static_cast<std::uint32_t>(report.instances++)});
}

namespace {

// What may throw where the machine is out of memory, whatever the caller's float mode.
template <typename Work>
auto guarded(Status& failure, Work&& work) -> decltype(work()) {
  const DefaultFloatMode float_mode;
  try {
    auto result = work();
    if constexpr (std::is_same_v<decltype(result), Status>) {
      failure = result;
    } else {
      failure = result.status();
    }
    return result;
  } catch (const std::bad_alloc&) {
    failure = no_memory();
    return failure;
  }
}

}  // namespace

Status StoreWriter::add(const MeshView& mesh) {
  RAYMILL_RETURN_IF_ERROR(impl_->failure);
  RAYMILL_RETURN_IF_ERROR(check(mesh));
  return guarded(impl_->failure, [&] {
    ImportReport& report = impl_->builder->import_report();
    GeometryInfo& geometry = report.add_geometry();
    geometry.node = geometry.mesh = mesh.name;
    impl_->last_placed.reset();
    TriangleWriter out(*impl_->builder, report);
    out.begin_geometry();
    return impl_->add(mesh, impl_->builder->origin().position(), out);
  });
}

Result<std::uint32_t> StoreWriter::add_object(std::span<const MeshView> meshes) {
  RAYMILL_RETURN_IF_ERROR(impl_->failure);
  for (const MeshView& mesh : meshes) {
    RAYMILL_RETURN_IF_ERROR(check(mesh));
  }
  return guarded(impl_->failure, [&] { return impl_->add_object(meshes); });
}

Status StoreWriter::place(std::uint32_t object, const std::array<double, 16>& world_from_object) {
  RAYMILL_RETURN_IF_ERROR(impl_->failure);
  if (object >= impl_->objects.size()) {
    return {ErrorCode::invalid_argument, "there is no object " + std::to_string(object) + " to be placed; " +
                                             std::to_string(impl_->objects.size()) + " were added"};
  }
  Transform transform{world_from_object};
  transform.move_back(impl_->builder->origin().position());
  const Placement placement = placement_of(transform);
  const auto& m = world_from_object;
  const bool affine = m[3] == 0 && m[7] == 0 && m[11] == 0 && m[15] == 1;
  const Aabb& box = impl_->objects[object].box;
  if (!affine || !invertible(placement) || (!box.empty() && !in_range(placed_box(placement, box)))) {
    return {ErrorCode::invalid_argument, "object " + std::to_string(object) +
                                             " cannot be placed by a matrix that is not affine, all but singular or "
                                             "beyond float32; add() its meshes with it"};
  }
  return guarded(impl_->failure, [&] { return impl_->place(object, placement); });
}

Result<BuildReport> StoreWriter::finish() {
  RAYMILL_RETURN_IF_ERROR(impl_->failure);
  impl_->failure = {ErrorCode::invalid_argument, "the store is finished; nothing can be added to it"};
  const DefaultFloatMode float_mode;
  const std::unique_ptr<StoreBuilder> builder = std::move(impl_->builder);  // its memory and files end with the call
  try {
    return builder->finish();
  } catch (const std::bad_alloc&) {
    return no_memory();
  }
}

}  // namespace raymill
