#include "storage/build/page_plan.h"

#include <algorithm>
#include <bit>
#include <queue>
#include <span>
#include <string>
#include <unordered_set>
#include <utility>

#include "storage/base/position_map.h"
#include "storage/build/mask_spool.h"

namespace raymill::storage {
namespace {

constexpr std::uint32_t kUnplaced = 0xFFFFFFFFu;

// What a page would decode to, counted exactly while nodes are added.
class PageMeter {
 public:
  PageMeter(const WideTree& tree, const PageCost& cost)
      : tree_(tree), cost_(cost), corners_(tree.triangles.size() * 3) {}

  // Adds the nodes (a connected treelet, root first) if the page then still fits; else leaves the page as it was.
  bool try_add(std::span<const std::uint32_t> treelet) {
    const Counts before = counts_;
    const std::size_t vertices_before = vertices_.size();
    std::vector<std::uint32_t> new_geometries, new_ghosts;
    for (const std::uint32_t index : treelet) {
      add_node(tree_.nodes[index], new_geometries);
    }
    add_ghosts(treelet.front(), new_ghosts);
    if (fits()) {
      return true;
    }
    counts_ = before;
    vertices_.rollback(vertices_before);
    last_geometry_ = kNoGeometry;
    for (const std::uint32_t id : new_geometries) {
      geometries_.erase(id);
    }
    for (const std::uint32_t ghost : new_ghosts) {
      ghosts_.erase(ghost);
    }
    return false;
  }

  void clear() {
    counts_ = {};
    vertices_.clear();
    geometries_.clear();
    last_geometry_ = kNoGeometry;
    ghosts_.clear();
  }

  // Of all triangles that were added: the numbers that their corners' positions have in their pages.
  std::vector<std::uint16_t> take_corners() { return std::move(corners_); }

 private:
  struct Counts {
    std::uint64_t nodes = 0, externals = 0, triangles = 0, masked = 0;
  };

  void add_node(const WideNode& node, std::vector<std::uint32_t>& new_geometries) {
    ++counts_.nodes;
    for (unsigned slot = 0; slot < tree_.width; ++slot) {
      if (!node.has(slot)) {
        continue;
      }
      // Every inner child may turn out to stand in another page: an upper bound.
      counts_.externals += node.is_leaf(slot) ? 0 : 1;
      for (std::uint32_t i = node.child[slot]; i < node.child[slot] + node.count[slot]; ++i) {
        const Triangle& t = tree_.triangles[i];
        ++counts_.triangles;
        counts_.masked += has_mask(i) ? 1 : 0;
        for (std::size_t corner = 0; corner < 3; ++corner) {
          corners_[std::size_t(i) * 3 + corner] = static_cast<std::uint16_t>(vertices_.insert(t.v[corner]));
        }
        if (t.geometry_id != last_geometry_ && geometries_.insert(t.geometry_id).second) {
          new_geometries.push_back(t.geometry_id);
        }
        last_geometry_ = t.geometry_id;
      }
    }
  }

  void add_ghosts(std::uint32_t root, std::vector<std::uint32_t>& new_ghosts) {
    for (std::uint32_t node = root; node != 0;) {
      node = tree_.nodes[node].parent;
      if (!ghosts_.insert(node).second) {
        break;
      }
      new_ghosts.push_back(node);
    }
    for (const std::uint32_t ghost : new_ghosts) {
      ++counts_.nodes;
      counts_.externals += static_cast<std::uint64_t>(std::popcount(tree_.nodes[ghost].valid));
    }
  }

  [[nodiscard]] bool has_mask(std::uint32_t triangle) const {
    return !cost_.mask_entries.empty() && cost_.mask_entries[triangle] != TreeMasks::kNone &&
           cost_.mask_entries[triangle] >= TreeMasks::kShared;
  }

  // Everything inside a page is numbered with 16 bits.
  [[nodiscard]] bool fits() const {
    constexpr std::uint64_t kMost = 0xFFFF;
    return bytes() <= cost_.page_bytes && counts_.nodes < kMost && counts_.externals <= kMost &&
           counts_.triangles <= kMost && vertices_.size() <= kMost;
  }

  [[nodiscard]] std::uint64_t bytes() const {
    return cost_.header_bytes + counts_.nodes * cost_.node_bytes + counts_.externals * cost_.external_bytes +
           counts_.triangles * cost_.triangle_bytes + vertices_.size() * cost_.vertex_bytes +
           geometries_.size() * cost_.geometry_bytes + counts_.masked * cost_.mask_bytes;
  }

