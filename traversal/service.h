// Service, Store, Job: the calls that the embedded Engine and the remote Client offer alike. Public.
//
//   auto store = engine.open("city.mill");                                    // Result<std::shared_ptr<Store>>
//   auto job = (*store)->trace({.query = Query::closest});                    // Result<std::unique_ptr<Job>>
//   (*job)->push(rays);  (*job)->finish();
//   while (auto chunk = (*job)->next()) use(chunk->first_ray, *chunk);        // in the rays' order
//   if (auto s = (*job)->status(); !s.ok()) ...
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "storage/base/status.h"
#include "traversal/query.h"

namespace raymill {

/// A job's request.
struct TraceConfig {
  Query query = Query::closest;
  Mode mode = Mode::watertight;
  Field fields = kDefaultClosestFields;  ///< Query::any answers Field::t alone, others as answered_fields() says
  VolumeConfig volume = {};              ///< Query::transmittance, Query::spans
  std::uint64_t first = 0;               ///< of lists: of each ray at most so many, the nearest; 0: all
  bool skips = false;                    ///< each ray brings a primitive that it passes through (Job::push_with)
  bool masks = false;                    ///< each ray brings a mask (Job::push_with)
  std::uint32_t mask = kAllMask;         ///< of every ray, besides
  /// Rays of float64 come (Job::push64), and in a store with the feature origins keep of org all that two float32 hold.
  /// Needed there, and of a Client; of no effect elsewhere.
  bool float64 = false;
  bool relative = false;  ///< rays are given relative to StoreInfo::origin, not in world space
  /// [geometry_id]; a triangle is a hit where a bit is set in its geometry's mask and in those of the ray. None, or too
  /// short for an id: all bits. The caller's memory: what is there before an Engine is made counts.
  std::shared_ptr<const std::vector<std::uint32_t>> geometry_masks = {};
  /// How far a hit may lie from the surface, in scene units; 0: not at all. A store with proxies (BuildConfig::proxies)
  /// then answers for subtrees of which a ray crosses no more than twice that without reading them, by what their
  /// triangles cover on the average: Query::closest and any, not Mode::exact. Such a hit has u = v = kProxyBarycentric.
  double tolerance = 0;
  double tolerance_angle = 0;  ///< the same, times t and the length of dir: of a cone; the larger of the two counts
};

/// Rows of hits for consecutive rays: a row a ray, but for lists (Query::all, Query::spans), where offsets() says whose
/// they are. Move-only:
/// it holds memory claimed from the budget until it is destroyed, so a caller that keeps every chunk stops its own job:
/// copy what is to stay.
class HitChunk {
 public:
  /// Gives back whatever holds the rows' memory.
  class Owner {
   public:
    virtual ~Owner() = default;
  };

  HitChunk(std::uint64_t index, std::uint64_t first_ray, HitLayout layout, std::span<const std::byte> rows,
           std::unique_ptr<Owner> owner)
      : index_(index), first_ray_(first_ray), layout_(layout), rows_(rows), owner_(std::move(owner)) {}
  HitChunk(HitChunk&&) = default;
  HitChunk& operator=(HitChunk&&) = default;

  [[nodiscard]] std::uint64_t index() const { return index_; }          ///< 0, 1, 2, ...
  [[nodiscard]] std::uint64_t first_ray() const { return first_ray_; }  ///< its position in the job's rays
  [[nodiscard]] std::size_t size() const { return rows_.size() / layout_.row_bytes(); }  ///< rows
  /// Lists: [rays + 1], the rows of ray first_ray() + i are those from offsets()[i] to offsets()[i + 1], by t,
  /// then geometry id, then primitive id. A ray whose rows are too many for a chunk is the last of this one and the
  /// first of the next: goes_on(). Empty for every other query.
  [[nodiscard]] std::span<const std::uint32_t> offsets() const { return offsets_; }
  [[nodiscard]] bool goes_on() const { return goes_on_; }
  void set_offsets(std::span<const std::uint32_t> offsets, bool goes_on) {
    offsets_ = offsets;
    goes_on_ = goes_on;
  }
  [[nodiscard]] const HitLayout& layout() const { return layout_; }
  /// The packed rows, size() * layout().row_bytes() bytes, as they stand in a hits file.
  [[nodiscard]] std::span<const std::byte> rows() const { return rows_; }
  [[nodiscard]] Hit hit(std::size_t i) const { return layout_.read(rows_.data() + i * layout_.row_bytes()); }
  [[nodiscard]] HitAttributes attributes(std::size_t i) const {
    return layout_.read_attributes(rows_.data() + i * layout_.row_bytes());
  }

