// What is asked of a store and how the answer looks: rays, hits, queries, modes, fields. Public.
#pragma once

#include <array>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>

#include "storage/base/status.h"

namespace raymill {

/// closest: the nearest hit. any: whether there is a hit at all.
/// count: how many crossings a ray has. all: every crossing, in order. traversal/crossings.md says what a crossing is.
/// transmittance: the share of light that fog volumes let pass between tnear and tfar; surfaces do not count.
/// spans: every part of [tnear, tfar] where a fog volume is denser than a threshold, in order.
enum class Query : std::uint8_t { closest, any, count, all, transmittance, spans };

/// Whether a ray's answer is a list, of hits or of spans.
constexpr bool gives_lists(Query query) { return query == Query::all || query == Query::spans; }
/// Whether a query looks at fog volumes, and at nothing else.
constexpr bool is_of_fog(Query query) { return query == Query::transmittance || query == Query::spans; }

/// exact: the integral of the trilinear field, cell by cell. march: samples at the middle of equal steps. ratio: a
/// random estimate that is right on the average (residual ratio tracking).
enum class VolumeMethod : std::uint8_t { exact, march, ratio };

/// How transmittance and spans are answered. traversal/volume/README.md says what each costs and is worth.
struct VolumeConfig {
  VolumeMethod method = VolumeMethod::exact;
  double step = 0;           ///< march: the longest, in scene units
  double density_scale = 1;  ///< extinction in 1 / scene unit, of a voxel that holds 1
  std::uint64_t seed = 1;    ///< ratio: what the answer depends on besides the ray itself
  double majorant = 1;       ///< ratio: how many times the least majorant; more samples, less noise
  double threshold = 0;      ///< spans: the voxel value that a span lies above
};

/// watertight: no ray passes between triangles that share an edge or a vertex (the decision is made in float64).
/// fast: Moeller-Trumbore in float32; error measured, not bounded.
/// exact: the hit of exact arithmetic on the store's float32 corners: whether there is one, which triangle it is, and
/// t, rounded to the nearest float32. traversal/exact.md says what decides at edges, in planes and at equal t.
enum class Mode : std::uint8_t { watertight, fast, exact };

/// What a hit row holds. The last four are what a store keeps of its triangles' corners (BuildConfig::attributes),
/// taken to where the ray hits (storage/ATTRIBUTES.md); NaN where there is nothing to take, and only Query::closest
/// answers them. For Query::any only `t` is answered: 0 where something was hit, +inf where nothing was. For
/// Query::count only `count` is, for Query::transmittance only `transmittance`, and by no other query; for Query::spans
/// `t`, `t_leave` and `geometry_id`.
enum class Field : std::uint32_t {
  none = 0,
  t = 1,                 ///< float32, in lengths of dir
  uv = 2,                ///< two float32: hit = (1-u-v) v0 + u v1 + v v2
  primitive_id = 4,      ///< uint32
  geometry_id = 8,       ///< uint32
  instance_id = 16,      ///< uint32; 0xFFFFFFFF: flattened geometry has no instance
  normal = 32,           ///< three float32: (v1-v0) x (v2-v0), normalised, not flipped
  count = 64,            ///< uint32; kNoCount: the ray is invalid
  transmittance = 128,   ///< float32, alone; NaN: the ray is invalid
  t_leave = 256,         ///< float32: where a span ends that begins at t
  shading_normal = 512,  ///< three float32: in the world, of length one
  uv0 = 1024,            ///< two float32: TEXCOORD_0
  uv1 = 2048,            ///< two float32: TEXCOORD_1
  color0 = 4096,         ///< four float32: COLOR_0; alpha is 1 where the scene has none
  attributes = shading_normal | uv0 | uv1 | color0,
  ids = primitive_id | geometry_id,
  all = 63,  ///< of a hit
};
constexpr Field operator|(Field a, Field b) { return Field(std::uint32_t(a) | std::uint32_t(b)); }
constexpr Field operator&(Field a, Field b) { return Field(std::uint32_t(a) & std::uint32_t(b)); }
constexpr Field without(Field set, Field fields) { return Field(std::uint32_t(set) & ~std::uint32_t(fields)); }
constexpr bool has(Field set, Field field) { return (std::uint32_t(set) & std::uint32_t(field)) != 0; }

constexpr Field kDefaultClosestFields = Field::t | Field::uv | Field::ids;
constexpr Field kSpanFields = Field::t | Field::t_leave | Field::geometry_id;

constexpr std::uint32_t kNoId = 0xFFFFFFFFu;
constexpr std::uint32_t kNoCount = 0xFFFFFFFFu;
constexpr std::uint32_t kAllMask = 0xFFFFFFFFu;
/// u and v of a hit that a proxy gave (TraceConfig::tolerance): its ids name the largest triangle that it stands for.
constexpr float kProxyBarycentric = -1;

/// A ray in world space. dir need not have length one; t counts in lengths of dir; a hit has tnear <= t <= tfar.
/// A ray is invalid when org or dir holds a NaN or an infinity, dir is zero, an end of the interval is NaN, or
/// tnear > tfar; its answer is t = NaN, or kNoCount, or no hits where all are asked for.
struct Ray {
  std::array<float, 3> org{};
  float tnear = 0;
  std::array<float, 3> dir{};
  float tfar = std::numeric_limits<float>::infinity();
};
static_assert(sizeof(Ray) == 32 && std::is_trivially_copyable_v<Ray>);

/// The same in float64. It is traced as a Ray, so what it gives is where it begins: org is taken relative to the
/// store's origin before it is rounded (traversal/ray_rounding.h).
struct Ray64 {
  std::array<double, 3> org{};
  double tnear = 0;
  std::array<double, 3> dir{};
  double tfar = std::numeric_limits<double>::infinity();
};
static_assert(sizeof(Ray64) == 64 && std::is_trivially_copyable_v<Ray64>);

/// Names a primitive.
struct PrimitiveIds {
  std::uint32_t geometry_id = kNoId;
  std::uint32_t primitive_id = kNoId;
  auto operator<=>(const PrimitiveIds&) const = default;
};

/// What rays bring; each empty, or one for each ray.
struct RayExtras {
  /// A primitive that the ray passes through, as the surface that it leaves; kNoId for none.
  std::span<const PrimitiveIds> skipped = {};
  std::span<const std::uint32_t> masks = {};
};

/// A hit with every field; those that were not asked for hold their defaults. A miss: t = +inf, ids kNoId. The answer
/// to Query::transmittance stands in t; a span's end in u.
struct Hit {
  float t = std::numeric_limits<float>::infinity();
  float u = 0;
  float v = 0;
  std::uint32_t primitive_id = kNoId;
  std::uint32_t geometry_id = kNoId;
  std::uint32_t instance_id = kNoId;
  std::array<float, 3> normal{};
  std::uint32_t count = 0;  ///< of crossings
};

/// Attributes of a hit. Those that were not asked for, that its triangle lacks, and those of a miss are NaN.
struct HitAttributes {
  static constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  std::array<float, 3> shading_normal{kNone, kNone, kNone};
  std::array<float, 2> uv0{kNone, kNone};
  std::array<float, 2> uv1{kNone, kNone};
  std::array<float, 4> color0{kNone, kNone, kNone, kNone};
};

inline constexpr HitAttributes kNoAttributes{};

/// Rows of hits: the asked fields, packed in the order t, t_leave, u, v, primitive_id, geometry_id, instance_id,
/// normal, count, shading_normal, uv0, uv1, color0. It is the row of the structured .npy and of the wire alike
/// (little-endian). Immutable.
class HitLayout {
 public:
  HitLayout() = default;
  explicit HitLayout(Field fields);

