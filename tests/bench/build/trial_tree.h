// TrialTree: a tree over a scene's triangles as a builder might make it, to see what each of its choices is worth. Its
// leaves hold references: with spatial splits a triangle may stand in several of them, each time with a part of its
// box.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "storage/base/status.h"
#include "storage/base/vec3.h"
#include "storage/build/binary_tree.h"

namespace raymill::bench {

enum class Quality { low, medium, high };  ///< rtcBuildBVH's: Morton codes, binned SAH, SAH with spatial splits

struct TreeChoice {
  Quality quality = Quality::medium;
  unsigned leaf = 8;          ///< triangles at most
  unsigned block = 4;         ///< triangles that SAH counts as one
  unsigned reinsertions = 0;  ///< passes of improve()
};

struct TrialTree {
  std::vector<storage::BinaryNode> nodes;  ///< nodes[0] is the root; a leaf's `left` counts in references
  std::vector<std::uint32_t> references;   ///< indices of triangles, in leaf order
};

/// Errors: internal (Embree refused).
Result<TrialTree> build_trial_tree(const storage::EmbreeDevice& device, std::span<const storage::Triangle> triangles,
                                   const TreeChoice& choice);

/// Takes nodes out and puts them where the tree's area grows least (Meister, Bittner 2018, one node after the other,
/// those of large area first); the leaves stay as they are.
void improve(TrialTree& tree, unsigned passes);

/// A node of up to eight children; a child is a node, or a leaf of `count` references from `child`.
struct TrialNode {
  storage::Aabb boxes[8];
  std::uint32_t child[8] = {};
  std::uint32_t count[8] = {};
  unsigned children = 0;
};

/// Opens the child of largest area until `width` stand, as the store's builder does. nodes[0] is the root.
std::vector<TrialNode> make_wide(const TrialTree& tree, unsigned width);

/// As `raymill build` tells it: a node visit 1, a triangle test 1, relative to the root's area.
double sah_cost(std::span<const TrialNode> nodes, const storage::Aabb& root);

}  // namespace raymill::bench
