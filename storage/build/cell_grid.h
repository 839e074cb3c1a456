// CellGrid: a coarse count of the scene, and the SAH partition of its cells into runs.
//
// Each triangle belongs to the cell that holds the middle of its box. A cell knows how many triangles it has and their
// box, which is all that a surface-area heuristic over planes between cells needs (binned SAH: Wald 2007). So one pass
// over the triangles, in any order and however many there are, plans their whole partition in a few megabytes.
// Thread-confined.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "storage/base/vec3.h"

namespace raymill::storage {

/// A tree over cells; its leaves are runs, or parts that need a finer grid of their own.
struct CellNode {
  Aabb box;
  std::uint64_t count = 0;
  std::uint32_t left = 0, right = 0;  ///< 0: a leaf (node 0 is the root)
  std::uint32_t first_cell = 0, cell_count = 0;
  [[nodiscard]] bool is_leaf() const { return left == 0; }
};

class CellGrid {
 public:
  static constexpr std::uint32_t kMostCells = 1u << 18;
  /// Memory of a grid for so many triangles, the caller's number for each cell and the tree over them included.
  static std::uint64_t bytes(std::uint64_t triangle_count);

  /// A grid over `middles` whose cells are about cubes; fewer cells where there are few triangles.
  CellGrid(const Aabb& middles, std::uint64_t triangle_count);

  [[nodiscard]] std::uint32_t cell_of(const Vec3f& middle) const {
    std::uint32_t cell = 0;
    for (int axis = 0; axis < 3; ++axis) {
      cell = cell * resolution_[static_cast<std::size_t>(axis)] + coordinate(middle, axis);
    }
    return cell;
  }
  /// Counts a triangle by its box: its cell is cell_of() of the box's middle.
  void add(std::uint32_t cell, const Aabb& box) {
    cells_[cell].box.grow(box);
    ++cells_[cell].count;
  }

  /// Splits until a part has at most `run_triangles`, or too few cells to split it well; such a part is left whole
  /// unless it is everything. Parts get at least an eighth of run_triangles where any plane allows it, so that no run
  /// is a page with three triangles. Nodes stand parents first; node 0 is the root.
  /// A single node that is larger than run_triangles: all middles are in one cell.
  std::vector<CellNode> partition(std::uint64_t run_triangles);
  /// The cells of a node, after partition().
  [[nodiscard]] std::span<const std::uint32_t> cells_of(const CellNode& node) const {
    return std::span(order_).subspan(node.first_cell, node.cell_count);
  }
  [[nodiscard]] std::uint32_t cell_count() const { return static_cast<std::uint32_t>(cells_.size()); }

 private:
  struct Cell {
    Aabb box;
    std::uint64_t count = 0;
  };
  struct Split {
    int axis = -1;
    std::uint32_t plane = 0;  ///< cells below it go left
  };

  [[nodiscard]] std::uint32_t coordinate(const Vec3f& middle, int axis) const;
  [[nodiscard]] std::uint32_t coordinate_of_cell(std::uint32_t cell, int axis) const;
  [[nodiscard]] Split best_split(std::span<const std::uint32_t> cells, std::uint64_t least);

  Aabb middles_;
  std::array<std::uint32_t, 3> resolution_{1, 1, 1};
  std::array<double, 3> scale_{};  // cells for each unit of length
  std::vector<Cell> cells_;
  std::vector<std::uint32_t> order_;
  std::vector<Cell> slices_;        // scratch: of an axis
  std::vector<double> right_cost_;  // scratch
};

}  // namespace raymill::storage
