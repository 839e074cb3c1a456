// Which kernel answers a choice of query, mode and width; compiled once per ISA.
#pragma once

#include "traversal/kernels/kernel-inl.h"

namespace raymill::traversal::RAYMILL_ISA {

template <int N, Query kQuery, Mode kMode>
void trace_batch(KernelContext& context, std::span<RayState> rays) {
  Batch<N, kQuery, kMode>(context, rays).run();
}

template <int N, Query kQuery>
Kernel select_mode(Mode mode) {
  switch (mode) {
    case Mode::fast:
      return &trace_batch<N, kQuery, Mode::fast>;
    case Mode::exact:
      return &trace_batch<N, kQuery, Mode::exact>;
    default:
      return &trace_batch<N, kQuery, Mode::watertight>;
  }
}

template <int N>
Kernel select_query(const KernelChoice& choice) {
  switch (choice.query) {
    case Query::closest:
      return select_mode<N, Query::closest>(choice.mode);
    case Query::any:
      return select_mode<N, Query::any>(choice.mode);
    default:  // crossings, whether they are listed or counted
      return select_mode<N, Query::all>(choice.mode);
  }
}

inline Kernel select_kernel(const KernelChoice& choice) {
  return choice.width == 8 ? select_query<8>(choice) : select_query<4>(choice);
}

}  // namespace raymill::traversal::RAYMILL_ISA
