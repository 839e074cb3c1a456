// ResidentStore: every page of a store in a page cache, and kernels run on them in batches as the engine runs them.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "storage/cache/page_cache.h"
#include "storage/io/store_file.h"
#include "traversal/kernel.h"

namespace raymill::bench {

class ResidentStore {
 public:
  static Result<ResidentStore> load(const std::string& path);

  struct Run {
    traversal::Isa isa = traversal::runnable_isas().back();
    Query query = Query::closest;
    Mode mode = Mode::watertight;
    std::size_t batch_rays = 512;
  };
  /// Traces valid rays by the kernel alone; hits[i] is ray i's. Thread-confined.
  Result<traversal::KernelCounters> trace(const Run& run, std::span<const Ray> rays, std::span<Hit> hits) const;
  /// The same by the expanded layout's kernels, where the store may have that (not with instances).
  Result<traversal::KernelCounters> trace_expanded(const Run& run, std::span<const Ray> rays,
                                                   std::span<Hit> hits) const;
  /// Its bytes.
  [[nodiscard]] std::uint64_t expanded_bytes() const { return traversal::ExpandedTree::bytes(*file_); }
  /// States of rays at the root, [rays.size()].
  void begin(std::span<const Ray> rays, std::vector<traversal::RayState>& states) const;
  [[nodiscard]] traversal::Kernel kernel(const Run& run) const;
  [[nodiscard]] unsigned width() const { return file_->rules().width; }
  [[nodiscard]] std::uint32_t page_count() const { return file_->page_count(); }
  [[nodiscard]] std::uint32_t root_page() const { return file_->footer().root_page; }
  [[nodiscard]] unsigned object_level() const { return file_->footer().object_level; }
  [[nodiscard]] const std::byte* image(std::uint32_t page) const { return cache_->images()[page].load(); }

 private:
  ResidentStore() = default;

  std::unique_ptr<storage::Ledger> ledger_;
  std::shared_ptr<const storage::StoreFile> file_;
  std::unique_ptr<storage::PageCache> cache_;
  std::unique_ptr<traversal::ExpandedTree> expanded_;
};

}  // namespace raymill::bench
