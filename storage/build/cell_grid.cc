#include "storage/build/cell_grid.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace raymill::storage {
namespace {

constexpr std::uint32_t kMostPerAxis = 1024;
// A part with fewer cells than this has too few planes to choose from.
constexpr std::size_t kLeastCells = 48;
// Triangles for each cell of a grid, at least.
constexpr std::uint64_t kTrianglesPerCell = 16;

double most_cells(std::uint64_t triangle_count) {
  return double(std::clamp<std::uint64_t>(triangle_count / kTrianglesPerCell, 1, CellGrid::kMostCells));
}

}  // namespace

std::uint64_t CellGrid::bytes(std::uint64_t triangle_count) {
  constexpr std::uint64_t kSliceBytes = (kMostPerAxis + 1) * (sizeof(Cell) + sizeof(double));
  return static_cast<std::uint64_t>(most_cells(triangle_count)) * (sizeof(Cell) + 2 * sizeof(std::uint32_t)) +
         kSliceBytes;
}

CellGrid::CellGrid(const Aabb& middles, std::uint64_t triangle_count) : middles_(middles) {
  const double most = most_cells(triangle_count);
  std::array<double, 3> extent{};
  for (int axis = 0; axis < 3; ++axis) {
    extent[static_cast<std::size_t>(axis)] = std::max(0.0, double(middles.upper[axis]) - middles.lower[axis]);
  }
  const double largest = *std::max_element(extent.begin(), extent.end());
  if (largest > 0) {
    // The finest cubes that are not too many.
    for (double side = largest / kMostPerAxis; true; side *= 1.0625) {
      double cells = 1;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        resolution_[axis] = static_cast<std::uint32_t>(std::floor(extent[axis] / side)) + 1;
        cells *= resolution_[axis];
      }
      if (cells <= most) {
        break;
      }
      if (side > 2 * largest) {
        resolution_ = {1, 1, 1};
        break;
      }
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      scale_[axis] = extent[axis] > 0 ? resolution_[axis] / extent[axis] : 0;
    }
  }
  cells_.resize(std::size_t(resolution_[0]) * resolution_[1] * resolution_[2]);
}

std::uint32_t CellGrid::coordinate(const Vec3f& middle, int axis) const {
  const auto a = static_cast<std::size_t>(axis);
  const double position = (double(middle[axis]) - middles_.lower[axis]) * scale_[a];
  return static_cast<std::uint32_t>(std::clamp(position, 0.0, double(resolution_[a] - 1)));
}

std::uint32_t CellGrid::coordinate_of_cell(std::uint32_t cell, int axis) const {
  if (axis == 2) {
    return cell % resolution_[2];
  }
  cell /= resolution_[2];
  return axis == 1 ? cell % resolution_[1] : cell / resolution_[1];
}

// Sweeps each axis' slices of cells. Among the planes that leave `least` triangles on both sides the cheapest; else the
// one that splits most evenly.
CellGrid::Split CellGrid::best_split(std::span<const std::uint32_t> cells, std::uint64_t least) {
  Split best, even;
  double best_cost = std::numeric_limits<double>::infinity();
  std::uint64_t best_smaller = 0;
  for (int axis = 0; axis < 3; ++axis) {
    std::uint32_t low = kMostCells, high = 0;
    for (const std::uint32_t cell : cells) {
      low = std::min(low, coordinate_of_cell(cell, axis));
      high = std::max(high, coordinate_of_cell(cell, axis));
    }
    const std::size_t count = std::size_t(high - low) + 1;
    if (count < 2) {
      continue;
    }
    slices_.assign(count, {});
    for (const std::uint32_t cell : cells) {
      Cell& slice = slices_[coordinate_of_cell(cell, axis) - low];
      slice.box.grow(cells_[cell].box);
      slice.count += cells_[cell].count;
    }
    right_cost_.assign(count, 0);
    Cell right;
    for (std::size_t i = count - 1; i > 0; --i) {
      right.box.grow(slices_[i].box);
      right.count += slices_[i].count;
      right_cost_[i] = right.box.half_area() * double(right.count);
    }
    const std::uint64_t all = right.count + slices_[0].count;
    Cell left;
    for (std::size_t i = 1; i < count; ++i) {
      left.box.grow(slices_[i - 1].box);
      left.count += slices_[i - 1].count;
      const std::uint64_t smaller = std::min(left.count, all - left.count);
      const double cost = left.box.half_area() * double(left.count) + right_cost_[i];
      const Split split{axis, low + static_cast<std::uint32_t>(i)};
      if (smaller >= least && cost < best_cost) {
        best_cost = cost;
        best = split;
      }
      if (smaller > best_smaller) {
        best_smaller = smaller;
        even = split;
      }
    }
  }
  return best.axis >= 0 ? best : even;
}

std::vector<CellNode> CellGrid::partition(std::uint64_t run_triangles) {
  order_.clear();
  CellNode root;
  for (std::uint32_t cell = 0; cell < cells_.size(); ++cell) {
    if (cells_[cell].count > 0) {
      order_.push_back(cell);
      root.box.grow(cells_[cell].box);
      root.count += cells_[cell].count;
    }
  }
  root.cell_count = static_cast<std::uint32_t>(order_.size());
  std::vector<CellNode> nodes{root};
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    const CellNode node = nodes[i];
    const bool too_coarse = i > 0 && node.cell_count < kLeastCells;
    if (node.count <= run_triangles || node.cell_count < 2 || too_coarse) {
      continue;
    }
    const auto cells = std::span(order_).subspan(node.first_cell, node.cell_count);
    const Split split = best_split(cells, run_triangles / 8);
    const auto middle = std::stable_partition(cells.begin(), cells.end(), [&](std::uint32_t cell) {
      return coordinate_of_cell(cell, split.axis) < split.plane;
    });
    CellNode left, right;
    left.first_cell = node.first_cell;
    left.cell_count = static_cast<std::uint32_t>(middle - cells.begin());
    right.first_cell = node.first_cell + left.cell_count;
    right.cell_count = node.cell_count - left.cell_count;
    for (CellNode* part : {&left, &right}) {
      for (const std::uint32_t cell : cells_of(*part)) {
        part->box.grow(cells_[cell].box);
        part->count += cells_[cell].count;
      }
    }
    nodes[i].left = static_cast<std::uint32_t>(nodes.size());
    nodes[i].right = nodes[i].left + 1;
    nodes.push_back(left);
    nodes.push_back(right);
  }
  return nodes;
}

}  // namespace raymill::storage