 private:
  std::uint64_t index_;
  std::uint64_t first_ray_;
  HitLayout layout_;
  std::span<const std::byte> rows_;
  std::span<const std::uint32_t> offsets_;
  bool goes_on_ = false;
  std::unique_ptr<Owner> owner_;
};

struct JobProgress {
  std::uint64_t rays_pushed = 0;
  std::uint64_t rays_done = 0;
  std::uint64_t bytes_read = 0;  ///< of pages, by the store since it was opened; 0: not known here
};

struct JobStats {
  std::uint64_t rays = 0;
  std::uint64_t hits = 0;  ///< rays that hit something
  std::uint64_t invalid = 0;
  std::uint64_t crossings = 0;  ///< of all rays, where the query is count or all
  // Of the store since it was opened (all jobs together):
  std::uint64_t pages_read = 0;
  std::uint64_t reads = 0;  ///< by which they came: pages that follow each other in the file come by one
  std::uint64_t bytes_read = 0;
  std::uint64_t distinct_pages = 0;
  std::uint64_t distinct_bytes =
      0;  ///< of those pages as they stand in the file; bytes_read / distinct_bytes: amplification
  std::uint64_t evictions = 0;
  double decode_seconds = 0;     ///< of all workers
  double idle_seconds = 0;       ///< of all workers, with jobs running and nothing to run or decode
  double lock_wait_seconds = 0;  ///< of all workers, for each other and for who pushes or fetches
  double lock_hold_seconds = 0;  ///< of all workers, while the others would have to wait
  std::uint64_t stalls = 0;      ///< times that a worker was idle, each up to 10 ms
  double mean_read_depth = 0;    ///< pages under way when a read began
  // Of this job:
  std::uint64_t nodes_visited = 0;
  std::uint64_t triangles_tested = 0;
  std::uint64_t proxies_taken = 0;    ///< subtrees that rays did not enter, hit or passed
  std::uint64_t masks_tested = 0;     ///< hits on triangles with a mask or one side, before it was known if they count
  std::uint64_t texels_read = 0;      ///< for those of them that no more than their place in the triangle decided
  std::uint64_t attributes_read = 0;  ///< triangles whose attributes were looked up
  std::uint64_t rays_expanded = 0;    ///< rays that the expanded layout answered
  double expand_seconds = 0;          ///< of all workers, for laying the store out so, once
  std::uint64_t pages_entered = 0;    ///< times a ray came to a page, or to another part of one
  std::uint64_t rays_parked = 0;      ///< times a ray waited for a page
  std::uint64_t peak_in_flight = 0;   ///< rays that were in flight at once
  std::uint64_t most_in_flight = 0;   ///< rays that may be, those that wait on disk among them
  std::uint64_t ray_spill_bytes = 0;  ///< of rays that waited on disk for a page
  std::uint64_t result_spill_bytes = 0;                    ///< results that waited on disk for next()
  double trace_seconds = 0;                                ///< from the first push to the last hit
  std::uint64_t peak_rss_bytes = 0;                        ///< of the process that traces
  std::string isa;                                         ///< "scalar", "avx2", "avx512"
  std::string kernel;                                      ///< e.g. "closest/mbvh8/bits128/watertight/avx2"
  std::map<std::string, std::uint64_t> peak_bytes_by_tag;  ///< of the claims on the budget
  std::string policy;                                      ///< which page was read next: "score", ...
  std::string eviction;                                    ///< which page went for it: "clock", "demand"
  std::string io;                                          ///< e.g. "io_uring/direct"
  std::string io_note;                                     ///< why reads are not direct, where they are not
};

/// One batch of rays in flight. push() and finish() may run in one thread while next() runs in another.
class Job {
 public:
  virtual ~Job() = default;  ///< a job that is not finished is cancelled
  /// Appends rays. Waits for credit and never grows past the budget: results that are not fetched go to a
  /// temporary file, so one thread may push everything before the first next(): as many rays as there are places for
  /// chunks, thousands of millions in a budget of 1 GiB, but 98 thousand in the least that a store needs.
  /// Errors: cancelled, and whatever ended the job.
  virtual Status push(std::span<const Ray> rays) = 0;
  /// The same for rays that bring what the job was asked for (TraceConfig::skips, masks). Errors: also invalid_argument
  /// (it was not, or the lengths differ), unsupported (a job that takes none).
  virtual Status push_with(std::span<const Ray> /*rays*/, const RayExtras& /*extras*/) {
    return {ErrorCode::unsupported, "this job takes no rays that bring primitives or masks"};
  }
  /// The same for rays of float64, with or without extras; the job may be pushed rays of both kinds. Errors: as
  /// push_with(); invalid_argument also where a store with the feature origins was not asked for them
  /// (TraceConfig::float64), since they would lose what that store keeps.
  virtual Status push64(std::span<const Ray64> /*rays*/, const RayExtras& /*extras*/ = {}) {
    return {ErrorCode::unsupported,
            "this job takes no rays of float64; round them relative to StoreInfo::origin and ask for "
            "TraceConfig::relative"};
  }
  /// Says that no more rays come.
  virtual Status finish() = 0;
  /// The next chunk in the rays' order; waits for it. A chunk comes when it is full or after finish(), so a caller with
  /// one thread pushes, finishes and then fetches. Empty when all is fetched or the job has failed: see status().
  virtual std::optional<HitChunk> next() = 0;
  [[nodiscard]] virtual Status status() const = 0;
  [[nodiscard]] virtual JobProgress progress() const = 0;
  [[nodiscard]] virtual JobStats stats() const = 0;
  /// Stops the job; its rays are dropped. next() then returns empty and status() says cancelled.
  virtual void cancel() = 0;
};

/// What a store holds, from its footer.
struct StoreInfo {
  std::string name;
  std::uint32_t format_version = 0;
  std::vector<std::string> features;
  std::array<double, 3> origin{};     ///< of the store's space, in the world; exact
  std::array<float, 3> bounds_min{};  ///< relative to the origin
  std::array<float, 3> bounds_max{};
  std::uint64_t triangles = 0;  ///< stored; those of an object once
  std::uint64_t instances = 0;
  std::uint64_t objects = 0;  ///< that are placed
  std::uint64_t nodes = 0;
  std::uint64_t pages = 0;
  std::uint64_t geometries = 0;
  std::uint32_t levels = 0;      ///< depth of the tree
  std::uint32_t page_bytes = 0;  ///< decoded size limit of a page
  std::uint64_t store_bytes = 0;
  std::uint64_t decoded_bytes = 0;       ///< all pages decoded
  std::uint64_t least_memory_bytes = 0;  ///< least --memory of a process that traces it with this service's threads
  std::string codec;
  std::uint32_t width = 0;
  std::string positions;             ///< "float32" or "lattice:STEP"
  std::vector<std::string> layouts;  ///< that its rays may be traced in: "compact", "expanded"
  std::string metadata_json;         ///< {"geometries":[...],"cameras":[...],"import":{...}}
};

class Store {
 public:
  virtual ~Store() = default;
  /// Reads the metadata too; costs time and memory in proportion to the number of geometries.
  [[nodiscard]] virtual Result<StoreInfo> info() const = 0;
  /// StoreInfo::origin alone; an Engine reads no metadata for it. Errors: those of info().
  [[nodiscard]] virtual Result<std::array<double, 3>> origin() const {
    Result<StoreInfo> described = info();
    return described ? Result<std::array<double, 3>>(described->origin) : described.status();
  }
  /// Whether rays of float64 keep more of org here than float32 does (TraceConfig::float64). Errors: those of info().
  [[nodiscard]] virtual Result<bool> keeps_float64() const {
    const Result<StoreInfo> described = info();
    RAYMILL_RETURN_IF_ERROR(described.status());
    const std::vector<std::string>& features = described->features;
    return std::find(features.begin(), features.end(), "origins") != features.end();
  }
  /// Starts a job. Errors: invalid_argument, budget_exceeded, busy_retry (too many jobs at once).
  virtual Result<std::unique_ptr<Job>> trace(const TraceConfig& config) = 0;
};

class Service {
 public:
  virtual ~Service() = default;
  /// Opens a store: a path (Engine) or a name below the server's --stores directory (Client).
  /// Errors: not_found, corrupt, checksum_mismatch, version_mismatch, unsupported, budget_exceeded, unavailable.
  virtual Result<std::shared_ptr<Store>> open(const std::string& name) = 0;
};

}  // namespace raymill
