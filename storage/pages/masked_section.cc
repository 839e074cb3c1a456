#include "storage/pages/masked_section.h"

#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "storage/pages/mask_page.h"
#include "storage/pages/planes.h"

namespace raymill::storage {
namespace {

constexpr std::uint32_t kMost = 0xFFFF;

std::uint32_t align_array(std::uint64_t offset) {
  return static_cast<std::uint32_t>((offset + kPageAlignment - 1) / kPageAlignment * kPageAlignment);
}

Status bad_masks(const char* what) { return {ErrorCode::corrupt, std::string("page has ") + what}; }

bool in_counts(const MaskSection& section) {
  return section.entry_count <= kMost && section.mask_count < MaskedTriangle::kNoMask && section.alpha_count <= kMost &&
         section.reserved == 0;
}

const char* fault_of(const MaskRef& mask, const PageRules& rules) {
  const MaskInfo& info = mask.info;
  if (info.width - 1 >= kMostMaskEdge || info.height - 1 >= kMostMaskEdge ||
      (info.bits != 1 && info.bits != 8 && info.bits != 16) || info.wrap_s > Wrap::clamp || info.wrap_t > Wrap::clamp ||
      info.reserved != 0 || info.reserved_too != 0 || mask.reserved != 0 || !(info.factor >= 0 && info.factor <= 1) ||
      !(info.cutoff >= 0) || !std::isfinite(info.cutoff)) {
    return "a mask with impossible values";
  }
  const std::uint64_t pages = mask_page_count(info, rules.page_bytes);
  return mask.first_page + pages > rules.page_count ? "a mask past the store's pages" : nullptr;
}

const char* fault_of(const MaskedTriangle& entry, const MaskSection& section) {
  const unsigned mask = entry.mask & MaskedTriangle::kMaskBits;
  if ((mask >= section.mask_count && mask != MaskedTriangle::kNoMask) ||
      (entry.alpha >= section.alpha_count && entry.alpha != kNoMaskIndex)) {
    return "a triangle cut out by a mask past its table";
  }
  for (const auto& corner : entry.corners) {
    for (const float x : corner) {
      if (!(std::fabs(x) <= kMostTexCoord)) {
        return "a triangle with a texture coordinate that is none";
      }
    }
  }
  for (std::uint32_t known = entry.known; known != 0; known >>= 2) {
    if ((known & 3) == 3) {
      return "a triangle with parts that are neither opaque nor cut";
    }
  }
  return nullptr;
}

}  // namespace

MaskOffsets mask_offsets(const PageHeader& header, const MaskSection& section) {
  MaskOffsets offsets;
  offsets.section = instances_end(header);
  offsets.indices = offsets.section + std::uint32_t(sizeof section);
  offsets.entries = align_array(std::uint64_t(offsets.indices) + std::uint64_t(header.triangle_count) * 2);
  offsets.masks = align_array(offsets.entries + std::uint64_t(section.entry_count) * sizeof(MaskedTriangle));
  offsets.alphas = align_array(offsets.masks + std::uint64_t(section.mask_count) * sizeof(MaskRef));
  offsets.end = align_array(offsets.alphas + std::uint64_t(section.alpha_count) * sizeof(CornerAlphas));
  return offsets;
}

std::uint32_t image_bytes_with_masks(const PageHeader& header, std::size_t image_bytes) {
  MaskSection section;
  const std::uint32_t at = instances_end(header);
  if (header.triangle_count > kMost + 1 || image_bytes < sizeof section || at > image_bytes - sizeof section) {
    return 0;
  }
  std::memcpy(&section, reinterpret_cast<const std::byte*>(&header) + at, sizeof section);
  return image_bytes_with_masks(header, section);
}

std::uint32_t image_bytes_with_masks(const PageHeader& header, const MaskSection& section) {
  return header.triangle_count <= kMost + 1 && in_counts(section) ? mask_offsets(header, section).end : 0;
}

Status check_masks(const PageView& view, const PageRules& rules) {
  const MaskSectionView masks(reinterpret_cast<const std::byte*>(&view.header()));
  const MaskSection& section = masks.section();
  for (std::uint32_t i = 0; i < view.header().triangle_count; ++i) {
    if (masks.indices()[i] >= section.entry_count && masks.indices()[i] != kNoMaskIndex) {
      return bad_masks("a triangle with an entry of masks past their list");
    }
  }
  for (std::uint32_t i = 0; i < section.entry_count; ++i) {
    if (const char* fault = fault_of(masks.entries()[i], section); fault != nullptr) {
      return bad_masks(fault);
    }
  }
  for (std::uint32_t i = 0; i < section.mask_count; ++i) {
    if (const char* fault = fault_of(masks.masks()[i], rules); fault != nullptr) {
      return bad_masks(fault);
    }
  }
  for (std::uint32_t i = 0; i < section.alpha_count; ++i) {
    for (const float alpha : masks.alphas()[i]) {
      if (!(alpha >= 0 && alpha <= 1)) {
        return bad_masks("a corner with an alpha that is none");
      }
    }
  }
  return {};
}

namespace {

// Word by word over all elements, each as its difference from the element before.
template <typename T>
void write_words(const T* elements, std::size_t count, PlaneWriter& out) {
  std::vector<std::uint32_t> codes(count);
  for (std::size_t word = 0; word < sizeof(T) / 4 && count > 0; ++word) {
    std::uint32_t last = 0;
    for (std::size_t i = 0; i < count; ++i) {
      std::uint32_t value = 0;
      std::memcpy(&value, reinterpret_cast<const std::byte*>(elements + i) + 4 * word, sizeof value);
      codes[i] = zigzag(value - last);
      last = value;
    }
    out.put(std::span<const std::uint32_t>(codes));
  }
}

template <typename T>
void read_words(PlaneReader& in, std::byte* elements, std::size_t count) {
  std::vector<std::uint32_t> codes(count);
  for (std::size_t word = 0; word < sizeof(T) / 4 && count > 0; ++word) {
    in.get(std::span(codes));
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < count; ++i) {
      value += unzigzag(codes[i]);
      std::memcpy(elements + i * sizeof(T) + 4 * word, &value, sizeof value);
    }
  }
}

}  // namespace

