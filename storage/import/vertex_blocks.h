// VertexBlocks: vertices in any number, claimed as they come; none is moved when more come. Thread-confined.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/base/status.h"
#include "storage/base/vec3.h"

namespace raymill::storage {

class VertexBlocks {
 public:
  static constexpr std::uint64_t kBlockVertices = 1 << 14;

  explicit VertexBlocks(Ledger& ledger) : ledger_(ledger) {}

  [[nodiscard]] std::uint64_t size() const { return size_; }
  const Vec3f& operator[](std::uint64_t i) const { return blocks_[i / kBlockVertices][i % kBlockVertices]; }

  /// Errors: budget_exceeded; the vertex is counted in size() then, and not kept.
  Status add(const Vec3f& vertex) {
    const std::uint64_t number = size_++;
    if (number % kBlockVertices == 0) {
      RAYMILL_ASSIGN_OR_RETURN(BudgetReservation claim,
                               ledger_.claim(Tag::build, kBlockVertices * sizeof(Vec3f) + kBlockBookBytes));
      claims_.push_back(std::move(claim));
      blocks_.push_back(std::make_unique<Vec3f[]>(kBlockVertices));
    }
    blocks_.back()[number % kBlockVertices] = vertex;
    return {};
  }

  void clear() {
    size_ = 0;
    blocks_.clear();
    claims_.clear();
  }

  /// What `count` vertices take.
  static constexpr std::uint64_t claim_bytes(std::uint64_t count) {
    return (count + kBlockVertices - 1) / kBlockVertices * (kBlockVertices * sizeof(Vec3f) + kBlockBookBytes);
  }

 private:
  static constexpr std::uint64_t kBlockBookBytes = 3 * (sizeof(void*) + sizeof(BudgetReservation));  // vectors double

  Ledger& ledger_;
  std::uint64_t size_ = 0;
  std::vector<std::unique_ptr<Vec3f[]>> blocks_;
  std::vector<BudgetReservation> claims_;
};

}  // namespace raymill::storage
