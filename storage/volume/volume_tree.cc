#include "storage/volume/volume_tree.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <utility>

#include "storage/volume/affine.h"

namespace raymill::storage {
namespace {

// Multiples that float32 holds exactly.
constexpr float kMostSteps = 1 << 24;

Status not_finite(const GridInfo& grid, const Index3& origin) {
  return {ErrorCode::bad_scene, "grid '" + grid.name + "' holds a value that is not finite near voxel (" +
                                    std::to_string(origin[0]) + ", " + std::to_string(origin[1]) + ", " +
                                    std::to_string(origin[2]) + "); repair the grid before"};
}

template <typename T>
void put_steps(std::span<const float, kBrickValues> values, float inverse_step, std::int32_t base,
               std::vector<std::byte>& out) {
  for (const float value : values) {
    const auto q = static_cast<T>(static_cast<std::int32_t>(value * inverse_step) - base);
    out.insert(out.end(), reinterpret_cast<const std::byte*>(&q), reinterpret_cast<const std::byte*>(&q + 1));
  }
}

}  // namespace

VolumeTree::VolumeTree(const GridInfo& grid, Config config)
    : grid_(grid),
      config_(std::move(config)),
      levels_(levels_for(grid.cells)),
      next_page_(config_.first_page),
      open_(levels_),
      open_from_(levels_ + 1),
      image_(config_.page_bytes) {}

std::uint64_t VolumeTree::bytes(std::uint32_t page_bytes) {
  // Two open pages, an image, the streams that it is coded to and from; the bricks of a node; vectors grow by doubling.
  constexpr std::uint64_t kNodeBricks = kNodeChildren * (brick_bytes(4) + sizeof(PendingBrick));
  return 10 * std::uint64_t(page_bytes) + 2 * kNodeBricks + (kMostVolumeLevels + 1) * sizeof(VolumeNode);
}

Index3 VolumeTree::node_origin(const Index3& origin, unsigned level) const {
  const std::int32_t cells = cells_of_level(level);
  Index3 corner{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    corner[axis] = grid_.origin[axis] + (origin[axis] - grid_.origin[axis]) / cells * cells;
  }
  return corner;
}

VolumeNode VolumeTree::new_node(const Index3& origin, unsigned level) const {
  VolumeNode node;
  node.origin = origin;
  node.level = static_cast<std::uint8_t>(level);
  const float background = on_lattice(grid_.background);
  node.lower.fill(background);
  node.upper.fill(background);
  return node;
}

std::size_t VolumeTree::slot_in(const VolumeNode& node, const Index3& origin) {
  const std::int32_t cells = cells_of_level(node.level - 1U);
  std::size_t slot = 0;
  for (std::size_t axis = 3; axis-- > 0;) {
    slot = slot * kNodeSide + static_cast<std::size_t>((origin[axis] - node.origin[axis]) / cells);
  }
  return slot;
}

void VolumeTree::set(VolumeNode& node, std::size_t slot, const Child& child) {
  node.lower[slot] = child.lower;
  node.upper[slot] = child.upper;
  node.page[slot] = child.page;
  node.item[slot] = child.item;
  node.kind[slot] = child.kind;
}

// Opens the nodes above a child of `level` at `origin`, and closes those that it is not below.
Status VolumeTree::open_path(const Index3& origin, unsigned level, std::size_t& slot) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::int64_t offset = std::int64_t(origin[axis]) - grid_.origin[axis];
    if (level >= levels_ || offset < 0 || offset >= grid_.cells[axis] || offset % cells_of_level(level) != 0) {
      return {ErrorCode::internal, "a bug of Raymill: a brick outside its grid"};
    }
  }
  std::uint64_t place = 0;
  for (unsigned above = levels_; above > 0; --above) {
    place = place * kNodeChildren + slot_in(new_node(node_origin(origin, above), above), origin);
  }
  if (any_ && place <= last_place_) {
    return {ErrorCode::internal, "a bug of Raymill: bricks out of order"};
  }
  last_place_ = place;
  any_ = true;
  for (unsigned above = 1; above <= levels_; ++above) {
    const bool open = above >= open_from_;
    if (open && open_[above - 1].origin == node_origin(origin, above)) {
      break;
    }
    if (open) {
      RAYMILL_RETURN_IF_ERROR(close(above));
    }
  }
  while (open_from_ > level + 1) {
    --open_from_;
    open_[open_from_ - 1] = new_node(node_origin(origin, open_from_), open_from_);
  }
  slot = slot_in(open_[level], origin);
  return {};
}

float VolumeTree::on_lattice(float value) const {
  if (!config_.step_exponent) {
    return value;
  }
  const float steps = std::ldexp(value, -*config_.step_exponent);
  return std::fabs(steps) < kMostSteps ? std::ldexp(std::nearbyint(steps), *config_.step_exponent) : value;
}

