#include "traversal/volume/volume_kernel.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>

#include "traversal/volume/fog.h"
#include "traversal/volume/level_set.h"
#include "traversal/volume/spans.h"
#include "traversal/volume/volume_math.h"

namespace raymill::traversal {
namespace {

using storage::ChildKind;
using storage::Index3;
using storage::Volume;
using storage::VolumeKind;
using storage::VolumeNode;
using storage::VolumePageView;

VolumeKind kind_of(Query query) { return is_of_fog(query) ? VolumeKind::fog : VolumeKind::level_set; }

std::optional<std::size_t> next_volume(Query query, std::span<const Volume> volumes, std::size_t from) {
  while (from < volumes.size() && volumes[from].kind != kind_of(query)) {
    ++from;
  }
  return from < volumes.size() ? std::optional(from) : std::nullopt;
}

void stand_at(RayState& ray, std::uint32_t page, std::uint16_t item, unsigned level) {
  ray.page = page;
  ray.node = item;
  ray.level = static_cast<std::uint8_t>(level | kAmongVolumes);
}

void stand_at_root(RayState& ray, const Volume& volume) {
  stand_at(ray, volume.root_page, volume.root_node, volume.levels);
}

Index3 cube(unsigned level) {
  const std::int32_t cells = storage::cells_of_level(level);
  return {cells, cells, cells};
}

double length_of(const RayState& ray) {
  const double x = ray.dir[0], y = ray.dir[1], z = ray.dir[2];
  return std::sqrt(x * x + y * y + z * z);
}

// One ray on its way through volumes.
class Walk {
 public:
  Walk(VolumeContext& context, RayState& ray)
      : context_(context),
        ray_(ray),
        t_(std::bit_cast<double>(ray.stack.words[0])),
        value_(std::bit_cast<double>(ray.stack.words[1])),
        span_(ray.stack.words[1]) {}

  void run() {
    while (!ray_.done && step()) {
      if (context_.lone_items && !ray_.done) {
        break;
      }
    }
    const bool of_spans = context_.query == Query::spans;
    ray_.stack.words = {std::bit_cast<std::uint64_t>(t_),
                        of_spans ? span_.bits() : std::bit_cast<std::uint64_t>(value_)};
  }

 private:
  // Does what is to be done at the item where the ray stands; false: its page is not there.
  bool step() {
    const std::byte* image = context_.images[ray_.page].load(std::memory_order_acquire);
    if (image == nullptr) {
      return false;
    }
    context_.touched[ray_.page].store(1, std::memory_order_relaxed);
    context_.counters.pages_entered += ray_.page != last_page_ ? 1 : 0;
    last_page_ = ray_.page;
    const VolumePageView page(image);
    if (!enter_volume(page)) {
      return end_corrupt();
    }
    if (ray_.resume == Resume::enter) {
      begin();
      return true;
    }
    ++context_.counters.nodes_visited;
    const unsigned level = ray_.level & ~kAmongVolumes;
    return level == 0 ? visit_brick(page) : visit_node(page, level);
  }

  bool end_corrupt() {
    context_.corrupt = true;
    ray_.done = true;
    return true;
  }

  // Finds out which volume the page is of; false where it is none that the ray may be in.
  bool enter_volume(const VolumePageView& page) {
    if (page.header().page_type != storage::kPageTypeVolume || page.header().kind != storage::VolumePageKind::bricks ||
        page.header().volume >= context_.volumes.size()) {
      return false;
    }
    if (volume_ == &context_.volumes[page.header().volume]) {
      return true;
    }
    const Volume& volume = context_.volumes[page.header().volume];
    if (volume_ != nullptr && ray_.resume != Resume::enter) {
      return false;  // a reference led into another volume
    }
    if (volume.kind != kind_of(context_.query)) {
      return false;
    }
    volume_ = &volume;
    in_volume_ = VolumeRay(volume, ray_);
    way_ = in_volume_.in_box(volume.origin, volume.cells);
    way_ = {std::max(way_.begin, double(ray_.tnear)), std::min(way_.end, double(ray_.tfar))};
    loss_ = length_of(ray_) * context_.config.density_scale;
    path_.fill({});
    if (context_.query == Query::transmittance && !way_.empty()) {
      prepare_fog();
    }
    return true;
  }

