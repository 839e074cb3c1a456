#include "storage/pages/proxy_maker.h"

#include <algorithm>
#include <bitset>
#include <cmath>
#include <utility>

#include "storage/pages/box_quantizer.h"
#include "storage/pages/page_image.h"

namespace raymill::storage {
namespace {

using Corner = std::array<float, 3>;

using Point = std::array<double, 3>;

Point point(const Vec3f& v) { return {v.x, v.y, v.z}; }

// Which of a grid of lines along an axis, through the box' face, meet a triangle.
class Shadow {
 public:
  static constexpr int kSide = 16;

  Shadow(std::size_t axis, const Point& lower, const Point& upper) : u_((axis + 1) % 3), v_((axis + 2) % 3) {
    low_ = {lower[u_], lower[v_]};
    scale_ = {kSide / (upper[u_] - lower[u_]), kSide / (upper[v_] - lower[v_])};
    flat_ = !std::isfinite(scale_[0]) || !std::isfinite(scale_[1]);
  }

  void add(const std::array<Point, 3>& corners) {
    if (flat_) {
      return;
    }
    // In steps of the grid; its lines stand at whole numbers and a half.
    std::array<double, 3> x{}, y{};
    for (std::size_t k = 0; k < 3; ++k) {
      x[k] = (corners[k][u_] - low_[0]) * scale_[0];
      y[k] = (corners[k][v_] - low_[1]) * scale_[1];
    }
    const auto [x_least, x_most] = std::minmax({x[0], x[1], x[2]});
    const auto [y_least, y_most] = std::minmax({y[0], y[1], y[2]});
    for (int j = first(y_least); j <= last(y_most); ++j) {
      for (int i = first(x_least); i <= last(x_most); ++i) {
        const std::size_t bit = static_cast<std::size_t>(j * kSide + i);
        if (!met_[bit] && inside(x, y, i + 0.5, j + 0.5)) {
          met_.set(bit);
        }
      }
    }
  }
  [[nodiscard]] double share() const { return static_cast<double>(met_.count()) / (kSide * kSide); }

 private:
  static int first(double least) { return std::max(0, static_cast<int>(std::ceil(least - 0.5))); }
  static int last(double most) { return std::min(kSide - 1, static_cast<int>(std::floor(most - 0.5))); }
  static bool inside(const std::array<double, 3>& x, const std::array<double, 3>& y, double px, double py) {
    bool below = false, above = false;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t next = (k + 1) % 3;
      const double side = (x[next] - x[k]) * (py - y[k]) - (y[next] - y[k]) * (px - x[k]);
      below = below || side < 0;
      above = above || side > 0;
    }
    return !(below && above);
  }

  std::size_t u_, v_;
  std::array<double, 2> low_{}, scale_{};
  bool flat_ = false;
  std::bitset<kSide * kSide> met_;
};

class Summary {
 public:
  Summary(const WideTree& tree, const Aabb& box)
      : tree_(tree),
        lower_(point(box.lower)),
        shadows_{Shadow(0, lower_, point(box.upper)), Shadow(1, lower_, point(box.upper)),
                 Shadow(2, lower_, point(box.upper))} {}

  void add_below(std::uint32_t index) {
    const WideNode& node = tree_.nodes[index];
    for (unsigned slot = 0; slot < tree_.width; ++slot) {
      if (node.has(slot) && node.is_leaf(slot)) {
        for (std::uint32_t t = node.child[slot]; t < node.child[slot] + node.count[slot]; ++t) {
          add(tree_.triangles[t]);
        }
      } else if (node.is_inner(slot)) {
        add_below(node.child[slot]);
      }
    }
  }

  // `exact`: of the box that the shadows fill; `faces`: of the one that rays meet.
  [[nodiscard]] Proxy proxy(const std::array<double, 3>& exact, const std::array<double, 3>& faces) const {
    Proxy proxy;
    const double all = faces[0] + faces[1] + faces[2];
    std::array<double, 3> root{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      root[axis] = std::sqrt(area_ * moments_[axis][axis]);
      proxy.area[axis] = to_half_digits(all > 0 ? root[axis] / all : 0);
      const double covered = faces[axis] > 0 ? shadows_[axis].share() * (exact[axis] / faces[axis]) : 0;
      proxy.coverage[axis] = static_cast<std::uint8_t>(std::lround(255 * std::clamp(covered, 0.0, 1.0)));
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::size_t a = (axis + 1) % 3, b = (axis + 2) % 3;
      const double product = root[a] * root[b];
      proxy.mixed[axis] = rounded(product > 0 ? area_ * moments_[a][b] / product : 0);
    }
    constexpr double kLeastMean = 1.0 / 64;  // of all normals alike
    Point mean = sum_;
    if (!(length(mean) > kLeastMean * area_)) {
      mean = largest_normal_;
    }
    const double norm = length(mean);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      proxy.normal[axis] = rounded(norm > 0 ? mean[axis] / norm : axis == 2 ? 1 : 0);
    }
    proxy.several = several_ ? 1 : 0;
    proxy.geometry_id = largest_->geometry_id;
    proxy.primitive_id = largest_->primitive_id;
    return proxy;
  }

