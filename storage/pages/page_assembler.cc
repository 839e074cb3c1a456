#include "storage/pages/page_assembler.h"

#include <algorithm>
#include <cassert>
#include <cstring>
#include <deque>
#include <map>
#include <string>
#include <unordered_map>

#include "storage/pages/box_quantizer.h"
#include "storage/pages/page_image.h"
#include "storage/pages/page_masks.h"

namespace raymill::storage {
namespace {

template <int N>
class Assembly {
 public:
  Assembly(const PageAssembler& assembler, const WideTree& tree, const PagePlan& plan, const TreePlace& place,
           const std::vector<std::uint16_t>& local_index, std::uint32_t page)
      : assembler_(assembler),
        tree_(tree),
        plan_(plan),
        place_(place),
        local_index_(local_index),
        page_(page),
        locals_(plan.pages[page]) {}

  Result<PageBuffer> run() {
    find_ghosts();
    nodes_.resize(locals_.size() + ghosts_.size());
    for (std::size_t i = 0; i < nodes_.size(); ++i) {
      RAYMILL_RETURN_IF_ERROR(i < locals_.size() ? fill_local(i) : fill_ghost(i));
    }
    return write();
  }

 private:
  [[nodiscard]] bool is_local(std::uint32_t node) const { return plan_.page_of[node] == page_; }

  // Nodes above the page's nodes that stand elsewhere, nearest to the scene's root first: those above the tree, then
  // the tree's own.
  void find_ghosts() {
    for (const std::uint32_t local : locals_) {
      for (std::uint32_t node = local; node != 0;) {
        node = tree_.nodes[node].parent;
        if (!is_local(node) && !ghost_index_.emplace(node, 0).second) {
          break;  // its own ancestors are in already
        }
      }
    }
    for (std::size_t i = 0; i < place_.ancestors.size(); ++i) {
      ghosts_.push_back({&place_.ancestors[i], i == 0 ? kNoParent : ghost_number(i - 1)});
    }
    for (auto& [node, index] : ghost_index_) {
      index = ghost_number(ghosts_.size());
      own_ghosts_.push_back(assembler_.outer_node(node));
      ghosts_.push_back({nullptr, kNoParent});
    }
    std::size_t own = place_.ancestors.size();
    for (const auto& [node, index] : ghost_index_) {
      ghosts_[own] = {&own_ghosts_[own - place_.ancestors.size()], parent_here(node)};
      ++own;
    }
  }

  [[nodiscard]] std::uint16_t ghost_number(std::size_t ghost) const {
    return static_cast<std::uint16_t>(locals_.size() + ghost);
  }
  [[nodiscard]] std::uint16_t index_here(std::uint32_t node) const {
    return is_local(node) ? local_index_[node] : ghost_index_.at(node);
  }
  [[nodiscard]] std::uint16_t parent_here(std::uint32_t node) const {
    if (node != 0) {
      return index_here(tree_.nodes[node].parent);
    }
    return place_.ancestors.empty() ? kNoParent : ghost_number(place_.ancestors.size() - 1);
  }

  static void copy_fixed(const WideNode& source, Node<N>& node) {
    node.level = source.level;
    node.valid = source.valid;
    node.order = source.order;
  }

  Status fill_ghost(std::size_t i) {
    const Ghost& ghost = ghosts_[i - locals_.size()];
    Node<N>& node = nodes_[i];
    copy_fixed(ghost.source->node, node);
    node.parent = ghost.parent;
    for (unsigned slot = 0; slot < N; ++slot) {
      if (ghost.source->node.has(slot)) {
        refer(node, slot, ghost.source->children[slot], ghost.source->proxies[slot]);
      }
    }
    return fill_boxes(node, ghost.source->node);
  }

  Status fill_local(std::size_t i) {
    const std::uint32_t index = locals_[i];
    const WideNode& source = tree_.nodes[index];
    Node<N>& node = nodes_[i];
    copy_fixed(source, node);
    node.parent = parent_here(index);
    for (unsigned slot = 0; slot < N; ++slot) {
      if (source.has(slot)) {
        fill_child(node, index, slot);
      }
    }
    return fill_boxes(node, source);
  }

  void refer(Node<N>& node, unsigned slot, const ExternalRef& ref, const Proxy& proxy) {
    node.external = static_cast<std::uint8_t>(node.external | 1U << slot);
    node.child[slot] = static_cast<std::uint16_t>(externals_.size());
    externals_.push_back(ref);
    if (place_.proxies != nullptr) {
      proxies_.push_back(proxy);
    }
  }

