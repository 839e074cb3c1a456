#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "storage/base/quotes.h"
#include "storage/import/byte_window.h"
#include "storage/import/mesh_import.h"
#include "storage/import/message.h"
#include "storage/import/stl_layout.h"
#include "storage/import/text_reader.h"
#include "storage/import/transform.h"

namespace raymill::storage {

namespace {

// Without regard to case: some programs write SOLID and FACET.
bool is_keyword(std::string_view word, std::string_view keyword) {
  const auto same = [](char a, char b) { return (a >= 'A' && a <= 'Z' ? a + ('a' - 'A') : a) == b; };
  return word.size() == keyword.size() && std::equal(word.begin(), word.end(), keyword.begin(), same);
}

class StlText {
 public:
  explicit StlText(const MeshImport& import) : import_(import), text_(import.file, 0, {}) {}

  Status run() {
    for (std::size_t solids = 0;; ++solids) {
      const std::string_view word = text_.word_of_any_line();
      if (word.empty() && text_.status().ok()) {
        return solids != 0 ? Status() : fault("holds no solid");
      }
      if (!is_keyword(word, "solid")) {
        return fault_at(word, "solid");
      }
      std::string name = text_.rest_of_line(kMostNameBytes);
      const std::string number = std::to_string(solids);
      RAYMILL_RETURN_IF_ERROR(begin_geometry(import_, solids, name.empty() ? "node" + number : name, "mesh" + number));
      RAYMILL_RETURN_IF_ERROR(read_facets());
    }
  }

 private:
  Status fault(std::string_view what) const { return bad_scene("line ", text_.line(), ": ", what); }
  Status fault_at(std::string_view word, std::string_view wanted) const {
    RAYMILL_RETURN_IF_ERROR(text_.status());
    return word.empty() ? bad_scene("ends where ", in_quotes(wanted), " should stand; it was cut short")
                        : fault(message(in_quotes(word.substr(0, 40)), " stands where ", in_quotes(wanted), " should"));
  }

  Status read_facets() {
    while (true) {
      const std::string_view word = text_.word_of_any_line();
      if (is_keyword(word, "endsolid")) {
        (void)text_.next_line();  // the name again
        return text_.status();
      }
      if (!is_keyword(word, "facet")) {
        return fault_at(word, "facet");
      }
      (void)text_.next_line();  // the normal, which says nothing that the corners do not
      RAYMILL_RETURN_IF_ERROR(read_loop());
    }
  }

  Status read_loop() {
    RAYMILL_RETURN_IF_ERROR(expect("outer"));
    RAYMILL_RETURN_IF_ERROR(expect("loop"));
    std::array<Vec3f, 3> corners;
    for (Vec3f& corner : corners) {
      RAYMILL_RETURN_IF_ERROR(expect("vertex"));
      for (int axis = 0; axis < 3; ++axis) {
        const std::string_view word = text_.word_of_any_line();
        if (!parse_coordinate(word, import_.origin[axis], corner[axis])) {
          return fault_at(word, "a number");
        }
      }
    }
    RAYMILL_RETURN_IF_ERROR(expect("endloop"));
    RAYMILL_RETURN_IF_ERROR(expect("endfacet"));
    return import_.out.add(corners);
  }

  Status expect(std::string_view keyword) {
    const std::string_view word = text_.word_of_any_line();
    return is_keyword(word, keyword) ? Status() : fault_at(word, keyword);
  }

  const MeshImport& import_;
  TextReader text_;
};

}  // namespace

Status import_stl_text(const MeshImport& import) {
  RAYMILL_ASSIGN_OR_RETURN(const BudgetReservation scratch, import.ledger.claim(Tag::build, ByteWindow::kBytes));
  return StlText(import).run();
}

Status import_stl_binary(const MeshImport& import) {
  static_assert(std::endian::native == std::endian::little);
  RAYMILL_ASSIGN_OR_RETURN(const BudgetReservation scratch, import.ledger.claim(Tag::build, ByteWindow::kBytes));
  RAYMILL_ASSIGN_OR_RETURN(const std::uint64_t facets, stl_facets(import.file));
  RAYMILL_RETURN_IF_ERROR(begin_geometry(import, 0, "node0", "mesh0"));
  ByteWindow window(import.file, kStlHeaderBytes);
  for (std::uint64_t i = 0; i < facets; ++i) {
    const std::span<const std::byte> row = window.peek(kStlFacetBytes);
    if (row.size() < kStlFacetBytes) {
      return window.status().ok() ? bad_scene("ends in facet ", i) : window.status();
    }
    std::array<Vec3f, 3> corners;
    constexpr std::size_t kNormalBytes = sizeof(Vec3f);
    static_assert(kNormalBytes + sizeof corners + 2 == kStlFacetBytes);
    std::memcpy(&corners, row.data() + kNormalBytes, sizeof corners);
    window.take(kStlFacetBytes);
    for (Vec3f& corner : corners) {
      corner = round_once({corner.x - import.origin[0], corner.y - import.origin[1], corner.z - import.origin[2]});
    }
    RAYMILL_RETURN_IF_ERROR(import.out.add(corners));
  }
  return {};
}

}  // namespace raymill::storage
