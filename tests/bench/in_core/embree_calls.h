// Embree's ways to trace a batch: ray by ray, in packets, in streams.
#pragma once

#include <span>

#include "tests/support/embree_files.h"

namespace raymill::bench {

enum class EmbreeCall { single, packet8, packet16, stream };

struct EmbreeBatch {
  EmbreeCall call = EmbreeCall::single;
  Query query = Query::closest;
  bool coherent = false;  ///< sets RTC_INTERSECT_CONTEXT_FLAG_COHERENT; single rays take no notice of it
};

/// hits[i] is ray i's, with t = 0 where any hit was asked for and there is one. Thread-confined.
void trace_by_embree(const EmbreeScene& scene, const EmbreeBatch& batch, std::span<const Ray> rays,
                     std::span<Hit> hits);

}  // namespace raymill::bench
