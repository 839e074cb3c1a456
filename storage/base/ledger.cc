#include "storage/base/ledger.h"

#include <algorithm>
#include <cassert>
#include <cstdio>
#include <cstring>
#include <memory>
#include <string>

namespace raymill::storage {

std::string_view to_string(Tag tag) {
  switch (tag) {
    case Tag::base:
      return "base";
    case Tag::directory:
      return "directory";
    case Tag::pages:
      return "pages";
    case Tag::decode:
      return "decode";
    case Tag::io:
      return "io";
    case Tag::rays:
      return "rays";
    case Tag::results:
      return "results";
    case Tag::build:
      return "build";
    case Tag::transport:
      return "transport";
    case Tag::count:
      break;
  }
  return "unknown";
}

BudgetReservation::~BudgetReservation() {
  if (ledger_ != nullptr) {
    (void)ledger_->change(tag_, bytes_, 0);
  }
}

Status BudgetReservation::resize(std::uint64_t bytes) {
  assert(ledger_ != nullptr);
  RAYMILL_RETURN_IF_ERROR(ledger_->change(tag_, bytes_, bytes));
  bytes_ = bytes;
  return {};
}

Result<BudgetReservation> Ledger::claim(Tag tag, std::uint64_t bytes) {
  RAYMILL_RETURN_IF_ERROR(change(tag, 0, bytes));
  BudgetReservation reservation;
  reservation.ledger_ = this;
  reservation.tag_ = tag;
  reservation.bytes_ = bytes;
  return reservation;
}

Status Ledger::change(Tag tag, std::uint64_t from_bytes, std::uint64_t to_bytes) {
  const std::lock_guard lock(mutex_);
  const std::uint64_t others_bytes = total_bytes_ - from_bytes;
  if (to_bytes > from_bytes && (to_bytes > budget_bytes_ || others_bytes > budget_bytes_ - to_bytes)) {
    return {ErrorCode::budget_exceeded, "memory budget of " + format_bytes(budget_bytes_) + " cannot hold " +
                                            format_bytes(to_bytes) + " of " + std::string(to_string(tag)) +
                                            "; needs at least " + format_bytes(others_bytes + to_bytes)};
  }
  total_bytes_ = others_bytes + to_bytes;
  const auto index = static_cast<std::size_t>(tag);
  used_bytes_[index] = used_bytes_[index] - from_bytes + to_bytes;
  peak_bytes_[index] = std::max(peak_bytes_[index], used_bytes_[index]);
  return {};
}

std::uint64_t Ledger::free_bytes() const {
  const std::lock_guard lock(mutex_);
  return budget_bytes_ - std::min(budget_bytes_, total_bytes_);
}

std::uint64_t Ledger::used_bytes(Tag tag) const {
  const std::lock_guard lock(mutex_);
  return used_bytes_[static_cast<std::size_t>(tag)];
}

std::uint64_t Ledger::peak_bytes(Tag tag) const {
  const std::lock_guard lock(mutex_);
  return peak_bytes_[static_cast<std::size_t>(tag)];
}

std::map<std::string, std::uint64_t> Ledger::peaks() const {
  const std::lock_guard lock(mutex_);
  std::map<std::string, std::uint64_t> peaks;
  for (std::size_t tag = 0; tag < peak_bytes_.size(); ++tag) {
    if (peak_bytes_[tag] > 0) {
      peaks.emplace(to_string(static_cast<Tag>(tag)), peak_bytes_[tag]);
    }
  }
  return peaks;
}

namespace {

std::uint64_t status_field_bytes(const char* field) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen("/proc/self/status", "re"), &std::fclose);
  if (!file) {
    return 0;
  }
  char line[256];
  const std::size_t length = std::strlen(field);
  while (std::fgets(line, sizeof line, file.get()) != nullptr) {
    unsigned long long kib = 0;
    if (std::strncmp(line, field, length) == 0 && std::sscanf(line + length, ": %llu kB", &kib) == 1) {
      return kib << 10;
    }
  }
  return 0;
}

}  // namespace

std::uint64_t resident_bytes() { return status_field_bytes("VmRSS"); }
std::uint64_t peak_resident_bytes() { return status_field_bytes("VmHWM"); }

std::string format_bytes(std::uint64_t bytes) {
  char text[32];
  if (bytes < kibibytes(1)) {
    std::snprintf(text, sizeof text, "%llu B", static_cast<unsigned long long>(bytes));
  } else if (bytes < mebibytes(1)) {
    std::snprintf(text, sizeof text, "%.1f KiB", static_cast<double>(bytes) / 1024.0);
  } else if (bytes < gibibytes(10)) {
    std::snprintf(text, sizeof text, "%.1f MiB", static_cast<double>(bytes) / 1048576.0);
  } else {
    std::snprintf(text, sizeof text, "%.1f GiB", static_cast<double>(bytes) / 1073741824.0);
  }
  return text;
}

}  // namespace raymill::storage
