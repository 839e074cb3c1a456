#include "client/cli/report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

namespace raymill::client {

namespace {

using nlohmann::json;
using storage::format_bytes;

std::string formatted(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

double rate(std::uint64_t count, double seconds) { return seconds > 0 ? static_cast<double>(count) / seconds : 0; }

// Text that another part of Raymill wrote as JSON; a part that cannot be read becomes null.
json parsed(const std::string& text) { return text.empty() ? json() : json::parse(text, nullptr, false); }

std::string line(const char* name, const std::string& value) {
  char text[32];
  std::snprintf(text, sizeof text, "%-14s", name);
  return text + value + "\n";
}

std::string point(const std::array<float, 3>& p) {
  char text[96];
  std::snprintf(text, sizeof text, "(%g, %g, %g)", double(p[0]), double(p[1]), double(p[2]));
  return text;
}

// With as many digits as tell millimetres from each other far out.
std::string point(const std::array<double, 3>& p) {
  char text[96];
  std::snprintf(text, sizeof text, "(%.13g, %.13g, %.13g)", p[0], p[1], p[2]);
  return text;
}

bool has_origin(const StoreInfo& info) { return info.origin != std::array<double, 3>{}; }

std::array<double, 3> in_world(const StoreInfo& info, const std::array<float, 3>& p) {
  return {info.origin[0] + p[0], info.origin[1] + p[1], info.origin[2] + p[2]};
}

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) {
    text += (text.empty() ? "" : ", ") + word;
  }
  return text;
}

std::string cost_text(const FeatureCost& cost) {
  const std::string pages = cost.pages > 0 ? " in " + std::to_string(cost.pages) + " pages" : "";
  return cost.feature + ": " +
         (cost.store_bytes ? format_bytes(*cost.store_bytes) + " on disk" + pages : "in the triangles' pages") +
         (cost.feature == "file" ? "" : ", " + format_bytes(cost.decoded_bytes) + " decoded");
}

json costs_json(const std::vector<FeatureCost>& costs) {
  json list = json::array();
  for (const FeatureCost& cost : costs) {
    list.push_back({{"feature", cost.feature},
                    {"pages", cost.pages},
                    {"store_bytes", cost.store_bytes ? json(*cost.store_bytes) : json()},
                    {"decoded_bytes", cost.decoded_bytes}});
  }
  return list;
}

// By the query, which a kernel's name begins with.
json kernels_json(const std::vector<std::string>& kernels) {
  json object = json::object();
  for (const std::string& kernel : kernels) {
    object[kernel.substr(0, kernel.find('/'))] = kernel;
  }
  return object;
}

std::string volume_text(const json& volume) {
  if (!volume.is_object()) {
    return "";
  }
  return volume.value("kind", "") + " '" + volume.value("grid", "") + "', geometry " +
         std::to_string(volume.value("geometry_id", 0U)) + ", " +
         std::to_string(volume.value("active_voxels", std::uint64_t{0})) + " active voxels";
}

std::string masks_text(const json& masks) {
  const auto number = [&](const char* key) { return masks.is_object() ? masks.value(key, std::uint64_t{0}) : 0; };
  return std::to_string(number("masks")) + " in " + std::to_string(number("pages")) + " pages (" +
         format_bytes(number("encoded_bytes")) + "), " + format_bytes(number("section_bytes")) +
         " beside the triangles when decoded; layout compact";
}

std::string attributes_text(const json& attributes) {
  const auto number = [&](const char* key) {
    return attributes.is_object() ? attributes.value(key, std::uint64_t{0}) : 0;
  };
  return (attributes.is_object() ? attributes.value("kept", "") : "") + " of " + std::to_string(number("entries")) +
         " triangles in " + std::to_string(number("pages")) + " pages (" + format_bytes(number("encoded_bytes")) +
         ", " + format_bytes(number("decoded_bytes")) + " decoded); jobs that ask for them: layout compact";
}

}  // namespace