  void prepare_fog() {
    if (context_.config.method == VolumeMethod::march) {
      steps_ = MarchSteps(way_, context_.config.step / length_of(ray_));
    } else if (context_.config.method == VolumeMethod::ratio) {
      key_ = mix(key_of(ray_, context_.config.seed) ^ static_cast<std::uint64_t>(volume_ - context_.volumes.data()));
    }
  }

  void begin() {
    ray_.resume = Resume::backtrack;
    t_ = way_.begin;
    const bool passes_through =
        context_.filter != nullptr && context_.filter->drops(ray_.skipped, ray_.mask, {volume_->geometry_id, 0});
    if (way_.empty() || passes_through) {
      end_volume();
    }
  }

  // Whether the ray is in the item's box, as it must be where no page is damaged.
  [[nodiscard]] std::optional<double> exit_of(const Index3& origin, unsigned level) const {
    const Interval in = in_volume_.in_box(origin, cube(level));
    return in.begin <= t_ && t_ < in.end ? std::optional(in.end) : std::nullopt;
  }

  bool visit_node(const VolumePageView& page, unsigned level) {
    if (ray_.node >= page.header().node_count || page.nodes()[ray_.node].level != level || level > volume_->levels) {
      return end_corrupt();
    }
    const VolumeNode& node = page.nodes()[ray_.node];
    const auto exit = exit_of(node.origin, level);
    if (!exit) {
      return end_corrupt();
    }
    path_[level] = {true, ray_.node, ray_.page, *exit};
    while (t_ < *exit && t_ < way_.end) {
      const std::size_t slot = slot_at(node);
      const Interval in{t_, std::min(way_.end, child_exit(node, slot))};
      if (in.empty()) {
        return end_corrupt();
      }
      if (node.kind[slot] != ChildKind::tile && needs_child(node.lower[slot], node.upper[slot])) {
        stand_at(ray_, node.page[slot], node.item[slot], level - 1);
        return true;
      }
      pass_tile(node.lower[slot], in);
      if (ray_.done || ended_) {
        ended_ = false;
        return true;
      }
      t_ = in.end;
    }
    go_up(level);
    return true;
  }

  // On: the nearest node above that the ray is still in, or the root where that is not known any more.
  void go_up(unsigned level) {
    if (!(t_ < way_.end)) {
      end_volume();
      return;
    }
    while (++level <= volume_->levels && path_[level].known) {
      if (t_ < path_[level].exit) {
        stand_at(ray_, path_[level].page, path_[level].item, level);
        return;
      }
    }
    stand_at_root(ray_, *volume_);
  }

  [[nodiscard]] std::size_t slot_at(const VolumeNode& node) const {
    const std::int32_t cells = storage::cells_of_level(node.level - 1U);
    std::size_t slot = 0;
    for (std::size_t axis = 3; axis-- > 0;) {
      slot = slot * storage::kNodeSide +
             static_cast<std::size_t>(in_volume_.part(axis, node.origin[axis], cells, storage::kNodeSide, t_));
    }
    return slot;
  }

  [[nodiscard]] double child_exit(const VolumeNode& node, std::size_t slot) const {
    const std::int32_t cells = storage::cells_of_level(node.level - 1U);
    double exit = std::numeric_limits<double>::infinity();
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto place = static_cast<std::int32_t>(slot >> (2 * axis) & 3);
      if (!in_volume_.parallel(axis)) {
        const std::int32_t index = node.origin[axis] + cells * (place + (in_volume_.forward(axis) ? 1 : 0));
        exit = std::min(exit, in_volume_.plane(axis, index));
      }
    }
    return exit;
  }

