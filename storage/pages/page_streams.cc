#include "storage/pages/page_streams.h"

#include <bit>
#include <cmath>
#include <cstring>

#include "storage/pages/masked_section.h"

namespace raymill::storage {
namespace {

// Float bits as unsigned integers in the order of the values: neighbours differ little..
constexpr std::uint32_t ordered_bits(std::uint32_t bits) {
  return (bits & 0x80000000U) != 0 ? ~bits : bits | 0x80000000U;
}
constexpr std::uint32_t bits_of_ordered(std::uint32_t ordered) {
  return (ordered & 0x80000000U) != 0 ? ordered & 0x7FFFFFFFU : ~ordered;
}

template <typename T>
T* array_at(std::byte* image, std::uint32_t offset) {
  return reinterpret_cast<T*>(image + offset);
}
template <typename T>
const T* array_at(const std::byte* image, std::uint32_t offset) {
  return reinterpret_cast<const T*>(image + offset);
}
const std::byte* image_of(const PageView& view) { return reinterpret_cast<const std::byte*>(&view.header()); }

// Child numbers follow from counters: a leaf starts where the last ended, external references are used in order, and
// an inner child stands shortly behind its parent. Only the difference from that is stored.
struct ChildPredictor {
  std::uint16_t next_triangle = 0;
  std::uint16_t next_external = 0;
  std::uint16_t last_inner = 0;

