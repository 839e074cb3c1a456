// PageMasks: the section of masks of a page that is assembled. Thread-confined.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "storage/pages/masked_section.h"
#include "storage/pages/page_assembler.h"

namespace raymill::storage {

class PageMasks {
 public:
  explicit PageMasks(const TreePlace& place) : place_(place) {}

  /// Takes the entries of the page's triangles, given by their numbers in the tree. False: none has one, and the page
  /// needs no section.
  bool gather(std::span<const std::uint32_t> triangles);
  /// Makes a header that is laid out that of a masked page.
  void lay_out(PageHeader& header) const;
  /// Writes the section; nothing where there is none.
  void write(const PageHeader& header, std::byte* image) const;

 private:
  using Words = std::array<std::uint32_t, sizeof(MaskedTriangle) / sizeof(std::uint32_t)>;
  std::uint16_t index_of_entry(const TreeMasks::Entry& entry);
  std::uint16_t mask_index(std::uint32_t mask);
  std::uint16_t alpha_index(const CornerAlphas& alphas);

  const TreePlace& place_;
  std::vector<std::uint16_t> indices_;
  std::vector<MaskedTriangle> entries_;
  std::vector<MaskRef> masks_;
  std::vector<CornerAlphas> alphas_;
  std::map<Words, std::uint16_t> known_entries_;  // by their bits
  std::map<std::uint32_t, std::uint16_t> known_masks_;
  std::map<CornerAlphas, std::uint16_t> known_alphas_;
};

}  // namespace raymill::storage