// Indices as corners are coded: entries stand in the order of first use. 0: none, 1: the next new entry.
void write_masks(const PageView& view, PlaneWriter& out) {
  const MaskSectionView masks(reinterpret_cast<const std::byte*>(&view.header()));
  const MaskSection& section = masks.section();
  std::vector<std::uint16_t> codes(view.header().triangle_count);
  std::uint16_t next_new = 0;
  for (std::size_t i = 0; i < codes.size(); ++i) {
    const std::uint16_t index = masks.indices()[i];
    codes[i] = index == kNoMaskIndex ? 0 : static_cast<std::uint16_t>(next_new - index + 1);
    next_new = static_cast<std::uint16_t>(next_new + (codes[i] == 1 ? 1 : 0));
  }
  out.put(std::span<const std::uint16_t>(codes));
  write_words(masks.entries(), section.entry_count, out);
  write_words(masks.masks(), section.mask_count, out);
  write_words(masks.alphas(), section.alpha_count, out);
}

void read_masks(PlaneReader& in, std::byte* image) {
  const PageHeader& header = PageView(image).header();
  const MaskSection section = MaskSectionView(image).section();
  const MaskOffsets offsets = mask_offsets(header, section);
  const std::span indices(reinterpret_cast<std::uint16_t*>(image + offsets.indices), header.triangle_count);
  in.get(indices);
  std::uint16_t next_new = 0;
  for (std::uint16_t& index : indices) {
    const std::uint16_t code = index;
    index = code == 0 ? kNoMaskIndex : static_cast<std::uint16_t>(next_new + 1 - code);
    next_new = static_cast<std::uint16_t>(next_new + (code == 1 ? 1 : 0));
  }
  read_words<MaskedTriangle>(in, image + offsets.entries, section.entry_count);
  read_words<MaskRef>(in, image + offsets.masks, section.mask_count);
  read_words<CornerAlphas>(in, image + offsets.alphas, section.alpha_count);
}

}  // namespace raymill::storage
