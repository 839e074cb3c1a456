// Opens a store, sends one ray straight down into its middle and prints what the ray meets.
#include <raymill/raymill.h>

#include <cstdio>

static int fail(const raymill::Status& status) { return std::fprintf(stderr, "%s\n", status.message().c_str()), 1; }

int main(int argc, char** argv) {
  raymill::EngineConfig config;
  config.memory = raymill::mebibytes(512);
  auto engine = raymill::Engine::create(config);
  if (!engine.ok()) return fail(engine.status());
  auto store = (*engine)->open(argc == 2 ? argv[1] : "");
  if (!store.ok()) return fail(store.status());
  auto info = (*store)->info();
  if (!info.ok()) return fail(info.status());
  auto job = (*store)->trace({.query = raymill::Query::closest});
  if (!job.ok()) return fail(job.status());

  const auto &low = info->bounds_min, &high = info->bounds_max;
  const raymill::Ray ray{.org = {(low[0] + high[0]) / 2, high[1] + 1, (low[2] + high[2]) / 2}, .dir = {0, -1, 0}};
  if (auto status = (*job)->push({&ray, 1}); !status.ok()) return fail(status);
  if (auto status = (*job)->finish(); !status.ok()) return fail(status);
  while (auto chunk = (*job)->next()) {
    const raymill::Hit hit = chunk->hit(0);
    std::printf("%.9g %u %u\n", hit.t, hit.primitive_id, hit.geometry_id);
  }
  const auto status = (*job)->status();
  return status.ok() ? 0 : fail(status);
}
