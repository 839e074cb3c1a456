// raymill-peer: Embree on the scene and rays of a trace, for as many seconds as it is given.
//
//   raymill-peer SCENE... --rays RAYS.npy [--threads N] [--seconds S]
//   raymill-peer SCENE... --commands        one run for each line of stdin: THREADS SECONDS RAYS.npy
//
// Prints a line of JSON when the scene stands, and one for each run. Exit codes: 0; 2 it could not be run.
#include <atomic>
#include <chrono>
#include <cstdio>
#include <iostream>
#include <mutex>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "client/cli/ray_file.h"
#include "storage/base/ledger.h"
#include "storage/base/quotes.h"
#include "tests/support/embree_files.h"
#include "tests/support/tool.h"

namespace raymill::bench {
namespace {

using Clock = std::chrono::steady_clock;

// Rays that a thread takes at once, and between two looks at the clock: a ray that waits for swap takes milliseconds.
constexpr std::size_t kChunkRays = 1024;
constexpr std::size_t kClockRays = 16;

struct Options {
  std::vector<std::string> scenes;
  EmbreeScene::Config embree;
  std::string rays;
  unsigned threads = 1;
  double seconds = 60;
  bool commands = false;
};

struct RunRequest {
  std::string rays;
  unsigned threads = 1;
  double seconds = 0;
};

double seconds_since(Clock::time_point begin) { return std::chrono::duration<double>(Clock::now() - begin).count(); }

// Deals out the rays of a file in its order. Thread-safe.
class RayDealer {
 public:
  explicit RayDealer(client::RayFileReader reader) : reader_(std::move(reader)) {}
  // Returns how many; 0 at the end and after an error.
  std::size_t take(std::span<Ray> rays) {
    const std::lock_guard lock(mutex_);
    auto count = status_.ok() ? reader_.read(rays) : Result<std::size_t>(std::size_t(0));
    if (!count) {
      status_ = count.status();
      return 0;
    }
    return *count;
  }
  [[nodiscard]] const Status& status() const { return status_; }  // once the threads are gone

 private:
  std::mutex mutex_;
  client::RayFileReader reader_;
  Status status_;
};

Result<nlohmann::json> trace(const EmbreeScene& scene, const RunRequest& request) {
  RAYMILL_ASSIGN_OR_RETURN(auto reader, client::RayFileReader::open(request.rays));
  const std::uint64_t asked = reader.count();
  RayDealer dealer(std::move(reader));
  std::atomic<std::uint64_t> rays = 0, hits = 0;
  const auto begin = Clock::now();
  const auto work = [&] {
    std::vector<Ray> chunk(kChunkRays);
    std::uint64_t done = 0, found = 0;
    bool in_time = true;
    while (in_time) {
      const std::size_t count = dealer.take(chunk);
      if (count == 0) {
        break;
      }
      for (std::size_t i = 0; i < count && in_time; ++i, ++done) {
        found += scene.closest(chunk[i]) ? 1 : 0;
        in_time = i % kClockRays != 0 || seconds_since(begin) < request.seconds;
      }
    }
    rays += done;
    hits += found;
  };
  std::vector<std::thread> threads;
  for (unsigned i = 0; i < request.threads; ++i) {
    threads.emplace_back(work);
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  const double seconds = seconds_since(begin);
  RAYMILL_RETURN_IF_ERROR(dealer.status());
  return nlohmann::json{{"event", "traced"},
                        {"rays", rays.load()},
                        {"hits", hits.load()},
                        {"complete", rays == asked},
                        {"seconds", seconds},
                        {"rays_per_second", static_cast<double>(rays) / seconds},
                        {"threads", request.threads},
                        {"rss_bytes", storage::resident_bytes()},
                        {"peak_rss_bytes", storage::peak_resident_bytes()}};
}

Status run(const Options& options) {
  RAYMILL_ASSIGN_OR_RETURN(const EmbreeScene scene, embree_of_files(options.scenes, options.embree));
  const auto print = [](const nlohmann::json& line) { std::cout << line.dump() << std::endl; };
  print({{"event", "built"},
         {"triangles", scene.triangles()},
         {"build_seconds", scene.build_seconds()},
         {"rss_bytes", storage::resident_bytes()},
         {"peak_rss_bytes", storage::peak_resident_bytes()}});
  if (!options.commands) {
    RAYMILL_ASSIGN_OR_RETURN(const auto traced, trace(scene, {options.rays, options.threads, options.seconds}));
    print(traced);
    return {};
  }
  for (std::string line; std::getline(std::cin, line);) {
    RunRequest request;
    std::istringstream words(line);
    if (!(words >> request.threads >> request.seconds >> std::ws) || !std::getline(words, request.rays)) {
      return {ErrorCode::invalid_argument, in_quotes(line) + " is not THREADS SECONDS RAYS.npy"};
    }
    RAYMILL_ASSIGN_OR_RETURN(const auto traced, trace(scene, request));
    print(traced);
  }
  return {};
}

int main(int argc, char** argv) {
  Options options;
  tests::Tool tool("raymill-peer", "Traces rays with Embree (rtcIntersect1), for a comparison with raymill trace.");
  tool.option("SCENE", options.scenes, "The scene files that the store was built from").required();
  auto rays = tool.option("--rays", options.rays, "RAYS.npy");
  tool.option("--threads", options.threads, "Threads that trace").between(1, 1024);
  tool.option("--seconds", options.seconds, "Stops after so long; the rays that were not reached are left out")
      .between(1e-3, 1e9);
  tool.option("--device", options.embree.device, "As rtcNewDevice takes it, e.g. isa=avx2");
  tool.flag("--keep-arrays", options.embree.keep_arrays, "Keep vertices and indices in memory after the build");
  const auto commands =
      tool.flag("--commands", options.commands, "Runs are lines of stdin, THREADS SECONDS RAYS.npy, until it ends");
  rays.excludes(commands);
  return tool.run(argc, argv, [&]() -> Result<bool> {
    if (options.rays.empty() && !options.commands) {
      return {ErrorCode::invalid_argument, "give --rays or --commands"};
    }
    RAYMILL_RETURN_IF_ERROR(run(options));
    return true;
  });
}

}  // namespace
}  // namespace raymill::bench

int main(int argc, char** argv) { return raymill::bench::main(argc, argv); }