  template <int N>
  std::uint16_t predict(const Node<N>& node, unsigned slot) const {
    return (node.leaf >> slot & 1) != 0       ? next_triangle
           : (node.external >> slot & 1) != 0 ? next_external
                                              : static_cast<std::uint16_t>(last_inner + 1);
  }
  template <int N>
  void advance(const Node<N>& node, unsigned slot) {
    if ((node.leaf >> slot & 1) != 0) {
      next_triangle = static_cast<std::uint16_t>(node.child[slot] + node.count[slot]);
    } else if ((node.external >> slot & 1) != 0) {
      next_external = static_cast<std::uint16_t>(node.child[slot] + 1);
    } else {
      last_inner = node.child[slot];
    }
  }
};

// Applies `field` to every column of a node in one fixed order; the writer and the reader share it.
template <int N, typename Field>
void for_each_byte_column(Field&& field) {
  field([](auto& node) -> auto& { return node.level; });
  field([](auto& node) -> auto& { return node.valid; });
  field([](auto& node) -> auto& { return node.leaf; });
  field([](auto& node) -> auto& { return node.external; });
  field([](auto& node) -> auto& { return node.order; });
  for (int axis = 0; axis < 3; ++axis) {
    field([axis](auto& node) -> auto& { return node.exponent[axis]; });
  }
  for (int slot = 0; slot < N; ++slot) {
    field([slot](auto& node) -> auto& { return node.count[slot]; });
    for (int axis = 0; axis < 3; ++axis) {
      field([ axis, slot ](auto& node) -> auto& { return node.lower[axis][slot]; });
      field([ axis, slot ](auto& node) -> auto& { return node.upper[axis][slot]; });
    }
  }
}

template <int N>
void write_nodes(const PageView& view, PlaneWriter& out) {
  const std::size_t count = std::size_t(view.header().node_count) + view.header().ghost_count;
  const std::span<const Node<N>> nodes(view.nodes<N>(), count);
  std::vector<std::uint8_t> bytes(count);
  for_each_byte_column<N>([&](auto column) {
    for (std::size_t i = 0; i < count; ++i) {
      bytes[i] = static_cast<std::uint8_t>(column(nodes[i]));
    }
    out.put(std::span<const std::uint8_t>(bytes));
  });
  std::vector<std::uint32_t> words(count);
  for (int axis = 0; axis < 3; ++axis) {
    std::uint32_t last = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint32_t code = ordered_bits(std::bit_cast<std::uint32_t>(nodes[i].base[axis]));
      words[i] = zigzag(code - last);
      last = code;
    }
    out.put(std::span<const std::uint32_t>(words));
  }
  std::vector<std::uint16_t> halves(count);
  for (std::size_t i = 0; i < count; ++i) {
    halves[i] = zigzag16(static_cast<std::uint16_t>(i - nodes[i].parent));
  }
  out.put(std::span<const std::uint16_t>(halves));
  halves.assign(count * N, 0);
  ChildPredictor predictor;
  for (std::size_t i = 0; i < count; ++i) {
    for (unsigned slot = 0; slot < N; ++slot) {
      if ((nodes[i].valid >> slot & 1) != 0) {
        halves[i * N + slot] =
            zigzag16(static_cast<std::uint16_t>(nodes[i].child[slot] - predictor.predict(nodes[i], slot)));
        predictor.advance(nodes[i], slot);
      }
    }
  }
  out.put(std::span<const std::uint16_t>(halves));
}

template <int N>
void read_nodes(PlaneReader& in, std::byte* image) {
  const PageHeader& header = PageView(image).header();
  const std::size_t count = std::size_t(header.node_count) + header.ghost_count;
  const std::span<Node<N>> nodes(array_at<Node<N>>(image, header.nodes_offset), count);
  std::vector<std::uint8_t> bytes(count);
  for_each_byte_column<N>([&](auto column) {
    in.get(std::span(bytes));
    for (std::size_t i = 0; i < count; ++i) {
      auto& target = column(nodes[i]);
      target = static_cast<std::remove_reference_t<decltype(target)>>(bytes[i]);
    }
  });
  std::vector<std::uint32_t> words(count);
  for (int axis = 0; axis < 3; ++axis) {
    in.get(std::span(words));
    std::uint32_t last = 0;
    for (std::size_t i = 0; i < count; ++i) {
      last += unzigzag(words[i]);
      nodes[i].base[axis] = std::bit_cast<float>(bits_of_ordered(last));
    }
  }
  std::vector<std::uint16_t> halves(count);
  in.get(std::span(halves));
  for (std::size_t i = 0; i < count; ++i) {
    nodes[i].parent = static_cast<std::uint16_t>(i - unzigzag16(halves[i]));
  }
  halves.resize(count * N);
  in.get(std::span(halves));
  ChildPredictor predictor;
  for (std::size_t i = 0; i < count; ++i) {
    for (unsigned slot = 0; slot < N; ++slot) {
      if ((nodes[i].valid >> slot & 1) != 0) {
        nodes[i].child[slot] =
            static_cast<std::uint16_t>(predictor.predict(nodes[i], slot) + unzigzag16(halves[i * N + slot]));
        predictor.advance(nodes[i], slot);
      }
    }
  }
}

// In the place of slot and kind.
constexpr std::uint8_t kInstanceCode = 0x80, kProxiedCode = 0x81;

std::uint8_t code_of(const ExternalRef& ref) {
  switch (ref.kind) {
    case ExternalKind::instance:
      return kInstanceCode;
    case ExternalKind::proxied:
      return kProxiedCode;
    default:
      return static_cast<std::uint8_t>(ref.slot << 1 | static_cast<std::uint8_t>(ref.kind));
  }
}

ExternalRef reference_of(std::uint32_t page, std::uint16_t node, std::uint8_t code) {
  if (code == kInstanceCode || code == kProxiedCode) {
    return {page, node, 0, code == kInstanceCode ? ExternalKind::instance : ExternalKind::proxied};
  }
  return {page, node, static_cast<std::uint8_t>(code >> 1), static_cast<ExternalKind>(code & 1)};
}

void write_externals(const PageView& view, PlaneWriter& out) {
  const std::size_t count = view.header().external_count;
  std::vector<std::uint32_t> pages(count);
  std::vector<std::uint16_t> nodes(count);
  std::vector<std::uint8_t> slots(count);
  std::uint32_t last = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const ExternalRef& ref = view.externals()[i];
    pages[i] = zigzag(ref.page - last);
    last = ref.page;
    nodes[i] = ref.node;
    slots[i] = code_of(ref);
  }
  out.put(std::span<const std::uint32_t>(pages));
  out.put(std::span<const std::uint16_t>(nodes));
  out.put(std::span<const std::uint8_t>(slots));
}

void read_externals(PlaneReader& in, std::byte* image) {
  const PageHeader& header = PageView(image).header();
  const std::size_t count = header.external_count;
  std::vector<std::uint32_t> pages(count);
  std::vector<std::uint16_t> nodes(count);
  std::vector<std::uint8_t> slots(count);
  in.get(std::span(pages));
  in.get(std::span(nodes));
  in.get(std::span(slots));
  auto* refs = array_at<ExternalRef>(image, header.externals_offset);
  std::uint32_t last = 0;
  for (std::size_t i = 0; i < count; ++i) {
    last += unzigzag(pages[i]);
    refs[i] = reference_of(last, nodes[i], slots[i]);
  }
}

