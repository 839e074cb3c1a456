// Whether what a job asks for makes sense, whatever the store. Errors: invalid_argument, which says why it does not.
#pragma once

#include "storage/base/status.h"
#include "traversal/query.h"
#include "traversal/service.h"

namespace raymill::traversal {

Status check(const TraceConfig& config);
/// Of a job with a tolerance.
Status check_tolerance(const TraceConfig& config);
/// Of a job that asks for attributes.
Status check_attribute_query(const TraceConfig& config);
/// Of a job for fog.
Status check(const VolumeConfig& config);

}  // namespace raymill::traversal
