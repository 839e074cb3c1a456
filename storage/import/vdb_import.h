// OpenVDB files: which grids they hold, and a grid as bricks.
//
//   FILE.vdb --> raymill-vdb (a process of its own) --pipe--> checked records --> BrickSink
//
// OpenVDB stays out of this process: what a damaged file does to it ends there, and leaves are loaded when they are
// wanted. Nothing that comes through the pipe is trusted. Thread-compatible.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "storage/base/status.h"
#include "storage/base/volume.h"
#include "storage/import/scene_import.h"

namespace raymill::storage {

/// Whether a file is OpenVDB's by its first bytes or, where they do not say, by its name. Errors: not_found, io.
Result<bool> is_vdb(const std::string& path);

struct VdbGrid {
  GridInfo grid;
  std::uint32_t index = 0;  ///< in the file
};

/// The grids of a file that can be traced: float32, with an active voxel, under a linear transform; `only`: of these
/// names. Others are left out and counted in the report; a file without any that is left is refused.
/// Errors: not_found, io, bad_scene, unsupported.
Result<std::vector<VdbGrid>> list_vdb(const std::string& path, const std::vector<std::string>& only,
                                      ImportReport& report);

/// Hands the grid's bricks and tiles to `sink`. Errors: io, bad_scene, and the sink's.
Status read_vdb(const std::string& path, const VdbGrid& grid, BrickSink& sink);

/// Where raymill-vdb is: $RAYMILL_VDB_READER, else beside this program, else in ../libexec/raymill from there.
/// Errors: not_found.
Result<std::string> vdb_reader_program();

}  // namespace raymill::storage
