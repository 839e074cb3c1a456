// A small font for what is drawn without one from the system: 5 x 7 pixels, digits, letters and some signs.
#pragma once

#include <array>
#include <cstdint>

namespace raymill::client {

constexpr int kGlyphColumns = 5, kGlyphRows = 7;
/// Rows from the top; bit 4 of each is its left column.
using Glyph = std::array<std::uint8_t, kGlyphRows>;

/// Letters without a glyph of their own come in the other case; what has none at all is a frame.
const Glyph& glyph_of(char character);

}  // namespace raymill::client
