// MaskSpool: the masks of a scene and what they do to its triangles, in blocks that go to disk where memory is short.
//
// A geometry's faces are kept once for each mesh, however often that is placed; trees find them by the triangles' ids.
// add_...() and finish() are thread-confined; after finish() the rest may be called from many threads.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "storage/base/block_store.h"
#include "storage/base/mask.h"
#include "storage/base/status.h"
#include "storage/base/vec3.h"
#include "storage/import/mask_sink.h"

namespace raymill::storage {

/// Of the triangles of one tree.
struct TreeMasks {
  struct Entry {
    FaceMask face;
    Sides sides = Sides::both;
  };
  static constexpr std::uint32_t kNone = 0xFFFFFFFF;
  /// The first entries stand for sides alone and are shared.
  static constexpr std::uint32_t kShared = 2;

  std::vector<std::uint32_t> entry_of;  ///< [triangle]; empty: none has one
  std::vector<Entry> entries;
  bool has_alphas = false;
};

class MaskSpool {
 public:
  static constexpr std::uint32_t kWorld = 0xFFFFFFFF;  ///< the tree that is no object's
  explicit MaskSpool(BlockStore& blocks) : blocks_(blocks) {}

  [[nodiscard]] bool empty() const { return geometries_.empty(); }
  /// Memory that a spool holds beside its tables.
  static constexpr std::uint64_t bytes() { return kBlockBytes; }

  /// Errors: disk_full, io.
  Result<std::uint32_t> add_mask(const AlphaMap& map);
  Result<std::uint64_t> add_faces(std::span<const FaceMask> faces);
  Status read_faces(std::uint64_t first, std::span<FaceMask> faces) const;
  void set_masks(std::uint32_t tree, std::uint32_t geometry_id, const GeometryMask& masks) {
    geometries_[{tree, geometry_id}] = masks;
  }
  /// No more come. Errors: disk_full, io.
  Status finish();

  /// What is known of a tree's triangles. Errors: io.
  Status look_up(std::uint32_t tree, std::span<const Triangle> triangles, TreeMasks& masks) const;
  /// What look_up() takes for so many triangles.
  static constexpr std::uint64_t tree_bytes(std::uint64_t triangles) {
    return triangles * (sizeof(std::uint32_t) + sizeof(TreeMasks::Entry));
  }

  struct Mask {
    MaskInfo info;
    std::vector<BlockId> tiles;  ///< row by row, as many to a block as fit
  };
  [[nodiscard]] std::span<const Mask> masks() const { return masks_; }
  /// Tiles of a mask from `first` on; as many bytes as `out` has. Errors: io.
  Status read_tiles(const Mask& mask, std::uint64_t first, std::span<std::byte> out) const;

 private:
  static constexpr std::size_t kPerBlock = kBlockBytes / sizeof(FaceMask);
  [[nodiscard]] const GeometryMask* find(std::uint32_t tree, std::uint32_t geometry_id) const;

  BlockStore& blocks_;
  std::vector<Mask> masks_;
  std::vector<BlockId> written_;  // faces
  std::vector<FaceMask> filling_;
  std::uint64_t face_count_ = 0;
  std::map<std::pair<std::uint32_t, std::uint32_t>, GeometryMask> geometries_;  // by tree and geometry id
};

}  // namespace raymill::storage
