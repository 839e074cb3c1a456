#include "storage/import/mask_footprint.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

namespace raymill::storage {
namespace {

// Of a place in texels. Places of at most 2^40 texels are computed with five roundings of 2^-53 each.
constexpr double kMargin = 0x1p-8;
// A footprint of more rows is taken for the whole texture: it would be looked at for long.
constexpr std::int64_t kMostRows = 1 << 17;

// Least and largest value of some texels.
struct Range {
  std::uint32_t low = std::numeric_limits<std::uint32_t>::max();
  std::uint32_t high = 0;

  void add(std::uint32_t value) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
  void add(const Range& other) {
    low = std::min(low, other.low);
    high = std::max(high, other.high);
  }
  [[nodiscard]] bool empty() const { return low > high; }
  /// Nothing more can be learnt from bits.
  [[nodiscard]] bool mixed_bits() const { return low == 0 && high == 1; }
};

// Texels first to last of a row of the texture.
void add_bits(const std::byte* row, std::uint32_t first, std::uint32_t last, Range& range) {
  for (std::uint32_t x = first; x <= last && !range.mixed_bits();) {
    std::uint64_t word = 0;
    std::memcpy(&word, row + x / 64 * 8, sizeof word);
    const std::uint32_t end = std::min(last, x / 64 * 64 + 63);
    const std::uint32_t count = end - x + 1;
    const std::uint64_t mask = (count == 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << count) - 1) << (x % 64);
    if ((word & mask) != 0) {
      range.add(1);
    }
    if ((word & mask) != mask) {
      range.add(0);
    }
    x = end + 1;
  }
}

void add_row(const AlphaMap& map, std::uint32_t y, std::uint32_t first, std::uint32_t last, Range& range) {
  if (map.info.bits == 1) {
    add_bits(map.row(y), first, last, range);
    return;
  }
  for (std::uint32_t x = first; x <= last; ++x) {
    range.add(map.value(x, y));
  }
}

// Unwrapped texels first to last of an unwrapped row.
void add_span(const AlphaMap& map, std::int64_t y, std::int64_t first, std::int64_t last, Range& range) {
  const std::uint32_t width = map.info.width;
  const std::uint32_t row = wrap_texel(y, map.info.height, map.info.wrap_t);
  if (map.info.wrap_s == Wrap::clamp || last - first + 1 < width) {
    // In pieces that lie between multiples of the width: each is one run of texels, in one order or the other.
    while (first <= last) {
      const std::int64_t start = first >= 0 ? first / width * width : -((-first + width - 1) / width) * width;
      const std::int64_t end = map.info.wrap_s == Wrap::clamp ? last : std::min(last, start + width - 1);
      const std::uint32_t a = wrap_texel(first, width, map.info.wrap_s), b = wrap_texel(end, width, map.info.wrap_s);
      add_row(map, row, std::min(a, b), std::max(a, b), range);
      first = end + 1;
    }
  } else {
    add_row(map, row, 0, width - 1, range);
  }
}

struct Point {
  double x, y;
};

// The least and greatest x of the triangle between two heights.
bool between(const std::array<Point, 3>& corners, double top, double bottom, double& low, double& high) {
  low = std::numeric_limits<double>::infinity();
  high = -low;
  for (std::size_t i = 0; i < 3; ++i) {
    Point a = corners[i], b = corners[(i + 1) % 3];
    if (a.y > b.y) {
      std::swap(a, b);
    }
    if (b.y < top || a.y > bottom) {
      continue;
    }
    for (const double y : {std::max(a.y, top), std::min(b.y, bottom)}) {
      const double part = b.y > a.y ? std::clamp((y - a.y) / (b.y - a.y), 0.0, 1.0) : 0;
      const double x = a.x + part * (b.x - a.x);
      low = std::min(low, x);
      high = std::max(high, x);
      if (b.y == a.y) {
        low = std::min(low, b.x);
        high = std::max(high, b.x);
      }
    }
  }
  return low <= high;
}

using Cells = std::array<Range, kCells * kCells>;

class Footprint {
 public:
  Footprint(const AlphaMap& map, const TexCoords& corners)
      : map_(map), box_(texel_rectangle(corners, map.info.width, map.info.height)) {
    for (std::size_t i = 0; i < 3; ++i) {
      corners_[i] = {double(corners[i][0]) * map.info.width, double(corners[i][1]) * map.info.height};
    }
  }

