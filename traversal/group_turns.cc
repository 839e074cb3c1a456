#include "traversal/group_turns.h"

#include <algorithm>
#include <utility>

namespace raymill::traversal {

GroupTurns::GroupTurns(const Config& config, Source source)
    : config_(config),
      source_(std::move(source)),
      group_bytes_((config.page_count + config.group_pages - 1) / config.group_pages),
      last_turn_(group_bytes_.size()) {
  for (std::uint32_t page = 0; page < config.page_count; ++page) {
    group_bytes_[page / config.group_pages] += config.encoded_bytes(page);
  }
}

std::uint64_t GroupTurns::bytes(std::uint32_t page_count, std::uint32_t group_pages) {
  return (page_count / group_pages + 1) * 2 * sizeof(std::uint64_t);
}

// From the cursor round to the cursor, so a page that is wanted again is read again only after the others.
std::optional<std::uint32_t> GroupTurns::scan() {
  const std::uint32_t begin = first_page(active_), end = end_page(active_);
  for (std::uint32_t i = 0; i < end - begin; ++i) {
    const std::uint32_t page = begin + (cursor_ - begin + i) % (end - begin);
    if (source_.wanted_rays(page) >= least_) {
      cursor_ = page + 1;
      return page;
    }
  }
  return std::nullopt;
}

std::optional<std::uint32_t> GroupTurns::next_page() {
  for (std::size_t tried = 0; tried <= group_bytes_.size(); ++tried) {
    if (active_ != kNone) {
      if (const auto page = scan()) {
        return page;
      }
      if (source_.rays_on_disk(active_) > 0) {
        return std::nullopt;
      }
    }
    if (!next_turn()) {
      return std::nullopt;
    }
  }
  return std::nullopt;
}

void GroupTurns::look() {
  if (active_ == kNone || rays(active_) == 0) {
    (void)next_turn();
  }
}

bool GroupTurns::next_turn() {
  const bool oldest = (turn_ + 1) % kAgeTurns == 0;
  const std::uint32_t group = choose(oldest ? ReadOrder::fifo : config_.order);
  if (group == kNone) {
    active_ = kNone;
    return false;
  }
  active_ = group;
  last_turn_[group] = ++turn_;
  cursor_ = first_page(group);
  const std::uint64_t average = rays(group) / config_.group_pages;
  least_ = oldest ? 1 : static_cast<std::uint32_t>(std::clamp<std::uint64_t>(average / 4, 1, 0xFFFFFFFFu));
  return true;
}

// That could be served: in memory at absent pages, and on disk.
std::uint64_t GroupTurns::rays(std::uint32_t group) const {
  std::uint64_t rays = source_.rays_on_disk(group);
  for (std::uint32_t page = first_page(group); page < end_page(group); ++page) {
    rays += source_.wanted_rays(page);
  }
  return rays;
}

double GroupTurns::value(std::uint32_t group, std::uint64_t rays, ReadOrder order) const {
  switch (order) {
    case ReadOrder::score:
      return static_cast<double>(rays) / static_cast<double>(group_bytes_[group]);
    case ReadOrder::most_rays:
      return static_cast<double>(rays);
    case ReadOrder::fifo:
      return -static_cast<double>(last_turn_[group]);
    case ReadOrder::sweep:
      break;
  }
  return 0;
}

// Of groups with rays the best, and of equal ones the first after the active one: that is the order of a sweep.
std::uint32_t GroupTurns::choose(ReadOrder order) const {
  const auto groups = static_cast<std::uint32_t>(group_bytes_.size());
  std::uint32_t best = kNone;
  double best_value = 0;
  for (std::uint32_t i = 1; i <= groups; ++i) {
    const std::uint32_t group = active_ == kNone ? i - 1 : (active_ + i) % groups;
    const std::uint64_t waiting = rays(group);
    if (waiting > 0 && (best == kNone || (group != active_ && value(group, waiting, order) > best_value))) {
      best = group;
      best_value = value(group, waiting, order);
    }
  }
  return best;
}

}  // namespace raymill::traversal
