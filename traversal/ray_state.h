// RayState: a ray while a kernel works on it. RecordLayout: the same ray while it waits.
//
// In flight a ray is a record of a few dozen bytes, and what it does not need takes none: the bitstack ends with its
// highest byte that is not zero, tnear stands only where it is not zero, the hit only where there is one, and of the
// hit only what the job asked for. The page is known from the queue. Nothing of a ray stands elsewhere, so a record can
// be moved, written to disk and taken up again by anybody.
//
//   flags level node number tfar org dir | rest of org? | skipped? | mask? | tnear? | hit? | corners? | object? |
//   bitstack
//                                     36 B + 0 or 12 + 0 or 8 + 0 or 4 + 0 or 4 + 0 to 28 + 0 or 36 + 0 or 40 to 80 + 0
//                                     to 16
//
// A ray that waits for a texel of a mask has 12 bytes more: it stands in a leaf, before a triangle that it meets, and
// its page is the mask's until the texel is known, then the leaf's.
//
// A ray that has ended and waits for attributes of its hit (attribute_fetch.h) has nothing of the last two; where it
// knows which they are it has 36 bytes, or none, by which normals go to the world.
//
// A ray in the space of a placed object has its rays in both spaces with it (kernels/instance-inl.h), the id of the
// instance and what takes normals to the world where the job asks for them.
// In mode exact a hit has the corners of its triangle with it, 36 B more: where two hits round to the same t, exact
// arithmetic decides, and the page that the first one stands in may be gone by then. The primitive that a ray skips
// and its mask stand in the records of jobs whose rays bring them, and what float32 leaves of org in those whose rays
// are float64, in stores with origins of their own for parts. A ray whose crossings are counted has the count for its
// hit.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "storage/base/types.h"
#include "traversal/query.h"

namespace raymill::traversal {

/// One mask of N bits for each level, level 0 in the low bits: children that the ray's boxes test kept and that are
/// still to be visited. This is the skip code of Afra & Szirmay-Kalos 2014 (section 3) with the circular order replaced
/// by slots in the ray's octant order, so that the next child is a table look-up.
struct Bitstack {
  std::array<std::uint64_t, 2> words{};
};
static_assert(sizeof(Bitstack) * 8 == storage::kBitstackBits);
static_assert(std::endian::native == std::endian::little, "a record holds the stack's low bytes");

/// What is to be done at the node where a ray stands.
enum class Resume : std::uint8_t {
  enter = 0,      ///< test the node's children
  backtrack = 1,  ///< go on with the bitstack, from this node upward
};

/// The node that a ray left for one that is not there. The image stays as long as the kernel's pages do.
struct LeftNode {
  const std::byte* image = nullptr;  ///< none: the ray has not moved
  std::uint32_t page = 0;
  std::uint16_t node = 0;
};

/// Of a ray in the space of a placed object.
struct InObject {
  std::uint32_t page = 0;  ///< with the node that the instance hangs on, where the ray goes on after the object
  std::uint16_t node = 0;
  std::uint8_t level = 0;  ///< of that node
  bool inside = false;
  std::uint32_t geometry_base = 0;
  float entry = 0;  ///< of the instance's box: no hit inside counts before it
  std::array<float, 3> world_org{};
  std::array<float, 3> world_dir{};
  std::uint32_t instance_id = kNoId;
  std::array<std::array<float, 3>, 3> normals{};  ///< columns; where normals are asked for
};

/// Of a ray in a leaf, before a triangle that is cut out by a mask.
struct TexelWait {
  enum class State : std::uint8_t { none = 0, asked = 1, cut = 2, counts = 3 };

  std::uint32_t leaf_page = 0;
  std::uint32_t texel = 0;  ///< of the page of masks
  std::uint16_t least = 0;  ///< value that counts
  std::uint8_t bits = 0;    ///< of a texel
  std::uint8_t slot : 3 = 0;
  std::uint8_t triangle : 3 = 0;  ///< of the leaf
  std::uint8_t state : 2 = 0;     ///< State

