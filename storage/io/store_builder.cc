#include "storage/io/store_builder.h"

#include <algorithm>
#include <filesystem>
#include <thread>
#include <utility>

#include "storage/import/vdb_import.h"
#include "storage/io/store_metadata.h"

namespace raymill::storage {
namespace {

// Libraries, stacks and the allocator's slack that come after the measurement.
constexpr std::uint64_t kBaseSlackBytes = 8 << 20;
constexpr std::uint32_t kLeastOpenBuckets = 8;
constexpr std::uint32_t kMostOpenBuckets = 4096;
// An instance takes three times what a triangle does while its run is built.
constexpr std::uint64_t kRunInstances = 1 << 15;

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// Beside the output, where there is room for a store. Beside a device there is none: /dev is memory.
std::string temporary_folder(const AtomicFile& output) {
  if (output.temporary_path() == output.path()) {
    std::error_code ignored;
    return std::filesystem::temp_directory_path(ignored);
  }
  const std::string& path = output.temporary_path();
  const std::size_t slash = path.find_last_of('/');
  return slash == std::string::npos ? "." : slash == 0 ? "/" : path.substr(0, slash);
}

}  // namespace

Result<StoreBuilder::Plan> StoreBuilder::check(const BuildConfig& config) {
  if (config.output.empty()) {
    return {ErrorCode::invalid_argument, "a store needs a name to be written to"};
  }
  if (config.width != 4 && config.width != 8) {
    return {ErrorCode::invalid_argument, "--width " + std::to_string(config.width) + " is neither 4 nor 8"};
  }
  if (config.page_bytes < kMinPageBytes || config.page_bytes > kMaxPageBytes) {
    return {ErrorCode::invalid_argument,
            "--page-size " + std::to_string(config.page_bytes) + " is outside 16 KiB (16384) to 1 MiB (1048576)"};
  }
  Plan plan;
  const auto codec = parse_codec(config.codec);
  if (!codec) {
    return {ErrorCode::invalid_argument, "--codec " + config.codec + " is none of raw, lz4, zstd and draco"};
  }
  plan.codec = *codec;
  RAYMILL_ASSIGN_OR_RETURN(plan.positions, parse_positions(config.positions));
  if (plan.codec == Codec::draco && plan.positions.kind == PositionsRequest::Kind::float32) {
    return {ErrorCode::invalid_argument,
            "--codec draco codes integers; give a lattice too, such as --positions lattice:16b"};
  }
  if (config.instances == "always" || config.instances == "never") {
    plan.instances = config.instances == "always" ? InstanceRule::always : InstanceRule::never;
  } else if (config.instances != "auto") {
    return {ErrorCode::invalid_argument, "--instances " + config.instances + " is none of auto, always and never"};
  }
  RAYMILL_ASSIGN_OR_RETURN(plan.volume_step, parse_volume_values(config.volume_values));
  for (const std::string& transform : config.volume_transforms) {
    RAYMILL_RETURN_IF_ERROR(parse_volume_transform(transform).status());
  }
  RAYMILL_ASSIGN_OR_RETURN(plan.origin, parse_origin(config.origin));
  if (config.origins == "always" || config.origins == "never") {
    plan.origins = config.origins == "always" ? OriginsRule::always : OriginsRule::never;
  } else if (config.origins != "auto") {
    return {ErrorCode::invalid_argument, "--origins " + config.origins + " is none of auto, always and never"};
  } else if (config.origin == "none") {
    plan.origins = OriginsRule::never;
  }
  if (config.blend_as_mask && !(*config.blend_as_mask >= 0 && *config.blend_as_mask <= 1)) {
    return {ErrorCode::invalid_argument, "--blend-as-mask takes a cutoff from 0 to 1"};
  }
  if (config.blend_as_mask && config.ignore_alpha) {
    return {ErrorCode::invalid_argument, "--blend-as-mask and --ignore-alpha exclude each other"};
  }
  plan.masks = {!config.ignore_alpha, config.blend_as_mask, config.cull_back_faces};
  if (!config.attributes.empty()) {
    RAYMILL_ASSIGN_OR_RETURN(plan.attributes, parse_attributes(config.attributes));
  }
  plan.threads = config.threads != 0 ? config.threads : std::max(1U, std::thread::hardware_concurrency());
  return plan;
}

Result<std::unique_ptr<StoreBuilder>> StoreBuilder::create(const BuildConfig& config, std::uint64_t run_triangles) {
  RAYMILL_ASSIGN_OR_RETURN(Plan plan, check(config));
  RAYMILL_ASSIGN_OR_RETURN(AtomicFile probe, AtomicFile::create(config.output));
  std::unique_ptr<StoreBuilder> builder(new StoreBuilder(config, std::move(plan), run_triangles, std::move(probe)));
  RAYMILL_RETURN_IF_ERROR(builder->claim_base());
  return builder;
}

StoreBuilder::StoreBuilder(const BuildConfig& config, Plan plan, std::uint64_t run_triangles, AtomicFile probe)
    : config_(config),
      plan_(std::move(plan)),
      run_triangles_(run_triangles),
      probe_(std::move(probe)),
      ledger_(config.memory),
      blocks_(ledger_, temporary_folder(probe_)),
      spool_(blocks_, plan_.threads > 1),
      instances_(blocks_),
      masks_(blocks_),
      attributes_(blocks_, plan_.attributes),
      origin_(plan_.origin.value_or(Origin())),
      volumes_({config.page_bytes, config.width, plan_.codec, plan_.volume_step, config.volume_grids}) {}

Status StoreBuilder::claim_base() {
  RAYMILL_ASSIGN_OR_RETURN(base_, ledger_.claim(Tag::base, resident_bytes() + kBaseSlackBytes));
  RAYMILL_ASSIGN_OR_RETURN(spool_claim_, ledger_.claim(Tag::build, spool_.bytes()));
  RAYMILL_ASSIGN_OR_RETURN(instances_claim_,
                           ledger_.claim(Tag::build, kBlockBytes + MaskSpool::bytes() +
                                                         (plan_.attributes != 0 ? AttributeSpool::bytes() : 0)));
  // While the input comes in, room stays for what reads it and for what follows. With little memory the triangles go to
  // disk at once.
  const std::uint64_t rest = ledger_.free_bytes();
  const std::uint64_t a_thread = run_build_bytes(run_triangles_) + page_build_bytes(config_.page_bytes, plan_.codec);
  blocks_.keep_free(std::max(rest / 4, std::min(rest, a_thread * plan_.threads)));
  return {};
}

Status StoreBuilder::step(const char* phase, double fraction) const {
  if (config_.progress && !config_.progress(phase, fraction)) {
    return {ErrorCode::interrupted, "build stopped; nothing was written to " + config_.output};
  }
  return {};
}

Status StoreBuilder::add(std::span<const Triangle> triangles) {
  if (object_ || part_ != kNoPart) {
    BucketWriter& writer = object_ ? *object_ : part_writers_[part_];
    for (const Triangle& t : triangles) {
      RAYMILL_RETURN_IF_ERROR(writer.add(t));
    }
  } else {
    RAYMILL_RETURN_IF_ERROR(spool_.add(triangles));
  }
  return step("import", import_fraction_);
}

Status StoreBuilder::begin_object() {
  object_.emplace(blocks_);
  return {};
}

Result<InstanceSink::Object> StoreBuilder::end_object() {
  RAYMILL_ASSIGN_OR_RETURN(TriangleBucket bucket, object_->take());
  object_.reset();
  const Object object{static_cast<std::uint32_t>(objects_.size()), bucket.box};
  objects_.emplace_back().bucket = std::move(bucket);
  return object;
}

Status StoreBuilder::place(const Placed& placed) {
  ++objects_[placed.object].placed;
  return instances_.add(placed);
}

Status StoreBuilder::add_volumes(const std::string& path) {
  const std::size_t file = volume_files_++;
  const bool given = file < config_.volume_transforms.size();
  RAYMILL_ASSIGN_OR_RETURN(Affine transform,
                           parse_volume_transform(given ? config_.volume_transforms[file] : "identity"));
  for (std::size_t axis = 0; axis < 3; ++axis) {
    transform[axis][3] -= origin_.position()[axis];
  }
  return volumes_.add(path, transform, import_report_);
}

Status StoreBuilder::needs(std::uint64_t triangles, std::uint64_t bytes) const {
  return {ErrorCode::budget_exceeded, "building " + std::to_string(triangles) + " triangles needs at least " +
                                          format_bytes(bytes) + " of memory, " + format_bytes(ledger_.budget_bytes()) +
                                          " given; raise --memory"};
}

Result<Partition> StoreBuilder::partition(TriangleBucket all, std::uint64_t run_triangles, Lattice& lattice) {
  if (all.count <= run_triangles && !lattice.active()) {
    return partition_triangles(blocks_, std::move(all), lattice, {run_triangles, kLeastOpenBuckets, 1, {}});
  }
  PartitionConfig config;
  config.run_triangles = run_triangles;
  config.most_open_buckets = kLeastOpenBuckets;
  config.threads = plan_.threads;
  const std::uint64_t useful = all.count / run_triangles * 8 + 2;  // parts have an eighth of a run or more
  while (config.most_open_buckets < std::min<std::uint64_t>(kMostOpenBuckets, useful) &&
         partition_bytes(config.most_open_buckets * 2, config.threads, all.count) <= ledger_.free_bytes()) {
    config.most_open_buckets *= 2;
  }
  const std::uint64_t bytes = partition_bytes(config.most_open_buckets, config.threads, all.count);
  const Result<BudgetReservation> claim = ledger_.claim(Tag::build, bytes);
  if (!claim) {
    return needs(all.count, base_.bytes() + blocks_.memory_bytes() + bytes);
  }
  const auto total = static_cast<double>(all.count);
  // Counted once and handed out once or twice; more only where a part is cut again.
  config.progress = [&](std::uint64_t handled) {
    return step("partition", std::min(1.0, double(handled) / (3 * total)));
  };
  return partition_triangles(blocks_, std::move(all), lattice, config);
}

void StoreBuilder::count_dropped(const Partition& parts, std::uint64_t placements) {
  if (parts.dropped_degenerate > 0) {
    import_report_.counts[ImportCode::dropped_degenerate] += parts.dropped_degenerate;
    import_report_.kept -= parts.dropped_degenerate * placements;
  }
}

// One step for all: objects keep it in their own space.
Result<Partition> StoreBuilder::partition(Lattice& lattice) {
  RAYMILL_RETURN_IF_ERROR(step("partition", 0));
  RAYMILL_ASSIGN_OR_RETURN(TriangleBucket all, spool_.take());
  spool_claim_ = {};
  RAYMILL_RETURN_IF_ERROR(masks_.finish());
  Aabb extent = all.box;
  for (const Tree& object : objects_) {
    extent.grow(object.bucket.box);
  }
  lattice = Lattice(plan_.positions, extent);
  RAYMILL_ASSIGN_OR_RETURN(Partition scene, partition(std::move(all), run_triangles_, lattice));
  count_dropped(scene, 1);
  for (Tree& object : objects_) {
    RAYMILL_ASSIGN_OR_RETURN(object.parts, partition(std::move(object.bucket), run_triangles_, lattice));
    count_dropped(object.parts, object.placed);
  }
  RAYMILL_RETURN_IF_ERROR(instances_.finish());
  if (is_wide()) {
    RAYMILL_ASSIGN_OR_RETURN(reach_, reach(scene.nodes.empty() ? Aabb() : scene.nodes[0].box));
  }
  RAYMILL_ASSIGN_OR_RETURN(TriangleBucket boxes, stand_ins());
  Lattice none;
  RAYMILL_ASSIGN_OR_RETURN(Partition instances,
                           partition(std::move(boxes), std::min(run_triangles_, kRunInstances), none));
  return join(std::move(scene), std::move(instances));
}

// Of all instances of objects that have a triangle left.
Result<TriangleBucket> StoreBuilder::stand_ins() {
  BucketWriter out(blocks_);
  for (std::uint64_t i = 0; i < instances_.count(); ++i) {
    RAYMILL_ASSIGN_OR_RETURN(const Placed placed, instances_.read(i));
    const Partition& object = objects_[placed.object].parts;
    if (!object.nodes.empty()) {
      RAYMILL_RETURN_IF_ERROR(out.add(stand_in(box_of(placed), static_cast<std::uint32_t>(i))));
    }
  }
  return out.take();
}

StoreHeader StoreBuilder::header(const Lattice& lattice) const {
  StoreHeader header;
  header.features = static_cast<std::uint64_t>(Feature::triangles);
  if (import_report_.geometry_count > 1) {
    header.features |= static_cast<std::uint64_t>(Feature::geometry_ids);
  }
  if (lattice.active()) {
    header.features |= static_cast<std::uint64_t>(Feature::lattice);
  }
  if (instances_.count() > 0) {
    header.features |= static_cast<std::uint64_t>(Feature::instances);
  }
  if (!masks_.empty()) {
    header.features |= static_cast<std::uint64_t>(Feature::masks);
  }
  if (!volumes_.empty()) {
    header.features |= static_cast<std::uint64_t>(Feature::volumes);
  }
  if (!origin_.is_zero()) {
    header.features |= static_cast<std::uint64_t>(Feature::origin);
    header.origin_steps = origin_.steps;
    header.origin_exponent = origin_.exponent;
  }
  if (is_wide()) {
    header.features |= static_cast<std::uint64_t>(Feature::origins);
  }
  if (config_.proxies) {
    header.features |= static_cast<std::uint64_t>(Feature::proxies);
  }
  if (plan_.attributes != 0) {
    header.features |= static_cast<std::uint64_t>(Feature::attributes);
    header.attributes = plan_.attributes;
  }
  header.page_bytes = config_.page_bytes;
  header.width = static_cast<std::uint8_t>(config_.width);
  header.codec = static_cast<std::uint8_t>(plan_.codec);
  header.lattice = lattice.active() ? 1 : 0;
  header.lattice_step_exponent = lattice.step_exponent();
  return header;
}

Result<BuildReport> StoreBuilder::finish() {
  RAYMILL_RETURN_IF_ERROR(place_parts());
  report_.import_seconds = seconds_since(start_);
  const auto partition_start = Clock::now();
  Lattice lattice;
  RAYMILL_ASSIGN_OR_RETURN(const Partition parts, partition(lattice));
  report_.import_json = to_json(import_report_);
  report_.max_displacement = lattice.max_displacement();
  report_.rms_displacement = lattice.rms_displacement();
  report_.partition_seconds = seconds_since(partition_start);
  if (parts.runs.empty() && volumes_.empty()) {
    return {ErrorCode::bad_scene,
            (config_.scenes.empty() ? config_.output : config_.scenes.front()) +
                ": holds no triangle that can be hit, so there is nothing to build; see the import report for what was "
                "dropped (" +
                report_.import_json + ")"};
  }
  if (config_.proxies && !masks_.empty()) {
    return {
        ErrorCode::invalid_argument,
        "--proxies stand for triangles that are opaque and have two sides, and this scene has others; leave it out, or "
        "--cull-back-faces, or give --ignore-alpha"};
  }
  RAYMILL_RETURN_IF_ERROR(check_has_attributes());
  const auto build_start = Clock::now();
  RAYMILL_RETURN_IF_ERROR(step("build", 0));
  if (parts.runs.empty()) {
    return finish_without_triangles(lattice, build_start);
  }
  RAYMILL_ASSIGN_OR_RETURN(const unsigned level, object_level(parts));
  RAYMILL_ASSIGN_OR_RETURN(StoreFileWriter writer, StoreFileWriter::create(config_.output, header(lattice)));
  StoreFooter footer;
  footer.geometry_count = import_report_.geometry_count;
  RAYMILL_RETURN_IF_ERROR(write_trees(parts, level, {lattice.active(), lattice.step_exponent()}, writer, footer));
  report_.triangles = footer.triangle_count;
  report_.instances = footer.instance_count;
  report_.objects = footer.object_count;
  report_.nodes = footer.node_count;
  report_.levels = footer.levels;
  report_.runs = parts.runs.size();
  import_report_.masks.masks = report_.masks = mask_refs_.size();
  report_.mask_pages = import_report_.masks.pages;
  report_.mask_bytes = import_report_.masks.encoded_bytes;
  report_.mask_section_bytes = import_report_.masks.section_bytes;
  return finish_file(writer, footer, build_start);
}

// A scene of volumes alone.
Result<BuildReport> StoreBuilder::finish_without_triangles(const Lattice& lattice, Clock::time_point build_start) {
  StoreHeader of_volumes = header(lattice);
  of_volumes.features &= ~static_cast<std::uint64_t>(Feature::proxies);  // which stand for triangles
  RAYMILL_ASSIGN_OR_RETURN(StoreFileWriter writer, StoreFileWriter::create(config_.output, of_volumes));
  StoreFooter footer;
  footer.geometry_count = import_report_.geometry_count;
  RAYMILL_RETURN_IF_ERROR(volumes_.write_empty_root(writer, footer));
  report_.nodes = footer.node_count;
  report_.levels = footer.levels;
  return finish_file(writer, footer, build_start);
}

// The pages of attributes and volumes, and what stands behind all pages.
Result<BuildReport> StoreBuilder::finish_file(StoreFileWriter& writer, StoreFooter& footer,
                                              Clock::time_point build_start) {
  RAYMILL_RETURN_IF_ERROR(write_attributes(writer, footer));
  if (!volumes_.empty()) {
    RAYMILL_RETURN_IF_ERROR(
        volumes_.write(writer, footer, ledger_, [this](double fraction) { return step("volumes", fraction); }));
    report_.volumes = import_report_.volumes.size();
    report_.bricks = volumes_.bricks();
  }
  report_.origin = origin_.position();
  report_.decoded_bytes = writer.decoded_bytes();
  report_.pages = writer.page_count();
  RAYMILL_RETURN_IF_ERROR(
      writer.finish(footer, metadata_json(import_report_, {plan_.positions.kind != PositionsRequest::Kind::float32,
                                                           report_.max_displacement, report_.rms_displacement})));
  report_.store_bytes = writer.written_bytes();
  report_.temporary_bytes = blocks_.file_bytes();
  report_.temporary_folder = blocks_.folder();
  report_.build_seconds = seconds_since(build_start);
  report_.peak_rss_bytes = peak_resident_bytes();
  report_.peak_bytes_by_tag = ledger_.peaks();
  return report_;
}

}  // namespace raymill::storage
