#include "storage/import/scene_origin.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <memory>
#include <optional>
#include <span>
#include <string_view>

#include "storage/import/extent.h"
#include "storage/import/message.h"
#include "storage/import/ply_body.h"
#include "storage/import/ply_header.h"
#include "storage/import/scene_format.h"
#include "storage/import/text_reader.h"

namespace raymill::storage {

namespace {

using Point = std::array<double, 3>;

// The first vertex of a file of words.
std::optional<Point> first_vertex_of_words(const ByteSource& file, std::string_view keyword) {
  TextReader text(file, 0, {.comments = true, .continuations = false});
  for (std::string_view word = text.word_of_any_line(); !word.empty(); word = text.word_of_any_line()) {
    if (word != keyword) {
      continue;
    }
    Point p{};
    bool good = true;
    for (double& x : p) {
      good = good && parse_double(text.word(), x) && std::isfinite(x);
    }
    return good ? std::optional<Point>(p) : std::nullopt;
  }
  return std::nullopt;
}

// The first vertex of a PLY whose positions are wider than float32. Where faces come first, the world's zero will do.
std::optional<Point> first_vertex_of_ply(const ByteSource& file) {
  const Result<PlyHeader> header = read_ply_header(file);
  if (!header.ok() || header->elements.empty()) {
    return std::nullopt;  // the import says why
  }
  const PlyElement& first = header->elements.front();
  if (first.name != "vertex" || first.has_lists() || first.count == 0) {
    return Point{};
  }
  const std::unique_ptr<PlyBody> body = PlyBody::open(file, *header, PlyBody::Reals::float64);
  Point p{};
  bool is_wide = false;
  for (const PlyProperty& property : first.properties) {
    double value = 0;
    if (!body->read(property.type, std::span(&value, 1)).ok()) {
      return std::nullopt;
    }
    const std::size_t axis = std::string_view("xyz").find(property.name);
    if (property.name.size() == 1 && axis < p.size()) {
      p[axis] = std::isfinite(value) ? value : 0;
      is_wide = is_wide || header->encoding == PlyEncoding::text || property.type == PlyType::float64 ||
                is_integer(property.type);
    }
  }
  return is_wide ? std::optional<Point>(p) : std::nullopt;
}

// Of a file that is worth a look.
std::optional<Point> first_vertex(SceneFormat format, const ByteSource& file) {
  switch (format) {
    case SceneFormat::obj:
      return first_vertex_of_words(file, "v");
    case SceneFormat::stl_text:
      return first_vertex_of_words(file, "vertex");
    case SceneFormat::ply:
      return first_vertex_of_ply(file);
    case SceneFormat::gltf:
    case SceneFormat::stl_binary:
      break;
  }
  return std::nullopt;
}

bool is_near(const Point& p, const Point& place) {
  bool is = true;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    is = is && std::fabs(p[axis] - place[axis]) <= kNearReach;
  }
  return is;
}

}  // namespace

Result<std::optional<Origin>> parse_origin(const std::string& text) {
  if (text == "auto") {
    return std::optional<Origin>();
  }
  if (text == "none") {
    return std::optional<Origin>(Origin());
  }
  std::array<double, 3> position{};
  const char* at = text.data();
  const char* const end = at + text.size();
  bool good = true;
  for (std::size_t axis = 0; axis < 3 && good; ++axis) {
    const auto [last, error] = std::from_chars(at, end, position[axis]);
    good = error == std::errc() && std::isfinite(position[axis]) && (axis == 2 ? last == end : *last == ',');
    at = good && axis < 2 ? last + 1 : last;
  }
  double most = 0;
  for (const double x : position) {
    most = std::max(most, std::fabs(x));
  }
  if (!good || most > 0x1p120) {
    return {ErrorCode::invalid_argument,
            "--origin " + text + " is none of auto, none and X,Y,Z, such as 500000,0,5200000"};
  }
  constexpr int kBits = 30;
  return std::optional<Origin>(most > 0 ? origin_near(position, std::ilogb(most) - kBits) : Origin());
}

Result<SceneLook> look_at_scene(const std::string& path, const ImportOptions& options, const std::optional<Point>& near,
                                Ledger& ledger, const std::function<Status()>& keep_going) {
  RAYMILL_ASSIGN_OR_RETURN(const ByteSource file, ByteSource::open(path));
  const Result<SceneFormat> format = detect_format(file, path);
  if (!format.ok()) {
    return in_context(path, format.status());
  }
  if (*format == SceneFormat::gltf) {
    return look_at_gltf(path, options.scene, ledger, keep_going);
  }
  const std::optional<Point> first = first_vertex(*format, file);
  // A PLY of wide numbers may begin anywhere and lie far out all the same.
  const bool is_worth_it = *format == SceneFormat::ply && !near;
  if (!first || (!is_worth_it && is_near(*first, near.value_or(Point{})))) {
    return SceneLook();
  }
  // About its own first vertex: where float32 would leave nothing of a scene, it is there to be measured.
  ImportOptions about;
  about.scene = options.scene;
  about.origin = *first;
  ExtentSink sink(about.origin, keep_going);
  ImportReport unused;
  RAYMILL_RETURN_IF_ERROR(import_scene(path, about, ledger, sink, unused));
  return SceneLook{sink.extent(), {{sink.extent(), true}}, true, {}};
}

Origin choose_origin(const Extent& extent) {
  if (!extent.is_far()) {
    return {};
  }
  return origin_near(extent.middle(), extent.side() > 0 ? std::ilogb(extent.side()) + 1 : -Origin::kMostExponent);
}

Result<Origin> choose_origin(const std::string& path, const ImportOptions& options, Ledger& ledger,
                             const std::function<Status()>& keep_going) {
  RAYMILL_ASSIGN_OR_RETURN(const SceneLook look, look_at_scene(path, options, {}, ledger, keep_going));
  return choose_origin(look.extent);
}

}  // namespace raymill::storage
