#include "storage/io/run_pipeline.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_pipeline.h>

#include <algorithm>
#include <atomic>
#include <limits>
#include <string>
#include <utility>

#include "storage/build/collapse.h"
#include "storage/build/triangle_bucket.h"

namespace raymill::storage {

std::uint64_t run_build_bytes(std::uint64_t triangles) {
  // The binary tree's build is the peak: Embree gives its memory back before the wide tree (15 B a triangle), the plan
  // (12), the pages' vertices (6) and the encoded pages (10 to 30) come. Of the pages of runs before it the allocator
  // keeps some.
  constexpr std::uint64_t kFixedBytes = 1 << 20;
  constexpr std::uint64_t kKeptBytes = 16;
  return kFixedBytes + triangles * (sizeof(Triangle) + kKeptBytes) + binary_tree_build_bytes(triangles);
}

std::uint64_t instance_run_bytes(std::uint64_t instances) {
  // One to a leaf: two binary nodes more than two thirds of one, and a fifth of a wide node. The instance stands in a
  // list, and once more in its page.
  return instances * (2 * sizeof(Instance) + 2 * sizeof(BinaryNode) + sizeof(WideNode) / 4);
}

std::uint64_t page_build_bytes(std::uint32_t page_bytes, Codec codec) {
  // Its image, what the image is made from, and the result.
  return 3 * std::uint64_t(page_bytes) + PageEncoder::bytes(page_bytes, codec);
}

// A run on its way through the stages. Its place is used again: large arrays that come and go with every run cost the
// system a tenth of the time.
struct RunPipeline::Run {
  explicit Run(const EmbreeDevice& device) : builder(device) {}

