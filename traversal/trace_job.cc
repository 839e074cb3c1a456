#include "traversal/trace_job.h"

#include <cmath>
#include <utility>

namespace raymill::traversal {

namespace {

HitFilter filter_of(const TraceConfig& config) {
  HitFilter filter{.skips = config.skips, .mask = config.mask, .geometry_masks = {}};
  if (config.geometry_masks) {
    filter.geometry_masks = *config.geometry_masks;
  }
  return filter;
}

}  // namespace

TraceJob::TraceJob(Setup setup)
    : config(setup.config),
      filter(filter_of(config)),
      tolerance{config.tolerance, config.tolerance_angle},
      kernel(setup.kernel),
      expanded_kernel(setup.expanded_kernel),
      kernel_name(std::move(setup.kernel_name)),
      most_in_flight(setup.most_in_flight),
      future_demand(std::move(setup.future_demand)),
      start_page(setup.start_page),
      among_volumes(setup.among_volumes),
      crossings_claim(std::move(setup.crossings_claim)),
      crossings(std::move(setup.crossings)),
      waiting(std::move(setup.waiting)),
      window(std::move(setup.window)),
      fresh(std::move(setup.fresh)) {}

bool TraceJob::valid(const Ray& ray) {
  bool zero = true;
  for (int axis = 0; axis < 3; ++axis) {
    if (!std::isfinite(ray.org[axis]) || !std::isfinite(ray.dir[axis])) {
      return false;
    }
    zero = zero && ray.dir[axis] == 0;
  }
  return !zero && ray.tnear <= ray.tfar;  // false for NaN
}

bool TraceJob::place_for_one() const {
  return window->room() > 0 && in_flight() < most_in_flight && waiting->has_extents_left();
}

bool TraceJob::place_for_many() const {
  return in_flight() <= most_in_flight - most_in_flight / 4 && window->can_begin_many() && waiting->has_extents_left();
}

}  // namespace raymill::traversal
