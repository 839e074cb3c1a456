// PlyBody: the numbers after a PLY header, one after the other, whatever their encoding. Thread-confined.
#pragma once

#include <memory>
#include <span>

#include "storage/base/status.h"
#include "storage/import/ply_header.h"

namespace raymill::storage {

class PlyBody {
 public:
  /// How a text's numbers come: rounded once to float32, or to float64.
  enum class Reals : std::uint8_t { float32, float64 };

  /// Starts behind the header; `file` outlives the body.
  static std::unique_ptr<PlyBody> open(const ByteSource& file, const PlyHeader& header, Reals reals);
  virtual ~PlyBody() = default;

  /// The next numbers. A text's number beyond float32 comes as round_once() has it, its whole numbers up to 2^53 as
  /// they are. Errors: bad_scene (the file ends, what is no number), io.
  virtual Status read(PlyType type, std::span<double> out) = 0;
  /// Goes past numbers. Errors: the same.
  virtual Status skip(PlyType type, std::uint64_t count) = 0;
};

}  // namespace raymill::storage
