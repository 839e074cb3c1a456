// The lanes of avx2. Include only from a translation unit that is compiled for AVX2 and defines RAYMILL_ISA.
#pragma once

#include "traversal/simd/x86-inl.h"
// The lanes come first: what follows is written on them.
#include "traversal/simd/near_far-inl.h"

namespace raymill::traversal::avx2 {

// How the indices of `count` triangles are turned around: three parts of eight words each are loaded, and each part's
// words of corner k go to their lanes.
struct CornerWordsTable {
  alignas(32) std::int32_t loaded[9][12] = {};   // all bits: that double word holds an index
  alignas(16) std::uint8_t byte[3][3][16] = {};  // [k][part]: pshufb
  alignas(16) std::uint16_t is_used[9][8] = {};
  constexpr CornerWordsTable() {
    for (unsigned count = 1; count <= 8; ++count) {
      for (unsigned i = 0; i < 12; ++i) {
        loaded[count][i] = i * 2 < count * 3 ? -1 : 0;
      }
      for (unsigned i = 0; i < 8; ++i) {
        is_used[count][i] = i < count ? 0xFFFF : 0;
      }
    }
    for (unsigned k = 0; k < 3; ++k) {
      for (unsigned i = 0; i < 8; ++i) {
        const unsigned word = 3 * i + k;
        for (unsigned part = 0; part < 3; ++part) {
          const bool is_here = word / 8 == part;
          byte[k][part][2 * i] = static_cast<std::uint8_t>(is_here ? word % 8 * 2 : 0x80);
          byte[k][part][2 * i + 1] = static_cast<std::uint8_t>(is_here ? word % 8 * 2 + 1 : 0x80);
        }
      }
    }
  }
};
inline constexpr CornerWordsTable kCornerWords;

/// See simd/scalar.h. Reads two bytes past an odd number of triangles; an image's primitive ids stand there.
inline void corner_indices(const std::uint16_t* indices, unsigned count,
                           std::array<std::array<std::int32_t, 8>, 3>& index) {
  const auto load = [](const void* from) { return _mm_load_si128(static_cast<const __m128i*>(from)); };
  const auto* words = reinterpret_cast<const int*>(indices);
  const auto* loaded = kCornerWords.loaded[count];
  const __m128i parts[] = {_mm_maskload_epi32(words, load(loaded)), _mm_maskload_epi32(words + 4, load(loaded + 4)),
                           _mm_maskload_epi32(words + 8, load(loaded + 8))};
  const __m128i is_used = load(kCornerWords.is_used[count]);
  for (unsigned k = 0; k < 3; ++k) {
    __m128i corners = _mm_shuffle_epi8(parts[0], load(kCornerWords.byte[k][0]));
    corners = _mm_or_si128(corners, _mm_shuffle_epi8(parts[1], load(kCornerWords.byte[k][1])));
    corners = _mm_or_si128(corners, _mm_shuffle_epi8(parts[2], load(kCornerWords.byte[k][2])));
    corners = _mm_blendv_epi8(_mm_broadcastw_epi16(corners), corners, is_used);
    const __m256i wide = _mm256_cvtepu16_epi32(corners);
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(index[k].data()),
                        _mm256_add_epi32(wide, _mm256_slli_epi32(wide, 1)));
  }
}

}  // namespace raymill::traversal::avx2