  static constexpr std::uint32_t kNoGeometry = 0xFFFFFFFFu;

  const WideTree& tree_;
  const PageCost& cost_;
  Counts counts_;
  PositionMap vertices_;
  std::vector<std::uint16_t> corners_;
  std::unordered_set<std::uint32_t> geometries_;
  std::uint32_t last_geometry_ = kNoGeometry;  // it is in geometries_
  std::unordered_set<std::uint32_t> ghosts_;
};

class Planner {
 public:
  Planner(const WideTree& tree, const PageCost& cost)
      : tree_(tree), cost_(cost), meter_(tree, cost), subtree_bytes_(tree.nodes.size()), is_top_(tree.nodes.size()) {}

  Result<PagePlan> run() {
    plan_.page_of.assign(tree_.nodes.size(), kUnplaced);
    measure_subtrees();
    find_treelets();
    RAYMILL_RETURN_IF_ERROR(pack(treelets_));
    adopt_parents();
    cut_top();
    RAYMILL_RETURN_IF_ERROR(pack(top_treelets_));
    order_pages();
    plan_.corners = meter_.take_corners();
    return std::move(plan_);
  }

 private:
  // Estimated bytes of each whole subtree; a mesh has about 0.6 vertices a triangle inside a page. Only a guide: the
  // meter decides.
  void measure_subtrees() {
    for (std::size_t i = tree_.nodes.size(); i-- > 0;) {
      const WideNode& node = tree_.nodes[i];
      double bytes = cost_.node_bytes;
      for (unsigned slot = 0; slot < tree_.width; ++slot) {
        bytes += node.count[slot] * (cost_.triangle_bytes + 0.6 * cost_.vertex_bytes);
        bytes += node.is_inner(slot) ? subtree_bytes_[node.child[slot]] : 0;
      }
      subtree_bytes_[i] = bytes;
    }
  }

  void find_treelets() {
    const double limit = double(cost_.page_bytes) / kTreeletsPerPage;
    for (std::uint32_t i = 0; i < tree_.nodes.size();) {
      if (subtree_bytes_[i] > limit) {
        is_top_[i] = true;
        ++i;
        continue;
      }
      const std::uint32_t end = subtree_end(i);
      std::vector<std::uint32_t> treelet;
      for (std::uint32_t node = i; node < end; ++node) {
        treelet.push_back(node);
      }
      treelets_.push_back(std::move(treelet));
      i = end;
    }
  }

  // Nodes stand depth first: a subtree is a range.
  [[nodiscard]] std::uint32_t subtree_end(std::uint32_t root) const {
    std::uint32_t end = root + 1;
    while (end < tree_.nodes.size() && tree_.nodes[end].level > tree_.nodes[root].level) {
      ++end;
    }
    return end;
  }

  // Fills pages in order; a treelet that no empty page can hold is taken apart into its root and its subtrees.
  Status pack(const std::vector<std::vector<std::uint32_t>>& treelets) {
    begin_page();
    for (const auto& treelet : treelets) {
      RAYMILL_RETURN_IF_ERROR(place(treelet));
    }
    return {};
  }

  Status place(const std::vector<std::uint32_t>& treelet) {
    if (!meter_.try_add(treelet)) {
      begin_page();
      if (!meter_.try_add(treelet)) {
        return take_apart(treelet);
      }
    }
    for (const std::uint32_t node : treelet) {
      plan_.page_of[node] = static_cast<std::uint32_t>(plan_.pages.size() - 1);
      plan_.pages.back().push_back(node);
    }
    return {};
  }

  Status take_apart(const std::vector<std::uint32_t>& treelet) {
    const std::uint32_t root = treelet.front();
    if (treelet.size() == 1) {
      return {ErrorCode::invalid_argument,
              "a page of " + std::to_string(cost_.page_bytes) +
                  " bytes cannot hold one node with its leaves and its escape table; use a larger page size"};
    }
    RAYMILL_RETURN_IF_ERROR(place({root}));
    std::vector<std::uint32_t> part;
    for (std::size_t i = 1; i < treelet.size(); ++i) {
      if (!part.empty() && tree_.nodes[treelet[i]].parent == root) {
        RAYMILL_RETURN_IF_ERROR(place(part));
        part.clear();
      }
      part.push_back(treelet[i]);
    }
    return part.empty() ? Status{} : place(part);
  }

