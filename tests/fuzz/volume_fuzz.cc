// A page of volumes from any bytes, with every codec: decoded or refused. What is decoded is then the whole store of a
// few rays, with a table that fits it as far as it can: whatever validate_volume_image lets through must end.
//
// The first byte chooses whether the rest is an encoded page or an image.

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <span>

#include "storage/pages/codec.h"
#include "storage/volume/volume_page.h"
#include "traversal/volume/volume_kernel.h"

namespace {

using namespace raymill;
using namespace raymill::storage;

constexpr std::uint32_t kPageBytes = 16 << 10;

struct Config {
  VolumeKind kind;
  Query query;
  VolumeConfig volume;
};

// A volume whose root is what the page gives.
Volume volume_of(const VolumePageView& page, VolumeKind kind) {
  Volume volume;
  volume.kind = kind;
  const VolumeNode& root = page.nodes()[0];
  volume.origin = root.origin;
  volume.levels = root.level;
  // Few cells: a tree may have a brick for each, and a fuzzer would find one that has.
  volume.cells = {24, 24, 24};
  volume.world_from_index = volume.index_from_world = {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
  return volume;
}

void run_rays(const std::byte* image) {
  const VolumePageView page(image);
  if (page.header().kind != VolumePageKind::bricks || page.header().node_count == 0 || page.header().volume != 0) {
    return;
  }
  const std::atomic<const std::byte*> images[] = {image};
  std::atomic<std::uint8_t> touched[] = {0};
  std::array<traversal::Crossing, 4> room;
  traversal::CrossingBuffer crossings{.room = room, .take = [](void*, std::span<const traversal::Crossing>) {}};
  const double middle = 0.5 * (double(page.nodes()[0].lower[0]) + double(page.nodes()[0].upper[0]));
  for (const auto& [kind, query, config] :
       {Config{VolumeKind::fog, Query::transmittance, {}},
        Config{VolumeKind::fog, Query::transmittance, {.method = VolumeMethod::march, .step = 0.5}},
        Config{VolumeKind::fog, Query::spans, {.threshold = middle}},
        Config{VolumeKind::level_set, Query::closest, {}}}) {
    const Volume volume = volume_of(page, kind);
    traversal::RayState ray;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      ray.org[axis] = static_cast<float>(volume.origin[axis]) - 3;
      ray.dir[axis] = 1 + 0.1F * static_cast<float>(axis);
    }
    ray.tfar = std::numeric_limits<float>::max();
    traversal::VolumeContext context{.volumes = {&volume, 1}, .query = query, .config = config, .need_normal = true};
    context.crossings = &crossings;
    context.images = images;
    context.touched = touched;
    traversal::begin_volumes(query, context.config, context.volumes, ray);
    traversal::run_volumes(context, {&ray, 1});
    // The one page is there, so nothing is left to wait for.
    if (!ray.done) {
      std::abort();
    }
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 1) {
    return 0;
  }
  const auto bytes = std::as_bytes(std::span(data, size)).subspan(1);
  if ((data[0] & 1) != 0) {
    const PageBuffer image(bytes.begin(), bytes.end());
    if (validate_volume_image(image, {kPageBytes, 1, 3}).ok()) {
      run_rays(image.data());
    }
    return 0;
  }
  static PageBuffer frame(kPageBytes);
  PageRules rules{8, 4, kPageBytes, 1, 3};
  rules.volumes = true;
  PageDecoder decoder(rules, {}, Codec::zstd);
  if (decoder.decode(bytes, frame) && VolumePageView::is_volume_page(frame.data())) {
    run_rays(frame.data());
  }
  return 0;
}
