#include "storage/pages/store_format.h"

#include <cmath>
#include <cstddef>
#include <span>
#include <string>

#include "storage/base/attribute.h"
#include "storage/base/checksum.h"

namespace raymill::storage {
namespace {

template <typename T>
std::uint64_t checksum_before(const T& value, std::size_t bytes) {
  return checksum(std::as_bytes(std::span(&value, 1)).first(bytes));
}

}  // namespace

void seal(StoreHeader& header) { header.checksum = checksum_before(header, offsetof(StoreHeader, checksum)); }
void seal(StoreFooter& footer) { footer.checksum = checksum_before(footer, offsetof(StoreFooter, checksum)); }

Status check(const StoreHeader& header) {
  if (header.magic != kHeaderMagic) {
    return {ErrorCode::corrupt,
            "is not a Raymill store (its first bytes are not RAYMILL); build one with `raymill build`"};
  }
  if (header.format_version != kFormatVersion) {
    return {ErrorCode::version_mismatch, "has format version " + std::to_string(header.format_version) +
                                             ", this program reads version " + std::to_string(kFormatVersion) +
                                             "; build the store again"};
  }
  if (header.checksum != checksum_before(header, offsetof(StoreHeader, checksum))) {
    return {ErrorCode::checksum_mismatch, "has a damaged header; restore or rebuild it"};
  }
  if ((header.features & ~kKnownFeatures) != 0) {
    return {ErrorCode::unsupported, "needs features that this program does not know (feature bits " +
                                        std::to_string(header.features & ~kKnownFeatures) + "); use a newer Raymill"};
  }
  if ((header.width != 4 && header.width != 8) || header.page_bytes < kMinPageBytes ||
      header.page_bytes > kMaxPageBytes || header.codec > static_cast<std::uint8_t>(Codec::draco) ||
      header.header_bytes != sizeof(StoreHeader) || header.lattice > 1 || header.lattice_step_exponent < -200 ||
      header.lattice_step_exponent > 200 || has(header.features, Feature::attributes) != (header.attributes != 0) ||
      (header.attributes & ~kAllAttributes) != 0 ||
      (has(header.features, Feature::masks) && has(header.features, Feature::proxies)) ||
      (has(header.features, Feature::origins) && !has(header.features, Feature::instances)) ||
      (has(header.features, Feature::origin) &&
       (header.origin().is_zero() || header.origin_exponent < -Origin::kMostExponent ||
        header.origin_exponent > Origin::kMostExponent))) {
    return {ErrorCode::corrupt, "has a header with impossible values; rebuild it"};
  }
  return {};
}

Status check(const StoreFooter& footer, const StoreHeader& header, std::uint64_t file_bytes) {
  if (footer.magic != kFooterMagic) {
    return {ErrorCode::corrupt, "ends without a footer; it was cut short, copy or build it again"};
  }
  if (footer.checksum != checksum_before(footer, offsetof(StoreFooter, checksum))) {
    return {ErrorCode::checksum_mismatch, "has a damaged footer; restore or rebuild it"};
  }
  const std::uint64_t directory_bytes = footer.page_count * sizeof(PageEntry);
  const bool sections_meet = footer.page_count > 0 && footer.page_count < 0xFFFFFFFFu &&
                             footer.metadata_offset <= file_bytes &&
                             footer.metadata_bytes <= file_bytes - footer.metadata_offset &&
                             footer.directory_offset == footer.metadata_offset + footer.metadata_bytes &&
                             directory_bytes <= file_bytes - footer.directory_offset &&
                             footer.directory_offset + directory_bytes + sizeof(StoreFooter) == file_bytes;
  bool finite = true;
  for (int axis = 0; axis < 3; ++axis) {
    finite = finite && std::isfinite(footer.bounds_min[axis]) && std::isfinite(footer.bounds_max[axis]);
  }
  if (footer.header_checksum != header.checksum || footer.file_bytes != file_bytes || !sections_meet || !finite ||
      footer.levels == 0 || footer.levels > max_levels(header.width) || footer.root_page >= footer.page_count ||
      footer.root_node >= kNoParent || footer.volume_page >= footer.page_count ||
      footer.attribute_page >= footer.page_count || footer.max_encoded_bytes > 4 * header.page_bytes ||
      footer.metadata_plain_bytes > kMostMetadataBytes || footer.object_level >= footer.levels ||
      (footer.object_level != 0) != has(header.features, Feature::instances)) {
    return {ErrorCode::corrupt, "has a footer that does not fit the file; copy or build it again"};
  }
  return {};
}

}  // namespace raymill::storage
