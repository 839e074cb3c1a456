// The least future demand: waiting rays say, by the children that they still have to visit, where they go next, so the
// page that the fewest of them name goes. What Belady's rule does with the whole future, this does with the part that
// is known. Among equals the clock's choice: those not entered since the hand last passed.
//
// Not all frames are looked at but kLooked pages that may go, from the hand on: the least of so many is among the
// lowest few percent of all, at a cost that does not grow with the memory. Thread-confined.
#pragma once

#include "storage/cache/eviction.h"

namespace raymill::storage {

class DemandEviction final : public Eviction {
 public:
  static constexpr std::uint32_t kLooked = 64;

  std::optional<std::uint32_t> choose(std::span<const PageId> page_in_frame, const PageDemand& demand,
                                      std::atomic<std::uint8_t>* touched) override;

 private:
  std::uint32_t hand_ = 0;
};

}  // namespace raymill::storage
