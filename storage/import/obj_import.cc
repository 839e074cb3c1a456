#include <map>
#include <utility>
#include <vector>

#include "storage/base/quotes.h"
#include "storage/import/mesh_import.h"
#include "storage/import/message.h"
#include "storage/import/polygon.h"
#include "storage/import/text_reader.h"
#include "storage/import/vertex_blocks.h"

namespace raymill::storage {

namespace {

constexpr TextReader::Style kObjStyle{.comments = true, .continuations = true};
// An entry of the map of geometries and of the report, with its three names.
constexpr std::uint64_t kObjGeometryBytes = 512 + 6 * kMostNameBytes;
constexpr std::uint64_t kObjScratchBytes =
    ByteWindow::kBytes + PolygonWriter::heap_bytes() + kMostPolygonCorners * sizeof(Vec3f);

// Two passes: vertices, then faces, so that a face may name vertices that come after it.
class ObjImport {
 public:
  explicit ObjImport(const MeshImport& import)
      : import_(import), polygons_(import.out, import.report), vertices_(import.ledger) {}

  Status run() {
    RAYMILL_ASSIGN_OR_RETURN(const BudgetReservation scratch, import_.ledger.claim(Tag::build, kObjScratchBytes));
    RAYMILL_ASSIGN_OR_RETURN(names_claim_, import_.ledger.claim(Tag::build, 0));
    RAYMILL_ASSIGN_OR_RETURN(text_begin_, text_offset(import_.file));
    RAYMILL_RETURN_IF_ERROR(read_vertices());
    RAYMILL_RETURN_IF_ERROR(read_faces());
    return geometries_.empty() ? only_points(vertices_.size()) : Status();
  }

 private:
  struct Names {
    std::string object, group, material;
    auto operator<=>(const Names&) const = default;
  };

  Status read_vertices() {
    TextReader text(import_.file, text_begin_, kObjStyle);
    do {
      if (text.word() != "v") {
        continue;
      }
      Vec3f position;
      for (int axis = 0; axis < 3; ++axis) {
        const std::string_view word = text.word();
        if (!parse_coordinate(word, import_.origin[axis], position[axis])) {
          return on_line(text, bad_number("a coordinate", word));
        }
      }
      if (!vertices_.add(position).ok()) {
        return too_many_vertices(text);
      }
      RAYMILL_RETURN_IF_ERROR(import_.out.pulse());
    } while (text.next_line());
    return text.status();
  }

  // Counts on, so that the sentence says what would do.
  Status too_many_vertices(TextReader& text) {
    std::uint64_t count = vertices_.size();
    while (text.next_line()) {
      count += text.word() == "v" ? 1 : 0;
      RAYMILL_RETURN_IF_ERROR(import_.out.pulse());
    }
    RAYMILL_RETURN_IF_ERROR(text.status());
    vertices_.clear();
    const auto claim = import_.ledger.claim(Tag::build, VertexBlocks::claim_bytes(count));
    return in_context(message("its ", count, " vertices must be held in memory"),
                      claim.ok() ? Status(ErrorCode::budget_exceeded, "others took it meanwhile") : claim.status());
  }

  Status read_faces() {
    TextReader text(import_.file, text_begin_, kObjStyle);
    do {
      const std::string_view keyword = text.word();
      Status status;
      if (keyword == "v") {
        ++vertices_met_;
        status = import_.out.pulse();
      } else if (keyword == "f" || keyword == "fo") {
        status = read_face(text);
      } else if (keyword == "o") {
        rename(names_.object, text);
      } else if (keyword == "g") {
        rename(names_.group, text);
      } else if (keyword == "usemtl") {
        rename(names_.material, text);
      } else {
        count_left_out(keyword);
      }
      if (!status.ok()) {
        return import_.out.sink_failed() ? status : on_line(text, status);
      }
    } while (text.next_line());
    return text.status();
  }

  void rename(std::string& name, TextReader& text) {
    name = text.rest_of_line(kMostNameBytes);
    renamed_ = true;
  }

  void count_left_out(std::string_view keyword) {
    if (keyword == "p") {
      ++import_.report.counts[ImportCode::left_out_points];
    } else if (keyword == "l") {
      ++import_.report.counts[ImportCode::left_out_lines];
    } else if (keyword == "curv" || keyword == "curv2" || keyword == "surf") {
      ++import_.report.counts[ImportCode::left_out_curves];
    }
  }

  Status read_face(TextReader& text) {
    RAYMILL_RETURN_IF_ERROR(choose_geometry());
    corners_.clear();
    for (std::string_view word = text.word(); !word.empty(); word = text.word()) {
      if (corners_.size() == kMostPolygonCorners) {
        return too_many_corners(corners_.size() + 1);
      }
      RAYMILL_ASSIGN_OR_RETURN(const Vec3f corner, vertex(word));
      corners_.push_back(corner);
    }
    return polygons_.add(corners_);
  }

  // "7", "7/1", "7//3", "7/1/3"; negative: counted back from the vertices that stand before the face.
  Result<Vec3f> vertex(std::string_view word) const {
    std::int64_t number = 0;
    const std::size_t slash = word.find('/');
    if (!parse_integer(word.substr(0, slash), number) ||
        (slash != std::string_view::npos && word.find_first_not_of("0123456789+-/", slash) != std::string_view::npos)) {
      return bad_number("a corner", word);
    }
    const std::int64_t limit = static_cast<std::int64_t>(number < 0 ? vertices_met_ : vertices_.size());
    if (number == 0 || number < -limit || number > limit) {
      return bad_scene("a face refers to vertex ", number, " and there are ", limit,
                       number < 0 ? " before it" : ", counted from 1");
    }
    return vertices_[static_cast<std::uint64_t>(number < 0 ? limit + number : number - 1)];
  }

  // A group that comes again goes on where it ended.
  Status choose_geometry() {
    if (!renamed_) {
      return {};
    }
    renamed_ = false;
    const auto known = geometries_.find(names_);
    if (known != geometries_.end()) {
      import_.out.resume_geometry(known->second);
      return {};
    }
    RAYMILL_RETURN_IF_ERROR(names_claim_.resize(names_claim_.bytes() + kObjGeometryBytes));
    const std::string number = std::to_string(geometries_.size());
    const std::string both = names_.object.empty()  ? names_.group
                             : names_.group.empty() ? names_.object
                                                    : message(names_.object, "/", names_.group);
    RAYMILL_RETURN_IF_ERROR(begin_geometry(import_, geometries_.size(), both.empty() ? "node" + number : both,
                                           names_.material.empty() ? "mesh" + number : names_.material));
    geometries_.emplace(names_, import_.report.geometries.size() - 1);
    return {};
  }

  static Status bad_number(std::string_view what, std::string_view word) {
    return bad_scene(what, " is ", in_quotes(word.substr(0, 40)), ", which is no number");
  }
  static Status on_line(const TextReader& text, const Status& status) {
    return text.status().ok() ? in_context(message("line ", text.line()), status) : text.status();
  }

  const MeshImport& import_;
  PolygonWriter polygons_;
  VertexBlocks vertices_;
  std::uint64_t text_begin_ = 0;
  std::uint64_t vertices_met_ = 0;
  Names names_;
  bool renamed_ = true;
  BudgetReservation names_claim_;
  std::map<Names, std::size_t> geometries_;  // where each stands in the report
  std::vector<Vec3f> corners_;
};

}  // namespace

Status import_obj(const MeshImport& import) { return ObjImport(import).run(); }

}  // namespace raymill::storage