  // Whether the bounds of a child do not say all that the query asks for.
  [[nodiscard]] bool needs_child(float lower, float upper) const {
    switch (context_.query) {
      case Query::transmittance:
        return lower != upper;
      case Query::spans:
        return is_dense(lower) != is_dense(upper);
      default:
        return side_of(lower) != side_of(upper);
    }
  }
  [[nodiscard]] bool is_dense(double value) const { return value > context_.config.threshold; }

  // A part of the way where the field has one value, or is on one side of what is looked for.
  void pass_tile(double value, const Interval& in) {
    if (context_.query == Query::spans) {
      set_dense(is_dense(value), in.begin);
    } else if (context_.query != Query::transmittance) {
      if (value_ != 0 && value_ != side_of(value)) {
        const double outward = value_ > 0 ? -1 : 1;  // against the ray where it comes from outside
        storage::Point3 gradient{};
        for (std::size_t axis = 0; axis < 3; ++axis) {
          gradient[axis] = outward * in_volume_.dir(axis);
        }
        take_hit({in.begin, gradient});
        return;
      }
      value_ = side_of(value);
    } else if (value != 0) {
      switch (context_.config.method) {
        case VolumeMethod::exact:
          value_ += value * (in.end - in.begin);
          break;
        case VolumeMethod::march:
          value_ += value * (steps_.first_behind(in.end) - steps_.first_behind(in.begin)) * steps_.size();
          break;
        case VolumeMethod::ratio:
          value_ *= exp_of_minus(std::max(0.0, value * loss_ * (in.end - in.begin)));
          break;
      }
    }
  }

  bool visit_brick(const VolumePageView& page) {
    if (ray_.node >= page.header().brick_count) {
      return end_corrupt();
    }
    const storage::Brick& brick = page.bricks()[ray_.node];
    const auto exit = exit_of(brick.origin, 0);
    if (!exit) {
      return end_corrupt();
    }
    const BrickCells cells(page, brick, storage::step_of(*volume_), in_volume_);
    const Interval in{t_, std::min(*exit, way_.end)};
    if (context_.query == Query::transmittance) {
      pass_fog(cells, brick, in);
    } else if (context_.query == Query::spans) {
      each_side(cells, in, context_.config.threshold, [this](bool dense, double t) { set_dense(dense, t); });
    } else if (const auto crossing = first_crossing(cells, in, value_)) {
      take_hit(*crossing);
      ended_ = false;
      return true;
    }
    t_ = in.end;
    go_up(0);
    return true;
  }

  void pass_fog(const BrickCells& cells, const storage::Brick& brick, const Interval& in) {
    switch (context_.config.method) {
      case VolumeMethod::exact:
        value_ += integrate(cells, in);
        break;
      case VolumeMethod::march:
        value_ += steps_.sum(cells, in);
        break;
      case VolumeMethod::ratio:
        value_ *= track(cells, brick, in, loss_, context_.config.majorant, key_);
        break;
    }
  }

  [[nodiscard]] float in_interval(double t) const { return std::clamp(static_cast<float>(t), ray_.tnear, ray_.tfar); }

  // From t on the fog is denser than the threshold, or not.
  void set_dense(bool dense, double t) {
    if (dense == span_.is_open()) {
      return;
    }
    if (!dense) {
      span_.leave(in_interval(t));
    } else if (!span_.enter(in_interval(t))) {
      give_span();
      span_.enter(in_interval(t));
    }
  }

  void give_span() {
    if (span_.exists()) {
      Hit hit;
      hit.t = span_.begin();
      hit.u = span_.end();
      hit.geometry_id = volume_->geometry_id;
      hit.primitive_id = 0;
      context_.crossings->add({ray_.number, hit});
      ray_.has_hit = true;
      span_ = {};
    }
  }

