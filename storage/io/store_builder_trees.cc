// The trees of a store: how many levels each may take, how many of its runs are built at once, and their pages.
#include <algorithm>
#include <string>

#include "storage/io/run_pipeline.h"
#include "storage/io/store_builder.h"
#include "storage/pages/mask_page.h"

namespace raymill::storage {

Result<unsigned> StoreBuilder::object_level(const Partition& scene) const {
  const unsigned width = config_.width;
  const unsigned most = max_levels(width);
  unsigned of_objects = 0;
  for (const Tree& object : objects_) {
    of_objects = std::max(of_objects, object.parts.runs.empty() ? 0 : least_levels(object.parts, width));
  }
  const unsigned of_scene = least_levels(scene, width);
  if (of_scene + of_objects > most) {
    return {ErrorCode::unsupported, std::to_string(scene.nodes[0].count) +
                                        " triangles and instances need a tree deeper than the " +
                                        std::to_string(kBitstackBits) + "-bit bitstack holds; use --width 8"};
  }
  // What is left is shared: a tree follows the SAH only with some levels to spare.
  return of_objects == 0 ? 0 : of_scene + (most - of_scene - of_objects) / 2;
}

Result<Instance> StoreBuilder::instance(std::uint32_t number) const {
  RAYMILL_ASSIGN_OR_RETURN(const Placed placed, instances_.read(number));
  const Tree& object = objects_[placed.object];
  const Aabb box = box_of(placed);
  Instance instance;
  instance.world_from_object = placed.world_from_object;
  instance.lower = box.lower;
  instance.upper = box.upper;
  instance.page = object.root_page;
  instance.geometry_base = placed.geometry_base;
  instance.instance_id = placed.instance_id;
  return instance;
}

Status StoreBuilder::write_trees(const Partition& scene, unsigned object_level, const PositionKind& positions,
                                 StoreFileWriter& writer, StoreFooter& footer) {
  in_all_ = scene.nodes[0].count;
  for (const Tree& object : objects_) {
    in_all_ += object.parts.nodes.empty() ? 0 : object.parts.nodes[0].count;
  }
  const unsigned most = max_levels(config_.width);
  std::uint32_t next_page = 0;
  RAYMILL_RETURN_IF_ERROR(write_masks(writer, next_page));
  const auto add = [&footer, this](const TreeTotals& totals) {
    footer.triangle_count += totals.triangles;
    footer.instance_count += totals.instances;
    footer.node_count += totals.nodes;
    footer.levels = std::max(footer.levels, totals.levels);
    import_report_.masks.section_bytes += totals.mask_section_bytes;
  };
  for (std::uint32_t number = 0; number < objects_.size(); ++number) {
    Tree& object = objects_[number];
    if (object.parts.runs.empty() || object.placed == 0) {
      continue;
    }
    object.root_page = next_page;
    RAYMILL_ASSIGN_OR_RETURN(const TreeTotals totals,
                             write_tree(object.parts, number, {object_level, most}, positions, writer, next_page));
    add(totals);
    ++footer.object_count;
  }
  footer.object_level = footer.object_count > 0 ? object_level : 0;
  footer.root_page = next_page;
  const LevelRange levels{0, object_level != 0 ? object_level : most};
  RAYMILL_ASSIGN_OR_RETURN(const TreeTotals totals,
                           write_tree(scene, MaskSpool::kWorld, levels, positions, writer, next_page));
  add(totals);
  const Aabb& box = scene.nodes[0].box;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    footer.bounds_min[axis] = box.lower[static_cast<int>(axis)];
    footer.bounds_max[axis] = box.upper[static_cast<int>(axis)];
  }
  report_.sah_cost = box.half_area() > 0 ? 1 + totals.area_cost / box.half_area() : 0;
  return {};
}

