// raymill-oracle: checks the hits of a trace against Embree in robust mode and against exact arithmetic.
//
//   raymill-oracle SCENE... --rays RAYS.npy --hits HITS.npy [--positions lattice:16b] [--threads N] [--json]
//
// Exit codes: 0 every ray's answer is right or differs by less than float64 can tell; 1 not so; 2 it could not be run.
#include <cstdio>
#include <fstream>
#include <iostream>
#include <limits>
#include <thread>

#include "client/cli/npy.h"
#include "client/cli/ray_file.h"
#include "storage/build/lattice.h"
#include "storage/import/scene_import.h"
#include "tests/support/tool.h"
#include "tests/trial/oracle/comparison.h"

namespace raymill::trial {
namespace {

struct Options {
  std::vector<std::string> scenes;
  std::string rays;
  std::string hits;
  std::string positions = "float32";
  unsigned threads = 0;
  bool json = false;
};

class Collector final : public storage::TriangleSink {
 public:
  Status add(std::span<const storage::Triangle> more) override {
    triangles.insert(triangles.end(), more.begin(), more.end());
    return {};
  }
  std::vector<storage::Triangle> triangles;
};

Result<std::vector<storage::Triangle>> read_scenes(const Options& options) {
  storage::Ledger ledger(std::numeric_limits<std::uint64_t>::max());
  storage::ImportReport report;
  Collector collector;
  for (const std::string& scene : options.scenes) {
    RAYMILL_RETURN_IF_ERROR(storage::import_scene(scene, {}, ledger, collector, report));
  }
  RAYMILL_ASSIGN_OR_RETURN(const auto positions, storage::parse_positions(options.positions));
  if (positions.kind != storage::PositionsRequest::Kind::float32) {
    RAYMILL_RETURN_IF_ERROR(storage::snap_to_lattice(positions, collector.triangles).status());
  }
  return std::move(collector.triangles);
}

Result<std::vector<Ray>> read_rays(const std::string& path) {
  RAYMILL_ASSIGN_OR_RETURN(auto reader, client::RayFileReader::open(path));
  std::vector<Ray> rays(reader.count());
  for (std::size_t done = 0; done < rays.size();) {
    RAYMILL_ASSIGN_OR_RETURN(const std::size_t count, reader.read(std::span(rays).subspan(done)));
    done += count;
  }
  return rays;
}

struct Hits {
  bool any = false;
  std::vector<Hit> rows;
};

Result<Hits> read_hits(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  const std::string text((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  const auto bytes = std::as_bytes(std::span(text));
  const auto header = client::parse_npy_header(bytes.first(std::min(bytes.size(), client::kMaxNpyHeaderBytes)));
  if (!header) {
    return {header.status().code(), path + ": " + header.status().message()};
  }
  Hits hits;
  hits.any = header->descr == HitLayout(Field::t).numpy_descr();
  const HitLayout layout(hits.any ? Field::t : kDefaultClosestFields);
  if (header->descr != layout.numpy_descr() || header->shape.size() != 1 ||
      bytes.size() - header->data_offset != header->shape[0] * layout.row_bytes()) {
    return {ErrorCode::bad_rays, path + ": not hits of the fields t, uv, primitive_id, geometry_id, or t alone"};
  }
  for (std::uint64_t i = 0; i < header->shape[0]; ++i) {
    hits.rows.push_back(layout.read(bytes.data() + header->data_offset + i * layout.row_bytes()));
  }
  return hits;
}

Result<Tally> compare(const Options& options) {
  RAYMILL_ASSIGN_OR_RETURN(const auto rays, read_rays(options.rays));
  RAYMILL_ASSIGN_OR_RETURN(const auto hits, read_hits(options.hits));
  if (rays.size() != hits.rows.size()) {
    return {ErrorCode::invalid_argument,
            std::to_string(rays.size()) + " rays and " + std::to_string(hits.rows.size()) + " hits"};
  }
  RAYMILL_ASSIGN_OR_RETURN(const auto triangles, read_scenes(options));
  RAYMILL_ASSIGN_OR_RETURN(const auto peer, EmbreePeer::create(triangles));
  const Reference reference(triangles);
  const Comparison comparison(triangles, peer, reference);
  const unsigned threads = options.threads > 0 ? options.threads : std::max(1U, std::thread::hardware_concurrency());
  std::vector<Tally> tallies(threads);
  std::vector<std::thread> workers;
  for (unsigned worker = 0; worker < threads; ++worker) {
    workers.emplace_back([&, worker] {
      for (std::size_t i = rays.size() * worker / threads; i < rays.size() * (worker + 1) / threads; ++i) {
        hits.any ? comparison.any(i, rays[i], hits.rows[i], tallies[worker])
                 : comparison.closest(i, rays[i], hits.rows[i], tallies[worker]);
      }
    });
  }
  Tally tally;
  for (unsigned worker = 0; worker < threads; ++worker) {
    workers[worker].join();
    tally.merge(std::move(tallies[worker]));
  }
  return tally;
}

int run(int argc, char** argv) {
  Options options;
  tests::Tool tool("raymill-oracle", "Checks traced hits against Embree (robust) and exact arithmetic.");
  tool.option("SCENE", options.scenes, "The scene files that the store was built from, in order").required();
  tool.option("--rays", options.rays, "RAYS.npy").required();
  tool.option("--hits", options.hits, "HITS.npy of raymill trace").required();
  tool.option("--positions", options.positions, "As for raymill build");
  tool.option("--threads", options.threads, "0: one for each core");
  tool.flag("--json", options.json, "Print JSON");
  return tool.run(argc, argv, [&]() -> Result<bool> {
    RAYMILL_ASSIGN_OR_RETURN(const Tally tally, compare(options));
    std::cout << (options.json ? tally.json().dump(1) + "\n" : tally.text());
    return tally.passed();
  });
}

}  // namespace
}  // namespace raymill::trial

int main(int argc, char** argv) { return raymill::trial::run(argc, argv); }
