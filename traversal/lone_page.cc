#include "traversal/lone_page.h"

#include <bit>
#include <cstring>

#include "storage/pages/attribute_page.h"
#include "storage/pages/mask_page.h"

namespace raymill::traversal {
namespace {

// Indices of external references have 16 bits; what is beyond stays local.
constexpr std::uint32_t kMostExternals = 1U << 16;

// The copy: the image, its references once more, and one for each node.
std::size_t copy_bytes(const storage::PageRules& rules) {
  const std::size_t most_nodes = rules.page_bytes / storage::node_bytes(rules.width);
  return 2 * std::size_t(rules.page_bytes) + most_nodes * sizeof(storage::ExternalRef) + storage::kPageAlignment;
}

}  // namespace

LonePage::LonePage(const storage::PageRules& rules)
    : rules_(rules),
      images_(new std::atomic<const std::byte*>[2 * std::size_t(rules.page_count)]()),
      copy_(copy_bytes(rules)) {}

std::uint64_t LonePage::bytes(const storage::PageRules& rules) {
  return 2 * std::uint64_t(rules.page_count) * sizeof(std::atomic<const std::byte*>) + copy_bytes(rules);
}

const std::atomic<const std::byte*>* LonePage::show(std::uint32_t page, const std::byte* image) {
  images_[shown_].store(nullptr);
  shown_ = page;
  const std::uint32_t image_bytes = storage::PageView(image).header().image_bytes;
  std::memcpy(copy_.data(), image, image_bytes);
  if (storage::MaskPageView::is_mask_page(image) || storage::AttributePageView::is_attribute_page(image)) {
    images_[page].store(copy_.data());
    return images_.get();
  }
  auto& header = *reinterpret_cast<storage::PageHeader*>(copy_.data());
  header.externals_offset =
      (image_bytes + storage::kPageAlignment - 1) / storage::kPageAlignment * storage::kPageAlignment;
  rules_.width == 8 ? part_nodes<8>(storage::PageView(image)) : part_nodes<4>(storage::PageView(image));
  images_[page].store(copy_.data());
  return images_.get();
}

template <int N>
void LonePage::part_nodes(const storage::PageView& view) {
  auto& header = *reinterpret_cast<storage::PageHeader*>(copy_.data());
  auto* nodes = reinterpret_cast<storage::Node<N>*>(copy_.data() + header.nodes_offset);
  auto* externals = reinterpret_cast<storage::ExternalRef*>(copy_.data() + header.externals_offset);
  std::memcpy(externals, view.externals(), header.external_count * sizeof(storage::ExternalRef));
  for (std::uint32_t i = 0; i < header.external_count; ++i) {
    const bool instance = externals[i].kind == storage::ExternalKind::instance;
    externals[i].page += externals[i].page == shown_ && !instance ? rules_.page_count : 0;  // a treelet of this page
  }
  for (std::uint32_t i = 0; i < header.node_count; ++i) {
    storage::Node<N>& node = nodes[i];
    for (unsigned local = node.valid & ~node.leaf & ~node.external; local != 0; local &= local - 1) {
      const auto slot = static_cast<unsigned>(std::countr_zero(local));
      if (header.external_count < kMostExternals) {
        externals[header.external_count] = {rules_.page_count + shown_, node.child[slot], 0,
                                            storage::ExternalKind::node};
        node.child[slot] = static_cast<std::uint16_t>(header.external_count++);
        node.external = static_cast<std::uint8_t>(node.external | 1U << slot);
      }
    }
  }
}

void LonePage::settle(std::span<RayState> rays, const std::byte* image) const {
  for (RayState& ray : rays) {
    ray.page -= ray.page >= rules_.page_count ? rules_.page_count : 0;
    ray.left.image = ray.left.image == copy_.data() ? image : ray.left.image;
  }
}

}  // namespace raymill::traversal