json stats_json(const JobStats& stats, const RunTimes& times, std::uint64_t memory_bytes, unsigned threads) {
  return {{"rays", stats.rays},
          {"hits", stats.hits},
          {"invalid", stats.invalid},
          {"crossings", stats.crossings},
          {"seconds",
           {{"open", times.open_seconds},
            {"input", times.input_seconds},
            {"trace", stats.trace_seconds},
            {"output", times.output_seconds}}},
          {"rays_per_second", rate(stats.rays, stats.trace_seconds)},
          {"pages_read", stats.pages_read},
          {"reads", stats.reads},
          {"bytes_read", stats.bytes_read},
          {"distinct_pages", stats.distinct_pages},
          {"distinct_bytes", stats.distinct_bytes},
          {"amplification", stats.distinct_bytes > 0 ? double(stats.bytes_read) / double(stats.distinct_bytes) : 0.0},
          {"evictions", stats.evictions},
          {"decode_seconds", stats.decode_seconds},
          {"idle_seconds", stats.idle_seconds},
          {"lock_wait_seconds", stats.lock_wait_seconds},
          {"lock_hold_seconds", stats.lock_hold_seconds},
          {"stalls", stats.stalls},
          {"mean_read_depth", stats.mean_read_depth},
          {"most_in_flight", stats.most_in_flight},
          {"policy", stats.policy},
          {"eviction", stats.eviction},
          {"peak_bytes_by_tag", stats.peak_bytes_by_tag},
          {"peak_rss_bytes", stats.peak_rss_bytes},
          {"rays_expanded", stats.rays_expanded},
          {"expand_seconds", stats.expand_seconds},
          {"isa", stats.isa},
          {"kernel", stats.kernel},
          {"io", stats.io},
          {"io_note", stats.io_note},
          {"nodes_visited", stats.nodes_visited},
          {"triangles_tested", stats.triangles_tested},
          {"masks_tested", stats.masks_tested},
          {"texels_read", stats.texels_read},
          {"attributes_read", stats.attributes_read},
          {"pages_entered", stats.pages_entered},
          {"proxies_taken", stats.proxies_taken},
          {"rays_parked", stats.rays_parked},
          {"hit_rate", stats.pages_entered > 0 ? 1 - double(stats.rays_parked) / double(stats.pages_entered) : 0.0},
          {"peak_in_flight", stats.peak_in_flight},
          {"ray_spill_bytes", stats.ray_spill_bytes},
          {"result_spill_bytes", stats.result_spill_bytes},
          {"memory_bytes", memory_bytes},
          {"threads", threads}};
}

std::string stats_text(const JobStats& stats) {
  std::string text = std::to_string(stats.rays) + " rays, " + std::to_string(stats.hits) + " hits";
  if (stats.invalid > 0) {
    text += ", " + std::to_string(stats.invalid) + " invalid";
  }
  return text + ", " + formatted("%.2f s", stats.trace_seconds) + " (" +
         formatted("%.3f M rays/s", rate(stats.rays, stats.trace_seconds) / 1e6) + "), " +
         std::to_string(stats.pages_read) + " pages read (" + format_bytes(stats.bytes_read) + "), peak " +
         format_bytes(stats.peak_rss_bytes) + "\n" + (stats.io_note.empty() ? "" : stats.io_note + "\n");
}

json info_json(const StoreInfo& info, const InfoExtras& extras) {
  json object = {{"format_version", info.format_version},
                 {"features", info.features},
                 {"bounds", {{"min", info.bounds_min}, {"max", info.bounds_max}}},
                 {"triangles", info.triangles},
                 {"instances", info.instances},
                 {"objects", info.objects},
                 {"nodes", info.nodes},
                 {"pages", info.pages},
                 {"store_bytes", info.store_bytes},
                 {"decoded_bytes", info.decoded_bytes},
                 {"least_memory_bytes", info.least_memory_bytes},
                 {"codec", info.codec},
                 {"width", info.width},
                 {"positions", info.positions},
                 {"page_bytes", info.page_bytes},
                 {"levels", info.levels},
                 {"layouts", info.layouts},
                 {"kernels", kernels_json(extras.kernels)},
                 {"costs", costs_json(extras.costs)}};
  if (has_origin(info)) {
    object["origin"] = info.origin;
    object["bounds"] = {{"min", in_world(info, info.bounds_min)}, {"max", in_world(info, info.bounds_max)}};
  }
  const json metadata = parsed(info.metadata_json);
  for (const char* key : {"import", "geometries", "cameras"}) {
    object[key] = metadata.is_object() && metadata.contains(key) ? metadata[key] : json();
  }
  for (const char* key : {"volumes", "lattice", "masks", "attributes"}) {
    if (metadata.is_object() && metadata.contains(key)) {
      object[key] = metadata[key];
    }
  }
  return object;
}