  void fill_child(Node<N>& node, std::uint32_t index, unsigned slot) {
    const WideNode& source = tree_.nodes[index];
    if (source.is_leaf(slot) && !place_.instances.empty()) {
      refer(node, slot, {static_cast<std::uint32_t>(instances_.size()), 0, 0, ExternalKind::instance}, {});
      instances_.push_back(place_.instances[source.child[slot]]);
    } else if (source.is_leaf(slot)) {
      node.leaf = static_cast<std::uint8_t>(node.leaf | 1U << slot);
      node.count[slot] = source.count[slot];
      node.child[slot] = static_cast<std::uint16_t>(triangles_.size());
      for (std::uint32_t t = source.child[slot]; t < source.child[slot] + source.count[slot]; ++t) {
        triangles_.push_back(t);
      }
    } else if (source.is_inner(slot) && is_local(source.child[slot])) {
      node.child[slot] = local_index_[source.child[slot]];
    } else {
      refer(node, slot, assembler_.reference_to(index, slot), assembler_.proxy_of(index, slot));
    }
  }

  Status fill_boxes(Node<N>& node, const WideNode& source) {
    const Aabb all = node_box(source, N);
    for (int axis = 0; axis < 3; ++axis) {
      const AxisFrame frame = choose_frame(all.lower[axis], all.upper[axis]);
      node.base[axis] = frame.base;
      node.exponent[axis] = frame.exponent;
      for (unsigned slot = 0; slot < N; ++slot) {
        node.lower[axis][slot] = 255;
        node.upper[axis][slot] = 0;
        if (!source.has(slot)) {
          continue;
        }
        const auto lower = quantize_lower(frame, source.boxes[slot].lower[axis]);
        const auto upper = quantize_upper(frame, source.boxes[slot].upper[axis]);
        if (!lower || !upper) {
          return {ErrorCode::internal, "a box of page " + std::to_string(page_) + " cannot be quantised outward"};
        }
        node.lower[axis][slot] = *lower;
        node.upper[axis][slot] = *upper;
      }
    }
    return {};
  }

  PageBuffer write() {
    std::vector<Vec3f> positions(triangles_.size() * 3);
    std::map<std::uint32_t, std::uint32_t> geometries;  // sorted: the table does not depend on the order of nodes
    std::vector<std::uint16_t> indices;
    indices.reserve(triangles_.size() * 3);
    std::uint32_t vertex_count = 0;
    const std::uint32_t* last_geometry = nullptr;
    for (const std::uint32_t index : triangles_) {
      const Triangle& t = tree_.triangles[index];
      for (std::size_t corner = 0; corner < 3; ++corner) {
        const std::uint16_t vertex = assembler_.vertex_of(index, corner);
        indices.push_back(vertex);
        positions[vertex] = t.v[corner];
        vertex_count = std::max(vertex_count, vertex + 1U);
      }
      if (last_geometry == nullptr || *last_geometry != t.geometry_id) {
        geometries.emplace(t.geometry_id, 0);
      }
      last_geometry = &t.geometry_id;
    }
    positions.resize(vertex_count);
    PageHeader header;
    header.page_type = place_.proxies != nullptr ? kPageTypeProxies : kPageTypeTriangles;
    header.width = N;
    header.node_count = static_cast<std::uint16_t>(locals_.size());
    header.ghost_count = static_cast<std::uint16_t>(ghosts_.size());
    header.external_count = static_cast<std::uint32_t>(externals_.size());
    header.triangle_count = static_cast<std::uint32_t>(triangles_.size());
    header.vertex_count = vertex_count;
    header.geometry_count = static_cast<std::uint32_t>(geometries.size());
    header.geometry_index_bytes = geometries.size() <= 1 ? 0 : geometries.size() <= 256 ? 1 : 2;
    header.instance_count = static_cast<std::uint32_t>(instances_.size());
    lay_out(header);
    PageMasks masks(place_);
    if (place_.masks != nullptr && masks.gather(triangles_)) {
      masks.lay_out(header);
    }

    PageBuffer image(header.image_bytes);
    std::memcpy(image.data(), &header, sizeof header);
    masks.write(header, image.data());
    const auto copy = [&image](std::uint32_t offset, const auto& values) {
      if (!values.empty()) {
        std::memcpy(image.data() + offset, values.data(), values.size() * sizeof values[0]);
      }
    };
    copy(header.nodes_offset, nodes_);
    copy(header.externals_offset, externals_);
    copy(header.vertices_offset, positions);
    copy(header.indices_offset, indices);
    copy(instances_offset(header), instances_);
    copy(instances_end(header), proxies_);
    write_ids(header, geometries, image);
    return image;
  }

