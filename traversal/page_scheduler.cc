#include "traversal/page_scheduler.h"

#include <bit>

namespace raymill::traversal {
namespace {

constexpr std::uint32_t kNone = 0xFFFFFFFFu;

}  // namespace

PageScheduler::PageScheduler(std::uint32_t page_count)
    : demand_(page_count), links_(page_count), list_of_(page_count, kNotListed), is_ready_(page_count) {
  lists_.fill({kNone, kNone});
}

std::uint64_t PageScheduler::bytes(std::uint32_t page_count) {
  // Demand, links, list, ready bit, and the ready list at its longest.
  return std::uint64_t(page_count) * (sizeof(std::uint32_t) + sizeof(Links) + 1 + 1 + sizeof(std::uint32_t));
}

void PageScheduler::list(std::uint32_t page) {
  const auto which = static_cast<std::uint8_t>(std::bit_width(demand_[page]) - 1);
  List& list = lists_[which];
  links_[page] = {list.tail, kNone};
  (list.tail == kNone ? list.head : links_[list.tail].next) = page;
  list.tail = page;
  list_of_[page] = which;
  ++wanted_count_;
}

void PageScheduler::unlist(std::uint32_t page) {
  if (list_of_[page] == kNotListed) {
    return;
  }
  List& list = lists_[list_of_[page]];
  const Links links = links_[page];
  (links.previous == kNone ? list.head : links_[links.previous].next) = links.next;
  (links.next == kNone ? list.tail : links_[links.next].previous) = links.previous;
  list_of_[page] = kNotListed;
  --wanted_count_;
}

void PageScheduler::make_ready(std::uint32_t page) {
  if (!is_ready_[page] && demand_[page] > 0) {
    is_ready_[page] = true;
    ready_.push_back(page);
  }
}

void PageScheduler::add(storage::PageId page, std::uint32_t rays, PageState state) {
  const std::uint32_t i = index_of(page);
  demand_[i] += rays;
  if (state == PageState::resident) {
    make_ready(i);
  } else if (state == PageState::absent && list_of_[i] != std::bit_width(demand_[i]) - 1) {
    unlist(i);
    list(i);
  }
}

void PageScheduler::remove(storage::PageId page, std::uint32_t rays) {
  const std::uint32_t i = index_of(page);
  demand_[i] -= rays;
  if (demand_[i] == 0) {
    is_ready_[i] = false;  // it may be evicted before its place in the ready list comes up
  }
  if (list_of_[i] != kNotListed) {
    unlist(i);
    if (demand_[i] > 0) {
      list(i);
    }
  }
}

void PageScheduler::reading(storage::PageId page) { unlist(index_of(page)); }

void PageScheduler::arrived(storage::PageId page, bool resident) {
  const std::uint32_t i = index_of(page);
  if (resident) {
    make_ready(i);
  } else if (demand_[i] > 0 && list_of_[i] == kNotListed) {
    list(i);
  }
}

std::optional<storage::PageId> PageScheduler::take_ready() {
  while (!ready_.empty()) {
    const std::uint32_t page = ready_.front();
    ready_.pop_front();
    if (is_ready_[page]) {
      is_ready_[page] = false;
      return storage::PageId{page};
    }
  }
  return std::nullopt;
}

void PageScheduler::give_back(storage::PageId page) { make_ready(index_of(page)); }

std::optional<storage::PageId> PageScheduler::next_wanted(std::uint32_t least_rays) {
  if (wanted_count_ == 0) {
    return std::nullopt;
  }
  const bool aged = ++picks_ % kAgeInterval == 0;
  for (unsigned i = 0; i < kLists; ++i) {
    const List& list = lists_[aged ? i : kLists - 1 - i];
    if (list.head != kNone) {
      return aged || demand_[list.head] >= least_rays ? std::optional(storage::PageId{list.head}) : std::nullopt;
    }
  }
  return std::nullopt;
}

}  // namespace raymill::traversal
