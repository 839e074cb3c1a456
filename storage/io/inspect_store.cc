// verify() and inspect_page(): tools that look into a store and never write.
#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

#include "storage/base/aligned.h"
#include "storage/io/build_store.h"
#include "storage/io/store_file.h"
#include "storage/io/volume_table.h"
#include "storage/pages/attribute_page.h"
#include "storage/pages/codec.h"
#include "storage/pages/mask_page.h"
#include "storage/pages/masked_section.h"
#include "storage/pages/page_assembler.h"
#include "storage/pages/page_image.h"

namespace raymill {
namespace {

using namespace storage;

// Looking into a store takes a page or two; the budget of a job does not apply.
constexpr std::uint64_t kInspectBudgetBytes = gibibytes(4);

using DirectBuffer = std::vector<std::byte, AlignedAllocator<std::byte, kDirectBlockBytes>>;

nlohmann::ordered_json proxy_json(const Proxy& proxy) {
  std::array<float, 3> area{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    area[axis] = from_half_digits(proxy.area[axis]);
  }
  return {{"area", area},
          {"mixed", proxy.mixed},
          {"normal", proxy.normal},
          {"coverage", proxy.coverage},
          {"several_geometries", proxy.several != 0},
          {"geometry_id", proxy.geometry_id},
          {"primitive_id", proxy.primitive_id}};
}

template <int N>
nlohmann::ordered_json nodes_json(const PageView& view) {
  auto nodes = nlohmann::ordered_json::array();
  const std::uint32_t total = std::uint32_t(view.header().node_count) + view.header().ghost_count;
  for (std::uint32_t i = 0; i < total; ++i) {
    const Node<N>& node = view.nodes<N>()[i];
    nlohmann::ordered_json json{{"index", i},
                                {"ghost", i >= view.header().node_count},
                                {"level", node.level},
                                {"parent", node.parent == kNoParent ? -1 : int(node.parent)}};
    json["children"] = nlohmann::ordered_json::array();
    for (unsigned slot = 0; slot < N; ++slot) {
      if ((node.valid >> slot & 1) == 0) {
        continue;
      }
      nlohmann::ordered_json child{{"slot", slot}};
      std::array<float, 3> lower{}, upper{};
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const float scale = power_of_two(node.exponent[axis]);
        lower[axis] = decode_plane(node.base[axis], scale, node.lower[axis][slot]);
        upper[axis] = decode_plane(node.base[axis], scale, node.upper[axis][slot]);
      }
      child["min"] = lower;
      child["max"] = upper;
      if ((node.leaf >> slot & 1) != 0) {
        child["first_triangle"] = node.child[slot];
        child["triangles"] = node.count[slot];
      } else if ((node.external >> slot & 1) != 0) {
        const ExternalRef& ref = view.externals()[node.child[slot]];
        if (ref.kind == ExternalKind::instance) {
          child["instance"] = ref.page;
        } else {
          child["page"] = ref.page;
          child["node"] = ref.node;
        }
        if (ref.kind == ExternalKind::leaf) {
          child["leaf_slot"] = ref.slot;
        }
        if (ref.kind == ExternalKind::proxied) {
          child["proxy"] = proxy_json(view.proxies()[node.child[slot]]);
        }
      } else {
        child["node"] = node.child[slot];
      }
      json["children"].push_back(std::move(child));
    }
    nodes.push_back(std::move(json));
  }
  return nodes;
}

nlohmann::ordered_json masks_json(const PageHeader& header, const MaskSectionView& view) {
  nlohmann::ordered_json json;
  json["entry_of_triangle"] = nlohmann::ordered_json::array();
  for (std::uint32_t i = 0; i < header.triangle_count; ++i) {
    const std::uint16_t index = view.indices()[i];
    json["entry_of_triangle"].push_back(index == kNoMaskIndex ? -1 : int(index));
  }
  for (std::uint32_t i = 0; i < view.section().entry_count; ++i) {
    const MaskedTriangle& entry = view.entries()[i];
    const unsigned mask = entry.mask & MaskedTriangle::kMaskBits;
    json["entries"].push_back({{"mask", mask == MaskedTriangle::kNoMask ? -1 : int(mask)},
                               {"front_only", (entry.mask & MaskedTriangle::kFrontOnly) != 0},
                               {"tex_coords", entry.corners},
                               {"known", entry.known}});
    if (entry.alpha != kNoMaskIndex) {
      json["entries"].back()["alphas"] = view.alphas()[entry.alpha];
    }
  }
  for (std::uint32_t i = 0; i < view.section().mask_count; ++i) {
    const MaskRef& mask = view.masks()[i];
    json["list"].push_back({{"first_page", mask.first_page},
                            {"size", {mask.info.width, mask.info.height}},
                            {"bits", mask.info.bits},
                            {"cutoff", mask.info.cutoff}});
  }
  return json;
}

nlohmann::ordered_json page_json(const PageView& view) {
  const PageHeader& header = view.header();
  nlohmann::ordered_json json{{"nodes", header.node_count},         {"ghosts", header.ghost_count},
                              {"externals", header.external_count}, {"triangles", header.triangle_count},
                              {"vertices", header.vertex_count},    {"geometries", header.geometry_count}};
  json["tree"] = header.width == 8 ? nodes_json<8>(view) : nodes_json<4>(view);
  json["triangle_list"] = nlohmann::ordered_json::array();
  for (std::uint32_t i = 0; i < header.triangle_count; ++i) {
    auto corners = nlohmann::ordered_json::array();
    for (std::uint32_t k = 0; k < 3; ++k) {
      const Vec3f& v = view.vertices()[view.indices()[i * 3 + k]];
      corners.push_back({v.x, v.y, v.z});
    }
    json["triangle_list"].push_back({{"geometry_id", view.geometry_id(i)},
                                     {"primitive_id", view.primitive_ids()[i]},
                                     {"corners", std::move(corners)}});
  }
  for (std::uint32_t i = 0; i < header.instance_count; ++i) {
    const Instance& instance = view.instances()[i];
    json["instances"].push_back({{"instance_id", instance.instance_id},
                                 {"geometry_base", instance.geometry_base},
                                 {"page", instance.page},
                                 {"node", instance.node},
                                 {"min", {instance.lower.x, instance.lower.y, instance.lower.z}},
                                 {"max", {instance.upper.x, instance.upper.y, instance.upper.z}},
                                 {"world_from_object", instance.world_from_object}});
  }
  if (header.page_type == kPageTypeMasked) {
    json["masks"] = masks_json(header, MaskSectionView(reinterpret_cast<const std::byte*>(&header)));
  }
  return json;
}

nlohmann::ordered_json volume_json(const Volume& volume) {
  return {{"geometry_id", volume.geometry_id},
          {"kind", volume.kind == VolumeKind::level_set ? "level set" : "fog volume"},
          {"origin", volume.origin},
          {"cells", volume.cells},
          {"levels", volume.levels},
          {"root", {{"page", volume.root_page}, {"node", volume.root_node}}},
          {"values", volume.lattice != 0 ? "lattice" : "float32"},
          {"step", step_of(volume)},
          {"min", volume.lower},
          {"max", volume.upper},
          {"background", volume.background},
          {"bricks", volume.brick_count},
          {"active_voxels", volume.active_voxels},
          {"world_from_index", volume.world_from_index}};
}

nlohmann::ordered_json volume_node_json(const VolumeNode& node) {
  auto children = nlohmann::ordered_json::array();
  for (std::size_t slot = 0; slot < kNodeChildren; ++slot) {
    nlohmann::ordered_json child{{"slot", slot}, {"min", node.lower[slot]}, {"max", node.upper[slot]}};
    if (node.kind[slot] != ChildKind::tile) {
      child["page"] = node.page[slot];
      child[node.kind[slot] == ChildKind::brick ? "brick" : "node"] = node.item[slot];
    }
    children.push_back(std::move(child));
  }
  return {{"level", node.level}, {"origin", node.origin}, {"children", std::move(children)}};
}

nlohmann::ordered_json volume_page_json(const VolumePageView& view) {
  const VolumePageHeader& header = view.header();
  nlohmann::ordered_json json{{"kind", header.kind == VolumePageKind::table ? "table of volumes" : "bricks"}};
  if (header.kind == VolumePageKind::table) {
    for (std::uint32_t i = 0; i < header.volume_count; ++i) {
      json["volumes"].push_back(volume_json(view.volumes()[i]));
    }
    return json;
  }
  json["volume"] = header.volume;
  json["nodes"] = nlohmann::ordered_json::array();
  for (std::uint32_t i = 0; i < header.node_count; ++i) {
    json["nodes"].push_back(volume_node_json(view.nodes()[i]));
  }
  json["bricks"] = nlohmann::ordered_json::array();
  for (std::uint32_t i = 0; i < header.brick_count; ++i) {
    const Brick& brick = view.bricks()[i];
    json["bricks"].push_back(
        {{"origin", brick.origin}, {"value_bytes", brick.value_bytes}, {"min", brick.lower}, {"max", brick.upper}});
  }
  return json;
}

nlohmann::ordered_json attribute_page_json(const AttributePageView& view) {
  const AttributePageHeader& header = view.header();
  nlohmann::ordered_json json{{"attributes", to_string_of(header.attributes)}, {"count", header.count}};
  if (header.kind == AttributePageKind::geometries) {
    for (std::uint32_t i = 0; i < header.count; ++i) {
      const AttributeGeometry& geometry = view.geometry(i);
      json["geometries"].push_back({{"first_entry", geometry.first_entry},
                                    {"triangles", geometry.triangle_count},
                                    {"present", to_string_of(geometry.present)},
                                    {"normal_columns", geometry.normal_columns}});
    }
    return json;
  }
  const std::size_t floats = corner_floats(header.attributes);
  for (std::uint32_t i = 0; i < header.count; ++i) {
    nlohmann::ordered_json corners = nlohmann::ordered_json::array();
    for (std::size_t corner = 0; corner < 3; ++corner) {
      const float* first = view.entry(i) + corner * floats;
      corners.push_back(std::vector<float>(first, first + floats));
    }
    json["entries"].push_back(std::move(corners));
  }
  return json;
}

// Checks the pages of attributes of a store one after the other, in the order of their numbers.
class AttributeCheck {
 public:
  explicit AttributeCheck(const StoreFile& store) : geometry_count_(store.footer().geometry_count) {
    if (store.has_attributes()) {
      places_ = AttributePlaces(store.header().attributes, store.footer().attribute_page, store.header().page_bytes,
                                geometry_count_, store.page_count());
    }
  }

