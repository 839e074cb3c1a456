// StoreBuilder: triangles in any number go in, a store comes out; memory is the budget, not the scene.
//
//   add() --> spool --partition--> runs --each: SAH tree, wide tree, page plan--> pages --> file
//             (blocks)             top tree over the runs' roots ------------------^
//
// What comes out depends on the triangles and their order alone: neither on the threads nor on the memory. Runs are
// built side by side and written in order, so a page is numbered before the next run's pages are known; references to a
// run's root, which other runs' escape tables need earlier, are settled in advance (PageNumbers). Thread-confined.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "storage/base/atomic_file.h"
#include "storage/base/block_store.h"
#include "storage/base/ledger.h"
#include "storage/base/status.h"
#include "storage/build/partition.h"
#include "storage/build/top_tree.h"
#include "storage/build/triangle_spool.h"
#include "storage/import/scene_import.h"
#include "storage/io/build_store.h"
#include "storage/io/store_file_writer.h"
#include "storage/io/volume_build.h"
#include "storage/pages/codec.h"

namespace raymill::storage {

class StoreBuilder final : public TriangleSink {
 public:
  /// `config` must outlive the builder; its scenes are not read here. `run_triangles`: smaller only in tests.
  /// Errors: invalid_argument, budget_exceeded, and those of a file that cannot be written.
  static Result<std::unique_ptr<StoreBuilder>> create(const BuildConfig& config,
                                                      std::uint64_t run_triangles = kRunTriangles);

  Ledger& ledger() { return ledger_; }
  /// What the triangles are called; whoever adds them fills it.
  ImportReport& import_report() { return import_report_; }
  /// For progress: the share of the input that has been added.
  void set_import_fraction(double fraction) { import_fraction_ = fraction; }

  /// Errors: disk_full, io, interrupted.
  Status add(std::span<const Triangle> triangles) override;
  /// Adds the grids of an OpenVDB file. Errors: those of VolumeBuild::add(), invalid_argument (the transform).
  Status add_volumes(const std::string& path);
  /// Builds and writes the store. Errors: bad_scene (nothing to hit), budget_exceeded, unsupported, disk_full, io,
  /// interrupted, internal.
  Result<BuildReport> finish();

 private:
  struct Plan {
    Codec codec = Codec::zstd;
    PositionsRequest positions;
    std::optional<std::int32_t> volume_step{};
    unsigned threads = 1;
  };
  using Clock = std::chrono::steady_clock;

  StoreBuilder(const BuildConfig& config, Plan plan, std::uint64_t run_triangles, AtomicFile probe);
  static Result<Plan> check(const BuildConfig& config);
  Status claim_base();
  [[nodiscard]] Status step(const char* phase, double fraction) const;
  [[nodiscard]] StoreHeader header(const Lattice& lattice) const;
  Result<Partition> partition(Lattice& lattice);
  Result<BuildReport> finish_without_triangles(const Lattice& lattice, Clock::time_point build_start);
  Result<BuildReport> finish_file(StoreFileWriter& writer, StoreFooter& footer, Clock::time_point build_start);
  [[nodiscard]] Status needs(std::uint64_t triangles, std::uint64_t bytes) const;

  const BuildConfig& config_;
  const Plan plan_;
  const std::uint64_t run_triangles_;
  AtomicFile probe_;  // a full disk or a wrong folder is found before the hours of work, not after them
  Ledger ledger_;
  BudgetReservation base_;
  BlockStore blocks_;
  TriangleSpool spool_;
  BudgetReservation spool_claim_;
  ImportReport import_report_;
  VolumeBuild volumes_;
  std::size_t volume_files_ = 0;
  BuildReport report_;
  double import_fraction_ = 0;
  Clock::time_point start_ = Clock::now();
};

}  // namespace raymill::storage
