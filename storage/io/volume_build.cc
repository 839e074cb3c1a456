#include "storage/io/volume_build.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstring>
#include <limits>

#include "storage/base/aligned.h"
#include "storage/pages/page_encoder.h"
#include "storage/pages/page_image.h"
#include "storage/pages/volume_codec.h"
#include "storage/volume/affine.h"
#include "storage/volume/volume_tree.h"

namespace raymill::storage {
namespace {

// zstd's tables, and the pipe's buffer.
constexpr std::uint64_t kScratchBytes = 5 << 20;
constexpr int kMostExponent = 100;

// Bounds as float32 that surely hold the box.
void grow(StoreFooter& footer, const Volume& volume) {
  for (unsigned corner = 0; corner < 8; ++corner) {
    Point3 p{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      p[axis] = double(volume.origin[axis]) + ((corner >> axis & 1) != 0 ? volume.cells[axis] : 0);
    }
    p = map_point(volume.world_from_index, p);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto at = static_cast<float>(p[axis]);
      constexpr float kInf = std::numeric_limits<float>::infinity();
      footer.bounds_min[axis] = std::min(footer.bounds_min[axis], std::nextafter(at, -kInf));
      footer.bounds_max[axis] = std::max(footer.bounds_max[axis], std::nextafter(at, kInf));
    }
  }
}

template <int N>
PageBuffer empty_root() {
  PageHeader header;
  header.width = N;
  header.node_count = 1;
  lay_out(header);
  Node<N> node;
  for (auto& planes : node.lower) {
    planes.fill(255);
  }
  PageBuffer image(header.image_bytes);
  std::memcpy(image.data(), &header, sizeof header);
  std::memcpy(image.data() + header.nodes_offset, &node, sizeof node);
  return image;
}

}  // namespace

Result<std::optional<std::int32_t>> parse_volume_values(const std::string& text) {
  if (text == "float32") {
    return std::optional<std::int32_t>();
  }
  const std::string prefix = "lattice:";
  double step = 0;
  if (text.starts_with(prefix)) {
    const char* end = text.data() + text.size();
    const auto [last, error] = std::from_chars(text.data() + prefix.size(), end, step);
    step = error == std::errc{} && last == end ? step : 0;
  }
  if (!(step > 0) || !std::isfinite(step) || std::abs(std::ilogb(step)) > kMostExponent) {
    return {ErrorCode::invalid_argument,
            "--volume-values " + text + " is neither float32 nor lattice:STEP, such as lattice:0.004"};
  }
  return std::optional<std::int32_t>(std::ilogb(step));
}

