#include "traversal/trace_checks.h"

#include <cmath>

namespace raymill::traversal {

Status check(const TraceConfig& config) {
  if (config.fields == Field::none) {
    return {ErrorCode::invalid_argument, "a job needs at least one field"};
  }
  if (has(config.fields, Field::count) && config.query != Query::count) {
    return {ErrorCode::invalid_argument, "only the query count answers the field count"};
  }
  if (has(config.fields, Field::transmittance) && config.query != Query::transmittance) {
    return {ErrorCode::invalid_argument, "only the query transmittance answers the field transmittance"};
  }
  if (!config.geometry_masks && (config.masks || config.mask != kAllMask)) {
    return {ErrorCode::invalid_argument, "masks of rays need masks of geometries to be held against"};
  }
  if (has(config.fields, Field::t_leave) && config.query != Query::spans) {
    return {ErrorCode::invalid_argument, "only the query spans answers the field t_leave"};
  }
  if (config.first != 0 && !gives_lists(config.query)) {
    return {ErrorCode::invalid_argument,
            "only the queries all and spans give the first ones of a ray; closest gives the first hit"};
  }
  return {};
}

Status check_tolerance(const TraceConfig& config) {
  const auto fits = [](double value) { return value >= 0 && std::isfinite(value); };
  if (!fits(config.tolerance) || !fits(config.tolerance_angle)) {
    return {ErrorCode::invalid_argument, "a tolerance is a finite number, 0 or more"};
  }
  if (config.query != Query::closest && config.query != Query::any) {
    return {ErrorCode::invalid_argument, "only the queries closest and any are answered within a tolerance"};
  }
  if (config.mode == Mode::exact) {
    return {ErrorCode::invalid_argument,
            "mode exact gives no answers within a tolerance; use watertight or fast, or leave the tolerance out"};
  }
  return {};
}

Status check_attribute_query(const TraceConfig& config) {
  if (config.query != Query::closest) {
    return {ErrorCode::invalid_argument, "only the query closest answers the fields " +
                                             to_string(config.fields & Field::attributes) +
                                             "; leave them out, or ask it"};
  }
  if (config.tolerance != 0 || config.tolerance_angle != 0) {
    return {ErrorCode::invalid_argument, "hits within a tolerance lie on no triangle, so they have no " +
                                             to_string(config.fields & Field::attributes) +
                                             "; leave out the fields, or the tolerance"};
  }
  return {};
}

Status check(const VolumeConfig& config) {
  const auto positive = [](double value) { return value > 0 && std::isfinite(value); };
  if (config.method == VolumeMethod::march && !positive(config.step)) {
    return {ErrorCode::invalid_argument, "marching takes a step above 0, in scene units"};
  }
  if (!positive(config.density_scale) || !(config.majorant >= 1 && std::isfinite(config.majorant))) {
    return {ErrorCode::invalid_argument, "a density scale is above 0, a majorant at least 1 times the least"};
  }
  if (!std::isfinite(config.threshold)) {
    return {ErrorCode::invalid_argument, "a threshold is a number that voxels may hold"};
  }
  return {};
}

}  // namespace raymill::traversal
