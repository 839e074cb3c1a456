// Picture: an image that is made row by row, kept in a raw file beside its target, and turned into EXR or PNG by the
// program raymill-image at the end. Thread-confined.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "client/cli/image/raw_image.h"
#include "client/cli/parse.h"
#include "storage/base/atomic_file.h"
#include "storage/base/status.h"

namespace raymill::client {

/// "exr" or "png", by the ending of `path`. Errors: invalid_argument.
Result<std::string> image_format(const std::string& path);

/// Where raymill-image is: $RAYMILL_IMAGE_WRITER, else beside this program, else in ../libexec/raymill from there.
/// Errors: not_found, with the places looked at.
Result<std::string> image_writer_program();

class Picture {
 public:
  /// Checks the ending and finds raymill-image, so that nothing is traced in vain.
  static Result<Picture> create(const std::string& path, Extent extent, std::uint32_t channels, Tone tone);

  /// The next whole rows from the top, width x channels values each.
  Status append(std::span<const float> rows);
  /// Turns the rows into the image and gives it its name.
  Status commit();

 private:
  Picture(storage::AtomicFile image, storage::AtomicFile raw, std::string format, std::string program)
      : image_(std::move(image)), raw_(std::move(raw)), format_(std::move(format)), program_(std::move(program)) {}

  storage::AtomicFile image_;
  storage::AtomicFile raw_;  ///< never committed: it goes when the picture does
  std::string format_;
  std::string program_;
  RawImageHeader header_;
};

}  // namespace raymill::client
