#include "storage/cache/eviction.h"

#include "storage/cache/clock_eviction.h"
#include "storage/cache/demand_eviction.h"

namespace raymill::storage {

std::string_view to_string(EvictionKind kind) { return kind == EvictionKind::clock ? "clock" : "demand"; }

Result<EvictionKind> parse_eviction(const std::string& name) {
  for (const EvictionKind kind : {EvictionKind::clock, EvictionKind::demand}) {
    if (name == to_string(kind)) {
      return kind;
    }
  }
  return {ErrorCode::invalid_argument, "eviction '" + name + "' is none of clock and demand"};
}

std::unique_ptr<Eviction> make_eviction(EvictionKind kind) {
  if (kind == EvictionKind::clock) {
    return std::make_unique<ClockEviction>();
  }
  return std::make_unique<DemandEviction>();
}

}  // namespace raymill::storage
