// The algorithms for avx512, where the sixteen boxes of a node are one register: the paper's MIC case. See
// kernels-inl.h.
#define RAYMILL_ISA avx512
#include "traversal/simd/avx512.h"
// The lanes come first: what follows is written on them.

namespace raymill::traversal::avx512 {

template <>
struct Floats<16> {
  __m512 lanes;
  static Floats broadcast(float x) { return {_mm512_set1_ps(x)}; }
  void store(float* out) const { _mm512_storeu_ps(out, lanes); }
};
inline Floats<16> operator+(Floats<16> a, Floats<16> b) { return {_mm512_add_ps(a.lanes, b.lanes)}; }
inline Floats<16> operator-(Floats<16> a, Floats<16> b) { return {_mm512_sub_ps(a.lanes, b.lanes)}; }
inline Floats<16> operator*(Floats<16> a, Floats<16> b) { return {_mm512_mul_ps(a.lanes, b.lanes)}; }
inline Floats<16> min_keep(Floats<16> a, Floats<16> b) { return {_mm512_min_ps(a.lanes, b.lanes)}; }
inline Floats<16> max_keep(Floats<16> a, Floats<16> b) { return {_mm512_max_ps(a.lanes, b.lanes)}; }
inline Floats<16> abs(Floats<16> x) { return {_mm512_abs_ps(x.lanes)}; }
inline unsigned less_equal(Floats<16> a, Floats<16> b) { return _mm512_cmp_ps_mask(a.lanes, b.lanes, _CMP_LE_OQ); }

}  // namespace raymill::traversal::avx512

#include "tests/bench/seed/kernels-inl.h"

namespace raymill::bench::avx512 {

std::vector<Algorithm> algorithms() { return all_algorithms(); }

}  // namespace raymill::bench::avx512