  // The first crossing of a volume is the nearest, and the end of the ray's way through it.
  void take_hit(const SurfaceCrossing& crossing) {
    const float t = in_interval(crossing.t);
    const PrimitiveIds ids{volume_->geometry_id, 0};
    ended_ = true;
    if (context_.query == Query::any) {
      ray_.hit.t = 0;
      ray_.has_hit = true;
      ray_.done = true;
      return;
    }
    if (!ray_.has_hit || t < ray_.tfar || ids < PrimitiveIds{ray_.hit.geometry_id, ray_.hit.primitive_id}) {
      ray_.hit = {};
      ray_.hit.t = ray_.tfar = t;
      ray_.hit.geometry_id = ids.geometry_id;
      ray_.hit.primitive_id = ids.primitive_id;
      ray_.has_hit = true;
      if (context_.need_normal) {
        ray_.hit.normal = normal_of(crossing.gradient);
      }
    }
    end_volume();
  }

  // In world space: gradients go by the transpose of the map from there.
  [[nodiscard]] std::array<float, 3> normal_of(const storage::Point3& gradient) const {
    storage::Point3 n{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      for (std::size_t row = 0; row < 3; ++row) {
        n[axis] += volume_->index_from_world[row][axis] * gradient[row];
      }
    }
    const double length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    return length > 0 ? std::array<float, 3>{float(n[0] / length), float(n[1] / length), float(n[2] / length)}
                      : std::array<float, 3>{};
  }

  void end_volume() {
    const auto index = static_cast<std::size_t>(volume_ - context_.volumes.data());
    const bool is_fog = context_.query == Query::transmittance;
    if (context_.query == Query::spans) {
      set_dense(false, way_.end);
      give_span();
    }
    const auto next = next_volume(context_.query, context_.volumes, index + 1);
    if (next) {
      ray_.resume = Resume::enter;
      value_ = is_fog ? value_ : 0;
      t_ = 0;
      stand_at_root(ray_, context_.volumes[*next]);
      return;
    }
    ray_.done = true;
    if (is_fog) {
      const double depth = value_ * loss_;
      const double transmittance = context_.config.method == VolumeMethod::ratio ? value_
                                   : depth > 0                                   ? exp_of_minus(depth)
                                                                                 : 1 / exp_of_minus(-depth);
      ray_.hit.t = static_cast<float>(transmittance);
    }
  }

  VolumeContext& context_;
  RayState& ray_;
  double t_;
  /// Fog: the integral of density so far, in lengths of dir; ratio: the transmittance. Level sets: the side, 0 unknown.
  double value_;
  SpanInHand span_;     ///< in the place of value_, where spans are asked for
  bool ended_ = false;  // a tile ended the way through the volume
  const Volume* volume_ = nullptr;
  VolumeRay in_volume_;
  Interval way_;
  double loss_ = 0;
  MarchSteps steps_;
  std::uint64_t key_ = 0;
  std::uint32_t last_page_ = 0xFFFFFFFFU;
  // Nodes that the ray came down through in this run.
  struct Above {
    bool known = false;
    std::uint16_t item = 0;
    std::uint32_t page = 0;
    double exit = 0;
  };
  std::array<Above, storage::kMostVolumeLevels + 1> path_{};  // [level]
};

}  // namespace

bool looks_at(Query query, std::span<const Volume> volumes) {
  const bool asks = is_of_fog(query) || query == Query::closest || query == Query::any;
  return asks && next_volume(query, volumes, 0).has_value();
}

void begin_volumes(Query query, const VolumeConfig& config, std::span<const Volume> volumes, RayState& ray) {
  const Volume& first = volumes[*next_volume(query, volumes, 0)];
  ray.resume = Resume::enter;
  ray.left = {};
  const bool ratio = query == Query::transmittance && config.method == VolumeMethod::ratio;
  ray.stack.words = {0, std::bit_cast<std::uint64_t>(ratio ? 1.0 : 0.0)};
  stand_at_root(ray, first);
  ray.done = false;
}

void run_volumes(VolumeContext& context, std::span<RayState> rays) {
  for (RayState& ray : rays) {
    if (!ray.done && is_among_volumes(ray)) {
      Walk(context, ray).run();
    }
  }
}

}  // namespace raymill::traversal
