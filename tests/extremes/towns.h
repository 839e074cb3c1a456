// Towns: three reliefs in one store, ten thousand kilometres from the first to the last, met by float64 rays near each.
#pragma once

#include <cstddef>
#include <string>

#include "storage/base/status.h"

namespace raymill::extremes {

struct TownsPage {
  std::string text;  ///< of the page, with its heading
  bool passed = true;
};
/// `rays`: for each line. What is not as promised is printed. Errors: of builds and jobs.
Result<TownsPage> run_towns(std::size_t rays);

}  // namespace raymill::extremes