// The brick with its values at the end of pending_values_.
Brick VolumeTree::quantise(std::span<const float, kBrickValues> values, const Index3& origin) {
  Brick brick;
  brick.origin = origin;
  const auto [least, most] = std::minmax_element(values.begin(), values.end());
  brick.lower = *least;
  brick.upper = *most;
  brick.values_offset = static_cast<std::uint32_t>(pending_values_.size());
  const float inverse_step = config_.step_exponent ? std::ldexp(1.0F, -*config_.step_exponent) : 0;
  const float least_step = brick.lower * inverse_step, most_step = brick.upper * inverse_step;
  const bool steps = config_.step_exponent && std::fabs(least_step) < kMostSteps && std::fabs(most_step) < kMostSteps;
  if (steps && most_step - least_step <= 0xFFFF) {
    brick.base = static_cast<std::int32_t>(least_step);
    brick.value_bytes = most_step - least_step <= 0xFF ? 1 : 2;
    brick.value_bytes == 1 ? put_steps<std::uint8_t>(values, inverse_step, brick.base, pending_values_)
                           : put_steps<std::uint16_t>(values, inverse_step, brick.base, pending_values_);
  } else {
    const auto bytes = std::as_bytes(values);
    pending_values_.insert(pending_values_.end(), bytes.begin(), bytes.end());
  }
  pending_values_.resize(brick.values_offset + std::size_t{brick_bytes(brick.value_bytes)});
  return brick;
}

Status VolumeTree::add_brick(const Index3& origin, std::span<const float, kBrickValues> values) {
  std::array<float, kBrickValues> kept{};
  for (std::size_t i = 0; i < kBrickValues; ++i) {
    if (!std::isfinite(values[i])) {
      return not_finite(grid_, origin);
    }
    kept[i] = on_lattice(values[i]) + 0.0F;  // no negative zero
  }
  std::size_t slot = 0;
  RAYMILL_RETURN_IF_ERROR(open_path(origin, 0, slot));
  if (std::all_of(kept.begin(), kept.end(), [&](float value) { return value == kept[0]; })) {
    set(open_[0], slot, {kept[0], kept[0]});
    return {};
  }
  pending_.push_back({quantise(kept, origin), slot});
  ++brick_count_;
  return {};
}

Status VolumeTree::add_tile(const Index3& origin, unsigned level, float value) {
  if (!std::isfinite(value)) {
    return not_finite(grid_, origin);
  }
  std::size_t slot = 0;
  RAYMILL_RETURN_IF_ERROR(open_path(origin, level, slot));
  const float kept = on_lattice(value) + 0.0F;
  set(open_[level], slot, {kept, kept});
  return {};
}

// Closes all open nodes up to this level and names the last one to its parent.
Status VolumeTree::close(unsigned level) {
  while (open_from_ <= level) {
    const unsigned closed = open_from_;
    RAYMILL_ASSIGN_OR_RETURN(const Child child, place(closed));
    ++open_from_;
    if (closed == levels_) {
      root_ = child;
    } else {
      set(open_[closed], slot_in(open_[closed], open_[closed - 1].origin), child);
    }
  }
  return {};
}

// Finds the node of the level a place in a page. A node of one value needs none, but the root, which rays enter by.
Result<VolumeTree::Child> VolumeTree::place(unsigned level) {
  if (level == 1) {
    RAYMILL_RETURN_IF_ERROR(place_bricks());
  }
  const VolumeNode& node = open_[level - 1];
  const auto is_tile = [&](std::size_t slot) {
    return node.kind[slot] == ChildKind::tile && node.lower[slot] == node.lower[0];
  };
  bool one_value = level < levels_;
  for (std::size_t slot = 0; slot < kNodeChildren && one_value; ++slot) {
    one_value = is_tile(slot);
  }
  if (one_value) {
    return Child{node.lower[0], node.lower[0]};
  }
  return place_node(level == 1 ? bricks_ : nodes_, node);
}

Result<VolumeTree::Child> VolumeTree::place_node(OpenPage& page, const VolumeNode& node) {
  if (!page.empty() && !fits(page, 1, 0, 0)) {
    RAYMILL_RETURN_IF_ERROR(flush(page));
  }
  begin(page);
  page.nodes.push_back(node);
  return Child{*std::min_element(node.lower.begin(), node.lower.end()),
               *std::max_element(node.upper.begin(), node.upper.end()), page.number,
               static_cast<std::uint16_t>(page.nodes.size() - 1), ChildKind::node};
}

