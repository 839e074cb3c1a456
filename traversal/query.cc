#include "traversal/query.h"

#include <utility>

namespace raymill {
namespace {

struct NamedField {
  Field field;
  std::string_view name;
};
constexpr NamedField kFieldNames[] = {
    {Field::t, "t"},
    {Field::uv, "uv"},
    {Field::primitive_id, "primitive_id"},
    {Field::geometry_id, "geometry_id"},
    {Field::instance_id, "instance_id"},
    {Field::normal, "normal"},
    {Field::count, "count"},
    {Field::transmittance, "transmittance"},
    {Field::t_leave, "t_leave"},
    {Field::shading_normal, "shading_normal"},
    {Field::uv0, "uv0"},
    {Field::uv1, "uv1"},
    {Field::color0, "color0"},
};
constexpr Query kQueries[] = {Query::closest, Query::any, Query::count, Query::all, Query::transmittance, Query::spans};

template <typename T>
void put(std::byte*& at, const T& value) {
  std::memcpy(at, &value, sizeof value);
  at += sizeof value;
}

template <typename T>
void get(const std::byte*& at, T& value) {
  std::memcpy(&value, at, sizeof value);
  at += sizeof value;
}

// Calls step(member) for each asked member of a hit, in the row's order.
template <typename HitType, typename Step>
void for_each_member(Field fields, HitType& hit, Step&& step) {
  if (has(fields, Field::t)) {
    step(hit.t);
  }
  if (has(fields, Field::t_leave)) {
    step(hit.u);
  }
  if (has(fields, Field::uv)) {
    step(hit.u);
    step(hit.v);
  }
  if (has(fields, Field::primitive_id)) {
    step(hit.primitive_id);
  }
  if (has(fields, Field::geometry_id)) {
    step(hit.geometry_id);
  }
  if (has(fields, Field::instance_id)) {
    step(hit.instance_id);
  }
  if (has(fields, Field::normal)) {
    step(hit.normal);
  }
  if (has(fields, Field::count)) {
    step(hit.count);
  }
  if (has(fields, Field::transmittance)) {
    step(hit.t);
  }
}

// The same of its attributes, behind them.
template <typename Attributes, typename Step>
void for_each_attribute(Field fields, Attributes& attributes, Step&& step) {
  if (has(fields, Field::shading_normal)) {
    step(attributes.shading_normal);
  }
  if (has(fields, Field::uv0)) {
    step(attributes.uv0);
  }
  if (has(fields, Field::uv1)) {
    step(attributes.uv1);
  }
  if (has(fields, Field::color0)) {
    step(attributes.color0);
  }
}

}  // namespace

HitLayout::HitLayout(Field fields) : fields_(fields) {
  Hit hit;
  HitAttributes attributes;
  const auto add = [this](const auto& member) { row_bytes_ += sizeof member; };
  for_each_member(fields, hit, add);
  hit_bytes_ = row_bytes_;
  for_each_attribute(fields, attributes, add);
}

void HitLayout::write(const Hit& hit, std::byte* row) const { write(hit, kNoAttributes, row); }

void HitLayout::write(const Hit& hit, const HitAttributes& attributes, std::byte* row) const {
  const auto put_member = [&row](const auto& member) { put(row, member); };
  for_each_member(fields_, hit, put_member);
  if (has(fields_, Field::attributes)) {
    for_each_attribute(fields_, attributes, put_member);
  }
}

Hit HitLayout::read(const std::byte* row) const {
  Hit hit;
  for_each_member(fields_, hit, [&row](auto& member) { get(row, member); });
  return hit;
}

HitAttributes HitLayout::read_attributes(const std::byte* row) const {
  HitAttributes attributes;
  row += hit_bytes_;
  for_each_attribute(fields_, attributes, [&row](auto& member) { get(row, member); });
  return attributes;
}

std::string HitLayout::numpy_descr() const {
  if (fields_ == Field::count) {
    return "'<u4'";
  }
  if (fields_ == Field::transmittance) {
    return "'<f4'";
  }
  std::string text = "[";
  const auto column = [&text](std::string_view name, std::string_view type, std::string_view shape = "") {
    text += text.size() > 1 ? ", " : "";
    text += "('" + std::string(name) + "', '" + std::string(type) + "'" + std::string(shape) + ")";
  };
  if (has(fields_, Field::t)) {
    column("t", "<f4");
  }
  if (has(fields_, Field::t_leave)) {
    column("t_leave", "<f4");
  }
  if (has(fields_, Field::uv)) {
    column("u", "<f4");
    column("v", "<f4");
  }
  if (has(fields_, Field::primitive_id)) {
    column("primitive_id", "<u4");
  }
  if (has(fields_, Field::geometry_id)) {
    column("geometry_id", "<u4");
  }
  if (has(fields_, Field::instance_id)) {
    column("instance_id", "<u4");
  }
  if (has(fields_, Field::normal)) {
    column("normal", "<f4", ", (3,)");
  }
  if (has(fields_, Field::count)) {
    column("count", "<u4");
  }
  if (has(fields_, Field::shading_normal)) {
    column("shading_normal", "<f4", ", (3,)");
  }
  if (has(fields_, Field::uv0)) {
    column("uv0", "<f4", ", (2,)");
  }
  if (has(fields_, Field::uv1)) {
    column("uv1", "<f4", ", (2,)");
  }
  if (has(fields_, Field::color0)) {
    column("color0", "<f4", ", (4,)");
  }
  return text + "]";
}

std::string_view to_string(Query query) {
  switch (query) {
    case Query::any:
      return "any";
    case Query::count:
      return "count";
    case Query::all:
      return "all";
    case Query::transmittance:
      return "transmittance";
    case Query::spans:
      return "spans";
    default:
      return "closest";
  }
}
std::string_view to_string(Mode mode) {
  switch (mode) {
    case Mode::fast:
      return "fast";
    case Mode::exact:
      return "exact";
    default:
      return "watertight";
  }
}

std::string_view to_string(VolumeMethod method) {
  switch (method) {
    case VolumeMethod::march:
      return "march";
    case VolumeMethod::ratio:
      return "ratio";
    default:
      return "exact";
  }
}

std::string to_string(Field fields) {
  std::string text;
  for (const NamedField& named : kFieldNames) {
    if (has(fields, named.field)) {
      if (!text.empty()) {
        text += ',';
      }
      text += named.name;
    }
  }
  return text;
}

Result<Query> parse_query(std::string_view text) {
  for (const Query query : kQueries) {
    if (text == to_string(query)) {
      return query;
    }
  }
  return {ErrorCode::invalid_argument,
          "query '" + std::string(text) + "' is none of closest, any, count, all, transmittance, spans"};
}

Result<Mode> parse_mode(std::string_view text) {
  for (const Mode mode : {Mode::watertight, Mode::fast, Mode::exact}) {
    if (text == to_string(mode)) {
      return mode;
    }
  }
  return {ErrorCode::invalid_argument, "mode '" + std::string(text) + "' is none of watertight, fast, exact"};
}

Result<VolumeMethod> parse_volume_method(std::string_view text) {
  for (const VolumeMethod method : {VolumeMethod::exact, VolumeMethod::march, VolumeMethod::ratio}) {
    if (text == to_string(method)) {
      return method;
    }
  }
  return {ErrorCode::invalid_argument, "method '" + std::string(text) + "' is none of exact, march, ratio"};
}

Result<Field> parse_fields(std::string_view text) {
  Field fields = Field::none;
  while (!text.empty()) {
    const std::size_t comma = text.find(',');
    const std::string_view name = text.substr(0, comma);
    text = comma == std::string_view::npos ? std::string_view{} : text.substr(comma + 1);
    Field field = name == "all"                ? Field::all
                  : name == "ids"              ? Field::ids
                  : name == "u" || name == "v" ? Field::uv
                                               : Field::none;
    for (const NamedField& named : kFieldNames) {
      field = name == named.name ? named.field : field;
    }
    if (field == Field::none) {
      return {ErrorCode::invalid_argument,
              "field '" + std::string(name) +
                  "' is none of t, uv, primitive_id, geometry_id, instance_id, normal, ids, all, shading_normal, uv0, "
                  "uv1, color0"};
    }
    fields = fields | field;
  }
  if (fields == Field::none) {
    return {ErrorCode::invalid_argument, "no field is named; give some of t, uv, primitive_id, geometry_id, normal"};
  }
  return fields;
}

}  // namespace raymill
