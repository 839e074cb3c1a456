// Lanes of float32 in AVX2 registers; the same operations as simd/scalar.h, the same bits.
// Include only from a translation unit that is compiled for AVX2.
#pragma once

#include <immintrin.h>

#include <array>
#include <cstdint>

namespace raymill::traversal::avx2 {

template <int N>
struct Floats;

template <>
struct Floats<8> {
  __m256 lanes;
  static Floats broadcast(float x) { return {_mm256_set1_ps(x)}; }
  static Floats from_bytes(const std::uint8_t* bytes) {
    const __m128i packed = _mm_loadl_epi64(reinterpret_cast<const __m128i*>(bytes));
    return {_mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(packed))};
  }
  static Floats gather(const float* base, const std::array<std::int32_t, 8>& index) {
    return {_mm256_i32gather_ps(base, _mm256_loadu_si256(reinterpret_cast<const __m256i*>(index.data())), 4)};
  }
  void store(float* out) const { _mm256_storeu_ps(out, lanes); }
};
inline Floats<8> operator+(Floats<8> a, Floats<8> b) { return {_mm256_add_ps(a.lanes, b.lanes)}; }
inline Floats<8> operator-(Floats<8> a, Floats<8> b) { return {_mm256_sub_ps(a.lanes, b.lanes)}; }
inline Floats<8> operator*(Floats<8> a, Floats<8> b) { return {_mm256_mul_ps(a.lanes, b.lanes)}; }
inline Floats<8> operator/(Floats<8> a, Floats<8> b) { return {_mm256_div_ps(a.lanes, b.lanes)}; }
inline Floats<8> min_keep(Floats<8> a, Floats<8> b) { return {_mm256_min_ps(a.lanes, b.lanes)}; }
inline Floats<8> max_keep(Floats<8> a, Floats<8> b) { return {_mm256_max_ps(a.lanes, b.lanes)}; }
inline Floats<8> abs(Floats<8> x) { return {_mm256_andnot_ps(_mm256_set1_ps(-0.0F), x.lanes)}; }
inline unsigned less_equal(Floats<8> a, Floats<8> b) {
  return static_cast<unsigned>(_mm256_movemask_ps(_mm256_cmp_ps(a.lanes, b.lanes, _CMP_LE_OQ)));
}
inline unsigned less(Floats<8> a, Floats<8> b) {
  return static_cast<unsigned>(_mm256_movemask_ps(_mm256_cmp_ps(a.lanes, b.lanes, _CMP_LT_OQ)));
}

template <>
struct Floats<4> {
  __m128 lanes;
  static Floats broadcast(float x) { return {_mm_set1_ps(x)}; }
  static Floats from_bytes(const std::uint8_t* bytes) {
    return {_mm_cvtepi32_ps(_mm_cvtepu8_epi32(_mm_loadu_si32(bytes)))};
  }
};
inline Floats<4> operator+(Floats<4> a, Floats<4> b) { return {_mm_add_ps(a.lanes, b.lanes)}; }
inline Floats<4> operator-(Floats<4> a, Floats<4> b) { return {_mm_sub_ps(a.lanes, b.lanes)}; }
inline Floats<4> operator*(Floats<4> a, Floats<4> b) { return {_mm_mul_ps(a.lanes, b.lanes)}; }
inline Floats<4> min_keep(Floats<4> a, Floats<4> b) { return {_mm_min_ps(a.lanes, b.lanes)}; }
inline Floats<4> max_keep(Floats<4> a, Floats<4> b) { return {_mm_max_ps(a.lanes, b.lanes)}; }
inline Floats<4> abs(Floats<4> x) { return {_mm_andnot_ps(_mm_set1_ps(-0.0F), x.lanes)}; }
inline unsigned less_equal(Floats<4> a, Floats<4> b) {
  return static_cast<unsigned>(_mm_movemask_ps(_mm_cmple_ps(a.lanes, b.lanes)));
}

}  // namespace raymill::traversal::avx2