  [[nodiscard]] Field fields() const { return fields_; }
  [[nodiscard]] std::size_t row_bytes() const { return row_bytes_; }
  /// Attributes are NaN.
  void write(const Hit& hit, std::byte* row) const;
  void write(const Hit& hit, const HitAttributes& attributes, std::byte* row) const;
  [[nodiscard]] Hit read(const std::byte* row) const;
  [[nodiscard]] HitAttributes read_attributes(const std::byte* row) const;
  /// The dtype of a NumPy structured array of such rows, e.g. "[('t', '<f4'), ('primitive_id', '<u4')]"; a plain one of
  /// counts.
  [[nodiscard]] std::string numpy_descr() const;

 private:
  Field fields_ = Field::none;
  std::size_t row_bytes_ = 0;
  std::size_t hit_bytes_ = 0;  // of those, before the attributes
};

/// The fields that a query answers when these are asked for.
constexpr Field answered_fields(Query query, Field asked) {
  return query == Query::any             ? Field::t
         : query == Query::count         ? Field::count
         : query == Query::transmittance ? Field::transmittance
         : query == Query::spans         ? kSpanFields
                                         : asked;
}

std::string_view to_string(Query query);
std::string_view to_string(Mode mode);
std::string_view to_string(VolumeMethod method);
/// Fields as a comma-separated list of names, as `--fields` takes them.
std::string to_string(Field fields);
Result<Query> parse_query(std::string_view text);
Result<Mode> parse_mode(std::string_view text);
Result<VolumeMethod> parse_volume_method(std::string_view text);
Result<Field> parse_fields(std::string_view text);

}  // namespace raymill
