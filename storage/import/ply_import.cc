#include <algorithm>
#include <array>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "storage/base/quotes.h"
#include "storage/import/byte_window.h"
#include "storage/import/mesh_import.h"
#include "storage/import/message.h"
#include "storage/import/ply_body.h"
#include "storage/import/polygon.h"
#include "storage/import/transform.h"
#include "storage/import/triangle_assembler.h"

namespace raymill::storage {

namespace {

constexpr std::uint64_t kPlyScratchBytes =
    ByteWindow::kBytes + PolygonWriter::heap_bytes() + kMostPolygonCorners * (sizeof(double) + sizeof(Vec3f));

bool holds_triangles(const PlyElement& element) { return element.name == "face" || element.name == "tristrips"; }

class PlyImport {
 public:
  explicit PlyImport(const MeshImport& import) : import_(import), polygons_(import.out, import.report) {}

  Status run() {
    RAYMILL_ASSIGN_OR_RETURN(header_, read_ply_header(import_.file));
    const auto& elements = header_.elements;
    const auto vertex = std::find_if(elements.begin(), elements.end(),
                                     [](const PlyElement& element) { return element.name == "vertex"; });
    if (vertex == elements.end()) {
      return bad_scene("has no element 'vertex'");
    }
    RAYMILL_RETURN_IF_ERROR(find_positions(*vertex));
    const auto full = [](const PlyElement& element) { return holds_triangles(element) && element.count != 0; };
    if (std::none_of(elements.begin(), elements.end(), full)) {
      return only_points(vertex->count);
    }
    RAYMILL_ASSIGN_OR_RETURN(const BudgetReservation scratch, import_.ledger.claim(Tag::build, kPlyScratchBytes));
    body_ = open_body();
    for (auto element = elements.begin(); element != vertex; ++element) {
      RAYMILL_RETURN_IF_ERROR(skip_element(*element));
    }
    RAYMILL_RETURN_IF_ERROR(read_vertices(*vertex));
    // Faces that stand before the vertices are read when these are known, in a second pass.
    auto element = vertex + 1;
    if (std::any_of(elements.begin(), vertex, full)) {
      body_ = open_body();
      element = elements.begin();
    }
    RAYMILL_RETURN_IF_ERROR(begin_geometry(import_, 0, "node0", "mesh0"));
    for (; element != elements.end(); ++element) {
      RAYMILL_RETURN_IF_ERROR(take_element(*element));
    }
    return {};
  }

 private:
  [[nodiscard]] std::unique_ptr<PlyBody> open_body() const {
    const bool moved = import_.origin != std::array<double, 3>{};
    return PlyBody::open(import_.file, header_, moved ? PlyBody::Reals::float64 : PlyBody::Reals::float32);
  }

  Status find_positions(const PlyElement& vertex) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::string_view name = std::string_view("xyz").substr(axis, 1);
      const PlyProperty* property = vertex.find(name);
      if (property == nullptr || property->list_count) {
        return bad_scene("its element 'vertex' has no property ", in_quotes(name));
      }
      positions_[axis] = property;
    }
    return {};
  }

  Status take_element(const PlyElement& element) {
    if (!holds_triangles(element)) {
      return skip_element(element);
    }
    const PlyProperty* corners = element.find("vertex_indices");
    corners = corners != nullptr ? corners : element.find("vertex_index");
    if (element.count != 0 && (corners == nullptr || !corners->list_count || !is_integer(corners->type))) {
      return bad_scene("its element ", in_quotes(element.name), " has no list 'vertex_indices' of whole numbers");
    }
    const bool strips = element.name == "tristrips";
    return for_rows(element, [&](const PlyProperty& property) {
      return &property != corners ? skip_property(property) : strips ? read_strip(property) : read_face(property);
    });
  }

  // Calls `take` with each property of each row; an error is told with the row's number.
  template <typename Take>
  Status for_rows(const PlyElement& element, const Take& take) {
    for (std::uint64_t row = 0; row < element.count; ++row) {
      RAYMILL_RETURN_IF_ERROR(import_.out.pulse());
      for (const PlyProperty& property : element.properties) {
        Status status = take(property);
        if (!status.ok()) {
          return import_.out.sink_failed() ? status : in_context(message(element.name, " ", row), status);
        }
      }
    }
    return {};
  }

  Status skip_element(const PlyElement& element) {
    if (element.has_lists() || header_.encoding == PlyEncoding::text) {
      return for_rows(element, [this](const PlyProperty& property) { return skip_property(property); });
    }
    // Fits: the header was checked against the file's size.
    return body_->skip(PlyType::uint8, element.count * element.least_row_bytes(header_.encoding));
  }

