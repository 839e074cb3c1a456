// A texture's alpha, by OpenImageIO in a process of its own (raymill-image), row by row. Thread-compatible.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "storage/base/ledger.h"
#include "storage/base/status.h"
#include "storage/import/child_stream.h"
#include "storage/import/mask_sink.h"

namespace raymill::storage {

/// The program: RAYMILL_IMAGE_READER, else raymill-image beside this one or where it is installed. Errors: not_found.
Result<std::string> image_reader_program();

/// A picture in memory under a name that a child process can open; gone with this object.
class PictureFile {
 public:
  /// Errors: io.
  static Result<PictureFile> create(std::uint64_t size_bytes);
  PictureFile(PictureFile&& other) noexcept;
  PictureFile& operator=(PictureFile&&) = delete;
  ~PictureFile();
  /// Appends. Errors: io.
  Status write(std::span<const std::byte> bytes);
  [[nodiscard]] std::string path() const;

 private:
  explicit PictureFile(int descriptor) : descriptor_(descriptor) {}
  int descriptor_ = -1;
};

/// A mask in memory, claimed.
struct HeldMask {
  BudgetReservation claim;
  AlphaMap map;
};

/// Reads the alpha of the picture at `path`; `like` says factor, cutoff and wraps. With `as_values` texels keep their
/// alpha, else one bit says whether they count. Nothing where the picture has no alpha: it is opaque everywhere.
/// Errors: bad_scene (missing, no picture, damaged), unsupported (too large), budget_exceeded, not_found (the program),
/// io.
Result<std::optional<HeldMask>> read_alpha(const std::string& path, const MaskInfo& like, bool as_values,
                                           Ledger& ledger);

}  // namespace raymill::storage
