// Engine: Raymill inside the caller's process. Public.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "storage/base/ledger.h"
#include "traversal/page_trace.h"
#include "traversal/service.h"
#include "traversal/timeline.h"

namespace raymill {

struct EngineConfig {
  /// Limit of the whole process, not of this engine alone: what the process holds already is measured and counted.
  std::uint64_t memory = gibibytes(2);
  unsigned threads = 0;  ///< workers; 0: one for each core
  std::string isa = {};  ///< "scalar", "avx2", "avx512"; empty: the best this machine has
  /// Which page is read next: "score" (most rays for each byte), "most-rays", "fifo" (longest wanted) or "sweep" (in
  /// the file's order). No answer depends on it.
  std::string policy = "score";
  /// Which page goes for it: "demand" (the one that the fewest waiting rays will still ask for) or "clock" (one that
  /// was not entered lately). No answer depends on it.
  std::string eviction = "demand";
  /// How a store stands in memory: "compact" (decoded pages, 24 bytes a triangle), "expanded" (59 bytes, a third to a
  /// half faster; all of it is read before the first ray) or "auto": expanded where memory is plenty and rays are many
  /// (store_expansion.h). No answer depends on it.
  std::string layout = "auto";
  /// Whether the rays of a push (each 64 Ki of them) are traced sorted in space (ray_order.h): "never", "always", or
  /// "auto": where they are scattered and the store, in memory, is larger than caches are. Hits come in the rays' own
  /// order all the same, and no answer depends on it.
  std::string sort_rays = "auto";
  std::string io = "auto";  ///< page reads by "uring" or "pread"; "auto": io_uring where the kernel allows it
  unsigned max_jobs = 1;    ///< jobs at once; each gets its share of the ray memory
  unsigned max_stores = 1;  ///< stores open at once; each gets its share of the page memory
  /// For tests: every ray suspends at every node, and a page is evicted when a batch has run there. Slow beyond use.
  bool adversarial = false;
  std::shared_ptr<PageTrace> page_trace = {};  ///< records the pages of the first store; finish() it after the jobs
  std::shared_ptr<Timeline> timeline = {};     ///< records what workers and reads do; finish() it after the jobs
  std::string spill_directory = {};            ///< for results that wait; empty: TMPDIR, else /tmp
};

/// Thread-safe. Stores and jobs keep what they need of the engine alive.
class Engine final : public Service {
 public:
  /// Errors: invalid_argument (unknown ISA or io), budget_exceeded (the process itself is larger than the budget).
  static Result<std::unique_ptr<Engine>> create(const EngineConfig& config);
  ~Engine() override;
  Result<std::shared_ptr<Store>> open(const std::string& path) override;

 private:
  class Impl;
  explicit Engine(std::shared_ptr<Impl> impl);
  std::shared_ptr<Impl> impl_;
};

/// The instruction sets that this build has kernels for and this machine can run, best first.
std::vector<std::string> available_isas();

}  // namespace raymill