  /// Geometries' pages come first, and are full; what they name must be there.
  Status add(std::uint32_t page, const AttributePageView& view) {
    const AttributePageHeader& header = view.header();
    const bool of_geometries = header.kind == AttributePageKind::geometries;
    const std::uint32_t first = of_geometries ? places_.first_page : places_.entries_page;
    const std::uint64_t before =
        std::uint64_t{page - first} * (of_geometries ? places_.geometries_per_page : places_.entries_per_page);
    std::uint64_t& count = of_geometries ? geometries_ : entries_;
    if (page < first || (of_geometries && page >= places_.entries_page) || count != before) {
      return {ErrorCode::corrupt, "holds attributes where others should stand"};
    }
    count += header.count;
    for (std::uint32_t i = 0; of_geometries && i < header.count; ++i) {
      const AttributeGeometry& geometry = view.geometry(i);
      if (geometry.present != 0) {
        named_ = std::max(named_, geometry.first_entry + geometry.triangle_count);
      }
    }
    return {};
  }
  [[nodiscard]] bool adds_up() const {
    return places_.set == 0 || (geometries_ == geometry_count_ && named_ <= entries_);
  }

 private:
  const std::uint64_t geometry_count_;
  AttributePlaces places_;
  std::uint64_t geometries_ = 0, entries_ = 0, named_ = 0;
};

}  // namespace

