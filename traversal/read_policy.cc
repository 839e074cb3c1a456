#include "traversal/read_policy.h"

#include <algorithm>
#include <bit>
#include <utility>

#include "traversal/page_list.h"

namespace raymill::traversal {
namespace {

// Lists by half powers of two of the score: constant time, and never off by more than 1.5 from the best.
class ListPolicy final : public ReadPolicy {
 public:
  ListPolicy(std::uint32_t page_count, std::function<std::uint32_t(std::uint32_t)> encoded_bytes)
      : lists_(page_count, kLists), encoded_bytes_(std::move(encoded_bytes)) {}

  void update(std::uint32_t page, std::uint32_t rays) override {
    if (rays == 0) {
      lists_.remove(page);
      return;
    }
    const unsigned list = list_for(page, rays);
    if (lists_.list_of(page) != list) {
      lists_.remove(page);
      lists_.push_back(list, page);
      highest_ = std::max(highest_, list);
    }
  }

  std::optional<std::uint32_t> next() override {
    while (highest_ > 0 && lists_.head(highest_) == PageList::kNone) {
      --highest_;
    }
    const std::uint32_t page = lists_.head(highest_);
    return page != PageList::kNone ? std::optional(page) : std::nullopt;
  }

 private:
  static constexpr unsigned kLists = 128;

  [[nodiscard]] unsigned list_for(std::uint32_t page, std::uint32_t rays) const {
    std::uint64_t value = rays;
    if (encoded_bytes_) {
      // Rays for each MiB.
      value = std::max<std::uint64_t>(1, (value << 20) / std::max(1U, encoded_bytes_(page)));
    }
    const auto width = static_cast<unsigned>(std::bit_width(value));
    const unsigned half = width >= 2 ? static_cast<unsigned>(value >> (width - 2) & 1) : 0;
    return 2 * (width - 1) + half;
  }

  PageList lists_;
  std::function<std::uint32_t(std::uint32_t)> encoded_bytes_;  // none: all pages cost the same
  unsigned highest_ = 0;                                       // no list above it has pages
};

class FifoPolicy final : public ReadPolicy {
 public:
  explicit FifoPolicy(std::uint32_t page_count) : list_(page_count, 1) {}

  void update(std::uint32_t page, std::uint32_t rays) override {
    if (rays == 0) {
      list_.remove(page);
    } else if (list_.list_of(page) == PageList::kNotListed) {
      list_.push_back(0, page);
    }
  }
  std::optional<std::uint32_t> next() override {
    const std::uint32_t page = list_.head(0);
    return page != PageList::kNone ? std::optional(page) : std::nullopt;
  }

 private:
  PageList list_;
};

// A cursor goes round; pages that less than half of the average wait for are left out until nothing else is there.
class SweepPolicy final : public ReadPolicy {
 public:
  explicit SweepPolicy(std::uint32_t page_count) : rays_(page_count), words_((page_count + 63) / 64) {}

  void update(std::uint32_t page, std::uint32_t rays) override {
    wanted_ += (rays > 0 ? 1 : 0) - (rays_[page] > 0 ? 1 : 0);
    total_rays_ += rays;
    total_rays_ -= rays_[page];
    rays_[page] = rays;
    const std::uint64_t bit = std::uint64_t(1) << (page % 64);
    words_[page / 64] = rays > 0 ? words_[page / 64] | bit : words_[page / 64] & ~bit;
  }

  std::optional<std::uint32_t> next() override {
    if (wanted_ <= 0) {
      return std::nullopt;
    }
    const auto average = static_cast<std::uint32_t>(total_rays_ / static_cast<std::uint64_t>(wanted_));
    for (const std::uint32_t least : {std::max(1U, average / 2), 1U}) {
      if (const auto page = from_cursor(least)) {
        cursor_ = *page + 1;
        return page;
      }
    }
    return std::nullopt;
  }

 private:
  [[nodiscard]] std::optional<std::uint32_t> from_cursor(std::uint32_t least) const {
    const auto pages = static_cast<std::uint32_t>(rays_.size());
    const auto count = static_cast<std::uint32_t>(words_.size());
    const std::uint32_t start = cursor_ < pages ? cursor_ : 0;
    // The first word is looked at twice: from the cursor on, and at the end below it.
    for (std::uint32_t i = 0; i <= count; ++i) {
      const std::uint32_t word = (start / 64 + i) % count;
      std::uint64_t bits = words_[word];
      if (i == 0) {
        bits &= ~std::uint64_t(0) << (start % 64);
      }
      for (; bits != 0; bits &= bits - 1) {
        const std::uint32_t page = word * 64 + static_cast<std::uint32_t>(std::countr_zero(bits));
        if (rays_[page] >= least) {
          return page;
        }
      }
    }
    return std::nullopt;
  }

  std::vector<std::uint32_t> rays_;
  std::vector<std::uint64_t> words_;
  std::uint32_t cursor_ = 0;
  std::int64_t wanted_ = 0;
  std::uint64_t total_rays_ = 0;
};

}  // namespace

std::string_view to_string(ReadOrder order) {
  switch (order) {
    case ReadOrder::score:
      return "score";
    case ReadOrder::most_rays:
      return "most-rays";
    case ReadOrder::fifo:
      return "fifo";
    case ReadOrder::sweep:
      return "sweep";
  }
  return "";
}

Result<ReadOrder> parse_read_order(const std::string& name) {
  for (const ReadOrder order : {ReadOrder::score, ReadOrder::most_rays, ReadOrder::fifo, ReadOrder::sweep}) {
    if (name == to_string(order)) {
      return order;
    }
  }
  return {ErrorCode::invalid_argument, "policy '" + name + "' is none of score, most-rays, fifo and sweep"};
}

std::uint64_t read_policy_bytes(std::uint32_t page_count) {
  return page_count * (sizeof(std::uint32_t) + PageList::bytes_per_page()) + 2048;
}

std::unique_ptr<ReadPolicy> make_read_policy(ReadOrder order, std::uint32_t page_count,
                                             std::function<std::uint32_t(std::uint32_t)> encoded_bytes) {
  switch (order) {
    case ReadOrder::score:
      return std::make_unique<ListPolicy>(page_count, std::move(encoded_bytes));
    case ReadOrder::most_rays:
      return std::make_unique<ListPolicy>(page_count, nullptr);
    case ReadOrder::fifo:
      return std::make_unique<FifoPolicy>(page_count);
    case ReadOrder::sweep:
      break;
  }
  return std::make_unique<SweepPolicy>(page_count);
}

}  // namespace raymill::traversal