Result<Affine> parse_volume_transform(const std::string& text) {
  Affine map{{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
  if (text == "identity") {
    return map;
  }
  std::array<double, 16> numbers{0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1};
  std::size_t count = 0;
  const char* at = text.data();
  const char* const end = text.data() + text.size();
  bool good = true;
  while (good && at != end && count < numbers.size()) {
    const auto [last, error] = std::from_chars(at, end, numbers[count]);
    good = error == std::errc{} && std::isfinite(numbers[count]);
    at = good && last != end && (*last == ',' || *last == ' ') ? last + 1 : last;
    ++count;
  }
  const bool affine = numbers[12] == 0 && numbers[13] == 0 && numbers[14] == 0 && numbers[15] == 1;
  if (!good || at != end || (count != 12 && count != 16) || !affine) {
    return {
        ErrorCode::invalid_argument,
        "--volume-transform takes 'identity' or 12 or 16 numbers, the rows of an affine matrix, separated by commas"};
  }
  for (std::size_t i = 0; i < 12; ++i) {
    map[i / 4][i % 4] = numbers[i];
  }
  return map;
}

Status VolumeBuild::add(const std::string& path, const Affine& world_from_file, ImportReport& report) {
  RAYMILL_ASSIGN_OR_RETURN(std::vector<VdbGrid> grids, list_vdb(path, config_.grids, report));
  for (VdbGrid& found : grids) {
    GridInfo& grid = found.grid;
    grid.world_from_index = compose(world_from_file, grid.world_from_index);
    if (!inverse_of(grid.world_from_index)) {
      return {ErrorCode::bad_scene,
              path + ": grid '" + grid.name + "' has a transform that flattens it; give it one that does not"};
    }
    if (sources_.size() >= most_volumes(config_.page_bytes)) {
      return {ErrorCode::unsupported, path + ": a store with pages of this size takes " +
                                          std::to_string(most_volumes(config_.page_bytes)) +
                                          " volumes; build with a larger --page-size"};
    }
    const auto id = static_cast<std::uint32_t>(report.geometry_count);
    const char* kind = grid.kind == VolumeKind::level_set ? "level set" : "fog volume";
    GeometryInfo& geometry = report.add_geometry();
    geometry.file = path;
    geometry.node = grid.name;
    geometry.mesh = kind;
    report.volumes.push_back({id, path, grid.name, kind, grid.active_voxels, grid.origin, grid.cells});
    sources_.push_back({path, std::move(found), id});
  }
  return {};
}

Status VolumeBuild::write_empty_root(StoreFileWriter& writer, StoreFooter& footer) const {
  const PageBuffer image = config_.width == 8 ? empty_root<8>() : empty_root<4>();
  PageEncoder encoder(Codec::raw, {});
  footer.levels = 1;
  footer.node_count = 1;
  footer.bounds_min.fill(std::numeric_limits<float>::max());
  footer.bounds_max.fill(std::numeric_limits<float>::lowest());
  return writer.add_page(PageId{0}, encoder.encode(image), static_cast<std::uint32_t>(image.size()));
}

Result<Volume> VolumeBuild::write_volume(std::uint32_t index, StoreFileWriter& writer,
                                         const std::function<Status(double fraction)>& step) {
  const Source& source = sources_[index];
  VolumeTree::Config config{index, source.geometry_id, config_.page_bytes, next_page_, config_.step_exponent, {}};
  config.write = [&](std::uint32_t page, std::span<const std::byte> image) -> Status {
    RAYMILL_RETURN_IF_ERROR(step(double(index) / double(sources_.size())));
    return writer.add_page(PageId{page}, encode_volume_page(image, config_.codec),
                           static_cast<std::uint32_t>(image.size()));
  };
  VolumeTree tree(source.grid.grid, std::move(config));
  RAYMILL_RETURN_IF_ERROR(read_vdb(source.path, source.grid, tree));
  Result<Volume> volume = tree.finish();
  next_page_ = tree.next_page();
  return volume;
}

Status VolumeBuild::write(StoreFileWriter& writer, StoreFooter& footer, Ledger& ledger,
                          const std::function<Status(double fraction)>& step) {
  RAYMILL_ASSIGN_OR_RETURN(const BudgetReservation claim,
                           ledger.claim(Tag::build, VolumeTree::bytes(config_.page_bytes) + kScratchBytes));
  next_page_ = static_cast<std::uint32_t>(writer.page_count());
  std::vector<Volume> volumes;
  for (std::uint32_t i = 0; i < sources_.size(); ++i) {
    RAYMILL_ASSIGN_OR_RETURN(const Volume volume, write_volume(i, writer, step));
    bricks_ += volume.brick_count;
    grow(footer, volume);
    volumes.push_back(volume);
  }
  return write_table(volumes, writer, footer);
}

Status VolumeBuild::write_table(std::vector<Volume>& volumes, StoreFileWriter& writer, StoreFooter& footer) const {
  VolumePageHeader header;
  header.kind = VolumePageKind::table;
  header.volume_count = static_cast<std::uint32_t>(volumes.size());
  lay_out(header);
  PageBuffer image(header.image_bytes);
  std::memcpy(image.data(), &header, sizeof header);
  std::memcpy(image.data() + header.nodes_offset, volumes.data(), volumes.size() * sizeof(Volume));
  footer.volume_page = next_page_;
  return writer.add_page(PageId{next_page_}, encode_volume_page(image, config_.codec), header.image_bytes);
}

}  // namespace raymill::storage