Result<VerifyReport> verify(const std::string& path) {
  Ledger ledger(kInspectBudgetBytes);
  RAYMILL_ASSIGN_OR_RETURN(const std::shared_ptr<const StoreFile> store, StoreFile::open(path, ledger));
  RAYMILL_ASSIGN_OR_RETURN(const std::string metadata, store->read_metadata());
  if (!nlohmann::json::accept(metadata)) {
    return {ErrorCode::corrupt, path + ": has metadata that is not JSON; rebuild it"};
  }
  DirectBuffer buffer(store->read_buffer_bytes());
  PageBuffer frame(store->header().page_bytes);
  PageDecoder decoder(store->rules(), store->positions(), store->codec());
  RAYMILL_ASSIGN_OR_RETURN(const std::vector<Volume> volumes, read_volumes(*store));
  VerifyReport report;
  report.volumes = volumes.size();
  AttributeCheck attributes(*store);
  std::uint64_t decoded_bytes = 0;
  for (std::uint32_t i = 0; i < store->page_count(); ++i) {
    const PageId page{i};
    RAYMILL_ASSIGN_OR_RETURN(const std::span<const std::byte> encoded, store->read_page(page, buffer));
    RAYMILL_RETURN_IF_ERROR(store->check_page(page, encoded));
    const Result<std::uint32_t> size = decoder.decode(encoded, frame);
    if (!size) {
      return store->page_fault(page, size.status());
    }
    const bool holds_volume = VolumePageView::is_volume_page(frame.data());
    const bool holds_masks = MaskPageView::is_mask_page(frame.data());
    const bool holds_attributes = AttributePageView::is_attribute_page(frame.data());
    const Status bounds = holds_volume       ? check_bounds(frame.data(), volumes)
                          : holds_masks      ? Status()
                          : holds_attributes ? attributes.add(i, AttributePageView(frame.data()))
                                             : check_boxes(frame.data());
    if (!bounds.ok()) {
      return store->page_fault(page, bounds);
    }
    if (*size != store->entry(page).decoded_bytes) {
      return store->page_fault(page, {ErrorCode::corrupt, "decodes to another size than the directory says"});
    }
    if (holds_volume) {
      report.bricks += VolumePageView(frame.data()).header().brick_count;
    } else if (!holds_masks && !holds_attributes) {
      report.triangles += PageView(frame.data()).header().triangle_count;
      report.instances += PageView(frame.data()).header().instance_count;
    }
    report.bytes += encoded.size();
    decoded_bytes += *size;
    ++report.pages;
  }
  std::uint64_t bricks = 0;
  for (const Volume& volume : volumes) {
    bricks += volume.brick_count;
  }
  if (report.triangles != store->footer().triangle_count || report.bricks != bricks || !attributes.adds_up() ||
      report.instances != store->footer().instance_count || decoded_bytes != store->footer().decoded_bytes) {
    return {ErrorCode::corrupt, path + ": has pages that do not add up to what the footer says; rebuild it"};
  }
  return report;
}

