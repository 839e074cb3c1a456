// Timeline: what each worker and each read did when, in a file that Perfetto (ui.perfetto.dev) opens. Public.
//
// Chrome trace events as JSON, written as they come; nothing grows with the run. Lanes are threads: a lane's spans do
// not overlap. Reads overlap each other, so they are asynchronous events under their page's number. Thread-safe.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "storage/base/status.h"

namespace raymill {

class Timeline {
 public:
  using Clock = std::chrono::steady_clock;

  /// Errors: those of a file that cannot be written.
  static Result<std::shared_ptr<Timeline>> create(const std::string& path);
  ~Timeline();
  Timeline(const Timeline&) = delete;
  Timeline& operator=(const Timeline&) = delete;

  void name_lane(unsigned lane, std::string_view name);
  /// `amount` of `unit` was handled from `begin` to now.
  void span(unsigned lane, std::string_view name, Clock::time_point begin, std::string_view unit, std::uint64_t amount);
  void read(std::uint32_t page, Clock::time_point begin, Clock::time_point end, std::uint64_t bytes);
  /// A value over time.
  void counter(std::string_view name, std::uint64_t value);

  /// Gives the file its name; later events are lost. The first error of the whole run: disk_full, io.
  Status finish();

 private:
  class Impl;
  explicit Timeline(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace raymill
