#include "storage/pages/page_masks.h"

#include <bit>
#include <cstring>

namespace raymill::storage {

bool PageMasks::gather(std::span<const std::uint32_t> triangles) {
  const TreeMasks& masks = *place_.masks;
  if (masks.entry_of.empty()) {
    return false;
  }
  indices_.assign(triangles.size(), kNoMaskIndex);
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    const std::uint32_t entry = masks.entry_of[triangles[i]];
    if (entry != TreeMasks::kNone) {
      indices_[i] = index_of_entry(masks.entries[entry]);
    }
  }
  return !entries_.empty();
}

std::uint16_t PageMasks::index_of_entry(const TreeMasks::Entry& from) {
  MaskedTriangle entry;
  entry.mask = MaskedTriangle::kNoMask;
  if (from.face.mask < FaceMask::kCut) {
    entry.corners = from.face.corners;
    entry.known = from.face.known;
    entry.mask = mask_index(from.face.mask);
    entry.alpha = alpha_index(from.face.alphas);
  }
  if (from.sides != Sides::both) {
    entry.mask = static_cast<std::uint16_t>(
        entry.mask | MaskedTriangle::kFrontOnly |
        (from.sides == Sides::clockwise ? MaskedTriangle::kFrontClockwise : std::uint16_t{0}));
  }
  const auto [it, is_new] =
      known_entries_.emplace(std::bit_cast<Words>(entry), static_cast<std::uint16_t>(entries_.size()));
  if (is_new) {
    entries_.push_back(entry);
  }
  return it->second;
}

std::uint16_t PageMasks::mask_index(std::uint32_t mask) {
  const auto [it, is_new] = known_masks_.emplace(mask, static_cast<std::uint16_t>(masks_.size()));
  if (is_new) {
    masks_.push_back(place_.mask_refs[mask]);
  }
  return it->second;
}

std::uint16_t PageMasks::alpha_index(const CornerAlphas& alphas) {
  if (alphas == FaceMask().alphas) {
    return kNoMaskIndex;
  }
  const auto [it, is_new] = known_alphas_.emplace(alphas, static_cast<std::uint16_t>(alphas_.size()));
  if (is_new) {
    alphas_.push_back(alphas);
  }
  return it->second;
}

void PageMasks::lay_out(PageHeader& header) const {
  header.page_type = kPageTypeMasked;
  header.image_bytes = image_bytes_with_masks(
      header, {static_cast<std::uint32_t>(entries_.size()), static_cast<std::uint32_t>(masks_.size()),
               static_cast<std::uint32_t>(alphas_.size()), 0});
}

void PageMasks::write(const PageHeader& header, std::byte* image) const {
  if (entries_.empty()) {
    return;
  }
  const MaskSection section{static_cast<std::uint32_t>(entries_.size()), static_cast<std::uint32_t>(masks_.size()),
                            static_cast<std::uint32_t>(alphas_.size()), 0};
  const MaskOffsets offsets = mask_offsets(header, section);
  std::memcpy(image + offsets.section, &section, sizeof section);
  const auto copy = [image](std::uint32_t offset, const auto& values) {
    if (!values.empty()) {
      std::memcpy(image + offset, values.data(), values.size() * sizeof values[0]);
    }
  };
  copy(offsets.indices, indices_);
  copy(offsets.entries, entries_);
  copy(offsets.masks, masks_);
  copy(offsets.alphas, alphas_);
}

}  // namespace raymill::storage