  // Ranges of the texels in each cell of the rectangle, and of all together with those beside it.
  void scan(Cells& cells, Range& all) const {
    const std::int64_t first = box_.y - 1, last = box_.y + box_.height;
    if (last - first >= std::min<std::int64_t>(kMostRows, 8 * std::int64_t{map_.info.height} + 2) ||
        box_.width >= 64 * std::int64_t{kMostMaskEdge}) {
      add_everything(all);
      return;
    }
    for (std::int64_t y = first; y <= last; ++y) {
      double low = 0, high = 0;
      if (between(corners_, double(y) - kMargin, double(y) + 1 + kMargin, low, high)) {
        scan_row(y, static_cast<std::int64_t>(std::floor(low - kMargin)),
                 static_cast<std::int64_t>(std::floor(high + kMargin)), cells, all);
      }
    }
  }

 private:
  void add_everything(Range& all) const {
    for (std::uint32_t y = 0; y < map_.info.height; ++y) {
      add_row(map_, y, 0, map_.info.width - 1, all);
    }
  }

  // The least texel of column `cell` of cells, after the rectangle's first: x with x * kCells / n == cell.
  [[nodiscard]] static std::int64_t cell_begin(std::int64_t cell, std::int64_t n) {
    return (cell * n + kCells - 1) / kCells;
  }

  void scan_row(std::int64_t y, std::int64_t first, std::int64_t last, Cells& cells, Range& all) const {
    const std::int64_t dy = y - box_.y;
    if (dy < 0 || dy >= box_.height) {
      add_span(map_, y, first, last, all);
      return;
    }
    const std::int64_t row = dy * kCells / box_.height;
    const auto piece = [&](std::int64_t from, std::int64_t to, Range* cell) {
      from = std::max(from, first);
      to = std::min(to, last);
      if (from <= to) {
        Range range;
        add_span(map_, y, from, to, range);
        all.add(range);
        if (cell != nullptr) {
          cell->add(range);
        }
      }
    };
    piece(first, box_.x - 1, nullptr);
    for (std::int64_t column = 0; column < kCells; ++column) {
      piece(box_.x + cell_begin(column, box_.width), box_.x + cell_begin(column + 1, box_.width) - 1,
            &cells[static_cast<std::size_t>(row * kCells + column)]);
    }
    piece(box_.x + box_.width, last, nullptr);
  }

  const AlphaMap& map_;
  const TexelRectangle box_;
  std::array<Point, 3> corners_{};
};

}  // namespace

void judge_face(const AlphaMap& map, std::uint32_t number, FaceMask& face) {
  Cells cells;
  Range all;
  Footprint(map, face.corners).scan(cells, all);
  // What surely counts at the least alpha of the corners, and surely does not at the largest.
  std::uint32_t opaque_from = 1, cut_below = 1;
  if (map.info.bits != 1) {
    const std::uint32_t most = map.info.bits == 8 ? 255 : 65535;
    constexpr double kRounding = 0x1p-40;
    const auto [least, largest] = std::minmax({face.alphas[0], face.alphas[1], face.alphas[2]});
    opaque_from = least_counting(most, map.info.factor, double(least) * (1 - kRounding), map.info.cutoff);
    cut_below = least_counting(most, map.info.factor, double(largest) * (1 + kRounding), map.info.cutoff);
  }
  const auto state = [&](const Range& range) {
    return range.empty()              ? CellState::look_up
           : range.low >= opaque_from ? CellState::opaque
           : range.high < cut_below   ? CellState::cut
                                      : CellState::look_up;
  };
  const CellState whole = state(all);
  face.known = 0;
  if (whole != CellState::look_up) {
    face.mask = whole == CellState::opaque ? FaceMask::kOpaque : FaceMask::kCut;
    return;
  }
  face.mask = number;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    face.known |= static_cast<std::uint32_t>(state(cells[i])) << (2 * i);
  }
}

}  // namespace raymill::storage
