// VolumeTree: bricks and tiles in tree order go in, pages and the volume's entry in the table come out.
//
//   add_brick() --> the open node of level 1 --full--> page of bricks, the node beside them
//                        |  closed
//                        v
//                   open nodes of levels 2, 3, ... --closed--> page of nodes           finish(): the root, last
//
// A node is written after its children, so references are known when they are written; at most one node of each level
// and two pages are held. What comes out depends on what came in alone. Thread-confined.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "storage/base/aligned.h"
#include "storage/base/volume.h"
#include "storage/volume/volume_page.h"

namespace raymill::storage {

class VolumeTree final : public BrickSink {
 public:
  struct Config {
    std::uint32_t volume = 0;  ///< index in the table
    std::uint32_t geometry_id = 0;
    std::uint32_t page_bytes = 0;
    std::uint32_t first_page = 0;                 ///< of the pages that it makes
    std::optional<std::int32_t> step_exponent{};  ///< values on multiples of 2^e; none: float32 as they come
    /// Takes a page's image. Pages may come in another order than that of their numbers.
    std::function<Status(std::uint32_t page, std::span<const std::byte> image)> write;
  };
  VolumeTree(const GridInfo& grid, Config config);

  /// Memory that one holds.
  static std::uint64_t bytes(std::uint32_t page_bytes);

  /// Errors: bad_scene (a value that is not finite), internal (out of order, outside the grid), and those of write().
  Status add_brick(const Index3& origin, std::span<const float, kBrickValues> values) override;
  Status add_tile(const Index3& origin, unsigned level, float value) override;
  /// Writes what is left. Call once. Errors: those of write().
  Result<Volume> finish();

  [[nodiscard]] std::uint32_t next_page() const { return next_page_; }

 private:
  struct Child {
    float lower = 0, upper = 0;
    std::uint32_t page = 0;
    std::uint16_t item = 0;
    ChildKind kind = ChildKind::tile;
  };
  struct OpenPage {
    std::uint32_t number = 0;
    std::vector<VolumeNode> nodes;
    std::vector<Brick> bricks;
    std::vector<std::byte> values;
    [[nodiscard]] bool empty() const { return nodes.empty() && bricks.empty(); }
  };
  struct PendingBrick {
    Brick brick;
    std::size_t slot = 0;
  };

  Status open_path(const Index3& origin, unsigned level, std::size_t& slot);
  [[nodiscard]] VolumeNode new_node(const Index3& origin, unsigned level) const;
  [[nodiscard]] Index3 node_origin(const Index3& origin, unsigned level) const;
  static std::size_t slot_in(const VolumeNode& node, const Index3& origin);
  static void set(VolumeNode& node, std::size_t slot, const Child& child);
  Status close(unsigned level);
  Result<Child> place(unsigned level);
  Result<Child> place_node(OpenPage& page, const VolumeNode& node);
  Status place_bricks();
  [[nodiscard]] bool fits(const OpenPage& page, std::size_t nodes, std::size_t bricks, std::size_t values) const;
  void begin(OpenPage& page);
  Status flush(OpenPage& page);
  Brick quantise(std::span<const float, kBrickValues> values, const Index3& origin);
  [[nodiscard]] float on_lattice(float value) const;

  const GridInfo grid_;
  const Config config_;
  const unsigned levels_;
  std::uint32_t next_page_;
  std::vector<VolumeNode> open_;  // [level - 1], from the root (last) down to open_from_
  unsigned open_from_;            // least level that is open; levels_ + 1: none
  std::vector<PendingBrick> pending_;
  std::vector<std::byte> pending_values_;
  OpenPage bricks_, nodes_;
  PageBuffer image_;
  std::uint64_t last_place_ = 0;  // of what came last, in tree order
  bool any_ = false;
  std::uint64_t brick_count_ = 0;
  Child root_;
};

}  // namespace raymill::storage
