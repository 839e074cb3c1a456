// Building and looking into stores: what `raymill build`, `verify` and `inspect` do, as calls. Public.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/base/status.h"

namespace raymill {

struct BuildConfig {
  std::vector<std::string> scenes;      ///< .gltf or .glb files; geometry ids number on from file to file
  std::string output;                   ///< NAME.mill; written to a temporary name beside it and renamed when whole
  std::uint64_t memory = gibibytes(2);  ///< limit of the whole process
  std::optional<std::uint32_t> scene_index;
  std::string positions = "float32";  ///< "float32", "lattice:STEP" (rounded down to a power of two) or "lattice:BITSb"
  std::string codec = "zstd";         ///< raw, lz4, zstd, draco (draco needs a lattice)
  unsigned width = 8;                 ///< children of a node: 4 or 8
  std::uint32_t page_bytes = 64 << 10;  ///< decoded size limit of a page, 16 KiB to 1 MiB
  unsigned threads = 0;                 ///< 0: one for each core; the bytes of the store do not depend on it
  /// Called now and then from the building thread with a phase ("import", "build", "write") and a fraction in [0,1];
  /// returns false to stop the build (interrupted).
  std::function<bool(const char* phase, double fraction)> progress;
};

/// Figures of a build, and its import report as JSON ({"counts":{"dropped_degenerate":{"code":100,"count":3}},...}).
struct BuildReport {
  std::uint64_t triangles = 0;
  std::uint64_t nodes = 0;
  std::uint64_t pages = 0;
  std::uint64_t store_bytes = 0;
  std::uint64_t decoded_bytes = 0;
  std::uint32_t levels = 0;
  double sah_cost = 0;          ///< surface-area cost, node step 1, triangle test 1, relative to the root's area
  double max_displacement = 0;  ///< of a vertex by the lattice, scene units; 0 for float32
  double import_seconds = 0;
  double build_seconds = 0;
  double write_seconds = 0;
  std::uint64_t peak_rss_bytes = 0;
  std::string import_json;
};

/// Errors: not_found, io, disk_full, bad_scene, unsupported, invalid_argument, budget_exceeded, interrupted.
/// On any error nothing is left at `output` that was not there before.
Result<BuildReport> build(const BuildConfig& config);

struct VerifyReport {
  std::uint64_t pages = 0;
  std::uint64_t bytes = 0;
  std::uint64_t triangles = 0;
};
/// Reads a whole store and checks every checksum, every structure rule and that every box holds its triangles.
Result<VerifyReport> verify(const std::string& path);

/// A page's contents as JSON, decoded as far as the bytes allow; never writes.
Result<std::string> inspect_page(const std::string& path, std::uint32_t page);

}  // namespace raymill
