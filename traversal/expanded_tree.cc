#include "traversal/expanded_tree.h"

#include <algorithm>
#include <bit>
#include <limits>
#include <utility>

#include "storage/pages/attribute_page.h"

namespace raymill::traversal {

using storage::PageView;

namespace {

// A row is loaded whole: eight floats from any of its first.
constexpr std::uint64_t kTailBytes = 64;

std::uint64_t node_bytes(const storage::StoreFile& store) {
  return store.rules().width == 8 ? sizeof(ExpandedNode<8>) : sizeof(ExpandedNode<4>);
}
std::uint64_t node_count(const storage::StoreFile& store) { return store.footer().node_count; }
std::uint64_t word_count(const storage::StoreFile& store) { return store.footer().triangle_count * kBlockWords; }

// Corner rows and ids of `count` triangles from `first` on.
void write_block(const PageView& view, std::uint32_t first, std::uint32_t count, float* block) {
  for (std::uint32_t i = 0; i < count; ++i) {
    const std::uint32_t triangle = first + i;
    for (std::uint32_t corner = 0; corner < 3; ++corner) {
      const storage::Vec3f& p = view.vertices()[view.indices()[3 * triangle + corner]];
      float* row = block + (3 * corner) * count + i;
      row[0] = p[0];
      row[count] = p[1];
      row[2 * count] = p[2];
    }
    block[kCornerRows * count + i] = std::bit_cast<float>(view.primitive_ids()[triangle]);
    block[(kCornerRows + 1) * count + i] = std::bit_cast<float>(view.geometry_id(triangle));
  }
}

template <int N>
bool is_block(const storage::Node<N>& node, unsigned slot) {
  return ((node.valid & node.leaf & ~node.external) >> slot & 1) != 0;
}

}  // namespace

bool ExpandedTree::possible(const storage::StoreFile& store) {
  constexpr std::uint64_t kMost = std::numeric_limits<std::uint32_t>::max();
  return !store.has_volumes() && !store.has_masks() && store.footer().object_level == 0 && node_count(store) <= kMost &&
         word_count(store) <= kMost;
}

std::uint64_t ExpandedTree::bytes(const storage::StoreFile& store) {
  return node_count(store) * node_bytes(store) + word_count(store) * sizeof(float) + kTailBytes;
}

// A reference for each treelet but the root: never more than nodes.
std::uint64_t TreeExpander::bytes(const storage::StoreFile& store) {
  return store.page_count() * sizeof(PageNodes) + node_count(store) * sizeof(Patch);
}

Result<std::unique_ptr<TreeExpander>> TreeExpander::create(const storage::StoreFile& store, storage::Ledger& ledger) {
  std::unique_ptr<TreeExpander> expander(new TreeExpander(store));
  expander->tree_.reset(new ExpandedTree);
  ExpandedTree& tree = *expander->tree_;
  RAYMILL_ASSIGN_OR_RETURN(expander->claim_, ledger.claim(storage::Tag::decode, bytes(store)));
  RAYMILL_ASSIGN_OR_RETURN(tree.claim_, ledger.claim(storage::Tag::pages, ExpandedTree::bytes(store)));
  tree.memory_ = storage::MappedMemory(ExpandedTree::bytes(store), storage::MappedMemory::Pages::huge);
  if (tree.memory_.data() == nullptr) {
    return {ErrorCode::budget_exceeded, "the system has no address space for the expanded layout"};
  }
  tree.view_.nodes = tree.memory_.data();
  tree.view_.blocks = reinterpret_cast<const float*>(tree.memory_.data() + node_count(store) * node_bytes(store));
  expander->page_nodes_.resize(store.page_count());
  return expander;
}

Status TreeExpander::corrupt() const {
  return {ErrorCode::corrupt, store_.path() +
                                  ": has pages whose references do not fit each other; build it again (`raymill "
                                  "verify` names the page)"};
}

Status TreeExpander::add(storage::PageId page, const std::byte* image) {
  if (storage::AttributePageView::is_attribute_page(image)) {
    return {};
  }
  const PageView view(image);
  return store_.rules().width == 8 ? add_nodes<8>(page, view) : add_nodes<4>(page, view);
}

template <int N>
Status TreeExpander::add_nodes(storage::PageId page, PageView view) {
  const std::uint32_t count = view.header().node_count;
  const storage::Node<N>* from = view.nodes<N>();
  std::uint64_t words = 0;
  std::uint32_t patches = 0;
  for (std::uint32_t i = 0; i < count; ++i) {
    patches += static_cast<std::uint32_t>(std::popcount(unsigned(from[i].external)));
    for (unsigned slot = 0; slot < N; ++slot) {
      words += is_block(from[i], slot) ? std::uint64_t(from[i].count[slot]) * kBlockWords : 0;
    }
  }
  const std::uint64_t first = nodes_used_.fetch_add(count, std::memory_order_relaxed);
  std::uint64_t word = words_used_.fetch_add(words, std::memory_order_relaxed);
  if (first + count > node_count(store_) || word + words > word_count(store_)) {
    return corrupt();
  }
  page_nodes_[index_of(page)] = {static_cast<std::uint32_t>(first), count};

  std::vector<Patch> own;
  own.reserve(patches);
  for (std::uint32_t i = 0; i < count; ++i) {
    const storage::Node<N>& node = from[i];
    ExpandedNode<N>& to = nodes<N>()[first + i];
    to = {};
    to.valid = node.valid;
    to.order = node.order;
    to.level = node.level;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float scale = storage::power_of_two(node.exponent[axis]);
      for (unsigned slot = 0; slot < N; ++slot) {
        to.planes[axis][0][slot] = storage::decode_plane(node.base[axis], scale, node.lower[axis][slot]);
        to.planes[axis][1][slot] = storage::decode_plane(node.base[axis], scale, node.upper[axis][slot]);
      }
    }
    for (unsigned slot = 0; slot < N; ++slot) {
      if ((node.valid >> slot & 1) == 0) {
        continue;
      }
      if ((node.external >> slot & 1) != 0) {
        own.push_back({static_cast<std::uint32_t>(first + i), slot, view.externals()[node.child[slot]]});
      } else if (is_block(node, slot)) {
        write_block(view, node.child[slot], node.count[slot], blocks() + word);
        to.child[slot] = static_cast<std::uint32_t>(word);
        to.count[slot] = node.count[slot];
        to.leaves = static_cast<std::uint8_t>(to.leaves | 1U << slot);
        word += std::uint64_t(node.count[slot]) * kBlockWords;
      } else {
        to.child[slot] = static_cast<std::uint32_t>(first) + node.child[slot];
      }
    }
  }
  const std::lock_guard lock(mutex_);
  if (patches_.size() + own.size() > node_count(store_)) {
    return corrupt();
  }
  if (patches_.capacity() == 0) {
    patches_.reserve(node_count(store_));
  }
  patches_.insert(patches_.end(), own.begin(), own.end());
  return {};
}

