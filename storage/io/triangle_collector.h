// TriangleCollector: the sink that holds a whole scene, as long as the budget does. Thread-confined.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/base/status.h"
#include "storage/import/scene_import.h"

namespace raymill::storage {

/// Bytes that an in-core build of `triangle_count` triangles takes at its peak, the process's base aside.
std::uint64_t build_peak_bytes(std::uint64_t triangle_count, unsigned threads);

/// Once the budget is passed it only counts, so that the import can end by saying how much memory is needed.
class TriangleCollector final : public TriangleSink {
 public:
  TriangleCollector(Ledger& ledger, unsigned threads, std::uint64_t base_bytes)
      : ledger_(ledger), threads_(threads), base_bytes_(base_bytes) {}

  Status add(std::span<const Triangle> triangles) override;
  /// The triangles; the claim stays with `reservation`. Errors: budget_exceeded with the bytes the build needs.
  Result<std::vector<Triangle>> take(BudgetReservation& reservation);

 private:
  Ledger& ledger_;
  unsigned threads_;
  std::uint64_t base_bytes_;
  std::uint64_t count_ = 0;
  bool counting_only_ = false;
  BudgetReservation reservation_;
  std::vector<Triangle> triangles_;
};

}  // namespace raymill::storage
