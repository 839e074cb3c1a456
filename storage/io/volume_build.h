// VolumeBuild: the volumes of a store that is being built: listed while the scene is read, so that bad input is found
// early and geometry ids number on; written behind the pages of triangles. Thread-confined.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/base/status.h"
#include "storage/base/volume.h"
#include "storage/import/vdb_import.h"
#include "storage/io/store_file_writer.h"
#include "storage/pages/codec.h"
#include "storage/volume/volume_page.h"

namespace raymill::storage {

/// How a volume's values are kept: "float32" (as they are; none) or "lattice:STEP", multiples of STEP rounded down to a
/// power of two, of which 2^e is given as e. Errors: invalid_argument.
Result<std::optional<std::int32_t>> parse_volume_values(const std::string& text);

/// "identity", or 12 or 16 numbers: the rows of a 3 x 4 or 4 x 4 matrix that maps the file's world to the scene's.
/// Errors: invalid_argument.
Result<Affine> parse_volume_transform(const std::string& text);

class VolumeBuild {
 public:
  struct Config {
    std::uint32_t page_bytes = 0;
    unsigned width = 8;
    Codec codec = Codec::zstd;
    std::optional<std::int32_t> step_exponent{};
    std::vector<std::string> grids{};  ///< names; none: all
  };
  explicit VolumeBuild(Config config) : config_(std::move(config)) {}

  [[nodiscard]] bool empty() const { return sources_.empty(); }
  [[nodiscard]] std::uint64_t bricks() const { return bricks_; }
  /// Lists the grids of a file, each the next geometry. Errors: those of list_vdb(), unsupported (too many volumes),
  /// bad_scene (a transform without an inverse).
  Status add(const std::string& path, const Affine& world_from_file, ImportReport& report);
  /// Stands where a scene has no triangles: a root without children.
  Status write_empty_root(StoreFileWriter& writer, StoreFooter& footer) const;
  /// Writes all volumes and their table; the footer then names it, and its bounds hold the volumes too. `step` is
  /// called now and then with the volumes done. Errors: those of read_vdb(), budget_exceeded, disk_full, io, and
  /// step's.
  Status write(StoreFileWriter& writer, StoreFooter& footer, Ledger& ledger,
               const std::function<Status(double fraction)>& step);

 private:
  struct Source {
    std::string path;
    VdbGrid grid;
    std::uint32_t geometry_id = 0;
  };
  Result<Volume> write_volume(std::uint32_t index, StoreFileWriter& writer,
                              const std::function<Status(double fraction)>& step);
  Status write_table(std::vector<Volume>& volumes, StoreFileWriter& writer, StoreFooter& footer) const;

  const Config config_;
  std::vector<Source> sources_;
  std::uint32_t next_page_ = 0;
  std::uint64_t bricks_ = 0;
};

}  // namespace raymill::storage
