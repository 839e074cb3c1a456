// The slab test's constants and the rules that all boxes and triangles share.
//
// entry = max over axes of (near plane - org) * rdir, exit = min over axes of (far plane - org) * rdir, each operation
// rounded once, in this order. rdir = 1 / dir; a zero component gives an infinity of dir's sign, and a plane that
// passes exactly through org then gives 0 * inf = NaN, which min_keep and max_keep drop: no constraint from that axis.
//
// Monotone: for a box inside another every plane difference, product, minimum and maximum is ordered the same way, so
// the inner box never enters earlier nor leaves later than the outer one, bit for bit.
//
// Conservative: each of entry and exit has a relative error of at most gamma(3) = 3u / (1 - 3u), u = 2^-24, so exit is
// padded by 2 gamma(3) < 2^-21 of its magnitude (Ize 2013, section 3, who pads by 2 ulp for positive t; the magnitude
// makes it hold for negative t too). x + |x| * 2^-21 is monotone as well.
#pragma once

#include <array>

namespace raymill::traversal {

constexpr float kExitPad = 0x1p-21F;
static_assert(6.0 * 0x1p-24 / (1.0 - 3.0 * 0x1p-24) < 0x1p-21);

}  // namespace raymill::traversal
