// LonePage: the adversarial schedule of tests. Shows a kernel one page, as if no other were there and as if each of its
// nodes stood in a page of its own, so that every ray suspends at every node.
//
//   image of page p    child 7: local node 12     ->   copy of it    child 7: external reference to node 12 of page p +
//   n
//
// n is the store's page count: an alias that is never resident. No kernel knows of it. Thread-confined.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "storage/base/aligned.h"
#include "storage/pages/page_image.h"
#include "traversal/ray_state.h"

namespace raymill::traversal {

class LonePage {
 public:
  explicit LonePage(const storage::PageRules& rules);
  static std::uint64_t bytes(const storage::PageRules& rules);

  /// What a kernel finds: [2 * page_count] images, all null but the page's.
  const std::atomic<const std::byte*>* show(std::uint32_t page, const std::byte* image);
  /// After the kernel: rays that wait at an alias wait at the page itself.
  void settle(std::span<RayState> rays, const std::byte* image) const;

 private:
  template <int N>
  void part_nodes(const storage::PageView& view);

  const storage::PageRules rules_;
  std::unique_ptr<std::atomic<const std::byte*>[]> images_;
  storage::PageBuffer copy_;
  std::uint32_t shown_ = 0;
};

}  // namespace raymill::traversal
