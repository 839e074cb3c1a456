// build(): import -> lattice -> binary tree -> MBVH -> page plan -> pages -> file.
#include "storage/io/build_store.h"

#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <thread>

#include "storage/build/binary_tree.h"
#include "storage/build/collapse.h"
#include "storage/build/lattice.h"
#include "storage/build/page_plan.h"
#include "storage/import/scene_import.h"
#include "storage/io/store_metadata.h"
#include "storage/io/store_writer.h"
#include "storage/io/triangle_collector.h"
#include "storage/pages/codec.h"
#include "storage/pages/page_assembler.h"

namespace raymill {
namespace {

using namespace storage;
using Clock = std::chrono::steady_clock;

// Libraries, stacks and the allocator's slack that come after the measurement.
constexpr std::uint64_t kBaseSlackBytes = 8 << 20;
// Pages that are encoded at once by each thread before they are written in order.
constexpr std::size_t kPagesPerThread = 16;

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

struct Plan {
  Codec codec = Codec::zstd;
  PositionsRequest positions;
  unsigned threads = 1;
};

Result<Plan> check(const BuildConfig& config) {
  if (config.scenes.empty() || config.output.empty()) {
    return {ErrorCode::invalid_argument, "build needs at least one scene file and an output"};
  }
  if (config.width != 4 && config.width != 8) {
    return {ErrorCode::invalid_argument, "--width " + std::to_string(config.width) + " is neither 4 nor 8"};
  }
  if (config.page_bytes < kMinPageBytes || config.page_bytes > kMaxPageBytes) {
    return {ErrorCode::invalid_argument,
            "--page-size " + std::to_string(config.page_bytes) + " is outside 16 KiB (16384) to 1 MiB (1048576)"};
  }
  Plan plan;
  const auto codec = parse_codec(config.codec);
  if (!codec) {
    return {ErrorCode::invalid_argument, "--codec " + config.codec + " is none of raw, lz4, zstd and draco"};
  }
  plan.codec = *codec;
  RAYMILL_ASSIGN_OR_RETURN(plan.positions, parse_positions(config.positions));
  if (plan.codec == Codec::draco && plan.positions.kind == PositionsRequest::Kind::float32) {
    return {ErrorCode::invalid_argument,
            "--codec draco codes integers; give a lattice too, such as --positions lattice:16b"};
  }
  plan.threads = config.threads != 0 ? config.threads : std::max(1U, std::thread::hardware_concurrency());
  return plan;
}

class Builder {
 public:
  Builder(const BuildConfig& config, Plan plan) : config_(config), plan_(std::move(plan)), ledger_(config.memory) {}

  Result<BuildReport> run() {
    // As many workers as were asked for, also where that is more than there are cores; never fewer than others use.
    const tbb::global_control workers(
        tbb::global_control::max_allowed_parallelism,
        std::max(std::size_t{plan_.threads}, static_cast<std::size_t>(tbb::this_task_arena::max_concurrency())));
    const std::uint64_t base_bytes = resident_bytes() + kBaseSlackBytes;
    RAYMILL_ASSIGN_OR_RETURN(const BudgetReservation base, ledger_.claim(Tag::base, base_bytes));
    // A full disk or a wrong folder is found before the hours of work, not after them.
    RAYMILL_ASSIGN_OR_RETURN(const AtomicFile probe, AtomicFile::create(config_.output));
    BudgetReservation triangles_claim;
    RAYMILL_ASSIGN_OR_RETURN(std::vector<Triangle> triangles, import(base_bytes, triangles_claim));
    RAYMILL_RETURN_IF_ERROR(snap(triangles));
    if (triangles.empty()) {
      return {ErrorCode::bad_scene, config_.scenes.front() +
                                        ": holds no triangle that can be hit, so there is nothing to build; see the "
                                        "import report for what was dropped (" +
                                        report_.import_json + ")"};
    }
    RAYMILL_ASSIGN_OR_RETURN(const WideTree tree, build_tree(std::move(triangles)));
    RAYMILL_RETURN_IF_ERROR(write(tree));
    report_.peak_rss_bytes = peak_resident_bytes();
    return report_;
  }

 private:
  Status step(const char* phase, double fraction) const {
    if (config_.progress && !config_.progress(phase, fraction)) {
      return {ErrorCode::interrupted, "build stopped; nothing was written to " + config_.output};
    }
    return {};
  }

  Result<std::vector<Triangle>> import(std::uint64_t base_bytes, BudgetReservation& claim) {
    const auto start = Clock::now();
    TriangleCollector collector(ledger_, plan_.threads, base_bytes);
    for (std::size_t i = 0; i < config_.scenes.size(); ++i) {
      RAYMILL_RETURN_IF_ERROR(step("import", double(i) / double(config_.scenes.size())));
      RAYMILL_RETURN_IF_ERROR(
          import_gltf(config_.scenes[i], {config_.scene_index}, ledger_, collector, import_report_));
    }
    report_.import_seconds = seconds_since(start);
    return collector.take(claim);
  }

  Status snap(std::vector<Triangle>& triangles) {
    if (plan_.positions.kind != PositionsRequest::Kind::float32) {
      RAYMILL_ASSIGN_OR_RETURN(const LatticeResult lattice, snap_to_lattice(plan_.positions, triangles));
      positions_ = {true, lattice.step_exponent};
      report_.max_displacement = lattice.max_displacement;
      if (lattice.dropped_degenerate > 0) {
        import_report_.counts[ImportCode::dropped_degenerate] += lattice.dropped_degenerate;
        import_report_.kept -= lattice.dropped_degenerate;
      }
    }
    report_.import_json = to_json(import_report_);
    return {};
  }

