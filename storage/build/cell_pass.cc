#include "storage/build/cell_pass.h"

#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>

namespace raymill::storage {

// More than this many threads would wait for the visits, which are one at a time.
unsigned CellPass::blocks_at_once(unsigned threads) { return threads == 1 ? 1 : std::min(threads, 8U) + 2; }

std::uint64_t CellPass::bytes(unsigned threads) {
  return blocks_at_once(threads) * kBlockTriangles * (sizeof(Triangle) + sizeof(Aabb) + sizeof(std::uint32_t));
}

Status CellPass::run(const TriangleBucket& bucket, const Visit& visit) {
  constexpr std::size_t kLeastBlocks = 4;  // waking threads for fewer takes longer than what they would do
  return config_.threads == 1 || bucket.blocks.size() < kLeastBlocks ? run_here(bucket, visit)
                                                                     : run_side_by_side(bucket, visit);
}

Status CellPass::run_here(const TriangleBucket& bucket, const Visit& visit) {
  CellBlock block;
  for (std::size_t i = 0; i < bucket.blocks.size(); ++i) {
    RAYMILL_RETURN_IF_ERROR(fetch(bucket, i, block));
    locate(block);
    RAYMILL_RETURN_IF_ERROR(visit(block));
  }
  return {};
}

Status CellPass::run_side_by_side(const TriangleBucket& bucket, const Visit& visit) {
  // Blocks leave in the order in which they came, so the oldest one's place is free when another begins.
  std::vector<CellBlock> places(blocks_at_once(config_.threads));
  Status failure;
  std::atomic<bool> failed = false;
  std::size_t next = 0;
  const auto first =
      tbb::make_filter<void, CellBlock*>(tbb::filter_mode::serial_in_order, [&](tbb::flow_control& control) {
        CellBlock& block = places[next % places.size()];
        if (failed || next == bucket.blocks.size()) {
          control.stop();
          return &block;
        }
        block.status = fetch(bucket, next++, block);
        return &block;
      });
  const auto locating = tbb::make_filter<CellBlock*, CellBlock*>(tbb::filter_mode::parallel, [&](CellBlock* block) {
    locate(*block);
    return block;
  });
  const auto visiting = tbb::make_filter<CellBlock*, void>(tbb::filter_mode::serial_in_order, [&](CellBlock* block) {
    if (failure.ok()) {
      failure = block->status.ok() ? visit(*block) : block->status;
      failed = !failure.ok();
    }
  });
  tbb::task_arena arena(static_cast<int>(config_.threads));
  arena.execute([&] { tbb::parallel_pipeline(places.size(), first & locating & visiting); });
  return failure;
}

Status CellPass::fetch(const TriangleBucket& bucket, std::size_t index, CellBlock& block) {
  block.triangles.resize(bucket.in_block(index));
  RAYMILL_RETURN_IF_ERROR(store_.read(bucket.blocks[index], std::as_writable_bytes(std::span(block.triangles))));
  if (config_.consume) {
    store_.release(bucket.blocks[index]);
  }
  return config_.lattice != nullptr ? snap(block) : Status();
}

Status CellPass::snap(CellBlock& block) {
  std::size_t kept = 0;
  for (Triangle& t : block.triangles) {
    const Lattice::Outcome outcome = config_.lattice->snap(t);
    if (outcome == Lattice::Outcome::out_of_range) {
      return config_.lattice->out_of_range(t);
    }
    if (outcome == Lattice::Outcome::kept) {
      block.triangles[kept++] = t;
    }
  }
  block.dropped = block.triangles.size() - kept;
  block.triangles.resize(kept);
  return {};
}

void CellPass::locate(CellBlock& block) const {
  block.boxes.clear();
  block.cells.clear();
  for (const Triangle& t : block.triangles) {
    block.boxes.push_back(bounds(t));
    block.cells.push_back(grid_.cell_of(middle(block.boxes.back())));
  }
}

}  // namespace raymill::storage
