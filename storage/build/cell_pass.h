// CellPass: hands out a bucket's triangles in order, each with its box and its cell; these are found side by side.
//
//   next block (in order): read, onto the lattice -> boxes, cells (parallel) -> visit (in order)
//
// Thread-confined; its stages run on TBB's threads.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "storage/base/block_store.h"
#include "storage/base/status.h"
#include "storage/build/cell_grid.h"
#include "storage/build/lattice.h"
#include "storage/build/triangle_bucket.h"

namespace raymill::storage {

/// A block's triangles that the lattice left, with what is known of each.
struct CellBlock {
  std::vector<Triangle> triangles;
  std::vector<Aabb> boxes;
  std::vector<std::uint32_t> cells;
  std::uint64_t dropped = 0;  ///< that the lattice made degenerate
  Status status;
};

class CellPass {
 public:
  struct Config {
    unsigned threads = 1;
    bool consume = false;        ///< blocks are freed as they are read
    Lattice* lattice = nullptr;  ///< null: the triangles stand on it already
  };
  using Visit = std::function<Status(const CellBlock& block)>;

  CellPass(BlockStore& store, const CellGrid& grid, const Config& config)
      : store_(store), grid_(grid), config_(config) {}
  /// Memory of a pass.
  static std::uint64_t bytes(unsigned threads);

  /// An error of `visit` ends the pass. Errors: io, invalid_argument (the lattice), and visit's.
  Status run(const TriangleBucket& bucket, const Visit& visit);

 private:
  static unsigned blocks_at_once(unsigned threads);
  Status run_here(const TriangleBucket& bucket, const Visit& visit);
  Status run_side_by_side(const TriangleBucket& bucket, const Visit& visit);
  Status fetch(const TriangleBucket& bucket, std::size_t index, CellBlock& block);
  Status snap(CellBlock& block);
  void locate(CellBlock& block) const;

  BlockStore& store_;
  const CellGrid& grid_;
  const Config config_;
};

}  // namespace raymill::storage