  Result<WideTree> build_tree(std::vector<Triangle> triangles) {
    const auto start = Clock::now();
    RAYMILL_RETURN_IF_ERROR(step("build", 0));
    const unsigned level_limit = max_levels(config_.width);
    if (balanced_levels(triangles.size(), config_.width) > level_limit) {
      return {ErrorCode::unsupported, std::to_string(triangles.size()) + " triangles need a tree deeper than the " +
                                          std::to_string(kBitstackBits) + "-bit bitstack holds; use --width 8"};
    }
    RAYMILL_ASSIGN_OR_RETURN(const BinaryTree binary, build_binary_tree(triangles, plan_.threads, ledger_));
    RAYMILL_RETURN_IF_ERROR(step("build", 0.7));
    WideTree tree = collapse(binary, std::move(triangles), config_.width, level_limit);
    report_.build_seconds = seconds_since(start);
    report_.sah_cost = tree.sah_cost();
    return tree;
  }

  [[nodiscard]] StoreHeader header() const {
    StoreHeader header;
    header.features = static_cast<std::uint64_t>(Feature::triangles);
    if (import_report_.geometries.size() > 1) {
      header.features |= static_cast<std::uint64_t>(Feature::geometry_ids);
    }
    if (positions_.lattice) {
      header.features |= static_cast<std::uint64_t>(Feature::lattice);
    }
    header.page_bytes = config_.page_bytes;
    header.width = static_cast<std::uint8_t>(config_.width);
    header.codec = static_cast<std::uint8_t>(plan_.codec);
    header.lattice = positions_.lattice ? 1 : 0;
    header.lattice_step_exponent = positions_.step_exponent;
    return header;
  }

  Status write(const WideTree& tree) {
    const auto start = Clock::now();
    RAYMILL_RETURN_IF_ERROR(step("write", 0));
    RAYMILL_ASSIGN_OR_RETURN(const PagePlan pages, plan_pages(tree, page_cost(config_.width, config_.page_bytes)));
    RAYMILL_ASSIGN_OR_RETURN(StoreWriter writer, StoreWriter::create(config_.output, header()));
    RAYMILL_RETURN_IF_ERROR(write_pages(tree, pages, writer));

    StoreFooter footer;
    footer.triangle_count = tree.triangles.size();
    footer.node_count = tree.nodes.size();
    footer.geometry_count = import_report_.geometries.size();
    footer.levels = tree.levels;
    footer.root_page = pages.page_of[0];
    footer.root_node = 0;  // pages list nodes depth first, so the root is the first of its page
    for (int axis = 0; axis < 3; ++axis) {
      footer.bounds_min[static_cast<std::size_t>(axis)] = tree.bounds.lower[axis];
      footer.bounds_max[static_cast<std::size_t>(axis)] = tree.bounds.upper[axis];
    }
    report_.decoded_bytes = writer.decoded_bytes();
    RAYMILL_RETURN_IF_ERROR(writer.finish(footer, metadata_json(import_report_)));
    report_.triangles = tree.triangles.size();
    report_.nodes = tree.nodes.size();
    report_.pages = pages.pages.size();
    report_.levels = tree.levels;
    report_.store_bytes = writer.written_bytes();
    report_.write_seconds = seconds_since(start);
    return {};
  }

  // Pages are assembled and encoded side by side and written in order.
  Status write_pages(const WideTree& tree, const PagePlan& pages, StoreWriter& writer) {
    const PageAssembler assembler(tree, pages);
    struct Encoded {
      Status status;
      std::vector<std::byte> bytes;
      std::uint32_t decoded_bytes = 0;
    };
    std::vector<Encoded> batch(kPagesPerThread * plan_.threads);
    tbb::task_arena arena(static_cast<int>(plan_.threads));
    for (std::size_t first = 0; first < pages.pages.size(); first += batch.size()) {
      const std::size_t count = std::min(batch.size(), pages.pages.size() - first);
      arena.execute([&] {
        tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
          batch[i] = {};
          auto image = assembler.assemble(static_cast<std::uint32_t>(first + i));
          batch[i].status = image ? check_boxes(image->data()) : image.status();
          if (batch[i].status.ok()) {
            batch[i].decoded_bytes = static_cast<std::uint32_t>(image->size());
            batch[i].bytes = encode_page(*image, plan_.codec, positions_);
          }
        });
      });
      for (std::size_t i = 0; i < count; ++i) {
        RAYMILL_RETURN_IF_ERROR(batch[i].status);
        RAYMILL_RETURN_IF_ERROR(writer.add_page(batch[i].bytes, batch[i].decoded_bytes));
      }
      RAYMILL_RETURN_IF_ERROR(step("write", double(first + count) / double(pages.pages.size())));
    }
    return {};
  }

  const BuildConfig& config_;
  const Plan plan_;
  Ledger ledger_;
  ImportReport import_report_;
  PositionKind positions_;
  BuildReport report_;
};

}  // namespace

Result<BuildReport> build(const BuildConfig& config) {
  RAYMILL_ASSIGN_OR_RETURN(Plan plan, check(config));
  try {
    return Builder(config, std::move(plan)).run();
  } catch (const std::bad_alloc&) {
    return {ErrorCode::budget_exceeded, "the machine has no memory left for this build; lower --memory or free some"};
  }
}

}  // namespace raymill
