// MaskFootprint: which texels a triangle may fall on, and so whether a mask cuts it out, in whole, in part or not.
//
//            .            a row of texels, widened by a margin, cuts the triangle: from the least to the largest x of
//     -------/-.-------   what lies between its edges stand all texels that any point of the triangle falls on,
//           /   .         however its place was rounded, and few others
//     -----/-----.-----
//         /_______.
//
// Immutable functions; thread-safe.
#pragma once

#include "storage/import/mask_sink.h"

namespace raymill::storage {

/// Sets mask (kOpaque, kCut, else `number`) and known of a face whose corners and alphas are set. Corners are finite
/// and at most kMostTexCoord.
void judge_face(const AlphaMap& map, std::uint32_t number, FaceMask& face);

}  // namespace raymill::storage