// The bricks of the open node of level 1 go to pages: all to one, with the node, where that is large enough.
Status VolumeTree::place_bricks() {
  if (!bricks_.empty() && !fits(bricks_, 1, pending_.size(), pending_values_.size())) {
    RAYMILL_RETURN_IF_ERROR(flush(bricks_));
  }
  for (const PendingBrick& pending : pending_) {
    const std::size_t bytes = brick_bytes(pending.brick.value_bytes);
    if (!bricks_.empty() && !fits(bricks_, 0, 1, bytes)) {
      RAYMILL_RETURN_IF_ERROR(flush(bricks_));
    }
    begin(bricks_);
    Brick& brick = bricks_.bricks.emplace_back(pending.brick);
    brick.values_offset = static_cast<std::uint32_t>(bricks_.values.size());
    const auto values = std::span(pending_values_).subspan(pending.brick.values_offset, bytes);
    bricks_.values.insert(bricks_.values.end(), values.begin(), values.end());
    set(open_[0], pending.slot,
        {brick.lower, brick.upper, bricks_.number, static_cast<std::uint16_t>(bricks_.bricks.size() - 1),
         ChildKind::brick});
  }
  pending_.clear();
  pending_values_.clear();
  return {};
}

bool VolumeTree::fits(const OpenPage& page, std::size_t nodes, std::size_t bricks, std::size_t values) const {
  constexpr std::size_t kMostItems = 0xFFFF;
  const std::size_t node_count = page.nodes.size() + nodes, brick_count = page.bricks.size() + bricks;
  const std::size_t bytes = sizeof(VolumePageHeader) + node_count * sizeof(VolumeNode) + brick_count * sizeof(Brick) +
                            page.values.size() + values + kVolumeAlignment;
  return node_count <= kMostItems && brick_count <= kMostItems && bytes <= config_.page_bytes;
}

void VolumeTree::begin(OpenPage& page) {
  if (page.empty()) {
    page.number = next_page_++;
  }
}

Status VolumeTree::flush(OpenPage& page) {
  if (page.empty()) {
    return {};
  }
  VolumePageHeader header;
  header.volume = config_.volume;
  header.node_count = static_cast<std::uint16_t>(page.nodes.size());
  header.brick_count = static_cast<std::uint16_t>(page.bricks.size());
  header.values_bytes = static_cast<std::uint32_t>(page.values.size());
  header.plane_bytes = page.bricks.empty() ? 4 : 1;
  for (const Brick& brick : page.bricks) {
    header.plane_bytes = std::max(header.plane_bytes, brick.value_bytes);
  }
  lay_out(header);
  const auto image = std::span(image_).first(header.image_bytes);
  std::fill(image.begin(), image.end(), std::byte{0});
  std::memcpy(image.data(), &header, sizeof header);
  const auto copy = [&image](std::uint32_t offset, const auto& items) {
    const auto bytes = std::as_bytes(std::span(items));
    std::copy(bytes.begin(), bytes.end(), image.begin() + offset);
  };
  copy(header.nodes_offset, page.nodes);
  copy(header.bricks_offset, page.bricks);
  copy(header.values_offset, page.values);
  const std::uint32_t number = page.number;
  page.nodes.clear();
  page.bricks.clear();
  page.values.clear();
  return config_.write(number, image);
}

Result<Volume> VolumeTree::finish() {
  if (open_from_ > levels_) {
    open_from_ = levels_;
    open_[levels_ - 1] = new_node(grid_.origin, levels_);
  }
  RAYMILL_RETURN_IF_ERROR(close(levels_));
  RAYMILL_RETURN_IF_ERROR(flush(bricks_));
  RAYMILL_RETURN_IF_ERROR(flush(nodes_));
  Volume volume;
  volume.origin = grid_.origin;
  volume.cells = grid_.cells;
  volume.geometry_id = config_.geometry_id;
  volume.kind = grid_.kind;
  volume.lattice = config_.step_exponent ? 1 : 0;
  volume.levels = static_cast<std::uint8_t>(levels_);
  volume.step_exponent = config_.step_exponent.value_or(0);
  volume.root_page = root_.page;
  volume.root_node = root_.item;
  volume.background = on_lattice(grid_.background);
  volume.lower = root_.lower;
  volume.upper = root_.upper;
  volume.brick_count = brick_count_;
  volume.active_voxels = grid_.active_voxels;
  volume.world_from_index = grid_.world_from_index;
  const auto inverse = inverse_of(grid_.world_from_index);
  if (!inverse) {
    return {ErrorCode::bad_scene,
            "grid '" + grid_.name + "' has a transform that flattens it; give it one that does not"};
  }
  volume.index_from_world = *inverse;
  return volume;
}

}  // namespace raymill::storage
