// Values between the library and the wire.
#include <algorithm>

#include "server/limits.h"
#include "server/wire.h"

namespace raymill::server {

pb::Query to_wire(Query query) {
  switch (query) {
    case Query::closest:
      return pb::QUERY_CLOSEST;
    case Query::any:
      return pb::QUERY_ANY;
    case Query::count:
      return pb::QUERY_COUNT;
    case Query::all:
      return pb::QUERY_ALL;
    case Query::transmittance:
      return pb::QUERY_TRANSMITTANCE;
    case Query::spans:
      return pb::QUERY_SPANS;
  }
  return pb::QUERY_UNSPECIFIED;
}
pb::Mode to_wire(Mode mode) {
  return mode == Mode::fast ? pb::MODE_FAST : mode == Mode::exact ? pb::MODE_EXACT : pb::MODE_WATERTIGHT;
}
Query from_wire(pb::Query query) {
  switch (query) {
    case pb::QUERY_ANY:
      return Query::any;
    case pb::QUERY_COUNT:
      return Query::count;
    case pb::QUERY_ALL:
      return Query::all;
    case pb::QUERY_TRANSMITTANCE:
      return Query::transmittance;
    case pb::QUERY_SPANS:
      return Query::spans;
    default:
      return Query::closest;
  }
}
Mode from_wire(pb::Mode mode) {
  return mode == pb::MODE_FAST ? Mode::fast : mode == pb::MODE_EXACT ? Mode::exact : Mode::watertight;
}

namespace {

pb::VolumeMethod to_wire(VolumeMethod method) {
  return method == VolumeMethod::march   ? pb::VOLUME_METHOD_MARCH
         : method == VolumeMethod::ratio ? pb::VOLUME_METHOD_RATIO
                                         : pb::VOLUME_METHOD_EXACT;
}
VolumeMethod from_wire(pb::VolumeMethod method) {
  return method == pb::VOLUME_METHOD_MARCH   ? VolumeMethod::march
         : method == pb::VOLUME_METHOD_RATIO ? VolumeMethod::ratio
                                             : VolumeMethod::exact;
}

}  // namespace

TraceConfig to_trace_config(const pb::StartJob& start) {
  TraceConfig config{
      .query = from_wire(start.query()), .mode = from_wire(start.mode()), .fields = Field(start.fields())};
  if (is_of_fog(config.query)) {
    const pb::VolumeConfig& volume = start.volume();
    config.volume = {.method = from_wire(volume.method()),
                     .step = volume.step(),
                     .density_scale = volume.density_scale(),
                     .seed = volume.seed(),
                     .majorant = volume.majorant(),
                     .threshold = volume.threshold()};
  }
  config.first = start.first();
  config.skips = start.skips();
  config.masks = start.masks();
  config.mask = ~start.without_mask();
  config.float64 = start.float64();
  config.relative = start.relative();
  return config;
}

void fill(const TraceConfig& config, pb::StartJob& start) {
  start.set_query(to_wire(config.query));
  start.set_mode(to_wire(config.mode));
  start.set_fields(static_cast<std::uint32_t>(config.fields));
  if (is_of_fog(config.query)) {
    pb::VolumeConfig& volume = *start.mutable_volume();
    volume.set_method(to_wire(config.volume.method));
    volume.set_step(config.volume.step);
    volume.set_density_scale(config.volume.density_scale);
    volume.set_seed(config.volume.seed);
    volume.set_majorant(config.volume.majorant);
    volume.set_threshold(config.volume.threshold);
  }
  start.set_first(config.first);
  start.set_skips(config.skips);
  start.set_masks(config.masks);
  start.set_without_mask(~config.mask);
  start.set_float64(config.float64);
  start.set_relative(config.relative);
  start.set_geometry_masks(config.geometry_masks ? static_cast<std::uint32_t>(config.geometry_masks->size()) : 0);
}

std::size_t ray_bytes(const TraceConfig& config) {
  return (config.float64 ? sizeof(Ray64) : sizeof(Ray)) + (config.skips ? sizeof(PrimitiveIds) : 0) +
         (config.masks ? sizeof(std::uint32_t) : 0);
}

pb::JobStats to_wire(const JobStats& stats) {
  pb::JobStats wire;
  wire.set_rays(stats.rays);
  wire.set_hits(stats.hits);
  wire.set_invalid(stats.invalid);
  wire.set_crossings(stats.crossings);
  wire.set_pages_read(stats.pages_read);
  wire.set_bytes_read(stats.bytes_read);
  wire.set_distinct_pages(stats.distinct_pages);
  wire.set_nodes_visited(stats.nodes_visited);
  wire.set_triangles_tested(stats.triangles_tested);
  wire.set_masks_tested(stats.masks_tested);
  wire.set_texels_read(stats.texels_read);
  wire.set_attributes_read(stats.attributes_read);
  wire.set_rays_parked(stats.rays_parked);
  wire.set_ray_spill_bytes(stats.ray_spill_bytes);
  wire.set_result_spill_bytes(stats.result_spill_bytes);
  wire.set_trace_seconds(stats.trace_seconds);
  wire.set_peak_rss_bytes(stats.peak_rss_bytes);
  wire.set_isa(utf8_or_question_marks(stats.isa));
  wire.set_kernel(utf8_or_question_marks(stats.kernel));
  wire.set_io(utf8_or_question_marks(stats.io));
  wire.set_io_note(utf8_or_question_marks(stats.io_note));
  wire.set_distinct_bytes(stats.distinct_bytes);
  wire.set_evictions(stats.evictions);
  wire.set_decode_seconds(stats.decode_seconds);
  wire.set_idle_seconds(stats.idle_seconds);
  wire.set_lock_wait_seconds(stats.lock_wait_seconds);
  wire.set_lock_hold_seconds(stats.lock_hold_seconds);
  wire.set_most_in_flight(stats.most_in_flight);
  wire.set_policy(utf8_or_question_marks(stats.policy));
  wire.set_eviction(utf8_or_question_marks(stats.eviction));
  wire.set_reads(stats.reads);
  wire.set_stalls(stats.stalls);
  wire.set_mean_read_depth(stats.mean_read_depth);
  wire.set_rays_expanded(stats.rays_expanded);
  wire.set_expand_seconds(stats.expand_seconds);
  wire.set_pages_entered(stats.pages_entered);
  wire.set_peak_in_flight(stats.peak_in_flight);
  wire.mutable_peak_bytes_by_tag()->insert(stats.peak_bytes_by_tag.begin(), stats.peak_bytes_by_tag.end());
  return wire;
}

JobStats from_wire(const pb::JobStats& wire) {
  JobStats stats;
  stats.rays = wire.rays();
  stats.hits = wire.hits();
  stats.invalid = wire.invalid();
  stats.crossings = wire.crossings();
  stats.pages_read = wire.pages_read();
  stats.bytes_read = wire.bytes_read();
  stats.distinct_pages = wire.distinct_pages();
  stats.nodes_visited = wire.nodes_visited();
  stats.triangles_tested = wire.triangles_tested();
  stats.masks_tested = wire.masks_tested();
  stats.texels_read = wire.texels_read();
  stats.attributes_read = wire.attributes_read();
  stats.rays_parked = wire.rays_parked();
  stats.ray_spill_bytes = wire.ray_spill_bytes();
  stats.result_spill_bytes = wire.result_spill_bytes();
  stats.trace_seconds = wire.trace_seconds();
  stats.peak_rss_bytes = wire.peak_rss_bytes();
  stats.isa = wire.isa();
  stats.kernel = wire.kernel();
  stats.io = wire.io();
  stats.io_note = wire.io_note();
  stats.distinct_bytes = wire.distinct_bytes();
  stats.evictions = wire.evictions();
  stats.decode_seconds = wire.decode_seconds();
  stats.idle_seconds = wire.idle_seconds();
  stats.lock_wait_seconds = wire.lock_wait_seconds();
  stats.lock_hold_seconds = wire.lock_hold_seconds();
  stats.most_in_flight = wire.most_in_flight();
  stats.policy = wire.policy();
  stats.eviction = wire.eviction();
  stats.reads = wire.reads();
  stats.stalls = wire.stalls();
  stats.mean_read_depth = wire.mean_read_depth();
  stats.rays_expanded = wire.rays_expanded();
  stats.expand_seconds = wire.expand_seconds();
  stats.pages_entered = wire.pages_entered();
  stats.peak_in_flight = wire.peak_in_flight();
  stats.peak_bytes_by_tag.insert(wire.peak_bytes_by_tag().begin(), wire.peak_bytes_by_tag().end());
  return stats;
}

pb::StoreDescription to_wire(const StoreInfo& info) {
  pb::StoreDescription wire;
  wire.set_name(utf8_or_question_marks(info.name));
  wire.set_format_version(info.format_version);
  for (const std::string& feature : info.features) {
    wire.add_features(utf8_or_question_marks(feature));
  }
  for (const float bound : info.bounds_min) {
    wire.add_bounds(bound);
  }
  for (const float bound : info.bounds_max) {
    wire.add_bounds(bound);
  }
  wire.set_triangles(info.triangles);
  wire.set_nodes(info.nodes);
  wire.set_pages(info.pages);
  wire.set_geometries(info.geometries);
  wire.set_levels(info.levels);
  wire.set_page_bytes(info.page_bytes);
  wire.set_store_bytes(info.store_bytes);
  wire.set_decoded_bytes(info.decoded_bytes);
  wire.set_least_memory_bytes(info.least_memory_bytes);
  wire.set_codec(utf8_or_question_marks(info.codec));
  wire.set_width(info.width);
  wire.set_positions(utf8_or_question_marks(info.positions));
  wire.set_instances(info.instances);
  wire.set_objects(info.objects);
  if (info.origin != std::array<double, 3>{}) {
    wire.mutable_origin()->Assign(info.origin.begin(), info.origin.end());
  }
  for (const std::string& layout : info.layouts) {
    wire.add_layouts(utf8_or_question_marks(layout));
  }
  return wire;
}

StoreInfo from_wire(const pb::StoreDescription& wire, std::string_view metadata) {
  StoreInfo info;
  info.name = wire.name();
  info.format_version = wire.format_version();
  info.features.assign(wire.features().begin(), wire.features().end());
  for (int axis = 0; axis < 3 && wire.bounds_size() == 6; ++axis) {
    info.bounds_min[static_cast<std::size_t>(axis)] = wire.bounds(axis);
    info.bounds_max[static_cast<std::size_t>(axis)] = wire.bounds(axis + 3);
  }
  info.triangles = wire.triangles();
  info.nodes = wire.nodes();
  info.pages = wire.pages();
  info.geometries = wire.geometries();
  info.levels = wire.levels();
  info.page_bytes = wire.page_bytes();
  info.store_bytes = wire.store_bytes();
  info.decoded_bytes = wire.decoded_bytes();
  info.least_memory_bytes = wire.least_memory_bytes();
  info.codec = wire.codec();
  info.width = wire.width();
  info.positions = wire.positions();
  info.instances = wire.instances();
  info.objects = wire.objects();
  for (int axis = 0; axis < 3 && wire.origin_size() == 3; ++axis) {
    info.origin[static_cast<std::size_t>(axis)] = wire.origin(axis);
  }
  info.layouts.assign(wire.layouts().begin(), wire.layouts().end());
  info.metadata_json = metadata;
  return info;
}

Status status_from_wire(std::uint32_t code, std::string_view message) {
  if (code == 0) {
    return {};
  }
  const bool known = code <= 0xFFFF && to_string(ErrorCode(code)) != "unknown";
  return {known ? ErrorCode(code) : ErrorCode::internal, cut_sentence(message)};
}

std::string cut_sentence(std::string_view sentence) {
  std::size_t size = std::min(sentence.size(), kMostSentenceBytes);
  // Back to the first byte of a character: the others are 10xxxxxx.
  while (size < sentence.size() && size > 0 && (static_cast<unsigned char>(sentence[size]) & 0xC0u) == 0x80u) {
    --size;
  }
  return utf8_or_question_marks(sentence.substr(0, size));
}

std::string utf8_or_question_marks(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  for (std::size_t i = 0; i < text.size();) {
    const auto lead = static_cast<unsigned char>(text[i]);
    // Length by the lead byte; C0, C1 and F5 on never occur, overlong and surrogate forms are rare enough to let a
    // strict second byte decide: E0 needs A0 on, ED below A0, F0 90 on, F4 below 90.
    const std::size_t length = lead < 0x80                    ? 1
                               : lead >= 0xC2 && lead <= 0xDF ? 2
                               : (lead & 0xF0u) == 0xE0       ? 3
                               : lead >= 0xF0 && lead <= 0xF4 ? 4
                                                              : 0;
    bool good = length != 0 && i + length <= text.size();
    for (std::size_t k = 1; good && k < length; ++k) {
      const auto byte = static_cast<unsigned char>(text[i + k]);
      const unsigned char low = k > 1 ? 0x80 : lead == 0xE0 ? 0xA0 : lead == 0xF0 ? 0x90 : 0x80;
      const unsigned char high = k > 1 ? 0xBF : lead == 0xED ? 0x9F : lead == 0xF4 ? 0x8F : 0xBF;
      good = byte >= low && byte <= high;
    }
    if (good) {
      out.append(text, i, length);
      i += length;
    } else {
      out.push_back('?');
      ++i;
    }
  }
  return out;
}

}  // namespace raymill::server
