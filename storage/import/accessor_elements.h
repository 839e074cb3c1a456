// for_each_element: all elements of an accessor as numbers, by pieces.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "storage/base/status.h"
#include "storage/import/gltf_accessor.h"
#include "storage/import/primitive_readers.h"

namespace raymill::storage {

/// Calls take(element, components) for all elements of an accessor, with the first N of each. Errors: those of the
/// buffers.
template <std::size_t N, typename Take>
Status for_each_element(GltfAccessor accessor, Take&& take) {
  std::vector<std::byte> raw(kPieceCorners * accessor.element_bytes());
  const std::uint32_t step = size_bytes(accessor.type());
  for (std::uint64_t first = 0; first < accessor.count(); first += kPieceCorners) {
    const std::size_t taken = std::min<std::uint64_t>(kPieceCorners, accessor.count() - first);
    RAYMILL_RETURN_IF_ERROR(accessor.read(first, std::span(raw).first(taken * accessor.element_bytes())));
    for (std::size_t i = 0; i < taken; ++i) {
      std::array<double, N> values{};
      for (std::size_t k = 0; k < N && k * step < accessor.element_bytes(); ++k) {
        values[k] = component_value(raw.data() + i * accessor.element_bytes() + k * step, accessor.type(),
                                    accessor.normalized());
      }
      take(first + i, values);
    }
  }
  return {};
}

}  // namespace raymill::storage