  [[nodiscard]] bool active() const { return state != 0; }
  [[nodiscard]] State what() const { return static_cast<State>(state); }
  void become(State to) { state = static_cast<std::uint8_t>(to) & 3U; }
};
static_assert(sizeof(TexelWait) == 12 && std::is_trivially_copyable_v<TexelWait>);

/// What a ray that has ended still waits for, where attributes of its hit are asked for.
enum class AttributeStep : std::uint8_t {
  none = 0,
  geometry = 1,  ///< the page that says where its geometry's attributes are
  entry = 2,     ///< the page with those of its triangle: entry `node`; `level` has the attributes' bits
};

struct RayState {
  std::array<float, 3> org{};  ///< in the object's space where the ray is in one; dir alike
  std::array<float, 3> dir{};
  float tnear = 0;
  float tfar = 0;  ///< of the nearest hit so far, else the ray's own
  std::uint32_t number = 0;
  Bitstack stack;
  std::uint32_t page = 0;
  std::uint16_t node = 0;
  Resume resume = Resume::enter;
  std::uint8_t level = 0;  ///< that the node must have
  bool has_hit = false;
  bool done = false;
  LeftNode left;
  Hit hit;  ///< the nearest so far
  /// Of its triangle; mode exact alone. At AttributeStep::entry: what takes normals to the world, column by column.
  std::array<std::array<float, 3>, 3> corners{};
  std::array<float, 3> org_rest{};  ///< of org in the world, beyond float32; where rays bring it
  PrimitiveIds skipped;             ///< is no hit; where rays bring it
  std::uint32_t mask = kAllMask;    ///< where rays bring it
  InObject object;
  bool left_object = false;  ///< waits for the node where it goes on after an object
  AttributeStep attribute_step = AttributeStep::none;
  TexelWait texel;  ///< stores with masks alone
};

/// Out of the object that the ray is in.
inline void leave_object(RayState& ray) {
  ray.object.inside = false;
  ray.org = ray.object.world_org;
  ray.dir = ray.object.world_dir;
}

/// Whether a record holds the corners of the hit's triangle.
enum class KeptCorners : std::uint8_t { none, of_hit };

/// What a ray brings that stands in its record.
struct KeptExtras {
  bool skipped = false;
  bool mask = false;
  bool instance_id = false;  ///< of the object that it is in
  bool normals = false;      ///< what takes the object's normals to the world
  bool texel = false;        ///< that it waits for; stores with masks alone
  bool columns = false;      ///< what takes its shading normal to the world, once it waits for that
  bool org_rest = false;     ///< what float32 leaves of org
};

/// Bytes of a waiting ray. Immutable.
class RecordLayout {
 public:
  RecordLayout() = default;
  /// `kept`: what stands in a record of the best hit so far, t apart, which is tfar.
  explicit RecordLayout(Field kept, KeptCorners corners = KeptCorners::none, KeptExtras extras = {})
      : hit_(Field(std::uint32_t(kept) & ~std::uint32_t(Field::t))),
        corners_bytes_(corners == KeptCorners::of_hit ? sizeof(RayState::corners) : 0),
        rest_bytes_(extras.org_rest ? sizeof(RayState::org_rest) : 0),
        skip_bytes_(extras.skipped ? sizeof(RayState::skipped) : 0),
        mask_bytes_(extras.mask ? sizeof(RayState::mask) : 0),
        id_bytes_(extras.instance_id ? sizeof(InObject::instance_id) : 0),
        normals_bytes_(extras.normals ? sizeof(InObject::normals) : 0),
        texel_bytes_(extras.texel ? sizeof(TexelWait) : 0),
        columns_bytes_(extras.columns ? sizeof(RayState::corners) : 0) {}

  /// Of the smallest record.
  static constexpr std::size_t kLeastBytes = 36;
  /// Of the largest record.
  [[nodiscard]] std::size_t most_bytes() const {
    return sizeof(Fixed) + rest_bytes_ + skip_bytes_ + mask_bytes_ + sizeof(float) + hit_.row_bytes() + corners_bytes_ +
           object_bytes() + texel_bytes_ + columns_bytes_ + sizeof(Bitstack);
  }
  [[nodiscard]] std::size_t bytes(const RayState& ray) const { return bytes_for(flags_of(ray), level_of(ray)); }
  [[nodiscard]] std::size_t bytes(const std::byte* record) const {
    return bytes_for(static_cast<unsigned>(record[0]), static_cast<unsigned>(record[1]));
  }

