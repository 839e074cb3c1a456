// An OBJ file of any bytes: imported or refused, within a small budget and without a trace on disk.
#include <cstddef>
#include <cstdint>

#include "tests/fuzz/import_checker.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return raymill::fuzz::check_import(data, size, "fuzz.obj");
}