void write_deltas(std::span<const std::uint32_t> values, PlaneWriter& out) {
  std::vector<std::uint32_t> codes(values.size());
  std::uint32_t last = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    codes[i] = zigzag(values[i] - last);
    last = values[i];
  }
  out.put(std::span<const std::uint32_t>(codes));
}

void read_deltas(PlaneReader& in, std::span<std::uint32_t> values) {
  in.get(values);
  std::uint32_t last = 0;
  for (std::uint32_t& value : values) {
    last += unzigzag(value);
    value = last;
  }
}

// An instance is 34 words; word by word over all of them, each as its difference from the instance before.
constexpr std::size_t kInstanceWords = sizeof(Instance) / sizeof(std::uint32_t);
static_assert(sizeof(Instance) % sizeof(std::uint32_t) == 0);

void write_instances(const PageView& view, PlaneWriter& out) {
  const std::size_t count = view.header().instance_count;
  std::vector<std::uint32_t> words(count);
  for (std::size_t word = 0; word < kInstanceWords && count > 0; ++word) {
    for (std::size_t i = 0; i < count; ++i) {
      std::memcpy(&words[i], reinterpret_cast<const std::byte*>(view.instances() + i) + word * sizeof words[i],
                  sizeof words[i]);
    }
    write_deltas(words, out);
  }
}

void read_instances(PlaneReader& in, std::byte* image) {
  const PageHeader& header = PageView(image).header();
  auto* instances = array_at<std::byte>(image, instances_offset(header));
  std::vector<std::uint32_t> words(header.instance_count);
  for (std::size_t word = 0; word < kInstanceWords && !words.empty(); ++word) {
    read_deltas(in, words);
    for (std::size_t i = 0; i < words.size(); ++i) {
      std::memcpy(instances + i * sizeof(Instance) + word * sizeof words[i], &words[i], sizeof words[i]);
    }
  }
}

// Those of proxied references alone: the others are zeros. Byte by byte over all of them, but for the ids.
constexpr std::size_t kProxyBytes = offsetof(Proxy, geometry_id);

std::vector<std::uint32_t> proxied_references(const PageView& view) {
  std::vector<std::uint32_t> indices;
  for (std::uint32_t i = 0; view.has_proxies() && i < view.header().external_count; ++i) {
    if (view.externals()[i].kind == ExternalKind::proxied) {
      indices.push_back(i);
    }
  }
  return indices;
}

void write_proxies(const PageView& view, PlaneWriter& out) {
  const std::vector<std::uint32_t> indices = proxied_references(view);
  std::vector<std::uint8_t> bytes(indices.size());
  for (std::size_t byte = 0; byte < kProxyBytes && !indices.empty(); ++byte) {
    for (std::size_t i = 0; i < indices.size(); ++i) {
      bytes[i] = reinterpret_cast<const std::uint8_t*>(view.proxies() + indices[i])[byte];
    }
    out.put(std::span<const std::uint8_t>(bytes));
  }
  std::vector<std::uint32_t> ids(indices.size());
  for (const auto member : {&Proxy::geometry_id, &Proxy::primitive_id}) {
    for (std::size_t i = 0; i < indices.size(); ++i) {
      ids[i] = view.proxies()[indices[i]].*member;
    }
    write_deltas(ids, out);
  }
}

void read_proxies(PlaneReader& in, std::byte* image) {
  const PageView view(image);
  const std::vector<std::uint32_t> indices = proxied_references(view);
  auto* proxies = array_at<Proxy>(image, instances_end(view.header()));
  std::vector<std::uint8_t> bytes(indices.size());
  for (std::size_t byte = 0; byte < kProxyBytes && !indices.empty(); ++byte) {
    in.get(std::span(bytes));
    for (std::size_t i = 0; i < indices.size(); ++i) {
      reinterpret_cast<std::uint8_t*>(proxies + indices[i])[byte] = bytes[i];
    }
  }
  std::vector<std::uint32_t> ids(indices.size());
  for (const auto member : {&Proxy::geometry_id, &Proxy::primitive_id}) {
    read_deltas(in, ids);
    for (std::size_t i = 0; i < indices.size(); ++i) {
      proxies[indices[i]].*member = ids[i];
    }
  }
}

}  // namespace