// Masks come first in the file: triangles name their pages.
Status StoreBuilder::write_masks(StoreFileWriter& writer, std::uint32_t& next_page) {
  const Result<BudgetReservation> claim =
      ledger_.claim(Tag::build, masks_.masks().empty() ? 0 : page_build_bytes(config_.page_bytes, plan_.codec));
  RAYMILL_RETURN_IF_ERROR(claim.status());
  for (const MaskSpool::Mask& mask : masks_.masks()) {
    RAYMILL_RETURN_IF_ERROR(step("masks", double(mask_refs_.size()) / double(masks_.masks().size())));
    mask_refs_.push_back({mask.info, next_page, 0});
    const std::uint64_t tiles = tile_count(mask.info);
    const std::uint32_t most = tiles_per_page(mask.info.bits, config_.page_bytes);
    for (std::uint64_t first = 0; first < tiles; first += most) {
      std::vector<std::byte> texels(std::min<std::uint64_t>(most, tiles - first) * tile_bytes(mask.info.bits));
      RAYMILL_RETURN_IF_ERROR(masks_.read_tiles(mask, first, texels));
      const std::vector<std::byte> image = make_mask_page(mask.info.bits, texels);
      const std::vector<std::byte> encoded = encode_mask_page(image, plan_.codec);
      RAYMILL_RETURN_IF_ERROR(writer.add_page(PageId{next_page++}, encoded, static_cast<std::uint32_t>(image.size())));
      import_report_.masks.encoded_bytes += encoded.size();
      ++import_report_.masks.pages;
    }
  }
  return {};
}

Result<TreeTotals> StoreBuilder::write_tree(const Partition& parts, std::uint32_t tree, LevelRange levels,
                                            const PositionKind& positions, StoreFileWriter& writer,
                                            std::uint32_t& next_page) {
  const TopTree top = build_top_tree(parts, config_.width, levels);
  std::uint64_t a_run = 0;
  for (std::size_t run = 0; run < parts.runs.size(); ++run) {
    const std::uint64_t count = parts.runs[run].count;
    const std::uint64_t beside = parts.holds_instances(run) ? instance_run_bytes(count)
                                 : masks_.empty()           ? 0
                                                            : MaskSpool::tree_bytes(count);
    a_run = std::max(a_run, run_build_bytes(count) + beside + (config_.proxies ? ProxyTable::bytes(count) : 0));
  }
  // The directory grows by doubling; decoded pages hold 20 bytes a triangle or more.
  const std::uint64_t count = parts.nodes[0].count;
  const std::uint64_t directory = 2 * sizeof(PageEntry) * (count * 40 / config_.page_bytes + 64);
  const std::uint64_t a_page = page_build_bytes(config_.page_bytes, plan_.codec);
  const std::uint64_t free = ledger_.free_bytes() - std::min(ledger_.free_bytes(), directory);
  const auto threads =
      static_cast<unsigned>(std::clamp<std::uint64_t>((free - std::min(free, a_run)) / a_page, 1, plan_.threads));
  // A run more than threads, so that one is read while the others are built.
  const auto most_runs = static_cast<unsigned>(std::min<std::uint64_t>(parts.runs.size(), threads + 1));
  const std::uint64_t left = free - std::min(free, threads * a_page);
  const auto runs_at_once = static_cast<unsigned>(std::clamp<std::uint64_t>(left / a_run, 1, most_runs));
  const Result<BudgetReservation> claim =
      ledger_.claim(Tag::build, directory + threads * a_page + runs_at_once * a_run);
  if (!claim) {
    return needs(count, base_.bytes() + blocks_.memory_bytes() + directory + a_page + a_run);
  }
  report_.runs_at_once = runs_at_once;
  RunPipeline::Config config;
  config.width = config_.width;
  config.page_bytes = config_.page_bytes;
  config.codec = plan_.codec;
  config.positions = positions;
  config.proxies = config_.proxies;
  config.threads = threads;
  config.runs_at_once = runs_at_once;
  config.first_page = next_page;
  config.masks = masks_.empty() ? nullptr : &masks_;
  config.tree = tree;
  config.mask_refs = mask_refs_;
  config.instance = [this](std::uint32_t number) { return instance(number); };
  config.progress = [&](std::uint64_t done) { return step("build", double(in_trees_ + done) / double(in_all_)); };
  RunPipeline pipeline(config, blocks_, parts, top, writer);
  RAYMILL_RETURN_IF_ERROR(pipeline.run());
  next_page = pipeline.next_page();
  in_trees_ += count;
  return pipeline.totals();
}

}  // namespace raymill::storage
