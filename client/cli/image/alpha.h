// raymill-image alpha FILE: a picture's alpha to stdout (storage/import/alpha_stream.h).
#pragma once

#include <string>

namespace raymill::client {

/// Writes head and rows of the picture's first subimage at its full size, by scanlines, or by rows of tiles, so that no
/// more than one row of them is held beside what OpenImageIO itself holds. False: `sentence` says why.
bool write_alpha(const std::string& path, std::string& sentence);

}  // namespace raymill::client
