// What the golden tests share: where the kept files stand, and whether they are to be renewed.
#pragma once

#include <string>

namespace raymill::tests {

inline const std::string kGolden = RAYMILL_SOURCE_DIR "/tests/golden/";
/// --rewrite was given.
bool rewrite();

}  // namespace raymill::tests
