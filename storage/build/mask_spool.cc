#include "storage/build/mask_spool.h"

#include <algorithm>
#include <cstring>
#include <type_traits>

namespace raymill::storage {
namespace {

static_assert(std::is_trivially_copyable_v<FaceMask> && sizeof(FaceMask) == 44);

// Texels past the mask's edges are 0 and never looked at.
void cut_tile(const AlphaMap& map, std::uint32_t column, std::uint32_t row, std::byte* tile) {
  const std::size_t row_bytes = std::size_t{kTileEdge} * map.info.bits / 8;
  const std::size_t first = column * row_bytes;
  const std::size_t here = std::min(row_bytes, map.row_bytes - first);
  for (std::uint32_t y = 0; y < kTileEdge && row * kTileEdge + y < map.info.height; ++y) {
    std::memcpy(tile + y * row_bytes, map.row(row * kTileEdge + y) + first, here);
  }
}

}  // namespace

Result<std::uint32_t> MaskSpool::add_mask(const AlphaMap& map) {
  Mask mask{map.info, {}};
  const std::size_t bytes = tile_bytes(map.info.bits);
  std::vector<std::byte> block;
  const auto flush = [&]() -> Status {
    RAYMILL_ASSIGN_OR_RETURN(const BlockId id, blocks_.write(block));
    mask.tiles.push_back(id);
    block.clear();
    return {};
  };
  for (std::uint32_t row = 0; row * kTileEdge < map.info.height; ++row) {
    for (std::uint32_t column = 0; column * kTileEdge < map.info.width; ++column) {
      block.resize(block.size() + bytes);
      cut_tile(map, column, row, block.data() + block.size() - bytes);
      if (block.size() == kBlockBytes) {
        RAYMILL_RETURN_IF_ERROR(flush());
      }
    }
  }
  if (!block.empty()) {
    RAYMILL_RETURN_IF_ERROR(flush());
  }
  masks_.push_back(std::move(mask));
  return static_cast<std::uint32_t>(masks_.size() - 1);
}

Status MaskSpool::read_tiles(const Mask& mask, std::uint64_t first, std::span<std::byte> out) const {
  std::uint64_t at = first * tile_bytes(mask.info.bits);
  while (!out.empty()) {
    const std::size_t in_block = at % kBlockBytes;
    const auto piece = out.first(std::min(out.size(), kBlockBytes - in_block));
    RAYMILL_RETURN_IF_ERROR(blocks_.read(mask.tiles[at / kBlockBytes], piece, in_block));
    at += piece.size();
    out = out.subspan(piece.size());
  }
  return {};
}

Result<std::uint64_t> MaskSpool::add_faces(std::span<const FaceMask> faces) {
  const std::uint64_t first = face_count_;
  for (const FaceMask& face : faces) {
    filling_.reserve(kPerBlock);
    filling_.push_back(face);
    ++face_count_;
    if (filling_.size() == kPerBlock) {
      RAYMILL_RETURN_IF_ERROR(finish());
    }
  }
  return first;
}

Status MaskSpool::finish() {
  if (!filling_.empty()) {
    RAYMILL_ASSIGN_OR_RETURN(const BlockId block, blocks_.write(std::as_bytes(std::span(filling_))));
    written_.push_back(block);
    filling_.clear();
  }
  return {};
}

Status MaskSpool::read_faces(std::uint64_t first, std::span<FaceMask> faces) const {
  while (!faces.empty()) {
    const std::size_t block = first / kPerBlock, in_block = first % kPerBlock;
    const auto piece = faces.first(std::min(faces.size(), kPerBlock - in_block));
    if (block < written_.size()) {
      RAYMILL_RETURN_IF_ERROR(
          blocks_.read(written_[block], std::as_writable_bytes(piece), in_block * sizeof(FaceMask)));
    } else {
      std::copy_n(filling_.begin() + static_cast<std::ptrdiff_t>(in_block), piece.size(), piece.begin());
    }
    first += piece.size();
    faces = faces.subspan(piece.size());
  }
  return {};
}

const GeometryMask* MaskSpool::find(std::uint32_t tree, std::uint32_t geometry_id) const {
  const auto it = geometries_.find({tree, geometry_id});
  return it == geometries_.end() ? nullptr : &it->second;
}

Status MaskSpool::look_up(std::uint32_t tree, std::span<const Triangle> triangles, TreeMasks& masks) const {
  masks.entry_of.clear();
  masks.has_alphas = false;
  masks.entries.assign(TreeMasks::kShared, {});
  masks.entries[0].sides = Sides::counterclockwise;
  masks.entries[1].sides = Sides::clockwise;
  if (empty()) {
    return {};
  }
  bool any = false;
  masks.entry_of.assign(triangles.size(), TreeMasks::kNone);
  const GeometryMask* geometry = nullptr;
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    const Triangle& t = triangles[i];
    if (i == 0 || t.geometry_id != triangles[i - 1].geometry_id) {
      geometry = find(tree, t.geometry_id);
    }
    if (geometry == nullptr) {
      continue;
    }
    FaceMask face;
    if (geometry->first_face != GeometryMask::kNoFaces) {
      RAYMILL_RETURN_IF_ERROR(read_faces(geometry->first_face + t.primitive_id, {&face, 1}));
    }
    if (face.mask < FaceMask::kCut) {
      masks.entry_of[i] = static_cast<std::uint32_t>(masks.entries.size());
      masks.entries.push_back({face, geometry->sides});
      masks.has_alphas = masks.has_alphas || face.alphas != FaceMask().alphas;
      any = true;
    } else if (geometry->sides != Sides::both) {
      masks.entry_of[i] = geometry->sides == Sides::counterclockwise ? 0 : 1;
      any = true;
    }
  }
  if (!any) {
    masks.entry_of.clear();
  }
  return {};
}

}  // namespace raymill::storage
