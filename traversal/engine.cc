#include "traversal/engine.h"

#include <algorithm>
#include <climits>
#include <cstdlib>
#include <map>
#include <mutex>
#include <thread>

#include "storage/io/page_reader.h"
#include "storage/io/store_file.h"
#include "traversal/budget_plan.h"
#include "traversal/kernel.h"
#include "traversal/store_tracer.h"

namespace raymill {
namespace {

using storage::StoreFile;
using traversal::StoreTracer;

// Code and library pages that are touched only once rays run, allocator slack, small vectors.
constexpr std::uint64_t kBaseSlackBytes = 2 << 20;

Result<traversal::Isa> choose_isa(const std::string& name) {
  const std::vector<traversal::Isa> runnable = traversal::runnable_isas();
  if (name.empty()) {
    return runnable.front();
  }
  std::string list;
  for (const traversal::Isa isa : runnable) {
    if (name == to_string(isa)) {
      return isa;
    }
    list += (list.empty() ? "" : ", ") + std::string(to_string(isa));
  }
  return {ErrorCode::invalid_argument, "instruction set '" + name + "' is not one that this machine runs: " + list};
}

std::string canonical(const std::string& path) {
  char resolved[PATH_MAX];
  return ::realpath(path.c_str(), resolved) != nullptr ? std::string(resolved) : path;
}

std::string spill_directory(const std::string& asked) {
  if (!asked.empty()) {
    return asked;
  }
  const char* temporary = std::getenv("TMPDIR");
  return temporary != nullptr && *temporary != '\0' ? temporary : "/tmp";
}

StoreInfo describe(const StoreFile& file) {
  const storage::StoreHeader& header = file.header();
  const storage::StoreFooter& footer = file.footer();
  StoreInfo info;
  info.name = file.path();
  info.format_version = header.format_version;
  const auto feature = [&](storage::Feature bit, const char* name) {
    if ((header.features & static_cast<std::uint64_t>(bit)) != 0) {
      info.features.emplace_back(name);
    }
  };
  feature(storage::Feature::triangles, "triangles");
  feature(storage::Feature::geometry_ids, "geometry_ids");
  feature(storage::Feature::lattice, "lattice");
  feature(storage::Feature::instances, "instances");
  feature(storage::Feature::masks, "masks");
  feature(storage::Feature::volumes, "volumes");
  feature(storage::Feature::origin, "origin");
  feature(storage::Feature::origins, "origins");
  info.origin = header.origin().position();
  feature(storage::Feature::proxies, "proxies");
  feature(storage::Feature::attributes, "attributes");
  info.bounds_min = footer.bounds_min;
  info.bounds_max = footer.bounds_max;
  info.triangles = footer.triangle_count;
  info.instances = footer.instance_count;
  info.objects = footer.object_count;
  info.nodes = footer.node_count;
  info.pages = footer.page_count;
  info.geometries = footer.geometry_count;
  info.levels = footer.levels;
  info.page_bytes = header.page_bytes;
  info.store_bytes = footer.file_bytes;
  info.decoded_bytes = footer.decoded_bytes;
  info.codec = to_string(file.codec());
  info.width = header.width;
  info.positions = file.positions_text();
  info.layouts = {"compact"};
  if (traversal::ExpandedTree::possible(file)) {
    info.layouts.emplace_back("expanded");
  }
  return info;
}

}  // namespace

class Engine::Impl {
 public:
  // What the names in a config stand for.
  struct Choices {
    traversal::Isa isa;
    traversal::ReadOrder read_order;
    storage::EvictionKind eviction;
    traversal::Layout layout;
    traversal::SortRays sort_rays;
    storage::ReaderKind io;
    unsigned threads;
  };

  Impl(const EngineConfig& config, const Choices& choices)
      : config_(config), choices_(choices), ledger_(config.memory) {}

  Status claim_base() {
    base_bytes_ = storage::resident_bytes() + kBaseSlackBytes;
    auto base = ledger_.claim(storage::Tag::base, base_bytes_);
    if (!base) {
      return {ErrorCode::budget_exceeded, "the process itself needs at least " + storage::format_bytes(base_bytes_) +
                                              ", " + storage::format_bytes(config_.memory) +
                                              " given; raise the memory limit"};
    }
    base_ = std::move(*base);
    return {};
  }

  // A store that is open already is shared.
  Result<std::shared_ptr<StoreTracer>> open(const std::string& path) {
    const std::lock_guard lock(mutex_);
    const std::string key = canonical(path);
    std::erase_if(open_, [](const auto& entry) { return entry.second.expired(); });
    if (auto tracer = open_[key].lock(); tracer) {
      return tracer;
    }
    open_.erase(key);
    if (open_.size() >= config_.max_stores) {
      return {ErrorCode::busy_retry, path + ": " + std::to_string(open_.size()) +
                                         " stores are open, as many as there is page memory for; close one first"};
    }
    RAYMILL_ASSIGN_OR_RETURN(std::shared_ptr<const StoreFile> file, StoreFile::open(path, ledger_));
    StoreTracer::Config config;
    config.share = {ledger_.free_bytes() / (config_.max_stores - open_.size()), choices_.threads, config_.max_jobs};
    config.isa = choices_.isa;
    config.read_order = choices_.read_order;
    config.eviction = choices_.eviction;
    config.layout = choices_.layout;
    config.sort_rays = choices_.sort_rays;
    config.adversarial = config_.adversarial;
    config.page_trace = config_.page_trace;
    config.io = choices_.io;
    config.spill_directory = spill_directory(config_.spill_directory);
    config.timeline = config_.timeline;
    if (config.share.bytes < traversal::least_share_bytes(*file, choices_.threads, config_.max_jobs)) {
      return {ErrorCode::budget_exceeded, path + ": needs at least " + storage::format_bytes(least_memory(*file)) +
                                              " of memory, " + storage::format_bytes(config_.memory) +
                                              " given; raise --memory"};
    }
    auto tracer = StoreTracer::create(std::move(file), config, ledger_);
    if (tracer) {
      open_[key] = *tracer;
    }
    return tracer;
  }