  void begin_page() {
    meter_.clear();
    if (plan_.pages.empty() || !plan_.pages.back().empty()) {
      plan_.pages.emplace_back();
    }
  }

  // A top node whose inner children all came into one page stands there as a ghost already, which costs more than the
  // node itself; it moves in unless its own leaves are too many.
  void adopt_parents() {
    for (std::uint32_t i = static_cast<std::uint32_t>(tree_.nodes.size()); i-- > 0;) {
      const WideNode& node = tree_.nodes[i];
      std::uint32_t page = kUnplaced;
      bool one_page = is_top_[i];
      for (unsigned slot = 0; slot < tree_.width && one_page; ++slot) {
        if (!node.has(slot)) {
          continue;
        }
        one_page = node.is_inner(slot) && plan_.page_of[node.child[slot]] != kUnplaced &&
                   (page == kUnplaced || page == plan_.page_of[node.child[slot]]);
        page = one_page ? plan_.page_of[node.child[slot]] : page;
      }
      if (one_page && page != kUnplaced) {
        plan_.page_of[i] = page;
        plan_.pages[page].push_back(i);
        is_top_[i] = false;
      }
    }
    for (auto& page : plan_.pages) {
      std::sort(page.begin(), page.end());
    }
  }

  // Greedy cut by surface area: from each root take the largest frontier node until a page is full.
  void cut_top() {
    const std::size_t nodes_per_treelet = std::max<std::size_t>(
        1, cost_.page_bytes / 2 / (cost_.node_bytes + std::size_t(cost_.external_bytes) * tree_.width));
    std::vector<std::uint32_t> roots;
    if (is_top_[0]) {
      roots.push_back(0);
    }
    for (std::size_t next = 0; next < roots.size(); ++next) {
      using Entry = std::pair<double, std::uint32_t>;
      std::priority_queue<Entry, std::vector<Entry>, std::less<>> frontier;
      frontier.emplace(0.0, roots[next]);
      std::vector<std::uint32_t> treelet;
      while (!frontier.empty() && treelet.size() < nodes_per_treelet) {
        const std::uint32_t index = frontier.top().second;
        frontier.pop();
        treelet.push_back(index);
        const WideNode& node = tree_.nodes[index];
        for (unsigned slot = 0; slot < tree_.width; ++slot) {
          if (node.is_inner(slot) && is_top_[node.child[slot]]) {
            frontier.emplace(node.boxes[slot].half_area(), node.child[slot]);
          }
        }
      }
      for (; !frontier.empty(); frontier.pop()) {
        roots.push_back(frontier.top().second);
      }
      std::sort(treelet.begin(), treelet.end());
      top_treelets_.push_back(std::move(treelet));
    }
    first_top_page_ = plan_.pages.size() - (plan_.pages.back().empty() ? 1 : 0);
  }

  // The root's page stands first, then the other pages of the top part; pages that stayed empty go.
  void order_pages() {
    const auto top = plan_.pages.begin() + static_cast<std::ptrdiff_t>(first_top_page_);
    std::rotate(plan_.pages.begin(), top, plan_.pages.end());
    std::erase_if(plan_.pages, [](const auto& page) { return page.empty(); });
    const auto root = std::find_if(plan_.pages.begin(), plan_.pages.end(), [](const auto& page) {
      return std::find(page.begin(), page.end(), 0U) != page.end();
    });
    std::rotate(plan_.pages.begin(), root, root + 1);
    for (std::uint32_t page = 0; page < plan_.pages.size(); ++page) {
      std::sort(plan_.pages[page].begin(), plan_.pages[page].end());
      for (const std::uint32_t node : plan_.pages[page]) {
        plan_.page_of[node] = page;
      }
    }
  }

  const WideTree& tree_;
  const PageCost& cost_;
  PageMeter meter_;
  PagePlan plan_;
  std::vector<double> subtree_bytes_;
  std::vector<bool> is_top_;
  std::vector<std::vector<std::uint32_t>> treelets_;
  std::vector<std::vector<std::uint32_t>> top_treelets_;
  std::size_t first_top_page_ = 0;
};

}  // namespace

Result<PagePlan> plan_pages(const WideTree& tree, const PageCost& cost) { return Planner(tree, cost).run(); }

}  // namespace raymill::storage
