#include "tests/golden/format_example.h"

#include <zstd.h>

#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <cstring>

#include "storage/pages/codec.h"
#include "storage/pages/store_format.h"
#include "tests/support/stores.h"

namespace raymill::tests {
namespace {

using namespace storage;

constexpr std::size_t kBytesOfALine = 16;

// Writes "offset  bytes  what"; a long field goes over several lines.
class Dump {
 public:
  explicit Dump(std::string bytes) : bytes_(std::move(bytes)) {}

  void title(const std::string& text) { out_ += "\n# " + text + "\n"; }
  void field(std::size_t size, const std::string& what) {
    for (std::size_t i = 0; i < size; i += kBytesOfALine) {
      const std::size_t count = std::min(kBytesOfALine, size - i);
      char text[16];
      std::snprintf(text, sizeof text, "%04zx  ", at_ + i);
      std::string line = text;
      for (std::size_t k = 0; k < count; ++k) {
        std::snprintf(text, sizeof text, "%02x ", static_cast<unsigned char>(bytes_.at(at_ + i + k)));
        line += text;
      }
      line.resize(6 + 3 * kBytesOfALine + 1, ' ');
      line += i == 0 ? what : "";
      line.erase(line.find_last_not_of(' ') + 1);
      out_ += line + "\n";
    }
    at_ += size;
  }
  void skip_to(std::size_t offset, const std::string& what) {
    if (offset > at_) {
      field(offset - at_, what);
    }
  }
  [[nodiscard]] std::size_t at() const { return at_; }
  [[nodiscard]] const std::string& text() const { return out_; }