  void write_ids(const PageHeader& header, std::map<std::uint32_t, std::uint32_t>& geometries, PageBuffer& image) {
    std::uint32_t next = 0;
    for (auto& [id, index] : geometries) {
      index = next++;
      std::memcpy(image.data() + header.geometries_offset + index * sizeof id, &id, sizeof id);
    }
    auto geometry = geometries.end();
    for (std::size_t i = 0; i < triangles_.size(); ++i) {
      const Triangle& t = tree_.triangles[triangles_[i]];
      std::memcpy(image.data() + header.primitive_ids_offset + i * sizeof t.primitive_id, &t.primitive_id,
                  sizeof t.primitive_id);
      if (header.geometry_index_bytes != 0) {
        if (geometry == geometries.end() || geometry->first != t.geometry_id) {
          geometry = geometries.find(t.geometry_id);
        }
        // Little-endian: the low bytes come first.
        std::memcpy(image.data() + header.geometry_indices_offset + i * header.geometry_index_bytes, &geometry->second,
                    header.geometry_index_bytes);
      }
    }
  }

  struct Ghost {
    const OuterNode* source;
    std::uint16_t parent;
  };

  const PageAssembler& assembler_;
  const WideTree& tree_;
  const PagePlan& plan_;
  const TreePlace& place_;
  const std::vector<std::uint16_t>& local_index_;
  const std::uint32_t page_;
  const std::vector<std::uint32_t>& locals_;
  std::vector<Ghost> ghosts_;
  std::deque<OuterNode> own_ghosts_;  // of this tree
  std::map<std::uint32_t, std::uint16_t> ghost_index_;
  std::vector<Node<N>> nodes_;
  std::vector<ExternalRef> externals_;
  std::vector<Proxy> proxies_;            // [external], in stores that have them
  std::vector<std::uint32_t> triangles_;  // of the tree, in page order
  std::vector<Instance> instances_;
};

// Boxes of a page's own subtrees, bottom up: children stand behind their parents.
template <int N>
Status check_boxes_of(const PageView& view) {
  const PageHeader& header = view.header();
  const Node<N>* nodes = view.nodes<N>();
  std::vector<Aabb> content(header.node_count);
  for (std::uint32_t i = header.node_count; i-- > 0;) {
    const Node<N>& node = nodes[i];
    for (unsigned slot = 0; slot < N; ++slot) {
      if ((node.valid >> slot & 1) == 0) {
        continue;
      }
      Aabb decoded;
      for (int axis = 0; axis < 3; ++axis) {
        const float scale = power_of_two(node.exponent[axis]);
        decoded.lower[axis] = decode_plane(node.base[axis], scale, node.lower[axis][slot]);
        decoded.upper[axis] = decode_plane(node.base[axis], scale, node.upper[axis][slot]);
      }
      Aabb inside;
      if ((node.leaf >> slot & 1) != 0) {
        for (std::uint32_t t = node.child[slot]; t < std::uint32_t(node.child[slot]) + node.count[slot]; ++t) {
          for (int corner = 0; corner < 3; ++corner) {
            inside.grow(view.vertices()[view.indices()[t * 3 + corner]]);
          }
        }
      } else if ((node.external >> slot & 1) != 0) {
        const ExternalRef& ref = view.externals()[node.child[slot]];
        if (ref.kind == ExternalKind::instance) {
          inside = {view.instances()[ref.page].lower, view.instances()[ref.page].upper};
        }
      } else {
        if (node.child[slot] <= i) {
          return {ErrorCode::corrupt, "page has a node that stands before its parent"};
        }
        inside = content[node.child[slot]];
      }
      Aabb both = decoded;
      both.grow(inside);
      if (!(both == decoded)) {
        return {ErrorCode::corrupt, "page has a box that does not hold what is below it"};
      }
      content[i].grow(inside);
    }
  }
  return {};
}

}  // namespace

PageCost page_cost(unsigned width, std::uint32_t page_bytes, std::uint32_t ancestors, bool proxies) {
  PageCost cost;
  cost.page_bytes = page_bytes;
  cost.node_bytes = node_bytes(width);
  cost.external_bytes = sizeof(ExternalRef) + (proxies ? sizeof(Proxy) : 0);
  cost.header_bytes = static_cast<std::uint32_t>(sizeof(PageHeader) + 8 * kPageAlignment +
                                                 ancestors * (cost.node_bytes + width * cost.external_bytes));
  cost.triangle_bytes = 3 * sizeof(std::uint16_t) + sizeof(std::uint32_t) + sizeof(std::uint16_t);
  cost.vertex_bytes = sizeof(Vec3f);
  cost.geometry_bytes = sizeof(std::uint32_t);
  return cost;
}

void add_mask_cost(const TreeMasks& masks, PageCost& cost) {
  if (masks.entry_of.empty()) {
    return;
  }
  cost.header_bytes += static_cast<std::uint32_t>(sizeof(MaskSection) + 4 * kPageAlignment +
                                                  TreeMasks::kShared * sizeof(MaskedTriangle));
  cost.triangle_bytes += sizeof(std::uint16_t);
  cost.geometry_bytes += sizeof(MaskRef);  // a geometry has one mask at most
  cost.mask_bytes = sizeof(MaskedTriangle) + (masks.has_alphas ? sizeof(CornerAlphas) : 0);
  cost.mask_entries = masks.entry_of;
}

PageCost instance_page_cost(unsigned width, std::uint32_t page_bytes, std::uint32_t ancestors, bool proxies) {
  PageCost cost = page_cost(width, page_bytes, ancestors, proxies);
  cost.triangle_bytes = sizeof(Instance) + cost.external_bytes;
  cost.vertex_bytes = cost.geometry_bytes = 0;
  return cost;
}

PageAssembler::PageAssembler(const WideTree& tree, const PagePlan& plan, const TreePlace& place)
    : tree_(tree), plan_(plan), place_(place), local_index_(tree.nodes.size()) {
  for (const auto& page : plan.pages) {
    for (std::size_t i = 0; i < page.size(); ++i) {
      local_index_[page[i]] = static_cast<std::uint16_t>(i);
    }
  }
  number_vertices();
}

// Triangles stand in a page as its nodes and their slots do.
void PageAssembler::number_vertices() {
  constexpr std::uint32_t kNever = 0xFFFFFFFFu;
  std::vector<std::uint32_t> last_page(1U << 16, kNever);
  std::vector<std::uint16_t> number(1U << 16);
  vertex_of_corner_.resize(plan_.corners.size());
  for (std::uint32_t page = 0; page < plan_.pages.size(); ++page) {
    std::uint32_t next = 0;
    const auto visit = [&](std::size_t corner) {
      const std::uint16_t position = plan_.corners[corner];
      const bool is_new = last_page[position] != page;  // no branch: half of the corners are
      number[position] = is_new ? static_cast<std::uint16_t>(next) : number[position];
      last_page[position] = page;
      vertex_of_corner_[corner] = number[position];
      next += is_new ? 1 : 0;
    };
    for (const std::uint32_t index : plan_.pages[page]) {
      const WideNode& node = tree_.nodes[index];
      for (unsigned slot = 0; slot < tree_.width; ++slot) {
        const std::size_t first = std::size_t(node.child[slot]) * 3;
        for (std::size_t corner = first; corner < first + 3U * node.count[slot]; ++corner) {
          visit(corner);
        }
      }
    }
  }
}

ExternalRef PageAssembler::reference_to(std::uint32_t node, unsigned slot) const {
  const WideNode& source = tree_.nodes[node];
  if (source.is_leaf(slot)) {
    return {place_.numbers.of(plan_.page_of[node]), local_index_[node], static_cast<std::uint8_t>(slot),
            ExternalKind::leaf};
  }
  const std::uint32_t child = source.child[slot];
  if (source.is_outer(slot)) {
    return {(*place_.run_root_pages)[child], 0, 0, ExternalKind::node};
  }
  const bool proxied = place_.proxies != nullptr && place_.proxies->find(node, slot) != nullptr;
  return {place_.numbers.of(plan_.page_of[child]), local_index_[child], 0,
          proxied ? ExternalKind::proxied : ExternalKind::node};
}

Proxy PageAssembler::proxy_of(std::uint32_t node, unsigned slot) const {
  const Proxy* proxy = place_.proxies != nullptr ? place_.proxies->find(node, slot) : nullptr;
  return proxy != nullptr ? *proxy : Proxy();
}

OuterNode PageAssembler::outer_node(std::uint32_t node) const {
  OuterNode outer{tree_.nodes[node], {}, {}};
  for (unsigned slot = 0; slot < tree_.width; ++slot) {
    if (outer.node.has(slot)) {
      outer.children[slot] = reference_to(node, slot);
      outer.proxies[slot] = proxy_of(node, slot);
    }
  }
  return outer;
}

Result<PageBuffer> PageAssembler::assemble(std::uint32_t page) const {
  return tree_.width == 8 ? Assembly<8>(*this, tree_, plan_, place_, local_index_, page).run()
                          : Assembly<4>(*this, tree_, plan_, place_, local_index_, page).run();
}

Status check_boxes(const std::byte* image) {
  const PageView view(image);
  return view.header().width == 8 ? check_boxes_of<8>(view) : check_boxes_of<4>(view);
}

}  // namespace raymill::storage
