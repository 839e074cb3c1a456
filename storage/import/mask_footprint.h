// MaskFootprint: which texels a triangle may fall on, and so whether a mask cuts it out, in whole, in part or not.
//
//        row of texels, widened by a margin
//      _______/_\____________   the triangle between the row's edges, from its least to its greatest x: all texels that
//            /   \              any point of it falls on, however its place was rounded, and few others
//           /_____\
//
// Immutable functions; thread-safe.
#pragma once

#include "storage/import/mask_sink.h"

namespace raymill::storage {

/// Sets mask (kOpaque, kCut, else `number`) and known of a face whose corners and alphas are set. Corners are finite
/// and at most kMostTexCoord.
void judge_face(const AlphaMap& map, std::uint32_t number, FaceMask& face);

}  // namespace raymill::storage
