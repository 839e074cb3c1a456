// Where a store's origins lie: the one that all of it is relative to, and those of parts that lie apart.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "storage/import/vdb_import.h"
#include "storage/io/store_builder.h"

namespace raymill::storage {

namespace {

constexpr Placement moved_to(const std::array<double, 3>& p) { return {1, 0, 0, 0, 1, 0, 0, 0, 1, p[0], p[1], p[2]}; }

float largest(const Aabb& box, float most) {
  for (int axis = 0; axis < 3 && !box.empty(); ++axis) {
    most = std::max({most, std::fabs(box.lower[axis]), std::fabs(box.upper[axis])});
  }
  return most;
}

}  // namespace

Status StoreBuilder::choose_origins() {
  const bool wants_parts = plan_.origins != OriginsRule::never;
  bool is_open = !plan_.origin;
  std::vector<SceneLook> looks;
  std::vector<std::uint32_t> scenes;  // that the looks are at
  for (std::size_t i = 0; i < config_.scenes.size() && (is_open || wants_parts); ++i) {
    RAYMILL_ASSIGN_OR_RETURN(const bool holds_volumes, is_vdb(config_.scenes[i]));
    if (holds_volumes) {
      continue;
    }
    ImportOptions options;
    options.scene = config_.scene_index;
    const auto near = is_open ? std::nullopt : std::optional(origin_.position());
    RAYMILL_ASSIGN_OR_RETURN(
        SceneLook look, look_at_scene(config_.scenes[i], options, near, ledger_, [this] { return step("import", 0); }));
    if (std::exchange(is_open, false)) {
      origin_ = choose_origin(look.extent);
    }
    looks.push_back(std::move(look));
    scenes.push_back(static_cast<std::uint32_t>(i));
  }
  if (!wants_parts) {
    return {};
  }
  std::vector<ScenePiece> pieces;
  for (const SceneLook& look : looks) {
    for (const ScenePiece& piece : look.pieces) {
      pieces.push_back({piece.box.relative_to(origin_.position()), piece.gains});
    }
  }
  RAYMILL_RETURN_IF_ERROR(make_parts(std::move(pieces)));
  part_of_scene_.assign(config_.scenes.size(), kNoPart);
  for (std::size_t i = 0; i < looks.size(); ++i) {
    if (looks[i].is_whole) {
      part_of_scene_[scenes[i]] = part_of(parts_, looks[i].extent.relative_to(origin_.position()));
    }
  }
  return {};
}

Status StoreBuilder::make_parts(std::vector<ScenePiece> pieces) {
  parts_ = find_parts(std::move(pieces));
  RAYMILL_ASSIGN_OR_RETURN(parts_claim_, ledger_.claim(Tag::build, parts_.size() * BucketWriter::bytes()));
  objects_.resize(parts_.size());
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    part_writers_.emplace_back(blocks_);
  }
  return {};
}

ImportOptions StoreBuilder::begin_scene(std::size_t number) {
  ImportOptions options;
  options.scene = config_.scene_index;
  options.rule = plan_.instances;
  options.instances = this;
  options.origin = origin_.position();
  options.parts = parts_;
  options.part_sink = this;
  options.mask_rule = plan_.masks;
  options.masks = this;
  options.attributes = plan_.attributes;
  options.attribute_sink = this;
  part_ = part_of_scene_.empty() ? kNoPart : part_of_scene_[number];
  if (part_ != kNoPart) {
    const std::array<double, 3> own = parts_[part_].origin.position();
    for (std::size_t axis = 0; axis < 3; ++axis) {
      options.origin[axis] += own[axis];
    }
  }
  return options;
}

// Each part that a triangle came to is placed where it lies, with the geometry ids that it has in the scene. Its
// instance id is beyond those of the scene's own placements: exact ties tell spaces apart by it.
Status StoreBuilder::place_parts() {
  for (std::uint32_t i = 0; i < parts_.size(); ++i) {
    RAYMILL_ASSIGN_OR_RETURN(objects_[i].bucket, part_writers_[i].take());
    if (objects_[i].bucket.count == 0) {
      continue;
    }
    if (import_report_.instances == std::numeric_limits<std::uint32_t>::max()) {
      return {ErrorCode::unsupported, "the scene has 2^32 instances or more, more than ids reach"};
    }
    const Placement placement = moved_to(parts_[i].origin.position());
    if (!in_range(placed_box(placement, objects_[i].bucket.box))) {
      return {ErrorCode::bad_scene,
              "a mesh reaches beyond 2^120 and says that it does not (min and max of its accessors); mend it, or give "
              "--origins never"};
    }
    RAYMILL_RETURN_IF_ERROR(place({placement, i, 0, static_cast<std::uint32_t>(import_report_.instances++)}));
    ++report_.parts;
  }
  part_writers_.clear();
  parts_claim_ = {};
  return {};
}

bool StoreBuilder::is_wide() const {
  return report_.parts > 0 || (plan_.origins == OriginsRule::always && instances_.count() > 0);
}

Aabb StoreBuilder::box_of(const Placed& placed) const {
  const Aabb box = placed_box(placed.world_from_object, objects_[placed.object].parts.nodes[0].box);
  return is_wide() ? widened_for_rays(box, reach_) : box;
}

// The largest magnitude of a coordinate of the scene's own triangles, in a box, and of what is placed.
Result<float> StoreBuilder::reach(const Aabb& scene) const {
  float most = largest(scene, 0);
  for (std::uint64_t i = 0; i < instances_.count(); ++i) {
    RAYMILL_ASSIGN_OR_RETURN(const Placed placed, instances_.read(i));
    const Partition& object = objects_[placed.object].parts;
    if (!object.nodes.empty()) {
      most = largest(placed_box(placed.world_from_object, object.nodes[0].box), most);
    }
  }
  return most;
}

}  // namespace raymill::storage