 private:
  static double length(const Point& p) { return std::sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]); }
  static std::int8_t rounded(double share) {
    return static_cast<std::int8_t>(std::lround(127 * std::clamp(share, -1.0, 1.0)));
  }

  void add(const Triangle& triangle) {
    const std::array<Point, 3> corners{point(triangle.v[0]), point(triangle.v[1]), point(triangle.v[2])};
    Point a{}, b{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      a[axis] = corners[1][axis] - corners[0][axis];
      b[axis] = corners[2][axis] - corners[0][axis];
    }
    const Point cross{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
    const double twice = length(cross);
    for (std::size_t i = 0; i < 3; ++i) {
      sum_[i] += cross[i] / 2;
      for (std::size_t k = 0; k < 3 && twice > 0; ++k) {
        moments_[i][k] += cross[i] * (cross[k] / (2 * twice));  // area n n^T
      }
    }
    area_ += twice / 2;
    if (largest_ == nullptr || twice > largest_twice_) {
      largest_ = &triangle;
      largest_twice_ = twice;
      largest_normal_ = cross;
    }
    several_ = several_ || triangle.geometry_id != largest_->geometry_id;
    for (Shadow& shadow : shadows_) {
      shadow.add(corners);
    }
  }

  const WideTree& tree_;
  Point lower_;
  std::array<Shadow, 3> shadows_;
  double area_ = 0, largest_twice_ = 0;
  std::array<Point, 3> moments_{};
  Point sum_{}, largest_normal_{};
  const Triangle* largest_ = nullptr;
  bool several_ = false;
};

Corner corner(const Vec3f& v) { return {v.x, v.y, v.z}; }

// What the slot's box decodes to in a page.
std::pair<Corner, Corner> decoded_box(const WideNode& node, unsigned width, unsigned slot) {
  const Aabb all = node_box(node, width);
  Corner lower{}, upper{};
  for (int axis = 0; axis < 3; ++axis) {
    const AxisFrame frame = choose_frame(all.lower[axis], all.upper[axis]);
    const float scale = power_of_two(frame.exponent);
    const auto low = quantize_lower(frame, node.boxes[slot].lower[axis]);
    const auto high = quantize_upper(frame, node.boxes[slot].upper[axis]);
    const auto at = static_cast<std::size_t>(axis);  // what cannot be quantised is refused where the page is made
    lower[at] = decode_plane(frame.base, scale, low.value_or(0));
    upper[at] = decode_plane(frame.base, scale, high.value_or(255));
  }
  return {lower, upper};
}

Proxy make_proxy(const WideTree& tree, const WideNode& node, unsigned slot) {
  const Aabb& box = node.boxes[slot];
  Summary summary(tree, box);
  summary.add_below(node.child[slot]);
  const auto [lower, upper] = decoded_box(node, tree.width, slot);
  return summary.proxy(face_areas(corner(box.lower), corner(box.upper)), face_areas(lower, upper));
}

}  // namespace

ProxyTable::ProxyTable(const WideTree& tree, const PagePlan& plan, const ForEach& for_each) {
  for (std::uint32_t node = 0; node < tree.nodes.size(); ++node) {
    for (unsigned slot = 0; slot < tree.width; ++slot) {
      if (tree.nodes[node].is_inner(slot) && plan.page_of[node] != plan.page_of[tree.nodes[node].child[slot]]) {
        keys_.push_back(key_of(node, slot));
      }
    }
  }
  proxies_.resize(keys_.size());
  for_each(keys_.size(), [&](std::size_t i) {
    const WideNode& node = tree.nodes[keys_[i] / kMaxWidth];
    proxies_[i] = make_proxy(tree, node, static_cast<unsigned>(keys_[i] % kMaxWidth));
  });
}

const Proxy* ProxyTable::find(std::uint32_t node, unsigned slot) const {
  const auto at = std::lower_bound(keys_.begin(), keys_.end(), key_of(node, slot));
  return at != keys_.end() && *at == key_of(node, slot) ? &proxies_[static_cast<std::size_t>(at - keys_.begin())]
                                                        : nullptr;
}

}  // namespace raymill::storage
