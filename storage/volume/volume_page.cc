#include "storage/volume/volume_page.h"

#include <algorithm>
#include <cstring>
#include <string>

namespace raymill::storage {
namespace {

std::uint32_t align(std::uint64_t offset) {
  return static_cast<std::uint32_t>((offset + kVolumeAlignment - 1) / kVolumeAlignment * kVolumeAlignment);
}

Status bad(const std::string& what) { return {ErrorCode::corrupt, "volume page " + what}; }

bool in_index_range(const Index3& index) {
  return std::all_of(index.begin(), index.end(),
                     [](std::int32_t i) { return i > -kMostVolumeIndex && i < kMostVolumeIndex; });
}

bool ordered(float lower, float upper) { return std::isfinite(lower) && std::isfinite(upper) && lower <= upper; }

const char* fault_of(const VolumeNode& node, const VolumeRules& rules) {
  if (node.level < 1 || node.level > kMostVolumeLevels || !in_index_range(node.origin)) {
    return "has a level or an origin that cannot be";
  }
  for (std::size_t slot = 0; slot < kNodeChildren; ++slot) {
    if (!ordered(node.lower[slot], node.upper[slot])) {
      return "has bounds that are not";
    }
    switch (node.kind[slot]) {
      case ChildKind::tile:
        if (node.lower[slot] != node.upper[slot]) {
          return "has a tile of two values";
        }
        break;
      case ChildKind::brick:
      case ChildKind::node:
        if ((node.kind[slot] == ChildKind::brick) != (node.level == 1)) {
          return "has a child of another level";
        }
        if (node.page[slot] >= rules.page_count) {
          return "refers to a page that is not there";
        }
        break;
      default:
        return "has a child of no known kind";
    }
  }
  return nullptr;
}

const char* fault_of(const Brick& brick, const VolumePageView& page) {
  const VolumePageHeader& header = page.header();
  if (brick.value_bytes != 1 && brick.value_bytes != 2 && brick.value_bytes != 4) {
    return "has values of no known size";
  }
  const std::uint32_t bytes = brick_bytes(brick.value_bytes);
  if (brick.values_offset % 4 != 0 || brick.values_offset > header.values_bytes ||
      bytes > header.values_bytes - brick.values_offset) {
    return "has values past the page's end";
  }
  constexpr std::int32_t kMostBase = 1 << 24;
  if (!in_index_range(brick.origin) || !ordered(brick.lower, brick.upper) || brick.base > kMostBase ||
      brick.base < -kMostBase) {
    return "has bounds or a place that cannot be";
  }
  if (brick.value_bytes == 4) {
    const auto* values = reinterpret_cast<const float*>(page.values(brick));
    if (!std::all_of(values, values + kBrickValues, [](float value) { return std::isfinite(value); })) {
      return "has a value that is not finite";
    }
  }
  return nullptr;
}

const char* fault_of(const Volume& volume, const VolumeRules& rules) {
  const bool kind = volume.kind == VolumeKind::fog || volume.kind == VolumeKind::level_set;
  if (!kind || volume.levels < 1 || volume.levels > kMostVolumeLevels || volume.lattice > 1 ||
      volume.step_exponent < -120 || volume.step_exponent > 120) {
    return "is of no known kind";
  }
  if (volume.root_page >= rules.page_count || volume.geometry_id >= rules.geometry_count) {
    return "refers to what is not there";
  }
  const std::int32_t most = cells_of_level(volume.levels);
  const bool cells = std::all_of(volume.cells.begin(), volume.cells.end(),
                                 [most](std::int32_t count) { return count >= 1 && count <= most; });
  if (!cells || !in_index_range(volume.origin) || !ordered(volume.lower, volume.upper) ||
      !std::isfinite(volume.background)) {
    return "has a place or bounds that cannot be";
  }
  for (const Affine* map : {&volume.world_from_index, &volume.index_from_world}) {
    for (const auto& row : *map) {
      if (!std::all_of(row.begin(), row.end(), [](double x) { return std::isfinite(x); })) {
        return "has a transform that is not finite";
      }
    }
  }
  return nullptr;
}

template <typename T, typename Fault>
Status check_each(const T* items, std::uint32_t count, const char* name, Fault&& fault) {
  for (std::uint32_t i = 0; i < count; ++i) {
    if (const char* what = fault(items[i]); what != nullptr) {
      return bad(std::string(name) + " " + std::to_string(i) + " " + what);
    }
  }
  return {};
}

}  // namespace

void lay_out(VolumePageHeader& header) {
  const std::uint64_t table_bytes = std::uint64_t(header.volume_count) * sizeof(Volume);
  header.nodes_offset = sizeof(VolumePageHeader);
  header.bricks_offset =
      align(header.nodes_offset + table_bytes + std::uint64_t(header.node_count) * sizeof(VolumeNode));
  header.values_offset = align(header.bricks_offset + std::uint64_t(header.brick_count) * sizeof(Brick));
  header.image_bytes = align(std::uint64_t(header.values_offset) + header.values_bytes);
}

Status validate_volume_image(std::span<const std::byte> image, const VolumeRules& rules) {
  if (image.size() < sizeof(VolumePageHeader)) {
    return bad("is shorter than its header");
  }
  const VolumePageView page(image.data());
  const VolumePageHeader& header = page.header();
  const bool is_table = header.kind == VolumePageKind::table;
  const bool known = header.magic == kVolumePageMagic && header.page_type == kPageTypeVolume &&
                     header.triangle_nodes == 0 && (is_table || header.kind == VolumePageKind::bricks) &&
                     (header.plane_bytes == 1 || header.plane_bytes == 2 || header.plane_bytes == 4);
  const bool fits = header.values_bytes <= rules.page_bytes && header.volume_count <= most_volumes(rules.page_bytes) &&
                    image.size() <= rules.page_bytes;
  const bool whole = is_table ? header.node_count == 0 && header.brick_count == 0 && header.values_bytes == 0 &&
                                    header.volume == 0 && header.volume_count > 0
                              : header.volume_count == 0 && header.node_count + header.brick_count > 0;
  if (!known || !fits || !whole) {
    return bad("is of no known kind or has counts that cannot be");
  }
  VolumePageHeader expected = header;
  lay_out(expected);
  if (std::memcmp(&expected, &header, sizeof header) != 0 || header.image_bytes != image.size()) {
    return bad("has counts that do not fit its size");
  }
  if (is_table) {
    return check_each(page.volumes(), header.volume_count, "volume",
                      [&](const Volume& v) { return fault_of(v, rules); });
  }
  RAYMILL_RETURN_IF_ERROR(
      check_each(page.nodes(), header.node_count, "node", [&](const VolumeNode& n) { return fault_of(n, rules); }));
  return check_each(page.bricks(), header.brick_count, "brick", [&](const Brick& b) { return fault_of(b, page); });
}

Status check_bounds(const std::byte* image, std::span<const Volume> volumes) {
  const VolumePageView page(image);
  if (page.header().kind == VolumePageKind::table) {
    return {};
  }
  if (page.header().volume >= volumes.size()) {
    return bad("belongs to a volume that the store does not have");
  }
  const float step = step_of(volumes[page.header().volume]);
  return check_each(page.bricks(), page.header().brick_count, "brick", [&](const Brick& brick) -> const char* {
    const BrickValues values(page, brick, step);
    float lower = values.at(0), upper = lower;
    for (int i = 1; i < kBrickValues; ++i) {
      lower = std::min(lower, values.at(i));
      upper = std::max(upper, values.at(i));
    }
    return lower == brick.lower && upper == brick.upper ? nullptr : "has bounds that are not those of its values";
  });
}

}  // namespace raymill::storage
