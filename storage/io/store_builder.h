// StoreBuilder: triangles in any number go in, a store comes out; memory is the budget, not the scene.
//
//   add() --> spool --partition--> runs --each: SAH tree, wide tree, page plan--> pages --> file
//             (blocks)             top tree over the runs' roots ------------------^
//
// Each object is such a tree of its own, and the first in the file; then comes the scene's, whose runs are those of the
// triangles in world space and those of the instances.
//
// What comes out depends on the triangles and their order alone: neither on the threads nor on the memory. Runs are
// built side by side and written in order, so a page is numbered before the next run's pages are known; references to a
// run's root, which other runs' escape tables need earlier, are settled in advance (PageNumbers). Thread-confined.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "storage/base/atomic_file.h"
#include "storage/base/block_store.h"
#include "storage/base/ledger.h"
#include "storage/base/status.h"
#include "storage/build/attribute_spool.h"
#include "storage/build/instance_spool.h"
#include "storage/build/mask_spool.h"
#include "storage/build/partition.h"
#include "storage/build/top_tree.h"
#include "storage/build/triangle_spool.h"
#include "storage/import/scene_import.h"
#include "storage/import/scene_origin.h"
#include "storage/io/build_store.h"
#include "storage/io/run_pipeline.h"
#include "storage/io/store_file_writer.h"
#include "storage/io/volume_build.h"
#include "storage/pages/attribute_page.h"
#include "storage/pages/codec.h"

