// The decoded page: what stands in memory while rays run through it.
//
//   PageHeader | nodes, ghosts | external references | vertices | indices | primitive ids | geometry ids | instances |
//   proxies
//
// A page with a triangle that is cut out by a mask has a section more behind that (masked_section.h).
//
// A page is one relocatable image without pointers. Local nodes come first, then ghosts: copies of ancestors that stand
// in other pages, whose children are all external references. The ghosts of a node's parent chain are the escape
// table: backtracking out of the page reads siblings and their boxes from them and never touches the parent's page.
// Normative description: storage/FORMAT.md.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>

#include "storage/base/placement.h"
#include "storage/base/status.h"
#include "storage/base/types.h"
#include "storage/base/vec3.h"
#include "storage/pages/proxy.h"

namespace raymill::storage {

constexpr std::uint32_t kPageMagic = 0x47504D52;  // "RMPG"
constexpr std::uint16_t kPageTypeTriangles = 1;   // 0 is reserved: a page of zeros is never valid
constexpr std::uint16_t kPageTypeMasked = 4;      // the same, and a section of masks
constexpr std::uint16_t kPageTypeProxies = 8;     // triangles, and a proxy beside each external reference
constexpr std::uint16_t kNoParent = 0xFFFF;
constexpr std::size_t kPageAlignment = 32;

struct PageHeader {
  std::uint32_t magic = kPageMagic;
  std::uint16_t page_type = kPageTypeTriangles;
  std::uint8_t width = 0;
  std::uint8_t geometry_index_bytes = 0;  ///< 0: one geometry in the page; 1 or 2: an index for each triangle
  std::uint32_t image_bytes = 0;
  std::uint16_t node_count = 0;  ///< local nodes
  std::uint16_t ghost_count = 0;
  std::uint32_t external_count = 0;
  std::uint32_t triangle_count = 0;
  std::uint32_t vertex_count = 0;
  std::uint32_t geometry_count = 0;
  std::uint32_t nodes_offset = 0;
  std::uint32_t externals_offset = 0;
  std::uint32_t vertices_offset = 0;
  std::uint32_t indices_offset = 0;
  std::uint32_t primitive_ids_offset = 0;
  std::uint32_t geometries_offset = 0;
  std::uint32_t geometry_indices_offset = 0;
  std::uint32_t instance_count = 0;  ///< instances_offset(); where there are proxies, they come after these
};
static_assert(sizeof(PageHeader) == 64 && std::is_trivially_copyable_v<PageHeader>);
/// Nodes come first, so a reference's target is known without a look at the header.
constexpr std::uint32_t kNodesOffset = sizeof(PageHeader);
static_assert(kNodesOffset % kPageAlignment == 0);

/// What a child that is an external reference names.
enum class ExternalKind : std::uint8_t {
  node = 0,      ///< enter the node
  leaf = 1,      ///< test the leaf in `slot` of the node, or enter the instance there
  instance = 2,  ///< enter an instance of this page: `page` is its number in the page's table
  proxied = 3,   ///< enter the node, or take what stands for it: the proxy of the same index
};
/// Whether a ray that goes there enters the node that is named.
constexpr bool leads_to_node(ExternalKind kind) { return kind == ExternalKind::node || kind == ExternalKind::proxied; }

struct ExternalRef {
  std::uint32_t page = 0;
  std::uint16_t node = 0;
  std::uint8_t slot = 0;
  ExternalKind kind = ExternalKind::node;
};
static_assert(sizeof(ExternalRef) == 8 && std::is_trivially_copyable_v<ExternalRef>);

/// A placed object: a tree of its own, in its own space. Its root stands at the store's object level, so one bitstack
/// covers the levels above the instance and those of the object.
struct Instance {
  Placement world_from_object{};  ///< finite, its determinant too, and that not 0
  Vec3f lower, upper;             ///< world box, which holds the object's box as it is placed
  std::uint32_t page = 0;         ///< of the object's root
  std::uint16_t node = 0;
  std::uint16_t unused = 0;
  std::uint32_t geometry_base = 0;  ///< geometry id of a hit: this and the id that stands in the object
  std::uint32_t instance_id = 0;
};
static_assert(sizeof(Instance) == 136 && std::is_trivially_copyable_v<Instance>);

/// A node of N children with boxes of 8 bits a plane: plane = base + q * 2^exponent, product exact, sum rounded once.
/// The decoded box holds everything below the child; the builder proves it for each box.
template <int N>
struct alignas(32) Node {
  std::array<float, 3> base{};
  std::array<std::int8_t, 3> exponent{};
  std::uint8_t level = 0;
  std::uint16_t parent = kNoParent;  ///< index in the same array
  std::uint8_t valid = 0;            ///< bit for each slot that holds a child
  std::uint8_t leaf = 0;             ///< of those: child is the first triangle, count says how many
  std::uint8_t external = 0;         ///< of those: child is the index of an external reference
  std::uint8_t order = 0;            ///< N = 4: axes of slot bits 0 and 1, two bits each
  std::array<std::array<std::uint8_t, N>, 3> lower{};
  std::array<std::array<std::uint8_t, N>, 3> upper{};
  std::array<std::uint16_t, N> child{};
  std::array<std::uint8_t, N> count{};
};
static_assert(sizeof(Node<8>) == 96 && std::is_trivially_copyable_v<Node<8>>);
static_assert(sizeof(Node<4>) == 64 && std::is_trivially_copyable_v<Node<4>>);

constexpr std::uint32_t node_bytes(unsigned width) {
  return width == 8 ? std::uint32_t(sizeof(Node<8>)) : std::uint32_t(sizeof(Node<4>));
}

/// 2^exponent for -126 <= exponent <= 127.
float power_of_two(int exponent);

/// The plane that `q` stands for; what the kernels compute, bit for bit.
inline float decode_plane(float base, float scale, std::uint8_t q) { return base + float(q) * scale; }

/// Fills the offsets and image_bytes from the counts, width and geometry_index_bytes; of a masked page as far as its
/// section.
void lay_out(PageHeader& header);
/// Where the instances stand, and what comes after them: in a page of kPageTypeProxies a proxy for each external
/// reference, in one of kPageTypeMasked the section.
std::uint32_t instances_offset(const PageHeader& header);
std::uint32_t instances_end(const PageHeader& header);

/// Typed access to an image. Immutable view; the image must outlive it.
class PageView {
 public:
  explicit PageView(const std::byte* image) : image_(image) {}
  [[nodiscard]] const PageHeader& header() const { return *reinterpret_cast<const PageHeader*>(image_); }
  template <int N>
  [[nodiscard]] const Node<N>* nodes() const {
    return reinterpret_cast<const Node<N>*>(image_ + kNodesOffset);
  }
  [[nodiscard]] const ExternalRef* externals() const { return at<ExternalRef>(header().externals_offset); }
  [[nodiscard]] const Vec3f* vertices() const { return at<Vec3f>(header().vertices_offset); }
  /// Three corners for each triangle.
  [[nodiscard]] const std::uint16_t* indices() const { return at<std::uint16_t>(header().indices_offset); }
  [[nodiscard]] const std::uint32_t* primitive_ids() const { return at<std::uint32_t>(header().primitive_ids_offset); }
  /// Where a triangle's geometry index stands, or something near where all triangles have one geometry.
  [[nodiscard]] const std::byte* geometry_index(std::uint32_t triangle) const {
    return image_ + header().geometry_indices_offset + std::uint64_t(triangle) * header().geometry_index_bytes;
  }
  [[nodiscard]] std::uint32_t geometry_id(std::uint32_t triangle) const {
    const auto* table = at<std::uint32_t>(header().geometries_offset);
    switch (header().geometry_index_bytes) {
      case 0:
        return table[0];
      case 1:
        return table[at<std::uint8_t>(header().geometry_indices_offset)[triangle]];
      default:
        return table[at<std::uint16_t>(header().geometry_indices_offset)[triangle]];
    }
  }
  [[nodiscard]] const Instance* instances() const { return at<Instance>(instances_offset(header())); }
  [[nodiscard]] bool has_proxies() const { return header().page_type == kPageTypeProxies; }
  [[nodiscard]] const Proxy* proxies() const { return at<Proxy>(instances_end(header())); }

 private:
  template <typename T>
  [[nodiscard]] const T* at(std::uint32_t offset) const {
    return reinterpret_cast<const T*>(image_ + offset);
  }
  const std::byte* image_;
};

/// What a page may refer to, from the store's footer.
struct PageRules {
  unsigned width = 8;
  unsigned levels = 0;
  unsigned object_level = 0;  ///< of the roots of objects; 0: the store has none
  std::uint32_t page_bytes = 0;
  std::uint32_t page_count = 0;
  std::uint64_t geometry_count = 0;
  bool volumes = false;          ///< there are pages of volumes too
  bool proxies = false;          ///< all pages of triangles have them
  bool masks = false;            ///< there are pages of masks and masked pages too
  std::uint32_t attributes = 0;  ///< bits of those that pages of attributes hold (base/attribute.h); 0: there are none
};

/// Checks every index, count and offset of an image, so that traversal may follow them blindly inside the page. What
/// an external reference finds in its target is checked when a ray gets there. Errors: corrupt.
Status validate_image(std::span<const std::byte> image, const PageRules& rules);

}  // namespace raymill::storage
