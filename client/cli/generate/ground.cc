#include <algorithm>
#include <cmath>
#include <string>

#include "client/cli/generate/generate.h"

namespace raymill::client {

namespace {

// Quads along a tile's side: 2 x 512 x 512 triangles are one patch.
constexpr std::uint64_t kTileQuads = 512;
static_assert(2 * kTileQuads * kTileQuads == kPatchTriangles);

}  // namespace

Status add_ground(std::uint64_t triangles, float side, const HeightField& height, SceneWriter& scene) {
  if (triangles == 0) {
    return {};
  }
  // Quads fill rows of equal length; the last row may be short, and an odd count leaves half of the last quad.
  const std::uint64_t quads = (triangles + 1) / 2;
  const auto columns = static_cast<std::uint64_t>(std::ceil(std::sqrt(static_cast<double>(quads))));
  const std::uint64_t rows = (quads + columns - 1) / columns;
  const double step_x = side / static_cast<double>(columns), step_z = side / static_cast<double>(rows);
  const auto point = [&](std::uint64_t column, std::uint64_t row) {
    const auto x = static_cast<float>(static_cast<double>(column) * step_x - 0.5 * side);
    const auto z = static_cast<float>(static_cast<double>(row) * step_z - 0.5 * side);
    return Point{x, height(x, z), z};
  };
  for (std::uint64_t row0 = 0; row0 < rows; row0 += kTileQuads) {
    const std::uint64_t row1 = std::min(rows, row0 + kTileQuads);
    for (std::uint64_t column0 = 0; column0 < columns; column0 += kTileQuads) {
      const std::uint64_t column1 = std::min(columns, column0 + kTileQuads);
      const auto name = "ground-" + std::to_string(column0 / kTileQuads) + "-" + std::to_string(row0 / kTileQuads);
      RAYMILL_RETURN_IF_ERROR(scene.end_patch("before-" + name));
      const auto stride = static_cast<std::uint32_t>(column1 - column0 + 1);
      for (std::uint64_t row = row0; row <= row1; ++row) {
        for (std::uint64_t column = column0; column <= column1; ++column) {
          scene.vertex(point(column, row));
        }
      }
      for (std::uint64_t row = row0; row < row1; ++row) {
        for (std::uint64_t column = column0; column < column1; ++column) {
          const std::uint64_t quad = row * columns + column;
          if (quad >= quads) {
            break;
          }
          const auto a = static_cast<std::uint32_t>((row - row0) * stride + (column - column0));
          scene.triangle(a, a + stride, a + stride + 1);
          if (2 * quad + 1 < triangles) {
            scene.triangle(a, a + stride + 1, a + 1);
          }
        }
      }
      RAYMILL_RETURN_IF_ERROR(scene.end_patch(name));
    }
  }
  return {};
}

}  // namespace raymill::client