std::uint32_t coordinate_code(float value, const PositionKind& kind) {
  if (kind.lattice) {
    return static_cast<std::uint32_t>(static_cast<std::int32_t>(std::ldexp(double(value), -kind.step_exponent)));
  }
  return ordered_bits(std::bit_cast<std::uint32_t>(value));
}

float coordinate_value(std::uint32_t code, const PositionKind& kind) {
  if (kind.lattice) {
    return static_cast<float>(std::ldexp(double(static_cast<std::int32_t>(code)), kind.step_exponent));
  }
  return std::bit_cast<float>(bits_of_ordered(code));
}

void write_structure(const PageView& view, std::vector<std::byte>& out) {
  const PageHeader& header = view.header();
  PlaneWriter writer(out);
  if (header.width == 8) {
    write_nodes<8>(view, writer);
  } else {
    write_nodes<4>(view, writer);
  }
  write_externals(view, writer);
  write_deltas({view.primitive_ids(), header.triangle_count}, writer);
  const std::byte* image = image_of(view);
  write_deltas({array_at<std::uint32_t>(image, header.geometries_offset), header.geometry_count}, writer);
  writer.put(std::span(array_at<std::uint8_t>(image, header.geometry_indices_offset),
                       std::size_t(header.triangle_count) * header.geometry_index_bytes));
  write_instances(view, writer);
  if (view.has_proxies()) {
    write_proxies(view, writer);
  }
  if (header.page_type == kPageTypeMasked) {
    write_masks(view, writer);
  }
}

void read_structure(PlaneReader& in, std::byte* image) {
  const PageHeader& header = PageView(image).header();
  if (header.width == 8) {
    read_nodes<8>(in, image);
  } else {
    read_nodes<4>(in, image);
  }
  read_externals(in, image);
  read_deltas(in, {array_at<std::uint32_t>(image, header.primitive_ids_offset), header.triangle_count});
  read_deltas(in, {array_at<std::uint32_t>(image, header.geometries_offset), header.geometry_count});
  in.get(std::span(array_at<std::uint8_t>(image, header.geometry_indices_offset),
                   std::size_t(header.triangle_count) * header.geometry_index_bytes));
  read_instances(in, image);
  if (PageView(image).has_proxies()) {
    read_proxies(in, image);
  }
  if (header.page_type == kPageTypeMasked) {
    read_masks(in, image);
  }
}

void write_geometry(const PageView& view, const PositionKind& kind, std::vector<std::byte>& out) {
  const PageHeader& header = view.header();
  PlaneWriter writer(out);
  std::vector<std::uint32_t> codes(header.vertex_count);
  for (int axis = 0; axis < 3; ++axis) {
    for (std::uint32_t i = 0; i < header.vertex_count; ++i) {
      codes[i] = coordinate_code(view.vertices()[i][axis], kind);
    }
    write_deltas(codes, writer);
  }
  std::vector<std::uint16_t> indices(std::size_t(header.triangle_count) * 3);
  std::uint16_t next_new = 0;
  for (std::size_t i = 0; i < indices.size(); ++i) {
    indices[i] = static_cast<std::uint16_t>(next_new - view.indices()[i]);
    next_new = static_cast<std::uint16_t>(next_new + (indices[i] == 0 ? 1 : 0));
  }
  writer.put(std::span<const std::uint16_t>(indices));
}

void read_geometry(PlaneReader& in, const PositionKind& kind, std::byte* image) {
  const PageHeader& header = PageView(image).header();
  auto* vertices = array_at<Vec3f>(image, header.vertices_offset);
  std::vector<std::uint32_t> codes(header.vertex_count);
  for (int axis = 0; axis < 3; ++axis) {
    read_deltas(in, codes);
    for (std::uint32_t i = 0; i < header.vertex_count; ++i) {
      vertices[i][axis] = coordinate_value(codes[i], kind);
    }
  }
  const std::span indices(array_at<std::uint16_t>(image, header.indices_offset),
                          std::size_t(header.triangle_count) * 3);
  in.get(indices);
  std::uint16_t next_new = 0;
  for (std::uint16_t& index : indices) {
    const bool is_new = index == 0;
    index = static_cast<std::uint16_t>(next_new - index);
    next_new = static_cast<std::uint16_t>(next_new + (is_new ? 1 : 0));
  }
}

}  // namespace raymill::storage
