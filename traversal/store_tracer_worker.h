// StoreTracer::Worker: what a thread of a StoreTracer owns. Thread-confined.
#pragma once

#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "storage/pages/codec.h"
#include "traversal/lone_page.h"
#include "traversal/store_tracer.h"

namespace raymill::traversal {

struct StoreTracer::Worker {
  Worker(unsigned index_in, const storage::StoreFile& file, const Config& config)
      : index(index_in), decoder(file.rules(), file.positions(), file.codec()) {
    if (config.adversarial) {
      lone_page.emplace(file.rules());
    }
    if (config.page_trace) {
      page_lane.emplace(config.page_trace, file.page_count());
    }
    rays.reserve(kBatchRays + kBatchSlack);
    parked.reserve(kBatchRays + kBatchSlack);
  }
  const unsigned index;
  storage::PageDecoder decoder;
  std::vector<RayState> rays;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> parked;  // page, index in rays
  // Of a block of fresh rays, once there is one.
  std::vector<Hit> hits;
  std::vector<std::byte> entries;
  std::optional<LonePage> lone_page;
  std::optional<PageTrace::Lane> page_lane;
};

}  // namespace raymill::traversal