  std::uint32_t index = 0;
  Status status;
  std::vector<Triangle> triangles;  // in the tree while it has them
  BinaryTreeBuilder builder;
  BinaryTree binary;
  WideTree tree;
  PagePlan plan;
  TreePlace place;
  std::vector<Instance> instances;  // [triangle of the tree]
  TreeMasks masks;
  std::vector<EncodedPage> pages;
};

RunPipeline::RunPipeline(const Config& config, BlockStore& blocks, const Partition& partition, const TopTree& top,
                         StoreFileWriter& writer)
    : config_(config), blocks_(blocks), partition_(partition), top_(top), writer_(writer) {
  for (unsigned i = 0; i < config.threads; ++i) {
    encoders_.emplace_back(config.codec, config.positions);
  }
}

Status RunPipeline::run() {
  RAYMILL_ASSIGN_OR_RETURN(EmbreeDevice device, EmbreeDevice::create());
  device_.emplace(std::move(device));
  RAYMILL_RETURN_IF_ERROR(write_top());
  Status failure;                    // of the last stage, which is serial
  std::atomic<bool> failed = false;  // for the first: a run too many is started at worst
  std::uint32_t next = 0;
  // Runs leave in the order in which they came, so the oldest one's place is free when another begins.
  std::vector<Run> places;
  for (unsigned i = 0; i < config_.runs_at_once; ++i) {
    places.emplace_back(*device_);
  }
  using Item = Run*;
  const auto first = tbb::make_filter<void, Item>(tbb::filter_mode::serial_in_order, [&](tbb::flow_control& control) {
    if (failed || next == partition_.runs.size()) {
      control.stop();
      return Item();
    }
    const Item item = &places[next % places.size()];
    item->index = next++;
    return item;
  });
  const auto building = tbb::make_filter<Item, Item>(tbb::filter_mode::parallel, [&](Item item) {
    build(*item);
    return item;
  });
  const auto numbering = tbb::make_filter<Item, Item>(tbb::filter_mode::serial_in_order, [&](Item item) {
    if (item->status.ok()) {
      number(*item);
    }
    return item;
  });
  const auto encoding = tbb::make_filter<Item, Item>(tbb::filter_mode::parallel, [&](Item item) {
    if (item->status.ok()) {
      encode(*item);
    }
    return item;
  });
  const auto writing = tbb::make_filter<Item, void>(tbb::filter_mode::serial_in_order, [&](Item item) {
    if (failure.ok()) {
      failure = item->status.ok() ? write(*item) : item->status;
      failed = !failure.ok();
    }
  });
  arena_.execute(
      [&] { tbb::parallel_pipeline(config_.runs_at_once, first & building & numbering & encoding & writing); });
  return failure;
}

// The top tree's pages come first in the file. Their content is known before any run is built: a run's root is the
// first node of the page that is set aside for it.
Status RunPipeline::write_top() {
  const auto run_count = static_cast<std::uint32_t>(partition_.runs.size());
  PagePlan plan;
  if (!top_.tree.nodes.empty()) {
    RAYMILL_ASSIGN_OR_RETURN(plan,
                             plan_pages(top_.tree, page_cost(config_.width, config_.page_bytes, 0, config_.proxies)));
  }
  const auto top_pages = static_cast<std::uint32_t>(plan.pages.size());
  next_page_ = config_.first_page + top_pages + run_count;
  for (std::uint32_t run = 0; run < run_count; ++run) {
    run_root_pages_.push_back(config_.first_page + top_pages + run);
  }
  if (top_pages == 0) {
    return {};
  }
  const ProxyTable none;  // a run's root is always entered: what is below it is not known yet
  const TreePlace place{
      {}, {config_.first_page, config_.first_page + 1}, &run_root_pages_, {}, config_.proxies ? &none : nullptr};
  const PageAssembler assembler(top_.tree, plan, place);
  for (std::uint32_t node = 0; node < top_.tree.nodes.size(); ++node) {
    top_nodes_.push_back(assembler.outer_node(node));
  }
  add_to_totals(top_.tree, 0);
  std::vector<EncodedPage> pages;
  arena_.execute([&] { pages = encode_pages(assembler, plan.pages.size()); });
  return write_pages(pages, place.numbers);
}

TreePlace RunPipeline::place_of(std::uint32_t run) const {
  TreePlace place;
  if (!top_nodes_.empty()) {
    for (std::uint32_t node = top_.places[run].parent;; node = top_.tree.nodes[node].parent) {
      place.ancestors.push_back(top_nodes_[node]);
      if (node == 0) {
        break;
      }
    }
    std::reverse(place.ancestors.begin(), place.ancestors.end());
  }
  place.numbers.root = run_root_pages_[run];
  return place;
}

void RunPipeline::build(Run& run) const { run.status = build_tree(run); }

Status RunPipeline::build_tree(Run& run) const {
  const bool instances = partition_.holds_instances(run.index);
  RAYMILL_RETURN_IF_ERROR(load(blocks_, partition_.runs[run.index], run.triangles));
  RAYMILL_RETURN_IF_ERROR(run.builder.build(run.triangles, run.binary, instances ? 1 : kMaxLeafTriangles));
  const LevelRange levels = top_.places[run.index].levels;
  run.tree = instances ? collapse_single(run.binary, std::move(run.triangles), config_.width, levels)
                       : collapse(run.binary, std::move(run.triangles), config_.width, levels);
  run.place = place_of(run.index);
  run.instances.clear();
  for (std::size_t i = 0; instances && i < run.tree.triangles.size(); ++i) {
    RAYMILL_ASSIGN_OR_RETURN(const Instance instance, config_.instance(run.tree.triangles[i].primitive_id));
    run.instances.push_back(instance);
  }
  run.place.instances = run.instances;
  const auto ancestors = static_cast<std::uint32_t>(run.place.ancestors.size());
  PageCost cost = instances ? instance_page_cost(config_.width, config_.page_bytes, ancestors, config_.proxies)
                            : page_cost(config_.width, config_.page_bytes, ancestors, config_.proxies);
  if (config_.masks != nullptr && !instances) {
    RAYMILL_RETURN_IF_ERROR(config_.masks->look_up(config_.tree, run.tree.triangles, run.masks));
    run.place.masks = &run.masks;
    run.place.mask_refs = config_.mask_refs;
    add_mask_cost(run.masks, cost);
  }
  RAYMILL_ASSIGN_OR_RETURN(run.plan, plan_pages(run.tree, cost));
  return {};
}

void RunPipeline::number(Run& run) {
  constexpr std::uint64_t kMostPages = std::numeric_limits<std::uint32_t>::max() - 1;
  const std::uint64_t others = run.plan.pages.size() - 1;
  if (next_page_ + others > kMostPages) {
    run.status = {ErrorCode::unsupported, "the scene needs more than 2^32 pages; use a larger --page-size"};
    return;
  }
  run.place.numbers.others = next_page_;
  next_page_ += static_cast<std::uint32_t>(others);
}

ProxyTable RunPipeline::proxies_of(const WideTree& tree, const PagePlan& plan) const {
  return {tree, plan, [](std::size_t count, const std::function<void(std::size_t)>& work) {
            tbb::this_task_arena::isolate([&] { tbb::parallel_for(std::size_t{0}, count, work); });
          }};
}

void RunPipeline::encode(Run& run) {
  ProxyTable proxies;
  if (config_.proxies) {
    proxies = run.instances.empty() ? proxies_of(run.tree, run.plan) : ProxyTable();
    run.place.proxies = &proxies;
  }
  const PageAssembler assembler(run.tree, run.plan, run.place);
  run.pages = encode_pages(assembler, run.plan.pages.size());
}

std::vector<RunPipeline::EncodedPage> RunPipeline::encode_pages(const PageAssembler& assembler, std::size_t count) {
  std::vector<EncodedPage> pages(count);
  const auto encode_one = [&](std::size_t i) {
    PageEncoder& encoder = encoders_[static_cast<std::size_t>(tbb::this_task_arena::current_thread_index())];
    auto image = assembler.assemble(static_cast<std::uint32_t>(i));
    pages[i].status = image ? check_boxes(image->data()) : image.status();
    if (pages[i].status.ok()) {
      const PageHeader& header = PageView(image->data()).header();
      pages[i].decoded_bytes = header.image_bytes;
      pages[i].mask_section_bytes = header.image_bytes - instances_end(header);
      pages[i].bytes = encoder.encode(*image);
    }
  };
  // Pages of one run side by side too, for scenes of a few runs; a thread that waits here takes no other run on.
  tbb::this_task_arena::isolate([&] { tbb::parallel_for(std::size_t{0}, count, encode_one); });
  return pages;
}

Status RunPipeline::write_pages(const std::vector<EncodedPage>& pages, const PageNumbers& numbers) {
  for (std::uint32_t i = 0; i < pages.size(); ++i) {
    RAYMILL_RETURN_IF_ERROR(pages[i].status);
    totals_.mask_section_bytes += pages[i].mask_section_bytes;
    RAYMILL_RETURN_IF_ERROR(writer_.add_page(PageId{numbers.of(i)}, pages[i].bytes, pages[i].decoded_bytes));
  }
  return {};
}

Status RunPipeline::write(Run& run) {
  RAYMILL_RETURN_IF_ERROR(write_pages(run.pages, run.place.numbers));
  add_to_totals(run.tree, run.instances.size());
  run.triangles = std::move(run.tree.triangles);
  return config_.progress ? config_.progress(totals_.triangles + totals_.instances) : Status();
}

void RunPipeline::add_to_totals(const WideTree& tree, std::size_t instances) {
  totals_.triangles += tree.triangles.size() - instances;
  totals_.instances += instances;
  totals_.nodes += tree.nodes.size();
  totals_.levels = std::max(totals_.levels, tree.levels);
  totals_.area_cost += tree.area_cost();
}

}  // namespace raymill::storage