  /// Returns the record's size.
  std::size_t pack(const RayState& ray, std::byte* record) const {
    const unsigned flags = flags_of(ray);
    const Fixed fixed{
        static_cast<std::uint8_t>(flags), level_of(ray), ray.node, ray.number, ray.tfar, ray.org, ray.dir};
    std::memcpy(record, &fixed, sizeof fixed);
    std::byte* at = record + sizeof fixed;
    std::memcpy(at, &ray.org_rest, rest_bytes_);
    at += rest_bytes_;
    std::memcpy(at, &ray.skipped, skip_bytes_);
    at += skip_bytes_;
    std::memcpy(at, &ray.mask, mask_bytes_);
    at += mask_bytes_;
    if ((flags & kHasTnear) != 0) {
      std::memcpy(at, &ray.tnear, sizeof ray.tnear);
      at += sizeof ray.tnear;
    }
    if (ray.has_hit) {
      hit_.write(ray.hit, at);
      at += hit_.row_bytes();
      std::memcpy(at, ray.corners.data(), corners_bytes_);
      at += corners_bytes_;
    }
    if (ray.object.inside) {
      std::memcpy(at, &ray.object, kObjectBytes);
      std::memcpy(at + kObjectBytes, &ray.object.instance_id, id_bytes_);
      std::memcpy(at + kObjectBytes + id_bytes_, &ray.object.normals, normals_bytes_);
      at += object_bytes();
    }
    if (ray.texel.active()) {
      std::memcpy(at, &ray.texel, texel_bytes_);
      at += texel_bytes_;
    }
    if (ray.attribute_step == AttributeStep::entry) {
      std::memcpy(at, ray.corners.data(), columns_bytes_);
      at += columns_bytes_;
    }
    const std::size_t stack_bytes = flags >> kStackShift;
    std::memcpy(at, ray.stack.words.data(), stack_bytes);
    return static_cast<std::size_t>(at - record) + stack_bytes;
  }
  /// The page is the caller's to set.
  void unpack(const std::byte* record, RayState& ray) const {
    Fixed fixed;
    std::memcpy(&fixed, record, sizeof fixed);
    const std::byte* at = record + sizeof fixed;
    ray = {};
    ray.org = fixed.org;
    ray.dir = fixed.dir;
    ray.tfar = fixed.tfar;
    ray.number = fixed.number;
    ray.node = fixed.node;
    const bool at_texel = (fixed.level & kAtTexel) == kAtTexel;
    const bool at_attributes = is_at_attributes(fixed.level);
    ray.level = fixed.level & (at_texel ? kLevel & ~kAtTexel : kLevel);
    ray.left_object = !at_texel && !at_attributes && (fixed.level & kLeftObject) != 0;
    ray.resume = static_cast<Resume>(fixed.flags & kResume);
    ray.has_hit = (fixed.flags & kHasHit) != 0;
    std::memcpy(&ray.org_rest, at, rest_bytes_);
    at += rest_bytes_;
    std::memcpy(&ray.skipped, at, skip_bytes_);
    at += skip_bytes_;
    std::memcpy(&ray.mask, at, mask_bytes_);
    at += mask_bytes_;
    if ((fixed.flags & kHasTnear) != 0) {
      std::memcpy(&ray.tnear, at, sizeof ray.tnear);
      at += sizeof ray.tnear;
    }
    if (ray.has_hit) {
      ray.hit = hit_.read(at);
      ray.hit.t = fixed.tfar;
      at += hit_.row_bytes();
      std::memcpy(ray.corners.data(), at, corners_bytes_);
      at += corners_bytes_;
    }
    if (at_attributes) {
      ray.attribute_step = ray.level == 0 ? AttributeStep::geometry : AttributeStep::entry;
      if (ray.level != 0) {
        std::memcpy(ray.corners.data(), at, columns_bytes_);
      }
      return;
    }
    if ((fixed.level & kInside) != 0) {
      std::memcpy(static_cast<void*>(&ray.object), at, kObjectBytes);
      std::memcpy(&ray.object.instance_id, at + kObjectBytes, id_bytes_);
      std::memcpy(&ray.object.normals, at + kObjectBytes + id_bytes_, normals_bytes_);
      at += object_bytes();
    }
    if (at_texel) {
      std::memcpy(&ray.texel, at, texel_bytes_);
      at += texel_bytes_;
    }
    std::memcpy(ray.stack.words.data(), at, fixed.flags >> kStackShift);
  }

