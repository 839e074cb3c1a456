// Lanes of float32 in 256-bit registers; the same operations as simd/scalar.h, the same bits. Compiled once per ISA,
// for a function that two of them shared could be the one that the lesser machine cannot run.
#pragma once

#include <immintrin.h>

#include <array>
#include <cstdint>

namespace raymill::traversal::RAYMILL_ISA {

template <int N>
struct Floats;

template <>
struct Floats<8> {
  __m256 lanes;
  static Floats broadcast(float x) { return {_mm256_set1_ps(x)}; }
  static Floats load(const float* from) { return {_mm256_loadu_ps(from)}; }
  static Floats from_bytes(const std::uint8_t* bytes) {
    const __m128i packed = _mm_loadl_epi64(reinterpret_cast<const __m128i*>(bytes));
    return {_mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(packed))};
  }
  // Four rows of x y z ? in each half are turned into four columns.
  static std::array<Floats, 3> points(const float* base, const std::array<std::int32_t, 8>& index) {
    const auto rows = [&](int i) {
      return _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(base + index[i])),
                                  _mm_loadu_ps(base + index[i + 4]), 1);
    };
    const __m256 r0 = rows(0), r1 = rows(1), r2 = rows(2), r3 = rows(3);
    const __m256 xy01 = _mm256_unpacklo_ps(r0, r1), xy23 = _mm256_unpacklo_ps(r2, r3);
    const __m256 z01 = _mm256_unpackhi_ps(r0, r1), z23 = _mm256_unpackhi_ps(r2, r3);
    return {Floats{_mm256_shuffle_ps(xy01, xy23, _MM_SHUFFLE(1, 0, 1, 0))},
            Floats{_mm256_shuffle_ps(xy01, xy23, _MM_SHUFFLE(3, 2, 3, 2))},
            Floats{_mm256_shuffle_ps(z01, z23, _MM_SHUFFLE(1, 0, 1, 0))}};
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
inline Floats<8> select_by_sign(Floats<8> sign, Floats<8> a, Floats<8> b) {
  return {_mm256_blendv_ps(a.lanes, b.lanes, sign.lanes)};
}
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
  static Floats load(const float* from) { return {_mm_loadu_ps(from)}; }
  static Floats from_bytes(const std::uint8_t* bytes) {
    return {_mm_cvtepi32_ps(_mm_cvtepu8_epi32(_mm_loadu_si32(bytes)))};
  }
  void store(float* out) const { _mm_storeu_ps(out, lanes); }
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

}  // namespace raymill::traversal::RAYMILL_ISA
