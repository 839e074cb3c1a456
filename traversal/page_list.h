// PageList: doubly linked lists of pages in arrays that the lists share: a page is in one list at most.
// All operations take constant time. Thread-confined.
#pragma once

#include <cstdint>
#include <vector>

namespace raymill::traversal {

class PageList {
 public:
  static constexpr std::uint32_t kNone = 0xFFFFFFFFu;
  static constexpr std::uint8_t kNotListed = 0xFF;
  /// At most 255 lists.
  PageList(std::uint32_t page_count, unsigned list_count)
      : links_(page_count), list_of_(page_count, kNotListed), lists_(list_count, {kNone, kNone}) {}
  static constexpr std::uint64_t bytes_per_page() { return sizeof(Links) + 1; }

  [[nodiscard]] std::uint32_t head(unsigned list) const { return lists_[list].head; }
  [[nodiscard]] std::uint8_t list_of(std::uint32_t page) const { return list_of_[page]; }
  void push_back(unsigned list, std::uint32_t page) {
    List& l = lists_[list];
    links_[page] = {l.tail, kNone};
    (l.tail == kNone ? l.head : links_[l.tail].next) = page;
    l.tail = page;
    list_of_[page] = static_cast<std::uint8_t>(list);
  }
  /// Nothing where the page is in no list.
  void remove(std::uint32_t page) {
    if (list_of_[page] == kNotListed) {
      return;
    }
    List& l = lists_[list_of_[page]];
    const Links links = links_[page];
    (links.previous == kNone ? l.head : links_[links.previous].next) = links.next;
    (links.next == kNone ? l.tail : links_[links.next].previous) = links.previous;
    list_of_[page] = kNotListed;
  }

 private:
  struct Links {
    std::uint32_t previous, next;
  };
  struct List {
    std::uint32_t head, tail;
  };
  std::vector<Links> links_;
  std::vector<std::uint8_t> list_of_;
  std::vector<List> lists_;
};

}  // namespace raymill::traversal
