// A .gltf or .glb file of any bytes: imported or refused, within a small budget and without a trace on disk.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <span>

#include "storage/import/scene_import.h"

namespace {

using raymill::Status;
using raymill::storage::ImportReport;
using raymill::storage::Ledger;
using raymill::storage::Tag;
using raymill::storage::Triangle;

class Checker final : public raymill::storage::TriangleSink {
 public:
  Status add(std::span<const Triangle> triangles) override {
    for (const Triangle& triangle : triangles) {
      if (triangle.v[0] == triangle.v[1] || triangle.v[1] == triangle.v[2] || triangle.v[2] == triangle.v[0]) {
        std::abort();  // degenerate triangles must not come through
      }
    }
    kept += triangles.size();
    return {};
  }
  std::uint64_t kept = 0;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Ledger ledger(raymill::mebibytes(64));
  Checker checker;
  ImportReport report;
  const auto bytes = std::as_bytes(std::span(data, size));
  const Status status = raymill::storage::import_gltf_memory(bytes, "fuzz.gltf", {}, ledger, checker, report);
  const bool counted = !status.ok() || (checker.kept == report.kept && report.kept <= report.triangles);
  if (!counted || (!status.ok() && status.message().empty()) || ledger.used_bytes(Tag::build) != 0) {
    std::abort();
  }
  return 0;
}