std::string info_text(const StoreInfo& info, const InfoExtras& extras) {
  const double triangles = info.triangles > 0 ? static_cast<double>(info.triangles) : 1;
  std::string text =
      line("format", std::to_string(info.format_version)) +
      line("features", info.features.empty() ? "none" : joined(info.features)) +
      (has_origin(info)
           ? line("origin", point(info.origin)) + line("bounds", point(in_world(info, info.bounds_min)) + " to " +
                                                                     point(in_world(info, info.bounds_max)))
           : line("bounds", point(info.bounds_min) + " to " + point(info.bounds_max))) +
      line("triangles", std::to_string(info.triangles) + " in " + std::to_string(info.geometries) + " geometries") +
      (info.instances > 0
           ? line("instances", std::to_string(info.instances) + " of " + std::to_string(info.objects) + " objects")
           : std::string()) +
      line("nodes", std::to_string(info.nodes) + ", " + std::to_string(info.width) + " wide, " +
                        std::to_string(info.levels) + " levels") +
      line("pages", std::to_string(info.pages) + " of at most " + format_bytes(info.page_bytes)) +
      line("positions", info.positions) + line("codec", info.codec) +
      line("store", format_bytes(info.store_bytes) +
                        formatted(" (%.2f B a triangle)", static_cast<double>(info.store_bytes) / triangles)) +
      line("decoded", format_bytes(info.decoded_bytes) +
                          formatted(" (%.2f B a triangle)", static_cast<double>(info.decoded_bytes) / triangles)) +
      line("least memory", format_bytes(info.least_memory_bytes)) + line("layouts", joined(info.layouts));
  for (const FeatureCost& cost : extras.costs) {
    text += line("cost", cost_text(cost));
  }
  for (const std::string& kernel : extras.kernels) {
    text += line("kernel", kernel);
  }
  const json metadata = parsed(info.metadata_json);
  if (metadata.is_object() && metadata.contains("masks")) {
    text += line("masks", masks_text(metadata["masks"]));
  }
  if (metadata.is_object() && metadata.contains("attributes")) {
    text += line("attributes", attributes_text(metadata["attributes"]));
  }
  if (metadata.is_object() && metadata.contains("volumes")) {
    for (const json& volume : metadata["volumes"]) {
      text += line("volume", volume_text(volume));
    }
  }
  if (metadata.is_object() && metadata.contains("lattice") && metadata["lattice"].is_object()) {
    text += line("displacement", formatted("at most %g", metadata["lattice"].value("max_displacement", 0.0)) +
                                     formatted(", root of the mean square %g scene units",
                                               metadata["lattice"].value("rms_displacement", 0.0)));
  }
  if (metadata.is_object() && metadata.contains("cameras")) {
    for (const json& camera : metadata["cameras"]) {
      text += line("camera", camera.is_object() ? camera.value("name", "") : "");
    }
  }
  return text;
}

namespace {
double build_seconds(const BuildReport& report) {
  return report.import_seconds + report.partition_seconds + report.build_seconds;
}
}  // namespace

