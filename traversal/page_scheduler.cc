#include "traversal/page_scheduler.h"

#include <bit>
#include <utility>

namespace raymill::traversal {

PageScheduler::PageScheduler(std::uint32_t page_count, std::unique_ptr<ReadPolicy> policy)
    : policy_(std::move(policy)),
      demand_(page_count),
      by_age_(page_count, 1),
      is_ready_(page_count),
      counted_(page_count) {}

std::uint64_t PageScheduler::bytes(std::uint32_t page_count) {
  // Demand, age, ready bit, and the ready list at its longest.
  return page_count * (2 * sizeof(std::uint32_t) + PageList::bytes_per_page() + 1 + sizeof(std::uint32_t)) +
         read_policy_bytes(page_count);
}

void PageScheduler::tell(std::uint32_t page, std::uint32_t rays) {
  wanted_rays_ = wanted_rays_ - counted_[page] + rays;
  --pages_by_rays_[std::bit_width(counted_[page])];  // those without rays are counted too, modulo 2^32
  ++pages_by_rays_[std::bit_width(rays)];
  counted_[page] = rays;
  policy_->update(page, rays);
}

void PageScheduler::want(std::uint32_t page) {
  if (by_age_.list_of(page) == PageList::kNotListed) {
    by_age_.push_back(0, page);
    ++wanted_count_;
  }
  tell(page, demand_[page]);
}

void PageScheduler::unwant(std::uint32_t page) {
  if (by_age_.list_of(page) != PageList::kNotListed) {
    by_age_.remove(page);
    --wanted_count_;
    tell(page, 0);
  }
}

void PageScheduler::make_ready(std::uint32_t page) {
  if (!is_ready_[page] && demand_[page] > 0) {
    is_ready_[page] = true;
    ++ready_count_;
    ready_.push_back(page);
  }
}

void PageScheduler::unready(std::uint32_t page) {
  ready_count_ -= is_ready_[page] ? 1 : 0;
  is_ready_[page] = false;
}

void PageScheduler::add(storage::PageId page, std::uint32_t rays, PageState state) {
  const std::uint32_t i = index_of(page);
  demand_[i] += rays;
  if (state == PageState::resident) {
    make_ready(i);
  } else if (state == PageState::absent && demand_[i] > 0) {
    want(i);
  }
}

void PageScheduler::remove(storage::PageId page, std::uint32_t rays) {
  const std::uint32_t i = index_of(page);
  demand_[i] -= rays;
  if (demand_[i] == 0) {
    unready(i);  // it may be evicted before its place in the ready list comes up
    unwant(i);
  } else if (by_age_.list_of(i) != PageList::kNotListed) {
    tell(i, demand_[i]);
  }
}

void PageScheduler::reading(storage::PageId page) { unwant(index_of(page)); }

void PageScheduler::arrived(storage::PageId page, bool resident) {
  const std::uint32_t i = index_of(page);
  if (resident) {
    make_ready(i);
  } else if (demand_[i] > 0) {
    want(i);
  }
}

void PageScheduler::dropped(storage::PageId page) {
  const std::uint32_t i = index_of(page);
  unready(i);
  if (demand_[i] > 0) {
    want(i);
  }
}

std::optional<storage::PageId> PageScheduler::take_ready() {
  while (!ready_.empty()) {
    const std::uint32_t page = ready_.front();
    ready_.pop_front();
    if (is_ready_[page]) {
      unready(page);
      return storage::PageId{page};
    }
  }
  return std::nullopt;
}

void PageScheduler::give_back(storage::PageId page) { make_ready(index_of(page)); }

std::uint32_t PageScheduler::most_wanted_rays() const {
  for (unsigned width = 32; width > 0; --width) {
    if (pages_by_rays_[width] > 0) {
      return std::uint32_t(1) << (width - 1);
    }
  }
  return 0;
}

std::optional<storage::PageId> PageScheduler::longest_wanted() const {
  const std::uint32_t page = by_age_.head(0);
  return page == PageList::kNone ? std::nullopt : std::optional(storage::PageId{page});
}

std::optional<storage::PageId> PageScheduler::next_wanted() {
  if (wanted_count_ == 0) {
    return std::nullopt;
  }
  if (++picks_ % kAgeInterval == 0) {
    return longest_wanted();
  }
  const auto page = policy_->next();
  return page ? std::optional(storage::PageId{*page}) : std::nullopt;
}

}  // namespace raymill::traversal