 private:
  static constexpr unsigned kResume = 1, kHasHit = 2, kHasTnear = 4, kStackShift = 3;
  static constexpr unsigned kInside = 0x80, kLeftObject = 0x40, kLevel = 0x3F;
  // Both at once of what a ray that waits for a texel is not: on its way out of an object, and among volumes
  // (volume/volume_kernel.h).
  static constexpr unsigned kAtTexel = kLeftObject | 0x20;
  // Both at once of what no ray is, and not at a texel; the level is then what is known of its attributes.
  static constexpr unsigned kAtAttributes = kInside | kLeftObject, kMarks = kInside | kLeftObject | 0x20;
  static bool is_at_attributes(unsigned level) { return (level & kMarks) == kAtAttributes; }
  static constexpr std::size_t kObjectBytes = offsetof(InObject, instance_id);
  static_assert(kObjectBytes == 40 && std::is_trivially_copyable_v<InObject>);
  struct Fixed {
    std::uint8_t flags;
    std::uint8_t level;
    std::uint16_t node;
    std::uint32_t number;
    float tfar;
    std::array<float, 3> org;
    std::array<float, 3> dir;
  };
  static_assert(sizeof(Fixed) == kLeastBytes && std::is_trivially_copyable_v<Fixed>);
  static_assert(sizeof(Bitstack) < 1U << (8 - kStackShift), "the stack's size shares a byte with three flags");

  static std::uint8_t level_of(const RayState& ray) {
    return static_cast<std::uint8_t>(ray.level | (ray.object.inside ? kInside : 0) |
                                     (ray.left_object ? kLeftObject : 0) | (ray.texel.active() ? kAtTexel : 0) |
                                     (ray.attribute_step != AttributeStep::none ? kAtAttributes : 0));
  }
  static unsigned flags_of(const RayState& ray) {
    const auto& words = ray.stack.words;
    const int bits = words[1] != 0 ? 64 + std::bit_width(words[1]) : std::bit_width(words[0]);
    return static_cast<unsigned>(ray.resume) | (ray.has_hit ? kHasHit : 0) | (ray.tnear != 0 ? kHasTnear : 0) |
           static_cast<unsigned>(bits + 7) / 8 << kStackShift;
  }
  [[nodiscard]] std::size_t object_bytes() const { return kObjectBytes + id_bytes_ + normals_bytes_; }
  [[nodiscard]] std::size_t bytes_for(unsigned flags, unsigned level) const {
    const bool at_attributes = is_at_attributes(level);
    const bool in_object = !at_attributes && (level & kInside) != 0, at_texel = (level & kAtTexel) == kAtTexel;
    return sizeof(Fixed) + rest_bytes_ + skip_bytes_ + mask_bytes_ + ((flags & kHasTnear) != 0 ? sizeof(float) : 0) +
           ((flags & kHasHit) != 0 ? hit_.row_bytes() + corners_bytes_ : 0) + (in_object ? object_bytes() : 0) +
           (at_texel ? texel_bytes_ : 0) + (at_attributes && level != kAtAttributes ? columns_bytes_ : 0) +
           (flags >> kStackShift);
  }

  HitLayout hit_;
  std::size_t corners_bytes_ = 0;
  std::size_t rest_bytes_ = 0;
  std::size_t skip_bytes_ = 0;
  std::size_t mask_bytes_ = 0;
  std::size_t id_bytes_ = 0;
  std::size_t normals_bytes_ = 0;
  std::size_t texel_bytes_ = 0;
  std::size_t columns_bytes_ = 0;
};

}  // namespace raymill::traversal