  Status skip_property(const PlyProperty& property) {
    std::uint64_t count = 1;
    if (property.list_count) {
      RAYMILL_ASSIGN_OR_RETURN(count, read_list_count(property));
    }
    return body_->skip(property.type, count);
  }

  Result<std::uint64_t> read_list_count(const PlyProperty& property) {
    double count = 0;
    RAYMILL_RETURN_IF_ERROR(body_->read(*property.list_count, std::span(&count, 1)));
    if (!(count >= 0 && count <= std::numeric_limits<std::uint32_t>::max())) {
      return bad_scene("its list ", in_quotes(property.name), " has a count that no list has");
    }
    return static_cast<std::uint64_t>(count);
  }

  Status read_vertices(const PlyElement& vertex) {
    Result<BudgetReservation> claim = import_.ledger.claim(Tag::build, vertex.count * sizeof(Vec3f));
    if (!claim.ok()) {
      return in_context(message("its ", vertex.count, " vertices must be held in memory"), claim.status());
    }
    vertices_claim_ = std::move(claim).value();
    vertices_.reserve(vertex.count);
    Vec3d position;
    const std::array<double*, 3> coordinates = {&position.x, &position.y, &position.z};
    return for_rows(vertex, [&](const PlyProperty& property) -> Status {
      const auto axis = std::find(positions_.begin(), positions_.end(), &property);
      if (axis == positions_.end()) {
        RAYMILL_RETURN_IF_ERROR(skip_property(property));
      } else {
        RAYMILL_RETURN_IF_ERROR(body_->read(property.type, std::span(coordinates[axis - positions_.begin()], 1)));
      }
      if (&property == &vertex.properties.back()) {
        const auto& origin = import_.origin;
        vertices_.push_back(round_once({position.x - origin[0], position.y - origin[1], position.z - origin[2]}));
      }
      return {};
    });
  }

  Result<Vec3f> vertex(double index) const {
    if (!(index >= 0 && index < static_cast<double>(vertices_.size()))) {
      return bad_scene("refers to vertex ", static_cast<std::int64_t>(index), " and the file has only ",
                       vertices_.size());
    }
    return vertices_[static_cast<std::size_t>(index)];
  }

  Status read_face(const PlyProperty& property) {
    RAYMILL_ASSIGN_OR_RETURN(const std::uint64_t count, read_list_count(property));
    if (count > kMostPolygonCorners) {
      return too_many_corners(count);
    }
    indices_.resize(count);
    RAYMILL_RETURN_IF_ERROR(body_->read(property.type, indices_));
    corners_.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
      RAYMILL_ASSIGN_OR_RETURN(corners_[i], vertex(indices_[i]));
    }
    return polygons_.add(corners_);
  }

  // -1 ends a strip and begins the next.
  Status read_strip(const PlyProperty& property) {
    RAYMILL_ASSIGN_OR_RETURN(std::uint64_t left, read_list_count(property));
    std::optional<TriangleAssembler> strip;
    const auto count_leftover = [&] {
      if (strip && strip->leftover() != 0) {
        import_.report.counts[ImportCode::leftover_vertices] += strip->leftover();
      }
    };
    for (; left != 0; left -= indices_.size()) {
      indices_.resize(std::min<std::uint64_t>(left, kMostPolygonCorners));
      RAYMILL_RETURN_IF_ERROR(body_->read(property.type, indices_));
      for (const double index : indices_) {
        if (index == -1) {
          count_leftover();
          strip.reset();
          continue;
        }
        RAYMILL_ASSIGN_OR_RETURN(const Vec3f corner, vertex(index));
        if (!strip) {
          strip.emplace(PrimitiveMode::triangle_strip, import_.out);
        }
        RAYMILL_RETURN_IF_ERROR(strip->feed(std::span(&corner, 1)));
      }
    }
    count_leftover();
    return {};
  }

  const MeshImport& import_;
  PolygonWriter polygons_;
  PlyHeader header_;
  std::unique_ptr<PlyBody> body_;
  std::array<const PlyProperty*, 3> positions_{};
  BudgetReservation vertices_claim_;
  std::vector<Vec3f> vertices_;
  std::vector<double> indices_;
  std::vector<Vec3f> corners_;
};

}  // namespace

Status import_ply(const MeshImport& import) { return PlyImport(import).run(); }

}  // namespace raymill::storage