 private:
  std::string bytes_, out_;
  std::size_t at_ = 0;
};

void dump_header(Dump& dump) {
  dump.title("StoreHeader");
  dump.field(8, "magic");
  dump.field(4, "format_version = 1");
  dump.field(4, "header_bytes = 64");
  dump.field(8, "features = triangles");
  dump.field(4, "page_bytes = 16384");
  dump.field(1, "width = 4");
  dump.field(1, "codec = raw");
  dump.field(1, "lattice = 0");
  dump.field(1, "reserved");
  dump.field(4, "lattice_step_exponent = 0");
  dump.field(12, "origin_steps");
  dump.field(4, "origin_exponent = 0");
  dump.field(4, "attributes = 0");
  dump.field(8, "checksum of bytes 0x00 to 0x37");
}

void dump_node(Dump& dump) {
  dump.field(12, "base x, y, z");
  dump.field(3, "exponent x, y, z");
  dump.field(1, "level = 0");
  dump.field(2, "parent = none");
  dump.field(1, "valid");
  dump.field(1, "leaf");
  dump.field(1, "external");
  dump.field(1, "order");
  for (const char* plane : {"lower x of slots 0 to 3", "lower y", "lower z", "upper x", "upper y", "upper z"}) {
    dump.field(4, plane);
  }
  dump.field(8, "child of slots 0 to 3");
  dump.field(4, "count of slots 0 to 3");
  dump.field(6, "padding");
}

void dump_page(Dump& dump, const std::string& bytes) {
  EncodedHeader encoded;
  std::memcpy(&encoded, bytes.data() + dump.at(), sizeof encoded);
  PageHeader header;
  header.width = encoded.width;
  header.geometry_index_bytes = encoded.geometry_index_bytes;
  header.node_count = encoded.node_count;
  header.triangle_count = encoded.triangle_count;
  header.vertex_count = encoded.vertex_count;
  header.geometry_count = encoded.geometry_count;
  lay_out(header);
  dump.title("page 0: EncodedHeader");
  dump.field(2, "page_type = 1");
  dump.field(1, "codec = raw");
  dump.field(1, "width = 4");
  dump.field(1, "geometry_index_bytes = 0");
  dump.field(3, "reserved");
  dump.field(2, "node_count = " + std::to_string(encoded.node_count));
  dump.field(2, "ghost_count = " + std::to_string(encoded.ghost_count));
  dump.field(4, "external_count = " + std::to_string(encoded.external_count));
  dump.field(4, "triangle_count = " + std::to_string(encoded.triangle_count));
  dump.field(4, "vertex_count = " + std::to_string(encoded.vertex_count));
  dump.field(4, "geometry_count = " + std::to_string(encoded.geometry_count));
  dump.field(4, "streams_bytes = 0: raw has no streams");
  dump.field(4, "payload_bytes = " + std::to_string(encoded.payload_bytes));

  dump.title("page 0: payload, the image from byte 64 on (image offset = file offset - image_begin)");
  const std::size_t image = dump.at() - sizeof header;
  dump.skip_to(image + header.nodes_offset, "padding");
  for (int i = 0; i < encoded.node_count; ++i) {
    dump_node(dump);
  }
  dump.skip_to(image + header.vertices_offset, "padding");
  for (std::uint32_t i = 0; i < encoded.vertex_count; ++i) {
    dump.field(12, "vertex " + std::to_string(i));
  }
  dump.skip_to(image + header.indices_offset, "padding");
  for (std::uint32_t i = 0; i < encoded.triangle_count; ++i) {
    dump.field(6, "corners of triangle " + std::to_string(i));
  }
  dump.skip_to(image + header.primitive_ids_offset, "padding");
  dump.field(encoded.triangle_count * std::size_t{4}, "primitive ids");
  dump.skip_to(image + header.geometries_offset, "padding");
  dump.field(4, "geometry table: one geometry, id 0");
  dump.skip_to(image + header.image_bytes, "padding");
}

void dump_footer(Dump& dump) {
  dump.title("StoreFooter");
  for (const char* name : {"header_checksum", "metadata_offset", "metadata_bytes", "metadata_plain_bytes",
                           "metadata_checksum", "directory_offset", "directory_checksum", "page_count = 1",
                           "triangle_count = 2", "node_count = 1", "geometry_count = 1", "decoded_bytes"}) {
    dump.field(8, name);
  }
  for (const char* name : {"max_encoded_bytes", "levels = 1", "root_page = 0", "root_node = 0"}) {
    dump.field(4, name);
  }
  dump.field(12, "bounds_min");
  dump.field(12, "bounds_max");
  dump.field(8, "file_bytes");
  dump.field(16, "unused");
  dump.field(4, "attribute_page");
  dump.field(4, "volume_page");
  dump.field(8, "checksum of the footer's bytes before it");
  dump.field(8, "magic");
}

}  // namespace

std::string format_example(const TempFolder& folder) {
  // The scene's name stands in the metadata, so it is named from inside its folder.
  const std::string before = std::filesystem::current_path();
  std::filesystem::current_path(folder.path());
  write_file("two_triangles.glb",
             glb({{Corners{Vec3f{0, 0, 0}, {1, 0, 0}, {1, 1, 0}}, {Vec3f{0, 0, 0}, {1, 1, 0}, {0, 1, 0.5F}}}}));
  BuildConfig config = small_pages();
  config.scenes = {"two_triangles.glb"};
  config.output = "two_triangles.mill";
  config.codec = "raw";
  config.width = 4;
  const auto report = build(config);
  EXPECT_TRUE(report.ok()) << report.status().message();
  const std::string bytes = read_file("two_triangles.mill");
  std::filesystem::current_path(before);

  StoreFooter footer;
  std::memcpy(&footer, bytes.data() + bytes.size() - sizeof footer, sizeof footer);
  Dump dump(bytes);
  dump_header(dump);
  dump_page(dump, bytes);
  dump.title("metadata: a zstd frame over JSON, by zstd " + std::string(ZSTD_versionString()));
  dump.field(footer.metadata_bytes, "");
  dump.title("page directory: PageEntry 0");
  dump.field(8, "offset = 64");
  dump.field(8, "checksum of the page's encoded bytes");
  dump.field(4, "encoded_bytes");
  dump.field(4, "decoded_bytes");
  dump_footer(dump);
  EXPECT_EQ(dump.at(), bytes.size());
  return dump.text().substr(1);
}

}  // namespace raymill::tests
