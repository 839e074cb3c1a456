// raymill-exact-oracle [--rays N] [--seed S] [--kind NAME]: mode exact against integers of any length, on adversarial
// rays. Fails where anything differs.
#include <cstdio>

#include "tests/exact/comparison.h"
#include "tests/support/tool.h"

namespace raymill::tests {
namespace {

constexpr std::size_t kRaysPerScene = 500;

struct Options {
  std::uint64_t rays = 20000;
  std::uint64_t seed = 1;
  std::string kind;
};

Compared run_kind(const Options& options, std::size_t kind, std::uint64_t rays) {
  Compared total;
  for (std::uint64_t scene = 0; total.rays < rays; ++scene) {
    // One seed for each scene: a difference is found again by --kind and --seed alone.
    Random random(options.seed + scene * 0x9E3779B9u + kind);
    const Compared one = compare_adversary(random, Adversary(kind), std::min<std::uint64_t>(kRaysPerScene, rays));
    if (one.differences != 0 && total.differences == 0) {
      std::printf("%s, scene %llu: %s\n", kAdversaries[kind], static_cast<unsigned long long>(scene),
                  one.first.c_str());
    }
    total.rays += one.rays;
    total.hits += one.hits;
    total.differences += one.differences;
  }
  return total;
}

void print_line(const char* name, const Compared& compared) {
  std::printf("%-11s rays %8llu  hits %8llu  differences %llu\n", name, static_cast<unsigned long long>(compared.rays),
              static_cast<unsigned long long>(compared.hits), static_cast<unsigned long long>(compared.differences));
  std::fflush(stdout);
}

bool run(const Options& options) {
  const std::uint64_t kinds = options.kind.empty() ? kAdversaries.size() : 1;
  Compared total;
  for (std::size_t kind = 0; kind < kAdversaries.size(); ++kind) {
    if (options.kind.empty() || options.kind == kAdversaries[kind]) {
      const Compared one = run_kind(options, kind, (options.rays + kinds - 1) / kinds);
      print_line(kAdversaries[kind], one);
      total.rays += one.rays;
      total.hits += one.hits;
      total.differences += one.differences;
    }
  }
  print_line("all", total);
  return total.differences == 0;
}

}  // namespace
}  // namespace raymill::tests

int main(int argc, char** argv) {
  using namespace raymill::tests;
  Options options;
  Tool tool("raymill-exact-oracle", "Mode exact against integers of any length, on adversarial rays.");
  tool.option("--rays", options.rays, "In all, in scenes of 500");
  tool.option("--seed", options.seed, "Of scenes and rays");
  tool.option("--kind", options.kind, "One kind of adversary alone").one_of({kAdversaries.begin(), kAdversaries.end()});
  return tool.run(argc, argv, [&] { return run(options); });
}
