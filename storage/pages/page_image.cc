#include "storage/pages/page_image.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <string>

#include "storage/pages/masked_section.h"

namespace raymill::storage {
namespace {

std::uint32_t align(std::uint64_t offset) {
  return static_cast<std::uint32_t>((offset + kPageAlignment - 1) / kPageAlignment * kPageAlignment);
}

Status bad(const std::string& what) { return {ErrorCode::corrupt, "page " + what}; }

template <int N>
class NodeChecker {
 public:
  NodeChecker(const PageView& view, const PageRules& rules)
      : header_(view.header()), nodes_(view.nodes<N>()), externals_(view.externals()), rules_(rules) {}

  Status check_all() const {
    const std::uint32_t total = std::uint32_t(header_.node_count) + header_.ghost_count;
    for (std::uint32_t i = 0; i < total; ++i) {
      if (const char* fault = check(i, total); fault != nullptr) {
        return bad("node " + std::to_string(i) + " " + fault);
      }
    }
    return {};
  }

 private:
  [[nodiscard]] const char* check(std::uint32_t i, std::uint32_t total) const {
    const Node<N>& node = nodes_[i];
    const bool ghost = i >= header_.node_count;
    if (node.level >= rules_.levels) {
      return "lies deeper than the store's tree";
    }
    const bool root = node.parent == kNoParent;
    const bool root_level = node.level == 0 || node.level == rules_.object_level;
    if (root != root_level || (!root && node.parent >= total)) {
      return "has a parent that cannot be";
    }
    if (!root && nodes_[node.parent].level + 1 != node.level) {
      return "does not stand one level below its parent";
    }
    constexpr unsigned kSlots = (1U << N) - 1;
    if ((node.valid & ~kSlots) != 0 || (node.leaf & ~node.valid) != 0 || (node.external & ~node.valid) != 0 ||
        (node.leaf & node.external) != 0 || (ghost && node.external != node.valid)) {
      return "has child masks that contradict each other";
    }
    if (N == 4 && ((node.order & 3) > 2 || (node.order >> 2) > 2)) {
      return "orders its children by an axis that is none";
    }
    for (int axis = 0; axis < 3; ++axis) {
      if (!std::isfinite(node.base[axis]) || node.exponent[axis] < -126) {
        return "has a box frame that is not finite";
      }
    }
    return check_children(i);
  }

  [[nodiscard]] const char* check_children(std::uint32_t i) const {
    const Node<N>& node = nodes_[i];
    const bool ghost = i >= header_.node_count;
    for (unsigned slot = 0; slot < N; ++slot) {
      const unsigned bit = 1U << slot;
      if ((node.valid & bit) == 0) {
        continue;
      }
      const std::uint32_t child = node.child[slot];
      if ((node.leaf & bit) != 0) {
        if (node.count[slot] == 0 || node.count[slot] > kMaxLeafTriangles ||
            child + node.count[slot] > header_.triangle_count) {
          return "has a leaf past the page's triangles";
        }
      } else if ((node.external & bit) != 0) {
        if (child >= header_.external_count) {
          return "has a child past the page's external references";
        }
        // A leaf stands beside its node, so only a ghost refers to one. Otherwise two such references could name each
        // other, and a ray would follow them for ever.
        if (!ghost && externals_[child].kind == ExternalKind::leaf) {
          return "refers to a leaf in another page";
        }
        // Objects hold no instances, and an ancestor's instances are in the ancestor's page.
        if (externals_[child].kind == ExternalKind::instance && (ghost || node.level >= rules_.object_level)) {
          return "refers to an instance where none can be";
        }
      } else if (child >= header_.node_count || nodes_[child].parent != i) {
        return "has a child that does not name it as parent";
      }
    }
    return nullptr;
  }