Result<std::string> inspect_page(const std::string& path, std::uint32_t page_index) {
  Ledger ledger(kInspectBudgetBytes);
  RAYMILL_ASSIGN_OR_RETURN(const std::shared_ptr<const StoreFile> store, StoreFile::open(path, ledger));
  if (page_index >= store->page_count()) {
    return {ErrorCode::invalid_argument, path + ": has pages 0 to " + std::to_string(store->page_count() - 1) +
                                             ", not " + std::to_string(page_index)};
  }
  const PageId page{page_index};
  const PageEntry& entry = store->entry(page);
  nlohmann::ordered_json json{{"page", page_index},
                              {"offset", entry.offset},
                              {"encoded_bytes", entry.encoded_bytes},
                              {"decoded_bytes", entry.decoded_bytes}};
  DirectBuffer buffer(store->read_buffer_bytes());
  RAYMILL_ASSIGN_OR_RETURN(const std::span<const std::byte> encoded, store->read_page(page, buffer));
  const Status checksum = store->check_page(page, encoded);
  json["checksum"] = checksum.ok() ? "ok" : checksum.message();
  if (!encoded.empty()) {
    EncodedHeader header;
    std::copy_n(encoded.begin(), std::min(encoded.size(), sizeof header),
                std::as_writable_bytes(std::span(&header, 1)).begin());
    json["codec"] = to_string(static_cast<Codec>(header.codec));
  }
  PageBuffer frame(store->header().page_bytes);
  const Result<std::uint32_t> size =
      PageDecoder(store->rules(), store->positions(), store->codec()).decode(encoded, frame);
  if (!size) {
    json["fault"] = size.status().message();
  } else if (VolumePageView::is_volume_page(frame.data())) {
    json.update(volume_page_json(VolumePageView(frame.data())));
  } else if (MaskPageView::is_mask_page(frame.data())) {
    const MaskPageHeader& header = MaskPageView(frame.data()).header();
    json["mask_tiles"] = header.tile_count;
    json["bits"] = header.bits;
  } else if (AttributePageView::is_attribute_page(frame.data())) {
    json.update(attribute_page_json(AttributePageView(frame.data())));
  } else {
    json.update(page_json(PageView(frame.data())));
  }
  return json.dump(2);
}

}  // namespace raymill
