#include "storage/build/wide_node_order.h"

#include <algorithm>
#include <limits>

namespace raymill::storage {
namespace {

double center(const Aabb& box, int axis) { return 0.5 * box.lower[axis] + 0.5 * box.upper[axis]; }

}  // namespace

// The (child, slot) pair of largest projection on the slot's diagonal first.
std::array<unsigned, kMaxWidth> assign_slots(std::span<const Aabb> children, const Aabb& box, unsigned width,
                                             std::uint8_t& order) {
  const unsigned bits = width == 8 ? 3 : 2;
  std::array<int, 3> axes{0, 1, 2};
  if (bits == 2) {
    std::stable_sort(axes.begin(), axes.end(),
                     [&](int a, int b) { return box.upper[a] - box.lower[a] > box.upper[b] - box.lower[b]; });
  }
  order = static_cast<std::uint8_t>(axes[0] | axes[1] << 2);
  std::array<std::array<double, kMaxWidth>, kMaxWidth> gain{};
  for (std::size_t i = 0; i < children.size(); ++i) {
    for (unsigned bit = 0; bit < bits; ++bit) {
      const double offset = center(children[i], axes[bit]) - center(box, axes[bit]);
      for (unsigned slot = 0; slot < width; ++slot) {
        gain[i][slot] += (slot >> bit & 1) != 0 ? offset : -offset;
      }
    }
  }
  // Each child's best free slot; it is looked for again only when another child took it.
  std::array<unsigned, kMaxWidth> best_slot{};
  std::array<double, kMaxWidth> best_gain{};
  unsigned taken = 0;
  const auto find_best = [&](std::size_t i) {
    best_gain[i] = -std::numeric_limits<double>::infinity();
    for (unsigned slot = 0; slot < width; ++slot) {
      if ((taken >> slot & 1) == 0 && gain[i][slot] > best_gain[i]) {
        best_gain[i] = gain[i][slot];
        best_slot[i] = slot;
      }
    }
  };
  for (std::size_t i = 0; i < children.size(); ++i) {
    find_best(i);
  }
  std::array<unsigned, kMaxWidth> slots{};
  unsigned placed = 0;
  for (std::size_t step = 0; step < children.size(); ++step) {
    std::size_t best_child = children.size();
    for (std::size_t i = 0; i < children.size(); ++i) {
      if ((placed >> i & 1) == 0 && (best_child == children.size() || best_gain[i] > best_gain[best_child])) {
        best_child = i;
      }
    }
    const unsigned slot = best_slot[best_child];
    slots[best_child] = slot;
    placed |= 1U << best_child;
    taken |= 1U << slot;
    for (std::size_t i = 0; i < children.size(); ++i) {
      if ((placed >> i & 1) == 0 && best_slot[i] == slot) {
        find_best(i);
      }
    }
  }
  return slots;
}

}  // namespace raymill::storage