  const PageHeader& header_;
  const Node<N>* nodes_;
  const ExternalRef* externals_;
  const PageRules& rules_;
};

Status check_header(const PageHeader& header, std::size_t image_bytes, const PageRules& rules) {
  const bool masked = header.page_type == kPageTypeMasked && rules.masks;
  if (header.magic != kPageMagic ||
      (header.page_type != (rules.proxies ? kPageTypeProxies : kPageTypeTriangles) && !masked)) {
    return bad("is of no known type");
  }
  if (header.width != rules.width || header.geometry_index_bytes > 2) {
    return bad("has a layout that is not the store's");
  }
  PageHeader expected = header;
  lay_out(expected);
  if (masked) {
    expected.image_bytes = image_bytes_with_masks(header, image_bytes);
  }
  if (header.image_bytes != image_bytes || header.image_bytes > rules.page_bytes ||
      std::uint32_t(header.node_count) + header.ghost_count >= kNoParent || header.node_count == 0 ||
      header.external_count > 0x10000 || header.triangle_count > 0x10000 || header.vertex_count > 0x10000 ||
      header.geometry_count > 0x10000 || header.instance_count > (rules.object_level != 0 ? 0xFFFFU : 0U) ||
      (header.triangle_count > 0 && header.geometry_count == 0) ||
      (header.geometry_index_bytes == 0 && header.geometry_count > 1) ||
      std::bit_cast<std::array<std::byte, sizeof(PageHeader)>>(expected) !=
          std::bit_cast<std::array<std::byte, sizeof(PageHeader)>>(header)) {
    return bad("has counts that do not fit its size");
  }
  return {};
}

const char* fault_of(const Instance& instance, const PageRules& rules) {
  const auto finite = [](double x) { return std::isfinite(x); };
  const auto& m = instance.world_from_object;
  const double det = determinant(m);
  if (!std::all_of(m.begin(), m.end(), finite) || !std::isfinite(det) || det == 0) {
    return "that cannot be inverted";
  }
  for (int axis = 0; axis < 3; ++axis) {
    if (!(instance.lower[axis] <= instance.upper[axis]) || !finite(instance.lower[axis]) ||
        !finite(instance.upper[axis])) {
      return "whose box is none";
    }
  }
  if (instance.page >= rules.page_count || instance.geometry_base >= rules.geometry_count) {
    return "of an object that is not there";
  }
  return nullptr;
}

// Areas must be finite and not negative, so that an opacity is a number.
bool fault_of(const Proxy& proxy, const PageRules& rules) {
  constexpr std::uint16_t kInfinity = 0x7F80;
  return std::any_of(proxy.area.begin(), proxy.area.end(), [](std::uint16_t bits) { return bits >= kInfinity; }) ||
         proxy.several > 1 || proxy.geometry_id >= rules.geometry_count;
}

Status check_arrays(const PageView& view, const PageRules& rules) {
  const PageHeader& header = view.header();
  for (std::uint32_t i = 0; i < header.external_count; ++i) {
    const ExternalRef& ref = view.externals()[i];
    const bool instance = ref.kind == ExternalKind::instance;
    const bool proxied = ref.kind == ExternalKind::proxied && rules.proxies;
    if (ref.page >= (instance ? header.instance_count : rules.page_count) || ref.slot >= rules.width ||
        (!instance && !proxied && ref.kind != ExternalKind::node && ref.kind != ExternalKind::leaf)) {
      return bad("refers to a page that is not there");
    }
    if (proxied && fault_of(view.proxies()[i], rules)) {
      return bad("has a proxy that cannot be");
    }
  }
  for (std::uint32_t i = 0; i < header.instance_count; ++i) {
    if (const char* fault = fault_of(view.instances()[i], rules); fault != nullptr) {
      return bad("has an instance " + std::string(fault));
    }
  }
  for (std::uint32_t i = 0; i < header.vertex_count; ++i) {
    const Vec3f& v = view.vertices()[i];
    if (!std::isfinite(v.x) || !std::isfinite(v.y) || !std::isfinite(v.z)) {
      return bad("has a vertex that is not finite");
    }
  }
  for (std::uint32_t i = 0; i < header.triangle_count * 3; ++i) {
    if (view.indices()[i] >= header.vertex_count) {
      return bad("has a triangle with a corner past its vertices");
    }
  }
  const auto* image = reinterpret_cast<const std::byte*>(&header);
  const auto* geometries = reinterpret_cast<const std::uint32_t*>(image + header.geometries_offset);
  for (std::uint32_t i = 0; i < header.geometry_count; ++i) {
    if (geometries[i] >= rules.geometry_count) {
      return bad("names a geometry that the store does not have");
    }
  }
  for (std::uint32_t i = 0; header.geometry_index_bytes != 0 && i < header.triangle_count; ++i) {
    const auto* indices = image + header.geometry_indices_offset;
    const std::uint32_t index = header.geometry_index_bytes == 1 ? reinterpret_cast<const std::uint8_t*>(indices)[i]
                                                                 : reinterpret_cast<const std::uint16_t*>(indices)[i];
    if (index >= header.geometry_count) {
      return bad("has a triangle of a geometry past its table");
    }
  }
  return {};
}

}  // namespace

float power_of_two(int exponent) { return std::bit_cast<float>(static_cast<std::uint32_t>(exponent + 127) << 23); }

void lay_out(PageHeader& header) {
  std::uint64_t offset = sizeof(PageHeader);
  const auto place = [&offset](std::uint32_t& field, std::uint64_t bytes) {
    field = align(offset);
    offset = std::uint64_t(field) + bytes;
  };
  place(header.nodes_offset, (std::uint64_t(header.node_count) + header.ghost_count) * node_bytes(header.width));
  place(header.externals_offset, std::uint64_t(header.external_count) * sizeof(ExternalRef));
  place(header.vertices_offset, std::uint64_t(header.vertex_count) * sizeof(Vec3f));
  place(header.indices_offset, std::uint64_t(header.triangle_count) * 3 * sizeof(std::uint16_t));
  place(header.primitive_ids_offset, std::uint64_t(header.triangle_count) * sizeof(std::uint32_t));
  place(header.geometries_offset, std::uint64_t(header.geometry_count) * sizeof(std::uint32_t));
  place(header.geometry_indices_offset, std::uint64_t(header.triangle_count) * header.geometry_index_bytes);
  header.image_bytes = instances_end(header);
  if (header.page_type == kPageTypeProxies) {
    header.image_bytes = align(header.image_bytes + std::uint64_t(header.external_count) * sizeof(Proxy));
  }
}

std::uint32_t instances_offset(const PageHeader& header) {
  return align(std::uint64_t(header.geometry_indices_offset) +
               std::uint64_t(header.triangle_count) * header.geometry_index_bytes);
}

std::uint32_t instances_end(const PageHeader& header) {
  return align(std::uint64_t(instances_offset(header)) + std::uint64_t(header.instance_count) * sizeof(Instance));
}

Status validate_image(std::span<const std::byte> image, const PageRules& rules) {
  if (image.size() < sizeof(PageHeader)) {
    return bad("is shorter than its header");
  }
  const PageView view(image.data());
  RAYMILL_RETURN_IF_ERROR(check_header(view.header(), image.size(), rules));
  RAYMILL_RETURN_IF_ERROR(check_arrays(view, rules));
  if (view.header().page_type == kPageTypeMasked) {
    RAYMILL_RETURN_IF_ERROR(check_masks(view, rules));
  }
  return rules.width == 8 ? NodeChecker<8>(view, rules).check_all() : NodeChecker<4>(view, rules).check_all();
}

}  // namespace raymill::storage
