#include <cmath>
#include <nlohmann/json.hpp>

#include "storage/import/scene_import.h"

namespace raymill::storage {

std::string_view to_string(ImportCode code) {
  switch (code) {
    case ImportCode::dropped_degenerate:
      return "dropped_degenerate";
    case ImportCode::dropped_not_finite:
      return "dropped_not_finite";
    case ImportCode::dropped_out_of_range:
      return "dropped_out_of_range";
    case ImportCode::dropped_cut_out:
      return "dropped_cut_out";
    case ImportCode::masked_triangles:
      return "masked_triangles";
    case ImportCode::opaque_under_masks:
      return "opaque_under_masks";
    case ImportCode::opaque_without_texcoords:
      return "opaque_without_texcoords";
    case ImportCode::attributes_missing:
      return "attributes_missing";
    case ImportCode::attributes_not_finite:
      return "attributes_not_finite";
    case ImportCode::left_out_points:
      return "left_out_points";
    case ImportCode::left_out_lines:
      return "left_out_lines";
    case ImportCode::left_out_no_positions:
      return "left_out_no_positions";
    case ImportCode::skin_at_rest:
      return "skin_at_rest";
    case ImportCode::morph_at_rest:
      return "morph_at_rest";
    case ImportCode::extension_ignored:
      return "extension_ignored";
    case ImportCode::leftover_vertices:
      return "leftover_vertices";
    case ImportCode::left_out_small_faces:
      return "left_out_small_faces";
    case ImportCode::left_out_curves:
      return "left_out_curves";
    case ImportCode::left_out_grids:
      return "left_out_grids";
    case ImportCode::draco_primitives:
      return "draco_primitives";
    case ImportCode::sparse_accessors:
      return "sparse_accessors";
    case ImportCode::quantized_positions:
      return "quantized_positions";
    case ImportCode::polygons:
      return "polygons";
    case ImportCode::meshopt_views:
      return "meshopt_views";
    case ImportCode::gpu_instances:
      return "gpu_instances";
  }
  return "unknown";
}

bool in_range(const Aabb& box) {
  const auto within = [](const Vec3f& p) {
    return std::abs(p.x) <= kPositionLimit && std::abs(p.y) <= kPositionLimit && std::abs(p.z) <= kPositionLimit;
  };
  return within(box.lower) && within(box.upper);
}

std::string to_json(const ImportReport& report) {
  nlohmann::ordered_json counts = nlohmann::ordered_json::object();
  for (const auto& [code, count] : report.counts) {
    counts[std::string(to_string(code))] = {{"code", static_cast<int>(code)}, {"count", count}};
  }
  const nlohmann::ordered_json json = {{"counts", std::move(counts)},
                                       {"ignored_extensions", report.ignored_extensions},
                                       {"triangles", report.triangles},
                                       {"kept", report.kept}};
  return json.dump();
}

}  // namespace raymill::storage