json build_json(const BuildReport& report, const std::string& output) {
  return {
      {"output", output},
      {"triangles", report.triangles},
      {"instances", report.instances},
      {"objects", report.objects},
      {"nodes", report.nodes},
      {"pages", report.pages},
      {"store_bytes", report.store_bytes},
      {"decoded_bytes", report.decoded_bytes},
      {"levels", report.levels},
      {"volumes", report.volumes},
      {"bricks", report.bricks},
      {"masks", report.masks},
      {"mask_pages", report.mask_pages},
      {"mask_bytes", report.mask_bytes},
      {"mask_section_bytes", report.mask_section_bytes},
      {"attribute_entries", report.attribute_entries},
      {"attribute_pages", report.attribute_pages},
      {"attribute_bytes", report.attribute_bytes},
      {"attribute_decoded_bytes", report.attribute_decoded_bytes},
      {"sah_cost", report.sah_cost},
      {"max_displacement", report.max_displacement},
      {"origin", report.origin},
      {"parts", report.parts},
      {"rms_displacement", report.rms_displacement},
      {"seconds",
       {{"import", report.import_seconds}, {"partition", report.partition_seconds}, {"build", report.build_seconds}}},
      {"triangles_per_second", double(report.triangles) / std::max(build_seconds(report), 1e-9)},
      {"runs", report.runs},
      {"runs_at_once", report.runs_at_once},
      {"temporary_bytes", report.temporary_bytes},
      {"temporary_folder", report.temporary_folder},
      {"peak_rss_bytes", report.peak_rss_bytes},
      {"peak_bytes_by_tag", report.peak_bytes_by_tag},
      {"import", parsed(report.import_json)}};
}

std::string build_text(const BuildReport& report, const std::string& output) {
  const double triangles = report.triangles > 0 ? static_cast<double>(report.triangles) : 1;
  std::string text = output + ": " + std::to_string(report.triangles) + " triangles, " +
                     (report.instances > 0 ? std::to_string(report.instances) + " instances of " +
                                                 std::to_string(report.objects) + " objects, "
                                           : std::string()) +
                     std::to_string(report.pages) + " pages, " + format_bytes(report.store_bytes) +
                     formatted(" (%.2f B a triangle)", static_cast<double>(report.store_bytes) / triangles) +
                     formatted(", %.2f s", build_seconds(report)) + ", peak " + format_bytes(report.peak_rss_bytes) +
                     (report.temporary_bytes > 0 ? ", " + format_bytes(report.temporary_bytes) + " on disk for a while"
                                                 : std::string()) +
                     "\n";
  if (report.volumes > 0) {
    text += std::to_string(report.volumes) + " volumes of " + std::to_string(report.bricks) + " bricks\n";
  }
  if (report.origin != std::array<double, 3>{}) {
    text += "positions are kept relative to " + point(report.origin) + "\n";
  }
  if (report.parts > 0) {
    text += std::to_string(report.parts) + (report.parts == 1
                                                ? " part that lies apart is kept relative to an origin of its own\n"
                                                : " parts that lie apart are kept relative to origins of their own\n");
  }
  if (report.masks > 0) {
    text += std::to_string(report.masks) + " masks in " + std::to_string(report.mask_pages) + " pages (" +
            format_bytes(report.mask_bytes) + ")\n";
  }
  if (report.attribute_entries > 0) {
    text += "attributes of " + std::to_string(report.attribute_entries) + " triangles in " +
            std::to_string(report.attribute_pages) + " pages (" + format_bytes(report.attribute_bytes) + ")\n";
  }
  if (report.max_displacement > 0) {
    text += formatted("largest displacement of a vertex: %g scene units", report.max_displacement) +
            formatted(", root of the mean square %g\n", report.rms_displacement);
  }
  const json import = parsed(report.import_json);
  if (import.is_object() && import.contains("counts")) {
    for (const auto& [name, entry] : import["counts"].items()) {
      text += line(name.c_str(), " " + (entry.is_object() ? entry.value("count", json(0)).dump() : entry.dump()));
    }
  }
  return text;
}

json job_json(const JobInfo& job) {
  return {{"id", job.id},
          {"store", job.store},
          {"state", to_string(job.state)},
          {"query", to_string(job.query)},
          {"mode", to_string(job.mode)},
          {"fields", to_string(job.fields)},
          {"rays", job.rays},
          {"rays_done", job.rays_done},
          {"detached", job.detached},
          {"message", job.message}};
}

std::string job_text(const JobInfo& job) {
  std::string text = job.id + "  " + std::string(to_string(job.state)) + "  " + job.store + "  " +
                     std::string(to_string(job.query)) + "  " + std::to_string(job.rays_done) + "/" +
                     std::to_string(job.rays) + " rays";
  return text + (job.message.empty() ? "" : "  " + job.message) + "\n";
}

}  // namespace raymill::client