namespace raymill::storage {

/// What BuildConfig::origins names.
enum class OriginsRule : std::uint8_t { automatic, always, never };

class StoreBuilder final : public TriangleSink,
                           public InstanceSink,
                           public MaskSink,
                           public AttributeSink,
                           public PartSink {
 public:
  /// `config` must outlive the builder; its scenes are not read here. `run_triangles`: smaller only in tests.
  /// Errors: invalid_argument, budget_exceeded, and those of a file that cannot be written.
  static Result<std::unique_ptr<StoreBuilder>> create(const BuildConfig& config,
                                                      std::uint64_t run_triangles = kRunTriangles);

  Ledger& ledger() { return ledger_; }
  /// What the triangles are called; whoever adds them fills it.
  ImportReport& import_report() { return import_report_; }
  /// Where the configuration leaves it open, the first of its scenes that is no volume decides on the origin, and all
  /// of them on parts with origins of their own; before anything is added. Errors: those of look_at_scene().
  Status choose_origins();
  /// How the configuration's scene of that number is to be imported, which comes next.
  ImportOptions begin_scene(std::size_t number);
  /// What everything that is added is relative to.
  [[nodiscard]] const Origin& origin() const { return origin_; }
  /// For progress: the share of the input that has been added.
  void set_import_fraction(double fraction) { import_fraction_ = fraction; }

  /// Errors: disk_full, io, interrupted.
  Status add(std::span<const Triangle> triangles) override;
  Status begin_object() override;
  Result<Object> end_object() override;
  Status place(const Placed& placed) override;
  Result<std::uint32_t> add_mask(const AlphaMap& map) override { return masks_.add_mask(map); }
  Result<std::uint64_t> add_faces(std::span<const FaceMask> faces) override { return masks_.add_faces(faces); }
  Status read_faces(std::uint64_t first, std::span<FaceMask> faces) override { return masks_.read_faces(first, faces); }
  void set_masks(std::uint32_t geometry_id, const GeometryMask& masks) override {
    masks_.set_masks(object_            ? static_cast<std::uint32_t>(objects_.size())
                     : part_ != kNoPart ? part_
                                        : MaskSpool::kWorld,
                     geometry_id, masks);
  }
  void enter_part(std::uint32_t part) override { part_ = part; }
  Result<std::uint64_t> add_entries(std::span<const float> entries) override {
    return attributes_.add_entries(entries);
  }
  Status set_attributes(std::uint32_t geometry_id, const AttributeGeometry& geometry) override {
    return attributes_.set_attributes(geometry_id, geometry);
  }
  /// To be kept, as the config says.
  [[nodiscard]] AttributeSet attributes() const { return plan_.attributes; }
  /// What the import is to do with materials, as the config says.
  [[nodiscard]] MaskRule mask_rule() const { return plan_.masks; }
  /// Adds the grids of an OpenVDB file. Errors: those of VolumeBuild::add(), invalid_argument (the transform).
  Status add_volumes(const std::string& path);
  /// Builds and writes the store. Errors: bad_scene (nothing to hit), budget_exceeded, unsupported, disk_full, io,
  /// interrupted, internal.
  Result<BuildReport> finish();

 private:
  struct Plan {
    Codec codec = Codec::zstd;
    PositionsRequest positions;
    InstanceRule instances = InstanceRule::automatic;
    std::optional<std::int32_t> volume_step{};
    std::optional<Origin> origin{};
    OriginsRule origins = OriginsRule::automatic;
    MaskRule masks{};
    AttributeSet attributes = 0;
    unsigned threads = 1;
  };
  using Clock = std::chrono::steady_clock;

  // An object, from its triangles to where its root stands.
  struct Tree {
    TriangleBucket bucket;
    Partition parts;
    std::uint32_t root_page = 0;
    std::uint64_t placed = 0;
  };

  StoreBuilder(const BuildConfig& config, Plan plan, std::uint64_t run_triangles, AtomicFile probe);
  static Result<Plan> check(const BuildConfig& config);
  Status claim_base();
  [[nodiscard]] Status step(const char* phase, double fraction) const;
  [[nodiscard]] StoreHeader header(const Lattice& lattice) const;
  /// All triangles and instances, cut into runs; objects each for themselves.
  Result<Partition> partition(Lattice& lattice);
  Result<Partition> partition(TriangleBucket all, std::uint64_t run_triangles, Lattice& lattice);
  Status make_parts(std::vector<ScenePiece> pieces);
  Status place_parts();
  [[nodiscard]] bool is_wide() const;
  [[nodiscard]] Aabb box_of(const Placed& placed) const;
  Result<float> reach(const Aabb& scene) const;
  void count_dropped(const Partition& parts, std::uint64_t placements);
  Result<TriangleBucket> stand_ins();
  Result<BuildReport> finish_without_triangles(const Lattice& lattice, Clock::time_point build_start);
  Result<BuildReport> finish_file(StoreFileWriter& writer, StoreFooter& footer, Clock::time_point build_start);
  [[nodiscard]] Status needs(std::uint64_t triangles, std::uint64_t bytes) const;

  // In store_builder_trees.cc:
  /// The levels that objects begin with; 0 where there are none.
  [[nodiscard]] Result<unsigned> object_level(const Partition& scene) const;
  Status write_trees(const Partition& scene, unsigned object_level, const PositionKind& positions,
                     StoreFileWriter& writer, StoreFooter& footer);
  Result<TreeTotals> write_tree(const Partition& parts, std::uint32_t tree, LevelRange levels,
                                const PositionKind& positions, StoreFileWriter& writer, std::uint32_t& next_page);
  Status write_masks(StoreFileWriter& writer, std::uint32_t& next_page);

  // In store_builder_attributes.cc:
  /// The pages of attributes, behind those of triangles.
  Status write_attributes(StoreFileWriter& writer, StoreFooter& footer);
  [[nodiscard]] Status check_has_attributes() const;
  Status write_attribute_pages(AttributePageKind kind, BlockStream& items, StoreFileWriter& writer);
  [[nodiscard]] Result<Instance> instance(std::uint32_t number) const;

  const BuildConfig& config_;
  const Plan plan_;
  const std::uint64_t run_triangles_;
  AtomicFile probe_;  // a full disk or a wrong folder is found before the hours of work, not after them
  Ledger ledger_;
  BudgetReservation base_;
  BlockStore blocks_;
  TriangleSpool spool_;
  BudgetReservation spool_claim_;
  std::optional<BucketWriter> object_;  // that comes in
  std::vector<Tree> objects_;           // the parts come first
  std::vector<ScenePart> parts_;
  std::vector<std::uint32_t> part_of_scene_;  // [scene]; of those that are not cut
  std::vector<BucketWriter> part_writers_;
  BudgetReservation parts_claim_;
  std::uint32_t part_ = kNoPart;  // that comes in
  float reach_ = 0;               // of the scene, where there are origins of their own
  InstanceSpool instances_;
  BudgetReservation instances_claim_;
  MaskSpool masks_;
  std::vector<MaskRef> mask_refs_;  // [mask], once their pages are written
  AttributeSpool attributes_;
  std::uint64_t in_trees_ = 0;  // triangles and instances of trees that are written
  std::uint64_t in_all_ = 0;    // of all
  ImportReport import_report_;
  Origin origin_;
  VolumeBuild volumes_;
  std::size_t volume_files_ = 0;
  BuildReport report_;
  double import_fraction_ = 0;
  Clock::time_point start_ = Clock::now();
};

}  // namespace raymill::storage
