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
    for (unsigned slot = 0; slot < width; ++slot) {
      for (unsigned bit = 0; bit < bits; ++bit) {
        const double offset = center(children[i], axes[bit]) - center(box, axes[bit]);
        gain[i][slot] += (slot >> bit & 1) != 0 ? offset : -offset;
      }
    }
  }
  std::array<unsigned, kMaxWidth> slots{};
  unsigned placed = 0, taken = 0;
  for (std::size_t step = 0; step < children.size(); ++step) {
    double best = -std::numeric_limits<double>::infinity();
    std::size_t best_child = 0;
    unsigned best_slot = 0;
    for (std::size_t i = 0; i < children.size(); ++i) {
      for (unsigned slot = 0; slot < width; ++slot) {
        if ((placed >> i & 1) == 0 && (taken >> slot & 1) == 0 && gain[i][slot] > best) {
          best = gain[i][slot];
          best_child = i;
          best_slot = slot;
        }
      }
    }
    slots[best_child] = best_slot;
    placed |= 1U << best_child;
    taken |= 1U << best_slot;
  }
  return slots;
}

}  // namespace raymill::storage