// References to other pages and treelets become indices; those of kind leaf stand in ghosts only, which are not here.
// The levels rise along every path, so that no damage makes a cycle.
template <int N>
Status TreeExpander::resolve() {
  for (const Patch& patch : patches_) {
    ExpandedNode<N>& node = nodes<N>()[patch.node];
    if (patch.ref.page >= page_nodes_.size() || patch.ref.node >= page_nodes_[patch.ref.page].count) {
      return corrupt();
    }
    const std::uint32_t target = page_nodes_[patch.ref.page].first + patch.ref.node;
    if (nodes<N>()[target].level != node.level + 1) {
      return corrupt();
    }
    node.child[patch.slot] = target;
  }
  return {};
}

Result<std::unique_ptr<ExpandedTree>> TreeExpander::finish() {
  const std::uint32_t root_node = store_.footer().root_node;
  const PageNodes& root = page_nodes_[store_.footer().root_page];
  if (root_node >= root.count) {
    return corrupt();
  }
  RAYMILL_RETURN_IF_ERROR(store_.rules().width == 8 ? resolve<8>() : resolve<4>());
  tree_->view_.root = root.first + root_node;
  const storage::StoreFooter& footer = store_.footer();
  for (std::size_t axis = 0; axis < 3; ++axis) {
    constexpr float kCoherentPart = 1.0F / 32;
    const float side = footer.bounds_max[axis] - footer.bounds_min[axis];
    tree_->view_.coherent_width = std::max(tree_->view_.coherent_width, side * kCoherentPart);
  }
  patches_ = {};
  claim_ = {};
  return std::move(tree_);
}

}  // namespace raymill::traversal
