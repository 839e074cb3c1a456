// The store's metadata: what each geometry id is called, the scene's cameras, the import report. JSON.
#pragma once

#include <string>

#include "storage/import/scene_import.h"

namespace raymill::storage {

/// What the lattice did to positions.
struct LatticeFigures {
  bool active = false;
  double max_displacement = 0;  ///< scene units; of an object's vertices in its own space
  double rms_displacement = 0;
};

/// {"geometries":[{"geometry_id","file","node","mesh","primitive","triangles","kept"}],"cameras":[...],"import":{...}},
/// on a lattice also "lattice":{"max_displacement","rms_displacement"}
std::string metadata_json(const ImportReport& report, const LatticeFigures& lattice);

}  // namespace raymill::storage
