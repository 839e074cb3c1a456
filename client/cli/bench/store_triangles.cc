#include "client/cli/bench/store_triangles.h"

#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "storage/base/aligned.h"
#include "storage/io/store_file.h"
#include "storage/pages/codec.h"

namespace raymill::client {

using storage::PageId;
using Bytes = std::vector<std::byte, storage::AlignedAllocator<std::byte, storage::kDirectBlockBytes>>;

namespace {

// Decodes one page after the other.
class Pages {
 public:
  static Result<Pages> open(const std::string& path) {
    Pages pages;
    pages.ledger_ = std::make_unique<storage::Ledger>(std::numeric_limits<std::uint64_t>::max());
    RAYMILL_ASSIGN_OR_RETURN(pages.file_, storage::StoreFile::open(path, *pages.ledger_));
    const storage::StoreFile& file = *pages.file_;
    if (file.has_masks()) {
      return Status(ErrorCode::unsupported,
                    path +
                        ": has triangles that masks cut out, which are not read here; build it with --ignore-alpha "
                        "and without --cull-back-faces to compare");
    }
    pages.encoded_.resize(file.read_buffer_bytes());
    pages.frame_.resize(file.header().page_bytes);
    pages.decoder_.emplace(file.rules(), file.positions(), file.codec());
    return pages;
  }
  [[nodiscard]] const storage::StoreFile& file() const { return *file_; }
  /// Good until the next call.
  Result<storage::PageView> read(std::uint32_t page) {
    RAYMILL_ASSIGN_OR_RETURN(const auto encoded, file_->read_page(PageId{page}, encoded_));
    RAYMILL_RETURN_IF_ERROR(file_->check_page(PageId{page}, encoded));
    RAYMILL_ASSIGN_OR_RETURN([[maybe_unused]] const auto bytes, decoder_->decode(encoded, frame_));
    return storage::PageView(frame_.data());
  }

 private:
  std::unique_ptr<storage::Ledger> ledger_;
  std::shared_ptr<const storage::StoreFile> file_;
  Bytes encoded_, frame_;
  std::optional<storage::PageDecoder> decoder_;
};

void append_triangles(const storage::PageView& view, std::vector<storage::Triangle>& out) {
  for (std::uint32_t i = 0; i < view.header().triangle_count; ++i) {
    storage::Triangle& triangle = out.emplace_back();
    for (std::uint32_t corner = 0; corner < 3; ++corner) {
      triangle.v[corner] = view.vertices()[view.indices()[3 * i + corner]];
    }
    triangle.geometry_id = view.geometry_id(i);
    triangle.primitive_id = view.primitive_ids()[i];
  }
}

// The pages of one tree, each once; visit(view) sees them.
template <typename Visit>
Status walk_tree(Pages& pages, std::uint32_t root, Visit&& visit) {
  std::set<std::uint32_t> seen{root};
  std::vector<std::uint32_t> next{root};
  while (!next.empty()) {
    RAYMILL_ASSIGN_OR_RETURN(const storage::PageView view, pages.read(next.back()));
    next.pop_back();
    visit(view);
    for (std::uint32_t i = 0; i < view.header().external_count; ++i) {
      const storage::ExternalRef& ref = view.externals()[i];
      if (ref.kind != storage::ExternalKind::instance && seen.insert(ref.page).second) {
        next.push_back(ref.page);
      }
    }
  }
  return {};
}

}  // namespace

Status read_store_triangles(const std::string& path, storage::TriangleSink& sink) {
  RAYMILL_ASSIGN_OR_RETURN(Pages pages, Pages::open(path));
  if (pages.file().footer().instance_count > 0) {
    return {ErrorCode::unsupported,
            path + ": has instances, which are not read here; build it with --instances never to compare"};
  }
  std::vector<storage::Triangle> triangles;
  for (std::uint32_t page = 0; page < pages.file().page_count(); ++page) {
    RAYMILL_ASSIGN_OR_RETURN(const storage::PageView view, pages.read(page));
    triangles.clear();
    append_triangles(view, triangles);
    RAYMILL_RETURN_IF_ERROR(sink.add(triangles));
  }
  return {};
}

Result<PlacedTriangles> read_placed_triangles(const std::string& path) {
  RAYMILL_ASSIGN_OR_RETURN(Pages pages, Pages::open(path));
  PlacedTriangles scene;
  if (pages.file().footer().instance_count == 0) {
    return scene;
  }
  std::map<std::uint32_t, std::size_t> objects;  // by the page of their root
  RAYMILL_RETURN_IF_ERROR(walk_tree(pages, pages.file().footer().root_page, [&](const storage::PageView& view) {
    append_triangles(view, scene.world);
    for (std::uint32_t i = 0; i < view.header().instance_count; ++i) {
      const storage::Instance& instance = view.instances()[i];
      scene.places.push_back(
          {objects.emplace(instance.page, objects.size()).first->second, instance.world_from_object});
    }
  }));
  scene.objects.resize(objects.size());
  for (const auto& [page, object] : objects) {
    RAYMILL_RETURN_IF_ERROR(walk_tree(pages, page, [&, number = object](const storage::PageView& view) {
      append_triangles(view, scene.objects[number]);
    }));
  }
  return scene;
}

}  // namespace raymill::client
