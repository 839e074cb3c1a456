#include "storage/io/triangle_collector.h"

#include <algorithm>
#include <utility>

#include "storage/build/binary_tree.h"
#include "storage/build/wide_tree.h"

namespace raymill::storage {
namespace {

constexpr std::uint64_t kFirstCapacity = 1 << 16;

}  // namespace

std::uint64_t build_peak_bytes(std::uint64_t triangle_count, unsigned threads) {
  // The triangles; the binary tree and the runs under way; then the wide tree, about a node for eight triangles, and
  // the plan's numbers for each node; pages under way are small beside these.
  const std::uint64_t wide = triangle_count / 8 * (sizeof(WideNode) + 32);
  return triangle_count * sizeof(Triangle) + binary_tree_build_bytes(triangle_count, threads) + wide;
}

Status TriangleCollector::add(std::span<const Triangle> triangles) {
  count_ += triangles.size();
  if (counting_only_) {
    return {};
  }
  if (count_ > triangles_.capacity()) {
    const std::uint64_t capacity =
        std::max({kFirstCapacity, count_, std::uint64_t(triangles_.capacity()) + triangles_.capacity() / 2});
    // Both arrays exist while the triangles move over.
    const std::uint64_t moving_bytes = (capacity + triangles_.capacity()) * sizeof(Triangle);
    const Result<BudgetReservation> moving = ledger_.claim(Tag::build, moving_bytes - reservation_.bytes());
    if (!moving) {
      counting_only_ = true;
      triangles_ = {};
      reservation_ = {};
      return {};
    }
    triangles_.reserve(capacity);
  }
  triangles_.insert(triangles_.end(), triangles.begin(), triangles.end());
  if (const std::uint64_t bytes = triangles_.capacity() * sizeof(Triangle); bytes > reservation_.bytes()) {
    reservation_ = {};
    RAYMILL_ASSIGN_OR_RETURN(reservation_, ledger_.claim(Tag::build, bytes));
  }
  return {};
}

Result<std::vector<Triangle>> TriangleCollector::take(BudgetReservation& reservation) {
  const std::uint64_t needed = base_bytes_ + build_peak_bytes(count_, threads_);
  if (counting_only_ || needed > ledger_.budget_bytes()) {
    return {ErrorCode::budget_exceeded, "building " + std::to_string(count_) + " triangles needs at least " +
                                            format_bytes(needed) + " of memory, " +
                                            format_bytes(ledger_.budget_bytes()) + " given; raise --memory"};
  }
  reservation = std::move(reservation_);
  return std::move(triangles_);
}

}  // namespace raymill::storage
