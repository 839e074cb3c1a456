// ProxyTable: what stands for the subtrees of an MBVH that its pages refer to across page borders.
// Immutable once made.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "storage/build/page_plan.h"
#include "storage/build/wide_tree.h"
#include "storage/pages/proxy.h"

namespace raymill::storage {

class ProxyTable {
 public:
  /// Calls work(i) for each i below `count`, in any order, side by side if it likes.
  using ForEach = std::function<void(std::size_t count, const std::function<void(std::size_t)>& work)>;

  /// Without proxies: of a tree whose references are entered always.
  ProxyTable() = default;
  /// Of each child that is a node and stands in another page than its parent. The same tree and plan give the same
  /// bits. Each triangle is looked at once for each page border above it.
  ProxyTable(const WideTree& tree, const PagePlan& plan, const ForEach& for_each);

  /// Null: the reference to the child in `slot` of `node` has none.
  [[nodiscard]] const Proxy* find(std::uint32_t node, unsigned slot) const;
  [[nodiscard]] std::size_t size() const { return proxies_.size(); }
  /// Memory of the table of a tree of so many triangles: a page border has a hundred of them or more below it.
  static std::uint64_t bytes(std::uint64_t triangles) { return triangles; }

 private:
  static std::uint64_t key_of(std::uint32_t node, unsigned slot) { return std::uint64_t(node) * kMaxWidth + slot; }

  std::vector<std::uint64_t> keys_;  // ascending
  std::vector<Proxy> proxies_;
};

}  // namespace raymill::storage
