// The worked example of storage/FORMAT.md: a store of two triangles, byte by byte with the name of each field.
#pragma once

#include <string>

#include "tests/support/temp_folder.h"

namespace raymill::tests {

std::string format_example(const TempFolder& folder);

}  // namespace raymill::tests