  // Of a process like this one, with this store alone.
  [[nodiscard]] std::uint64_t least_memory(const StoreFile& file) const {
    const std::uint64_t directory = file.page_count() * sizeof(storage::PageEntry);
    const std::uint64_t least =
        base_bytes_ +
        (directory + traversal::least_share_bytes(file, choices_.threads, config_.max_jobs)) * config_.max_stores;
    return (least + mebibytes(1) - 1) / mebibytes(1) * mebibytes(1);
  }

 private:
  const EngineConfig config_;
  const Choices choices_;
  storage::Ledger ledger_;
  std::uint64_t base_bytes_ = 0;
  storage::BudgetReservation base_;
  std::mutex mutex_;
  std::map<std::string, std::weak_ptr<StoreTracer>> open_;
};

namespace {

template <typename Impl>
class EngineStore final : public Store {
 public:
  EngineStore(std::shared_ptr<Impl> engine, std::shared_ptr<StoreTracer> tracer) : engine_(std::move(engine)) {
    // Jobs and chunks outlive the store; what they hold of the tracer holds the engine's ledger too.
    struct Held {
      std::shared_ptr<Impl> engine;
      std::shared_ptr<StoreTracer> tracer;
    };
    auto held = std::make_shared<Held>(Held{engine_, std::move(tracer)});
    tracer_ = std::shared_ptr<StoreTracer>(held, held->tracer.get());
  }

  [[nodiscard]] Result<StoreInfo> info() const override {
    StoreInfo info = describe(tracer_->file());
    info.least_memory_bytes = engine_->least_memory(tracer_->file());
    RAYMILL_ASSIGN_OR_RETURN(info.metadata_json, tracer_->file().read_metadata());
    return info;
  }
  [[nodiscard]] Result<std::array<double, 3>> origin() const override {
    return tracer_->file().header().origin().position();
  }
  [[nodiscard]] Result<bool> keeps_float64() const override { return tracer_->file().has_origins(); }
  Result<std::unique_ptr<Job>> trace(const TraceConfig& config) override { return tracer_->start(config, tracer_); }

 private:
  std::shared_ptr<Impl> engine_;
  std::shared_ptr<StoreTracer> tracer_;
};

}  // namespace

Engine::Engine(std::shared_ptr<Impl> impl) : impl_(std::move(impl)) {}
Engine::~Engine() = default;

Result<std::unique_ptr<Engine>> Engine::create(const EngineConfig& config) {
  RAYMILL_ASSIGN_OR_RETURN(const traversal::Isa isa, choose_isa(config.isa));
  RAYMILL_ASSIGN_OR_RETURN(const traversal::ReadOrder read_order, traversal::parse_read_order(config.policy));
  RAYMILL_ASSIGN_OR_RETURN(const storage::EvictionKind eviction, storage::parse_eviction(config.eviction));
  RAYMILL_ASSIGN_OR_RETURN(traversal::Layout layout, traversal::parse_layout(config.layout));
  RAYMILL_ASSIGN_OR_RETURN(const traversal::SortRays sort_rays, traversal::parse_sort_rays(config.sort_rays));
  if (config.adversarial || config.page_trace) {
    if (layout == traversal::Layout::expanded) {
      return {ErrorCode::invalid_argument,
              "an adversarial schedule and a page trace are about pages; the expanded "
              "layout has none: leave it out"};
    }
    layout = traversal::Layout::compact;
  }
  RAYMILL_ASSIGN_OR_RETURN(const storage::ReaderKind io, storage::parse_reader_kind(config.io));
  const unsigned threads = config.threads != 0 ? config.threads : std::max(1U, std::thread::hardware_concurrency());
  if (threads > traversal::kMostThreads || config.max_jobs == 0 || config.max_stores == 0) {
    return {ErrorCode::invalid_argument, "an engine takes 1 to " + std::to_string(traversal::kMostThreads) +
                                             " threads, and at least one job and one store"};
  }
  auto impl = std::make_shared<Impl>(config, Impl::Choices{isa, read_order, eviction, layout, sort_rays, io, threads});
  RAYMILL_RETURN_IF_ERROR(impl->claim_base());
  return std::unique_ptr<Engine>(new Engine(std::move(impl)));
}

Result<std::shared_ptr<Store>> Engine::open(const std::string& path) {
  RAYMILL_ASSIGN_OR_RETURN(std::shared_ptr<StoreTracer> tracer, impl_->open(path));
  return std::shared_ptr<Store>(std::make_shared<EngineStore<Impl>>(impl_, std::move(tracer)));
}

std::vector<std::string> available_isas() {
  std::vector<std::string> names;
  for (const traversal::Isa isa : traversal::runnable_isas()) {
    names.emplace_back(to_string(isa));
  }
  return names;
}

}  // namespace raymill
