// The lanes of avx512: near and far planes of eight boxes in one register, indices turned around by one permutation.
// Include only from a translation unit that is compiled for AVX-512 F, BW, DQ, VL and VBMI and defines RAYMILL_ISA.
#pragma once

#include "traversal/simd/x86-inl.h"
// The lanes come first: what follows is written on them.
#include "traversal/simd/near_far-inl.h"

namespace raymill::traversal::avx512 {

// kPlaneBytes[axis][negative]: which of the bytes lower[3][8] upper[3][8] goes to the lowest byte of each of 16 lanes:
// near planes in lanes 0 to 7, far planes in lanes 8 to 15.
struct PlaneBytesTable {
  alignas(64) std::uint8_t byte[3][2][64] = {};
  constexpr PlaneBytesTable() {
    for (int axis = 0; axis < 3; ++axis) {
      for (int negative = 0; negative < 2; ++negative) {
        for (int lane = 0; lane < 16; ++lane) {
          const bool is_upper = (lane >= 8) != (negative != 0);
          byte[axis][negative][lane * 4] = static_cast<std::uint8_t>((is_upper ? 24 : 0) + axis * 8 + lane % 8);
        }
      }
    }
  }
};
inline constexpr PlaneBytesTable kPlaneBytes;

template <>
struct NearFar<8> {
  __m512 lanes;  // of an interval that is tightened, the far ones negated: one maximum then does for both

  static NearFar broadcast(float near, float far) {
    return {_mm512_insertf32x8(_mm512_set1_ps(near), _mm256_set1_ps(-far), 1)};
  }
  /// `upper` lies right behind `lower`.
  static NearFar from_bytes(const std::array<std::array<std::uint8_t, 8>, 3>& lower,
                            const std::array<std::array<std::uint8_t, 8>, 3>& /*upper*/, int axis, bool negative) {
    const __m512i planes = _mm512_maskz_loadu_epi8((std::uint64_t(1) << 48) - 1, lower.data());
    const __m512i which = _mm512_load_si512(kPlaneBytes.byte[axis][negative ? 1 : 0]);
    return {_mm512_cvtepi32_ps(_mm512_maskz_permutexvar_epi8(0x1111111111111111U, which, planes))};
  }
  static NearFar load(const float* planes, unsigned negative) {
    const __m512 lower_upper = _mm512_load_ps(planes);
    const auto turned = static_cast<__mmask16>(0 - negative);
    return {_mm512_mask_shuffle_f32x4(lower_upper, turned, lower_upper, lower_upper, _MM_SHUFFLE(1, 0, 3, 2))};
  }
  [[nodiscard]] Floats<8> near() const { return {_mm512_castps512_ps256(lanes)}; }
  [[nodiscard]] Floats<8> far() const {
    return {_mm256_xor_ps(_mm512_extractf32x8_ps(lanes, 1), _mm256_set1_ps(-0.0F))};
  }
  void tighten(const NearFar& planes) {
    const __m512 signs = _mm512_insertf32x8(_mm512_setzero_ps(), _mm256_set1_ps(-0.0F), 1);
    lanes = _mm512_max_ps(_mm512_xor_ps(planes.lanes, signs), lanes);
  }
};
inline NearFar<8> operator*(const NearFar<8>& planes, float x) {
  return {_mm512_mul_ps(planes.lanes, _mm512_set1_ps(x))};
}
inline NearFar<8> operator+(const NearFar<8>& planes, float x) {
  return {_mm512_add_ps(planes.lanes, _mm512_set1_ps(x))};
}
inline NearFar<8> operator-(const NearFar<8>& planes, float x) {
  return {_mm512_sub_ps(planes.lanes, _mm512_set1_ps(x))};
}

// kCornerWords[count]: word k * 8 + i of the result is word 3 i + k of the indices, that of triangle 0 where i >=
// count.
struct CornerWordsTable {
  alignas(64) std::uint16_t word[9][32] = {};
  constexpr CornerWordsTable() {
    for (unsigned count = 1; count <= 8; ++count) {
      for (unsigned k = 0; k < 3; ++k) {
        for (unsigned i = 0; i < 8; ++i) {
          word[count][k * 8 + i] = static_cast<std::uint16_t>((i < count ? i : 0) * 3 + k);
        }
      }
    }
  }
};
inline constexpr CornerWordsTable kCornerWords;

/// See simd/scalar.h.
inline void corner_indices(const std::uint16_t* indices, unsigned count,
                           std::array<std::array<std::int32_t, 8>, 3>& index) {
  const __m512i words = _mm512_maskz_loadu_epi16((1U << (3 * count)) - 1, indices);
  const __m512i corners = _mm512_permutexvar_epi16(_mm512_load_si512(kCornerWords.word[count]), words);
  const auto put = [](__m128i eight, std::array<std::int32_t, 8>& out) {
    const __m256i wide = _mm256_cvtepu16_epi32(eight);
    const __m256i times_three = _mm256_add_epi32(wide, _mm256_slli_epi32(wide, 1));
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(out.data()), times_three);
  };
  put(_mm512_castsi512_si128(corners), index[0]);
  put(_mm512_extracti32x4_epi32(corners, 1), index[1]);
  put(_mm512_extracti32x4_epi32(corners, 2), index[2]);
}

}  // namespace raymill::traversal::avx512
