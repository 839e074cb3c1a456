#include "client/cli/render/renderer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <condition_variable>
#include <limits>
#include <memory>
#include <mutex>
#include <vector>

namespace raymill::client {
namespace {

// Of what fog lets pass before a surface, and before none.
constexpr float kVeiled = 0.25F, kFaint = 0.75F;

// The ground y = 0 up to |x|, |z| <= 10 and a ceiling above a half of it; answers in chunks of 1000 rows.
class RoomStore final : public Store {
 public:
  Result<StoreInfo> info() const override { return StoreInfo(); }
  Result<std::unique_ptr<Job>> trace(const TraceConfig& config) override {
    return std::unique_ptr<Job>(std::make_unique<RoomJob>(config));
  }

 private:
  static Hit intersect(const Ray& ray) {
    Hit hit;
    for (const float y : {0.0F, 3.0F}) {
      const float t = (y - ray.org[1]) / ray.dir[1];
      const float x = ray.org[0] + t * ray.dir[0], z = ray.org[2] + t * ray.dir[2];
      if (t > ray.tnear && t < std::min(ray.tfar, hit.t) && std::abs(x) <= 10 && std::abs(z) <= (y > 0 ? 3 : 10)) {
        hit.t = t;
        hit.normal = {0, 1, 0};
      }
    }
    return hit;
  }

  class RoomJob final : public Job {
   public:
    explicit RoomJob(const TraceConfig& config) : layout_(config.fields), query_(config.query) {}
    Status push(std::span<const Ray> rays) override {
      const std::lock_guard lock(mutex_);
      rays_.insert(rays_.end(), rays.begin(), rays.end());
      return {};
    }
    Status finish() override {
      const std::lock_guard lock(mutex_);
      finished_ = true;
      changed_.notify_all();
      return {};
    }
    std::optional<HitChunk> next() override {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] { return finished_; });
      const std::size_t count = std::min<std::size_t>(1000, rays_.size() - first_);
      if (count == 0) {
        return std::nullopt;
      }
      rows_.resize(count * layout_.row_bytes());
      for (std::size_t i = 0; i < count; ++i) {
        Hit hit = intersect(rays_[first_ + i]);
        hit.t = query_ == Query::any && std::isfinite(hit.t) ? 0 : hit.t;
        if (query_ == Query::transmittance) {
          hit.t = std::isfinite(rays_[first_ + i].tfar) ? kVeiled : kFaint;
        }
        layout_.write(hit, rows_.data() + i * layout_.row_bytes());
      }
      first_ += count;
      return HitChunk(index_++, first_ - count, layout_, rows_, nullptr);
    }
    Status status() const override { return {}; }
    JobProgress progress() const override { return {}; }
    JobStats stats() const override {
      JobStats stats;
      stats.rays = rays_.size();
      return stats;
    }
    void cancel() override {}

   private:
    HitLayout layout_;
    Query query_;
    mutable std::mutex mutex_;
    std::condition_variable changed_;
    std::vector<Ray> rays_;
    std::vector<std::byte> rows_;
    std::size_t first_ = 0;
    std::uint64_t index_ = 0;
    bool finished_ = false;
  };
};

std::vector<float> picture(View view, std::uint32_t spp, std::uint64_t memory_bytes, std::uint64_t seed = 1,
                           double fog_density = 0) {
  RenderConfig config;
  config.view = view;
  config.extent = {.width = 120, .height = 90};
  config.spp = spp;
  config.seed = seed;
  config.ao_radius = 4;
  config.fog_density = fog_density;
  config.memory_bytes = memory_bytes;
  Renderer renderer(config);
  renderer.set_camera(*look_at({0, 2, 9}, {0, 1, 0}, 1.0));
  RoomStore store;
  std::vector<float> values;
  const Status status = renderer.render(
      store,
      [&](std::span<const float> rows) -> Status {
        values.insert(values.end(), rows.begin(), rows.end());
        return {};
      },
      [](double, std::uint64_t) {});
  EXPECT_TRUE(status.ok()) << status.message();
  EXPECT_EQ(values.size(), std::size_t{120} * 90 * channels_of(view));
  return values;
}

TEST(Renderer, MemoryDoesNotChangeThePicture) {
  for (const View view : {View::depth, View::normal, View::ao, View::path}) {
    const std::uint32_t spp = view == View::ao || view == View::path ? 3 : 1;
    EXPECT_EQ(picture(view, spp, 0), picture(view, spp, 64 << 20));
  }
}

TEST(Renderer, SeedChangesTheNoiseAndNotTheLight) {
  const auto a = picture(View::path, 4, 16 << 20, 1), b = picture(View::path, 4, 16 << 20, 2);
  EXPECT_NE(a, b);
  double sum_a = 0, sum_b = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    ASSERT_TRUE(std::isfinite(a[i]) && a[i] >= 0);
    sum_a += a[i];
    sum_b += b[i];
  }
  EXPECT_NEAR(sum_a / sum_b, 1, 0.02);
}

TEST(Renderer, DepthIsADistanceAndNormalsAreUnit) {
  const auto depth = picture(View::depth, 1, 1 << 20);
  const auto normal = picture(View::normal, 1, 1 << 20);
  // The top row sees the sky or the ceiling, the bottom row the ground close by.
  const std::size_t bottom = std::size_t{120} * 89 + 60;
  EXPECT_GT(depth[bottom], 2);
  EXPECT_LT(depth[bottom], 5);
  for (std::size_t i = 0; i < depth.size(); ++i) {
    EXPECT_EQ(normal[3 * i + 1], std::isfinite(depth[i]) ? 1 : 0);
  }
}

TEST(Renderer, FogVeilsWhatIsBehindIt) {
  const auto depth = picture(View::depth, 1, 1 << 20);
  const auto clear = picture(View::ao, 1, 4 << 20), veiled = picture(View::ao, 1, 4 << 20, 1, 2.0);
  EXPECT_EQ(veiled, picture(View::ao, 1, 0, 1, 2.0)) << "memory changes nothing";
  std::size_t near = 0;
  for (std::size_t i = 0; i < clear.size(); ++i) {
    const float behind = veiled[i] - kVeiled * clear[i], beyond = veiled[i] - kFaint * clear[i];
    // A half of what does not shine through; at edges a sample may see another surface than the pixel's middle.
    const bool is_surface = std::fabs(behind - (1 - kVeiled) / 2) < 1e-6F;
    EXPECT_TRUE(is_surface || std::fabs(beyond - (1 - kFaint) / 2) < 1e-6F);
    near += is_surface == std::isfinite(depth[i]) ? 1 : 0;
  }
  EXPECT_GT(near, clear.size() * 9 / 10);
  EXPECT_NE(picture(View::path, 1, 4 << 20), picture(View::path, 1, 4 << 20, 1, 2.0));
}

TEST(Renderer, OcclusionIsAShareThatTheCeilingLowers) {
  const auto values = picture(View::ao, 64, 4 << 20);
  for (const float value : values) {
    ASSERT_GE(value, 0);
    ASSERT_LE(value, 1);
  }
  // At the bottom the ground lies in the open; under the ceiling it does not.
  EXPECT_GT(values[std::size_t{120} * 89 + 60], 0.95F);
  EXPECT_LT(values[std::size_t{120} * 50 + 60], 0.9F);
}

}  // namespace
}  // namespace raymill::client
