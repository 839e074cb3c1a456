// RunPipeline: builds the runs of a partition side by side and writes their pages in order.
//
//   next run (in order) -> load, tree, plan (parallel) -> number its pages (in order)
//                       -> assemble, encode (parallel) -> write (in order)
//
// As many runs are under way as memory was claimed for. Thread-confined; its stages run on TBB's threads.
#pragma once

#include <tbb/task_arena.h>

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "storage/base/block_store.h"
#include "storage/base/status.h"
#include "storage/build/binary_tree.h"
#include "storage/build/mask_spool.h"
#include "storage/build/page_plan.h"
#include "storage/build/partition.h"
#include "storage/build/top_tree.h"
#include "storage/io/store_file_writer.h"
#include "storage/pages/codec.h"
#include "storage/pages/page_assembler.h"
#include "storage/pages/page_encoder.h"

namespace raymill::storage {

/// Memory that one run takes while it is built and encoded.
std::uint64_t run_build_bytes(std::uint64_t triangles);
/// What a run of instances takes beside that of so many triangles.
std::uint64_t instance_run_bytes(std::uint64_t instances);
/// Memory that a thread takes for the page that it makes.
std::uint64_t page_build_bytes(std::uint32_t page_bytes, Codec codec);

/// Sums over all trees of a store.
struct TreeTotals {
  std::uint64_t triangles = 0;
  std::uint64_t instances = 0;
  std::uint64_t nodes = 0;
  unsigned levels = 0;
  double area_cost = 0;
  std::uint64_t mask_section_bytes = 0;  ///< decoded
};

class RunPipeline {
 public:
  struct Config {
    unsigned width = 8;
    std::uint32_t page_bytes = 0;
    Codec codec = Codec::zstd;
    PositionKind positions;
    bool proxies = false;
    unsigned threads = 1;
    unsigned runs_at_once = 1;
    std::uint32_t first_page = 0;
    /// The instance that a triangle with this primitive id stands for; called from many threads at once.
    std::function<Result<Instance>(std::uint32_t number)> instance;
    const MaskSpool* masks = nullptr;         ///< none: all triangles are opaque
    std::uint32_t tree = MaskSpool::kWorld;   ///< by which the spool knows them
    std::span<const MaskRef> mask_refs = {};  ///< [mask]
    /// Called after each run with the triangles written so far; an error ends the work.
    std::function<Status(std::uint64_t triangles)> progress;
  };

  RunPipeline(const Config& config, BlockStore& blocks, const Partition& partition, const TopTree& top,
              StoreFileWriter& writer);

  /// Writes all pages, beginning with first_page, whose node 0 is the root. The partition's blocks are freed on the
  /// way. Errors: invalid_argument (page size), internal, disk_full, io, progress's.
  Status run();
  [[nodiscard]] const TreeTotals& totals() const { return totals_; }
  /// After the last page that was written.
  [[nodiscard]] std::uint32_t next_page() const { return next_page_; }

 private:
  struct EncodedPage {
    Status status;
    std::vector<std::byte> bytes;
    std::uint32_t decoded_bytes = 0;
    std::uint32_t mask_section_bytes = 0;
  };
  struct Run;

  Status write_top();
  [[nodiscard]] ProxyTable proxies_of(const WideTree& tree, const PagePlan& plan) const;
  void build(Run& run) const;
  Status build_tree(Run& run) const;
  void number(Run& run);
  void encode(Run& run);
  Status write(Run& run);
  [[nodiscard]] TreePlace place_of(std::uint32_t run) const;
  [[nodiscard]] std::vector<EncodedPage> encode_pages(const PageAssembler& assembler, std::size_t count);
  Status write_pages(const std::vector<EncodedPage>& pages, const PageNumbers& numbers);
  void add_to_totals(const WideTree& tree, std::size_t instances);

  const Config config_;
  tbb::task_arena arena_{static_cast<int>(config_.threads)};
  std::vector<PageEncoder> encoders_;  // [thread of the arena]
  BlockStore& blocks_;
  const Partition& partition_;
  const TopTree& top_;
  StoreFileWriter& writer_;
  std::optional<EmbreeDevice> device_;
  std::vector<std::uint32_t> run_root_pages_;
  std::vector<OuterNode> top_nodes_;
  std::uint32_t next_page_ = 0;
  TreeTotals totals_;
};

}  // namespace raymill::storage
