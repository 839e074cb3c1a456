#include "storage/io/volume_table.h"

#include "storage/base/aligned.h"
#include "storage/pages/codec.h"

namespace raymill::storage {

Result<std::vector<Volume>> read_volumes(const StoreFile& store) {
  std::vector<Volume> volumes;
  if (!store.has_volumes()) {
    return volumes;
  }
  const PageId page{store.footer().volume_page};
  std::vector<std::byte, AlignedAllocator<std::byte, kDirectBlockBytes>> buffer(store.read_buffer_bytes());
  RAYMILL_ASSIGN_OR_RETURN(const std::span<const std::byte> encoded, store.read_page(page, buffer));
  RAYMILL_RETURN_IF_ERROR(store.check_page(page, encoded));
  PageBuffer frame(store.header().page_bytes);
  PageDecoder decoder(store.rules(), store.positions(), store.codec());
  if (const auto size = decoder.decode(encoded, frame); !size) {
    return store.page_fault(page, size.status());
  }
  const VolumePageView table(frame.data());
  if (!VolumePageView::is_volume_page(frame.data()) || table.header().kind != VolumePageKind::table) {
    return store.page_fault(page, {ErrorCode::corrupt, "is not the table of volumes that the footer says it is"});
  }
  volumes.assign(table.volumes(), table.volumes() + table.header().volume_count);
  return volumes;
}

}  // namespace raymill::storage
