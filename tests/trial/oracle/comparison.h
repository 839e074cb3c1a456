// Comparison: one ray's answer against Embree's and the reference's. Immutable; thread-safe.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "tests/trial/oracle/embree_peer.h"
#include "tests/trial/oracle/reference.h"
#include "tests/trial/oracle/tally.h"

namespace raymill::trial {

class Comparison {
 public:
  /// `triangles` in any order; ids must be unique.
  Comparison(std::span<const storage::Triangle> triangles, const EmbreePeer& peer, const Reference& reference);

  void closest(std::uint64_t number, const Ray& ray, const Hit& ours, Tally& tally) const;
  void any(std::uint64_t number, const Ray& ray, const Hit& ours, Tally& tally) const;

 private:
  [[nodiscard]] std::optional<std::uint32_t> find(std::uint32_t geometry_id, std::uint32_t primitive_id) const;
  [[nodiscard]] std::string describe(const std::optional<Candidate>& candidate) const;
  void measure(std::uint64_t number, const Hit& ours, const Candidate& candidate, Tally& tally) const;

  std::span<const storage::Triangle> triangles_;
  const EmbreePeer& peer_;
  const Reference& reference_;
  std::vector<std::uint32_t> by_id_;  // triangles in the order of their ids
};

}  // namespace raymill::trial
