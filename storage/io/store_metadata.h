// The store's metadata: what each geometry id is called, the scene's cameras, the import report. JSON.
#pragma once

#include <string>

#include "storage/import/scene_import.h"

namespace raymill::storage {

/// {"geometries":[{"geometry_id","file","node","mesh","primitive","triangles","kept"}],"cameras":[...],"import":{...}}
std::string metadata_json(const ImportReport& report);

}  // namespace raymill::storage
