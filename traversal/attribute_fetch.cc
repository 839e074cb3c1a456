#include "traversal/attribute_fetch.h"

#include <cmath>

namespace raymill::traversal {
namespace {

using storage::Attribute;
using storage::AttributeGeometry;
using storage::AttributePageKind;
using storage::AttributePageView;
using storage::AttributeSet;

constexpr unsigned kFieldShift = 9;
constexpr Field field_of(Attribute attribute) { return static_cast<Field>(storage::bit_of(attribute) << kFieldShift); }
static_assert(field_of(Attribute::normal) == Field::shading_normal && field_of(Attribute::uv0) == Field::uv0 &&
              field_of(Attribute::uv1) == Field::uv1 && field_of(Attribute::color0) == Field::color0);
static_assert(storage::kAllAttributes <= 15, "a waiting ray has its attributes in the place of its level");

void finish(RayState& ray) {
  ray.attribute_step = AttributeStep::none;
  ray.done = true;
}

void fail(AttributeContext& context, RayState& ray) {
  context.corrupt = true;
  finish(ray);
}

// The three corners of an entry.
class Entry {
 public:
  Entry(const AttributePageView& page, std::uint32_t slot)
      : set_(page.header().attributes), floats_(page.entry(slot)), corner_(storage::corner_floats(set_)) {}

  [[nodiscard]] double at(Attribute attribute, std::size_t component, const Hit& hit) const {
    const float* value = floats_ + storage::first_float(set_, attribute) + component;
    return storage::attribute_at(value[0], value[corner_], value[2 * corner_], hit.u, hit.v);
  }
  template <std::size_t N>
  void take(Attribute attribute, const Hit& hit, std::array<float, N>& out) const {
    for (std::size_t i = 0; i < N; ++i) {
      out[i] = static_cast<float>(at(attribute, i, hit));
    }
  }

 private:
  AttributeSet set_;
  const float* floats_;
  std::uint32_t corner_;
};

// To the world, and to length one. NaN where it has no direction.
void take_normal(const Entry& entry, const RayState& ray, std::array<float, 3>& out) {
  std::array<double, 3> world{};
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t i = 0; i < 3; ++i) {
      world[k] += double(ray.corners[i][k]) * entry.at(Attribute::normal, i, ray.hit);
    }
  }
  const double length = std::sqrt(world[0] * world[0] + world[1] * world[1] + world[2] * world[2]);
  if (!(length > 0) || !std::isfinite(length)) {
    return;
  }
  for (std::size_t k = 0; k < 3; ++k) {
    out[k] = static_cast<float>(world[k] / length);
  }
}

void take_values(const Entry& entry, const RayState& ray, HitAttributes& values) {
  const AttributeSet wanted = ray.level;
  if (holds(wanted, Attribute::normal)) {
    take_normal(entry, ray, values.shading_normal);
  }
  if (holds(wanted, Attribute::uv0)) {
    entry.take(Attribute::uv0, ray.hit, values.uv0);
  }
  if (holds(wanted, Attribute::uv1)) {
    entry.take(Attribute::uv1, ray.hit, values.uv1);
  }
  if (holds(wanted, Attribute::color0)) {
    entry.take(Attribute::color0, ray.hit, values.color0);
  }
}

// From the page of its geometry, the ray goes on to that of its triangle, or is done.
void leave_geometry(AttributeContext& context, const AttributePageView& page, std::uint32_t slot, RayState& ray) {
  const AttributeGeometry& geometry = page.geometry(slot);
  const AttributeSet wanted = geometry.present & context.asked;
  if (wanted == 0) {
    finish(ray);
    return;
  }
  const auto place = context.places.entry(geometry.first_entry + ray.hit.primitive_id);
  if (ray.hit.primitive_id >= geometry.triangle_count || !place) {
    fail(context, ray);
    return;
  }
  ray.attribute_step = AttributeStep::entry;
  ray.level = static_cast<std::uint8_t>(wanted);
  ray.corners = geometry.normal_columns;
  ray.page = place->page;
  ray.node = static_cast<std::uint16_t>(place->slot);
}

// The ray's next step. False: its page is not there.
bool step(AttributeContext& context, RayState& ray, HitAttributes& values) {
  const std::byte* image = context.images[ray.page].load(std::memory_order_acquire);
  if (image == nullptr) {
    return false;
  }
  context.touched[ray.page].store(1, std::memory_order_relaxed);
  ++context.pages_entered;
  const AttributePageView page(image);
  if (ray.attribute_step == AttributeStep::geometry) {
    const auto place = context.places.geometry(ray.hit.geometry_id);
    if (!place || !page.has(AttributePageKind::geometries, place->slot)) {
      fail(context, ray);
    } else {
      leave_geometry(context, page, place->slot, ray);
    }
  } else if (!page.has(AttributePageKind::entries, ray.node)) {
    fail(context, ray);
  } else {
    take_values(Entry(page, ray.node), ray, values);
    ++context.entries_read;
    finish(ray);
  }
  return true;
}

}  // namespace

AttributeSet attributes_for(Field fields) {
  return (static_cast<std::uint32_t>(fields & Field::attributes) >> kFieldShift) & storage::kAllAttributes;
}
Field fields_of(AttributeSet attributes) { return static_cast<Field>(attributes << kFieldShift); }

void begin_attributes(const AttributeContext& context, RayState& ray) {
  const auto place = context.places.geometry(ray.hit.geometry_id);
  ray.attribute_step = AttributeStep::geometry;
  ray.level = 0;
  ray.node = 0;
  ray.page = place ? place->page : context.places.first_page;
  ray.resume = Resume::enter;
  ray.tnear = 0;
  ray.tfar = ray.hit.t;  // where the record keeps it
  ray.stack = {};
  ray.left = {};
  ray.left_object = false;
  ray.object.inside = false;
  ray.texel = {};
  ray.done = false;
}

void fetch_attributes(AttributeContext& context, std::span<RayState> rays, std::span<HitAttributes> values) {
  for (std::size_t i = 0; i < rays.size(); ++i) {
    RayState& ray = rays[i];
    while (ray.attribute_step != AttributeStep::none && step(context, ray, values[i])) {
    }
  }
}

}  // namespace raymill::traversal
