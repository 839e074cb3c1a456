#include "client/cli/bench/store_triangles.h"

#include <limits>
#include <vector>

#include "storage/base/aligned.h"
#include "storage/io/store_file.h"
#include "storage/pages/codec.h"

namespace raymill::client {

using storage::PageId;
using Bytes = std::vector<std::byte, storage::AlignedAllocator<std::byte, storage::kDirectBlockBytes>>;

Status read_store_triangles(const std::string& path, storage::TriangleSink& sink) {
  storage::Ledger ledger(std::numeric_limits<std::uint64_t>::max());
  RAYMILL_ASSIGN_OR_RETURN(const auto file, storage::StoreFile::open(path, ledger));
  if (file->footer().instance_count > 0) {
    return {ErrorCode::unsupported,
            path + ": has instances, which Embree is not given here; build it with --instances never to compare"};
  }
  Bytes encoded_bytes(file->read_buffer_bytes()), frame(file->header().page_bytes);
  storage::PageDecoder decoder(file->rules(), file->positions(), file->codec());
  std::vector<storage::Triangle> triangles;
  for (std::uint32_t page = 0; page < file->page_count(); ++page) {
    RAYMILL_ASSIGN_OR_RETURN(const auto encoded, file->read_page(PageId{page}, encoded_bytes));
    RAYMILL_RETURN_IF_ERROR(file->check_page(PageId{page}, encoded));
    RAYMILL_ASSIGN_OR_RETURN([[maybe_unused]] const auto bytes, decoder.decode(encoded, frame));
    const storage::PageView view(frame.data());
    triangles.clear();
    for (std::uint32_t i = 0; i < view.header().triangle_count; ++i) {
      storage::Triangle triangle{};
      for (std::uint32_t corner = 0; corner < 3; ++corner) {
        triangle.v[corner] = view.vertices()[view.indices()[3 * i + corner]];
      }
      triangle.geometry_id = view.geometry_id(i);
      triangle.primitive_id = view.primitive_ids()[i];
      triangles.push_back(triangle);
    }
    RAYMILL_RETURN_IF_ERROR(sink.add(triangles));
  }
  return {};
}

}  // namespace raymill::client
