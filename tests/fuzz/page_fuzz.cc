// A page from any bytes, with every codec: decoded or refused. What is decoded is then the whole store of a few rays:
// the kernels follow its indices blindly, so whatever validate_image lets through must end, in a hit, a miss or a
// refusal.
//
// The first byte chooses width, positions, what the store has, and whether the rest is an encoded page or an image.

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <span>

#include "storage/pages/attribute_page.h"
#include "storage/pages/codec.h"
#include "storage/pages/mask_page.h"
#include "storage/pages/page_assembler.h"
#include "traversal/attribute_fetch.h"
#include "traversal/kernel.h"
#include "traversal/mask_test.h"
#include "traversal/ray_state.h"

namespace {

using namespace raymill;
using namespace raymill::storage;

constexpr std::uint32_t kPageBytes = 16 << 10;
// Few levels: a tree may visit width^levels nodes, and a fuzzer would find one that does.
constexpr unsigned kLevels = 4;

void run_rays(const std::byte* image, const PageRules& rules) {
  const std::atomic<const std::byte*> images[] = {image};
  std::atomic<std::uint8_t> touched[] = {0};
  for (const traversal::Isa isa : traversal::runnable_isas()) {
    for (const Query query : {Query::closest, Query::any}) {
      for (const Mode mode : {Mode::watertight, Mode::fast, Mode::exact}) {
        traversal::RayState ray;
        ray.org = {0.1F, 0.2F, -5};
        ray.dir = {0.01F, -0.0F, 1};
        ray.tfar = std::numeric_limits<float>::max();
        traversal::KernelContext context{images, touched, true, {}, false};
        context.object_level = rules.object_level;
        const traversal::Footprint footprint{1, 0.5};
        context.footprint = rules.proxies ? &footprint : nullptr;
        context.masks = rules.masks;
        context.page_bytes = rules.page_bytes;
        traversal::find_kernel(isa, {query, mode, rules.width})(context, {&ray, 1});
        // The one page is there, so nothing is left to wait for.
        if (!ray.done) {
          std::abort();
        }
      }
    }
  }
}

// Any texel of any page: what it has is read, what it has not is refused.
void read_texels(const std::byte* image) {
  for (const std::uint8_t bits : {std::uint8_t{1}, std::uint8_t{8}, std::uint8_t{16}}) {
    for (std::uint32_t texel = 1; texel != 0; texel <<= 1) {
      bool counts = false;
      (void)traversal::read_texel(image, texel - 1, bits, 1, counts);
    }
  }
}

// Rays that ask for attributes of any hit: answered, refused, or left to wait for a page that is not there.
void read_attributes(const std::byte* image, const PageRules& rules) {
  const std::atomic<const std::byte*> images[] = {image, nullptr};
  std::atomic<std::uint8_t> touched[] = {0, 0};
  for (std::uint32_t id = 1; id != 0; id <<= 1) {
    for (const std::uint32_t first_page : {0U, 1U}) {
      traversal::AttributeContext context;
      context.places = AttributePlaces(rules.attributes, first_page, rules.page_bytes, first_page == 0 ? id : 0, 2);
      context.asked = kAllAttributes;
      context.images = images;
      context.touched = touched;
      traversal::RayState ray;
      ray.hit.geometry_id = ray.hit.primitive_id = id - 1;
      ray.hit.u = ray.hit.v = 0.25F;
      traversal::begin_attributes(context, ray);
      ray.page = 0;
      if (first_page == 1) {
        ray.attribute_step = traversal::AttributeStep::entry;
        ray.level = static_cast<std::uint8_t>(rules.attributes);
        ray.node = static_cast<std::uint16_t>(id - 1);
      }
      HitAttributes values;
      traversal::fetch_attributes(context, {&ray, 1}, {&values, 1});
      if (!ray.done && ray.page != 1) {
        std::abort();
      }
    }
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 1) {
    return 0;
  }
  const std::uint8_t choice = data[0];
  PageRules rules{(choice & 1) != 0 ? 8u : 4u, kLevels, (choice & 8) != 0 ? 2u : 0u, kPageBytes, 1, 3};
  rules.proxies = (choice & 16) != 0;
  rules.masks = (choice & 32) != 0;
  rules.attributes = (choice & 64) != 0 ? kAllAttributes : (choice & 128) != 0 ? 2 : 0;
  const PositionKind positions{(choice & 2) != 0, -12};
  const auto bytes = std::as_bytes(std::span(data, size)).subspan(1);
  if ((choice & 4) != 0) {
    PageBuffer image(bytes.begin(), bytes.end());
    if (validate_image(image, rules).ok()) {
      run_rays(image.data(), rules);
    }
    return 0;
  }
  static PageBuffer frame(kPageBytes);
  PageDecoder decoder(rules, positions, Codec::draco);
  const auto decoded = decoder.decode(bytes, frame);
  if (!decoded) {
    return 0;
  }
  if (MaskPageView::is_mask_page(frame.data())) {
    read_texels(frame.data());
    return 0;
  }
  if (AttributePageView::is_attribute_page(frame.data())) {
    read_attributes(frame.data(), rules);
    return 0;
  }
  (void)check_boxes(frame.data());
  run_rays(frame.data(), rules);
  return 0;
}
