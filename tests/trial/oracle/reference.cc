#include "tests/trial/oracle/reference.h"

#include <algorithm>
#include <numeric>

namespace raymill::trial {
namespace {

using storage::Aabb;
using storage::Vec3f;

constexpr std::uint32_t kLeafTriangles = 4;
// Three roundings of 2^-53 each; this is a thousand times as much.
constexpr double kMargin = 0x1p-42;

struct Entry {
  bool meets = false;
  double t = 0;
};

// The slab test in float64. A zero component of dir constrains nothing but the origin, which is compared exactly.
Entry enter(const Ray& ray, const Aabb& box, double limit) {
  double entry = -std::numeric_limits<double>::infinity(), exit = limit;
  for (int axis = 0; axis < 3; ++axis) {
    const double org = ray.org[axis], dir = ray.dir[axis];
    if (dir == 0) {
      if (org < box.lower[axis] || org > box.upper[axis]) {
        return {};
      }
      continue;
    }
    double near = (box.lower[axis] - org) / dir, far = (box.upper[axis] - org) / dir;
    if (dir < 0) {
      std::swap(near, far);
    }
    entry = std::max(entry, near - std::fabs(near) * kMargin);
    exit = std::min(exit, far + std::fabs(far) * kMargin);
  }
  return {entry <= exit, entry};
}

double centre(const storage::Triangle& triangle, int axis) {
  const Aabb box = bounds(triangle);
  return double(box.lower[axis]) + box.upper[axis];
}

}  // namespace

Reference::Reference(std::span<const storage::Triangle> triangles) : triangles_(triangles), order_(triangles.size()) {
  std::iota(order_.begin(), order_.end(), 0U);
  nodes_.reserve(triangles.size());
  nodes_.emplace_back();
  if (!triangles.empty()) {
    split(0, 0, static_cast<std::uint32_t>(triangles.size()));
  }
}

void Reference::split(std::uint32_t node, std::uint32_t first, std::uint32_t last) {
  Aabb box, centres;
  for (std::uint32_t i = first; i < last; ++i) {
    const Aabb triangle = bounds(triangles_[order_[i]]);
    box.grow(triangle);
    centres.grow(Vec3f{triangle.lower.x / 2 + triangle.upper.x / 2, triangle.lower.y / 2 + triangle.upper.y / 2,
                       triangle.lower.z / 2 + triangle.upper.z / 2});
  }
  nodes_[node].box = box;
  if (last - first <= kLeafTriangles) {
    nodes_[node].first = first;
    nodes_[node].count = last - first;
    return;
  }
  int axis = 0;
  for (int other = 1; other < 3; ++other) {
    if (centres.upper[other] - centres.lower[other] > centres.upper[axis] - centres.lower[axis]) {
      axis = other;
    }
  }
  const std::uint32_t middle = first + (last - first) / 2;
  std::nth_element(
      order_.begin() + first, order_.begin() + middle, order_.begin() + last,
      [&](std::uint32_t a, std::uint32_t b) { return centre(triangles_[a], axis) < centre(triangles_[b], axis); });
  const auto children = static_cast<std::uint32_t>(nodes_.size());
  nodes_[node].first = children;
  nodes_.emplace_back();
  nodes_.emplace_back();
  split(children, first, middle);
  split(children + 1, middle, last);
}

Candidate Reference::judge(const Ray& ray, std::uint32_t triangle) const {
  Candidate candidate{triangle, meet(ray, triangles_[triangle])};
  Meeting& meeting = candidate.meeting;
  if (!meeting.possible()) {
    return candidate;
  }
  // An answer's t is a float32 that may be off by 4 ulp: so near an end of the interval either answer is right.
  const double t = double(meeting.t), margin = 4 * ulp32(t) + meeting.t_error;
  if (t < ray.tnear - margin || t > ray.tfar + margin) {
    meeting.hit = meeting.near = false;
    return candidate;
  }
  candidate.inside = meeting.hit && meeting.t >= ray.tnear && meeting.t <= ray.tfar;
  candidate.certain = meeting.hit && !meeting.near && t > ray.tnear + margin && t < ray.tfar - margin;
  return candidate;
}

void Reference::collect(const Ray& ray, std::vector<Candidate>& found) const {
  found.clear();
  struct Pending {
    std::uint32_t node;
    double t;
  };
  constexpr int kDepth = 64;  // halves each time, so 2^32 triangles need 32
  Pending stack[kDepth];
  int size = 0;
  double limit = std::numeric_limits<double>::infinity();
  if (const Entry root = enter(ray, nodes_[0].box, limit); root.meets && !triangles_.empty()) {
    stack[size++] = {0, root.t};
  }
  while (size > 0) {
    const Pending at = stack[--size];
    const Node& node = nodes_[at.node];
    if (at.t > limit) {
      continue;
    }
    if (node.count > 0) {
      for (std::uint32_t i = node.first; i < node.first + node.count; ++i) {
        const Candidate candidate = judge(ray, order_[i]);
        if (candidate.meeting.possible()) {
          found.push_back(candidate);
          if (candidate.certain) {
            // What lies within rounding of the first hit may be answered in its place.
            const double t = double(candidate.meeting.t);
            limit = std::min(limit, t + 16 * ulp32(t) + 4 * candidate.meeting.t_error);
          }
        }
      }
      continue;
    }
    Pending left{node.first, 0}, right{node.first + 1, 0};
    const Entry l = enter(ray, nodes_[left.node].box, limit), r = enter(ray, nodes_[right.node].box, limit);
    left.t = l.t;
    right.t = r.t;
    if (l.meets && r.meets && l.t < r.t) {
      std::swap(left, right);  // the nearer one comes off the stack first
      stack[size++] = left;
      stack[size++] = right;
      continue;
    }
    if (l.meets) {
      stack[size++] = left;
    }
    if (r.meets) {
      stack[size++] = right;
    }
  }
}

}  // namespace raymill::trial
