#include "storage/io/store_metadata.h"

#include <nlohmann/json.hpp>

#include "storage/import/scene_import.h"

namespace raymill::storage {

std::string metadata_json(const ImportReport& report, const LatticeFigures& lattice) {
  nlohmann::ordered_json json;
  json["geometries"] = nlohmann::ordered_json::array();
  for (const GeometryInfo& geometry : report.geometries) {
    json["geometries"].push_back({{"geometry_id", geometry.geometry_id},
                                  {"file", geometry.file},
                                  {"node", geometry.node},
                                  {"mesh", geometry.mesh},
                                  {"primitive", geometry.primitive},
                                  {"triangles", geometry.triangles},
                                  {"kept", geometry.kept}});
    if (geometry.copies != 1) {
      json["geometries"].back()["copies"] = geometry.copies;
      json["geometries"].back()["stride"] = geometry.stride;
    }
  }
  json["cameras"] = nlohmann::ordered_json::array();
  for (const CameraInfo& camera : report.cameras) {
    json["cameras"].push_back({{"name", camera.name},
                               {"perspective", camera.perspective},
                               {"yfov_radians", camera.yfov_radians},
                               {"aspect_ratio", camera.aspect_ratio},
                               {"ymag", camera.ymag},
                               {"world_from_camera", camera.world_from_camera}});
  }
  for (const VolumeInfo& volume : report.volumes) {
    json["volumes"].push_back({{"geometry_id", volume.geometry_id},
                               {"file", volume.file},
                               {"grid", volume.grid},
                               {"kind", volume.kind},
                               {"active_voxels", volume.active_voxels},
                               {"origin", volume.origin},
                               {"cells", volume.cells}});
  }
  if (lattice.active) {
    json["lattice"] = {{"max_displacement", lattice.max_displacement}, {"rms_displacement", lattice.rms_displacement}};
  }
  if (report.masks.pages + report.masks.section_bytes > 0) {
    json["masks"] = {{"masks", report.masks.masks},
                     {"pages", report.masks.pages},
                     {"encoded_bytes", report.masks.encoded_bytes},
                     {"section_bytes", report.masks.section_bytes}};
  }
  if (report.attributes.set != 0) {
    json["attributes"] = {{"kept", to_string_of(report.attributes.set)},
                          {"entries", report.attributes.entries},
                          {"pages", report.attributes.pages},
                          {"encoded_bytes", report.attributes.encoded_bytes},
                          {"decoded_bytes", report.attributes.decoded_bytes}};
  }
  json["import"] = nlohmann::ordered_json::parse(to_json(report));
  // Names come from the scene file and may not be UTF-8.
  return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

}  // namespace raymill::storage
