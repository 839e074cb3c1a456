#include "client/cli/ray_maker.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include "client/cli/interrupt.h"
#include "client/cli/sampling.h"
#include "storage/base/quotes.h"

namespace raymill::client {

namespace {

constexpr std::pair<std::string_view, RayKind> kKinds[] = {{"primary", RayKind::primary},
                                                           {"ao", RayKind::ao},
                                                           {"bounce", RayKind::bounce},
                                                           {"random", RayKind::random},
                                                           {"shadow", RayKind::shadow}};

// Salts that keep the draws of one place apart.
constexpr std::uint64_t kPixelSalt = 1, kHitSalt = 2, kSegmentSalt = 3;

double diagonal_of(const StoreInfo& info) {
  double sum = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const double side = std::max(0.0, double(info.bounds_max[axis]) - info.bounds_min[axis]);
    sum += side * side;
  }
  return std::sqrt(sum);
}

}  // namespace

Result<RayKind> parse_ray_kind(std::string_view name) {
  for (const auto& [its_name, kind] : kKinds) {
    if (its_name == name) {
      return kind;
    }
  }
  return Status(ErrorCode::invalid_argument,
                in_quotes(name) + " is not a kind of rays; primary, ao, bounce, random and shadow are");
}

std::string_view to_string(RayKind kind) {
  return std::find_if(std::begin(kKinds), std::end(kKinds), [kind](const auto& its) { return its.second == kind; })
      ->first;
}

Query query_of(RayKind kind) { return kind == RayKind::shadow || kind == RayKind::ao ? Query::any : Query::closest; }

Extent picture_of(std::uint64_t count) {
  const auto width = static_cast<std::uint32_t>(std::ceil(std::sqrt(static_cast<double>(count) * 16 / 9)));
  const auto height = static_cast<std::uint32_t>((count + width - 1) / width);
  return {std::max(1U, width), std::max(1U, height)};
}

RayMaker::RayMaker(const RayOrder& order, const StoreInfo& info, const Camera& camera)
    : order_(order), info_(info), camera_(camera), extent_(picture_of(order.count)), diagonal_(diagonal_of(info)) {}

// The ray through pixel `index` of the first pass at its centre, of later ones at a place of its own.
Ray RayMaker::primary(std::uint64_t index, std::uint64_t pass) const {
  Random random(mix(order_.seed, mix(kPixelSalt, pass), index));
  const double dx = pass == 0 ? 0.5 : random.unit(), dy = pass == 0 ? 0.5 : random.unit();
  const std::uint64_t row = index / extent_.width;
  return camera_.ray(static_cast<double>(index % extent_.width) + dx, static_cast<double>(row) + dy, extent_);
}

// A segment between two points of the bounds: t = 1 is its end.
Ray RayMaker::segment(std::uint64_t index) const {
  Random random(mix(order_.seed, kSegmentSalt, index));
  Ray ray;
  for (int axis = 0; axis < 3; ++axis) {
    ray.org[axis] = random.range(info_.bounds_min[axis], info_.bounds_max[axis]);
  }
  for (int axis = 0; axis < 3; ++axis) {
    ray.dir[axis] = random.range(info_.bounds_min[axis], info_.bounds_max[axis]) - ray.org[axis];
  }
  ray.tfar = 1;
  return ray;
}

// What leaves the place where `ray` hit.
Ray RayMaker::secondary(const Ray& ray, const Hit& hit, std::uint64_t index, std::uint64_t pass) const {
  Random random(mix(order_.seed, mix(kHitSalt, pass), index));
  const Surface surface = surface_of(ray, hit);
  Ray next{.org = surface.origin};
  if (order_.kind == RayKind::shadow) {
    // To a square light over the scene, a fifth of the diagonal wide; t = 1 is the light.
    for (int axis = 0; axis < 3; ++axis) {
      const double centre = 0.5 * (double(info_.bounds_min[axis]) + info_.bounds_max[axis]);
      const double above = axis == 1 ? 0.75 * diagonal_ : (random.unit() - 0.5) * 0.2 * diagonal_;
      next.dir[axis] = static_cast<float>(centre + above) - next.org[axis];
    }
    next.tfar = 1;
    return next;
  }
  next.dir = cosine_direction(surface.normal, random);
  if (order_.kind == RayKind::ao) {
    next.tfar = static_cast<float>(order_.radius > 0 ? order_.radius : 0.1 * diagonal_);
  }
  return next;
}

// Rays that need no hit.
Status RayMaker::make_direct(std::span<Ray> buffer, const Sink& sink, const Observer& observer) const {
  for (std::uint64_t first = 0; first < order_.count;) {
    const auto step = static_cast<std::size_t>(std::min<std::uint64_t>(buffer.size(), order_.count - first));
    for (std::size_t i = 0; i < step; ++i) {
      buffer[i] = order_.kind == RayKind::random ? segment(first + i) : primary(first + i, 0);
    }
    RAYMILL_RETURN_IF_ERROR(sink(buffer.first(step)));
    first += step;
    observer(static_cast<double>(first) / static_cast<double>(order_.count), first, 0);
    if (interrupted()) {
      return interrupted_status();
    }
  }
  return {};
}

// Rays that leave the hits of primary rays: passes over the picture until there are enough.
Status RayMaker::make_secondary(Store& store, std::span<Ray> buffer, const Sink& sink, const Observer& observer,
                                RunStats& stats) const {
  const TraceConfig config{.fields = Field::t | Field::normal, .relative = true};
  std::uint64_t missing = order_.count;
  for (std::uint64_t pass = 0; missing > 0; ++pass) {
    RAYMILL_ASSIGN_OR_RETURN(const std::unique_ptr<Job> job, store.trace(config));
    const std::uint64_t missing_before = missing;
    std::uint64_t next = 0;
    BatchTimes times;
    const Status status = run_batch(
        *job,
        [&]() -> Result<std::span<const Ray>> {
          const auto step = static_cast<std::size_t>(std::min<std::uint64_t>(buffer.size(), order_.count - next));
          for (std::size_t i = 0; i < step; ++i) {
            buffer[i] = primary(next++, pass);
          }
          return std::span<const Ray>(buffer).first(step);
        },
        [&](const HitChunk& chunk) -> Status {
          for (std::size_t i = 0; i < chunk.size() && missing > 0; ++i) {
            const Hit hit = chunk.hit(i);
            if (std::isfinite(hit.t)) {
              const std::uint64_t index = chunk.first_ray() + i;
              const Ray ray = secondary(primary(index, pass), hit, index, pass);
              RAYMILL_RETURN_IF_ERROR(sink(std::span(&ray, 1)));
              --missing;
            }
          }
          return {};
        },
        [&](const JobProgress& state) {
          const double share = static_cast<double>(state.rays_done) / static_cast<double>(order_.count);
          observer(std::min(share, 1.0), state.rays_done, state.bytes_read);
        },
        times);
    RAYMILL_RETURN_IF_ERROR(status);
    stats.add(job->stats());
    if (missing == missing_before) {
      return {ErrorCode::invalid_argument, "the camera sees nothing of the scene; choose another with --camera"};
    }
  }
  return {};
}

Status RayMaker::make(Store& store, std::span<Ray> buffer, const Sink& sink, const Observer& observer,
                      RunStats& stats) const {
  const bool is_direct = order_.kind == RayKind::primary || order_.kind == RayKind::random;
  return is_direct ? make_direct(buffer, sink, observer) : make_secondary(store, buffer, sink, observer, stats);
}

}  // namespace raymill::client
