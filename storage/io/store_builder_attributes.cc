// The pages of attributes: where each geometry's are, then the entries of triangles.
#include <string>
#include <vector>

#include "storage/io/store_builder.h"
#include "storage/pages/attribute_page.h"

namespace raymill::storage {

Status StoreBuilder::check_has_attributes() const {
  if (plan_.attributes == 0 || !attributes_.empty()) {
    return {};
  }
  std::string names;
  for (const Attribute attribute : kAttributes) {
    if (holds(plan_.attributes, attribute)) {
      names += names.empty() ? "" : ", ";
      names += kind_of(attribute).gltf_name;
    }
  }
  return {ErrorCode::bad_scene, (config_.scenes.empty() ? config_.output : config_.scenes.front()) +
                                    ": --attributes asks for " + names +
                                    ", and no triangle of the scene has any of that (of PLY, OBJ and STL none is "
                                    "read); leave it out"};
}

Status StoreBuilder::write_attributes(StoreFileWriter& writer, StoreFooter& footer) {
  if (plan_.attributes == 0) {
    return {};
  }
  RAYMILL_RETURN_IF_ERROR(attributes_.fill_geometries(import_report_.geometry_count));
  const std::uint64_t bytes = attributes_.entries().size_bytes() + attributes_.geometries().size_bytes();
  const std::uint64_t directory = 2 * sizeof(PageEntry) * (bytes / (config_.page_bytes / 2) + 2);
  RAYMILL_ASSIGN_OR_RETURN(
      const BudgetReservation claim,
      ledger_.claim(Tag::build, directory + config_.page_bytes + attribute_encode_bytes(config_.page_bytes)));
  footer.attribute_page = static_cast<std::uint32_t>(writer.page_count());
  RAYMILL_RETURN_IF_ERROR(write_attribute_pages(AttributePageKind::geometries, attributes_.geometries(), writer));
  RAYMILL_RETURN_IF_ERROR(write_attribute_pages(AttributePageKind::entries, attributes_.entries(), writer));
  AttributeBytes& of = import_report_.attributes;
  of.set = plan_.attributes;
  of.entries = attributes_.entries().size_bytes() / attribute_item_bytes(AttributePageKind::entries, plan_.attributes);
  report_.attribute_entries = of.entries;
  report_.attribute_pages = of.pages;
  report_.attribute_bytes = of.encoded_bytes;
  report_.attribute_decoded_bytes = of.decoded_bytes;
  return {};
}

Status StoreBuilder::write_attribute_pages(AttributePageKind kind, BlockStream& items, StoreFileWriter& writer) {
  const std::uint64_t most = std::uint64_t{attribute_items_per_page(kind, plan_.attributes, config_.page_bytes)} *
                             attribute_item_bytes(kind, plan_.attributes);
  const std::uint64_t size = items.size_bytes();
  std::vector<std::byte> bytes;
  for (std::uint64_t at = 0; at < size; at += most) {
    RAYMILL_RETURN_IF_ERROR(step("attributes", double(at) / double(size)));
    bytes.resize(std::min(most, size - at));
    RAYMILL_RETURN_IF_ERROR(items.read(at, bytes));
    items.forget(at + bytes.size());
    const std::vector<std::byte> image = make_attribute_page(kind, plan_.attributes, bytes);
    const std::vector<std::byte> encoded = encode_attribute_page(image, plan_.codec);
    RAYMILL_RETURN_IF_ERROR(writer.add_page(PageId{static_cast<std::uint32_t>(writer.page_count())}, encoded,
                                            static_cast<std::uint32_t>(image.size())));
    ++import_report_.attributes.pages;
    import_report_.attributes.encoded_bytes += encoded.size();
    import_report_.attributes.decoded_bytes += image.size();
  }
  return {};
}

}  // namespace raymill::storage
