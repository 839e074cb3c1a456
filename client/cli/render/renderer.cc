#include "client/cli/render/renderer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>

namespace raymill::client {

namespace {

constexpr float kAlbedo = 0.65F;
constexpr Vector3 kSunDirection{0.62F, 0.65F, 0.44F};  // length one to three digits
constexpr float kSunSpread = 0.01F;                    // radius of the sun's disc at distance one
constexpr Vector3 kSunIrradiance{2.5F, 2.1F, 1.6F};
constexpr Vector3 kZenith{0.10F, 0.20F, 0.45F};
constexpr Vector3 kHorizon{0.30F, 0.37F, 0.46F};
constexpr Vector3 kNadir{0.14F, 0.13F, 0.12F};
constexpr Vector3 kFog{0.30F, 0.30F, 0.31F};  // what fog looks like where nothing shines through
constexpr float kOpenFog = 0.5F;              // the same in ao

// A wave is worth starting from here on; more memory than for the most is not asked for.
constexpr std::uint64_t kLeastWave = 4 << 10;
constexpr std::uint64_t kMostWave = 1 << 20;

Vector3 sky(const Vector3& direction) {
  const float length = std::hypot(direction[0], direction[1], direction[2]);
  const float height = direction[1] / length;
  const float s = std::sqrt(std::abs(height));
  const Vector3& end = height >= 0 ? kZenith : kNadir;
  Vector3 colour{};
  for (int i = 0; i < 3; ++i) {
    colour[i] = kHorizon[i] + (end[i] - kHorizon[i]) * s;
  }
  return colour;
}

float dot(const Vector3& a, const Vector3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

Vector3 sun_direction(Random& random) {
  const float r = kSunSpread * std::sqrt(random.unit()), angle = 2 * std::numbers::pi_v<float> * random.unit();
  return {kSunDirection[0] + r * std::cos(angle), kSunDirection[1], kSunDirection[2] + r * std::sin(angle)};
}

std::uint64_t wave_bytes(const RenderConfig& config) {
  constexpr std::uint64_t kState = sizeof(Ray) + 8;
  return config.view == View::path ? 3 * kState + sizeof(Vector3) : config.view == View::ao ? 2 * kState : kState;
}

std::uint64_t row_bytes(const RenderConfig& config) {
  return std::uint64_t{config.extent.width} * channels_of(config.view) * sizeof(float);
}

}  // namespace

std::uint64_t Renderer::least_memory_bytes(const RenderConfig& config) {
  return kLeastWave * wave_bytes(config) + row_bytes(config);
}

Renderer::Renderer(const RenderConfig& config) : config_(config) {
  // Rows first get a quarter of the memory, waves the rest. A row counts for as many rays as it has samples.
  const std::uint64_t rows =
      std::clamp<std::uint64_t>(config.memory_bytes / 4 / row_bytes(config), 1, config.extent.height);
  const std::uint64_t samples = rows * config.extent.width * config.spp;
  const std::uint64_t left = config.memory_bytes - std::min(config.memory_bytes, rows * row_bytes(config));
  wave_size_ = static_cast<std::size_t>(
      std::min(std::clamp(left / wave_bytes(config), kLeastWave, kMostWave), std::max<std::uint64_t>(samples, 1)));
  band_rows_ = static_cast<std::uint32_t>(rows);
  band_.resize(static_cast<std::size_t>(rows * row_bytes(config) / sizeof(float)));
  const auto reserve = [&](Wave& wave) {
    // Touched here, so that the memory is the process's before the engine looks at what is left.
    wave.rays.resize(wave_size_);
    wave.states.resize(wave_size_);
    wave.clear();
  };
  reserve(wave_);
  if (config.view == View::path) {
    reserve(next_wave_);
    light_.resize(wave_size_);
  }
  if (config.view == View::path || config.view == View::ao) {
    reserve(occlusion_);
  }
}

std::size_t Renderer::pixel_of(const PathState& state) const {
  return static_cast<std::size_t>((group_begin_ + state.slot) % band_pixels_);
}

Random Renderer::random_of(const PathState& state, std::uint32_t dimension) const {
  const std::uint64_t pixel = std::uint64_t{band_begin_} * config_.extent.width + pixel_of(state);
  const std::uint64_t sample = (group_begin_ + state.slot) / band_pixels_;
  return Random(mix(config_.seed, pixel, sample << 32 | dimension));
}

bool Renderer::next_group() {
  wave_.clear();
  group_begin_ = group_end_;
  group_end_ = std::min(group_begin_ + wave_size_, band_pixels_ * config_.spp);
  const bool is_centred = config_.view == View::depth || config_.view == View::normal;
  for (std::uint64_t path = group_begin_; path < group_end_; ++path) {
    const PathState state{.slot = static_cast<std::uint32_t>(path - group_begin_)};
    const std::size_t pixel = pixel_of(state);
    Random random = random_of(state, 0);
    const double dx = is_centred ? 0.5 : random.unit(), dy = is_centred ? 0.5 : random.unit();
    const auto x = static_cast<double>(pixel % config_.extent.width);
    const auto y = static_cast<double>(band_begin_ + pixel / config_.extent.width);
    wave_.add(camera_.ray(x + dx, y + dy, config_.extent), state);
  }
  std::fill_n(light_.begin(), light_.empty() ? 0 : wave_.rays.size(), Vector3{});
  return !wave_.rays.empty();
}

void Renderer::add_group_to_band() {
  for (std::uint64_t path = group_begin_; path < group_end_; ++path) {
    const Vector3& light = light_[static_cast<std::size_t>(path - group_begin_)];
    float* pixel = &band_[3 * static_cast<std::size_t>(path % band_pixels_)];
    for (int i = 0; i < 3; ++i) {
      pixel[i] += light[i];
    }
  }
}

Status Renderer::trace(Store& store, Query query, const Wave& wave,
                       const std::function<void(std::size_t, const Hit&)>& use) {
  if (wave.rays.empty()) {
    return {};
  }
  const Field fields = query == Query::any           ? Field::t
                       : config_.view == View::depth ? Field::t
                                                     : Field::t | Field::normal;
  TraceConfig request{.query = query, .mode = config_.mode, .fields = answered_fields(query, fields)};
  if (query == Query::transmittance) {
    request.volume.density_scale = config_.fog_density;
  }
  RAYMILL_ASSIGN_OR_RETURN(const std::unique_ptr<Job> job, store.trace(request));
  BatchTimes times;
  RAYMILL_RETURN_IF_ERROR(run_batch(
      *job, source_of(wave.rays),
      [&](const HitChunk& chunk) -> Status {
        for (std::size_t i = 0; i < chunk.size(); ++i) {
          use(static_cast<std::size_t>(chunk.first_ray()) + i, chunk.hit(i));
        }
        return {};
      },
      [&](const JobProgress& state) {
        const double share = static_cast<double>(state.rays_done) / static_cast<double>(wave.rays.size());
        progress_(fraction_begin_ + fraction_step_ * share, rays_before_ + state.rays_done);
      },
      times));
  stats_.add(job->stats());
  rays_before_ += wave.rays.size();
  fraction_begin_ += fraction_step_;
  return {};
}

void Renderer::add_light(const PathState& state, const Vector3& light) {
  Vector3& sum = light_[state.slot];
  for (int i = 0; i < 3; ++i) {
    sum[i] += state.throughput * light[i];
  }
}

void Renderer::use_first_hit(std::size_t index, const Hit& hit) {
  const PathState& state = wave_.states[index];
  const Ray& ray = wave_.rays[index];
  const bool is_hit = std::isfinite(hit.t);
  if (config_.view == View::depth) {
    band_[pixel_of(state)] = is_hit ? hit.t : std::numeric_limits<float>::infinity();
  } else if (config_.view == View::normal) {
    const Vector3 normal = is_hit ? hit.normal : Vector3{};
    std::copy(normal.begin(), normal.end(), &band_[3 * pixel_of(state)]);
  } else if (!is_hit) {
    band_[pixel_of(state)] += state.throughput;
  } else {
    Random random = random_of(state, 1);
    const Surface surface = surface_of(ray, hit);
    occlusion_.add({.org = surface.origin, .dir = cosine_direction(surface.normal, random), .tfar = config_.ao_radius},
                   state);
  }
}

Status Renderer::shade_fog(Store& store) {
  RAYMILL_RETURN_IF_ERROR(trace(store, Query::closest, wave_,
                                [this](std::size_t index, const Hit& hit) { wave_.rays[index].tfar = hit.t; }));
  return trace(store, Query::transmittance, wave_, [this](std::size_t index, const Hit& hit) {
    PathState& state = wave_.states[index];
    state.throughput = 1 - hit.t;
    if (config_.view == View::ao) {
      band_[pixel_of(state)] += state.throughput * kOpenFog;
    } else {
      add_light(state, kFog);
    }
    state.throughput = hit.t;
    wave_.rays[index].tfar = std::numeric_limits<float>::infinity();
  });
}

void Renderer::use_path_hit(std::size_t index, const Hit& hit, std::uint32_t bounce) {
  PathState state = wave_.states[index];
  const Ray& ray = wave_.rays[index];
  if (!std::isfinite(hit.t)) {
    add_light(state, sky(ray.dir));
    return;
  }
  Random random = random_of(state, 1 + bounce);
  const Surface surface = surface_of(ray, hit);
  state.throughput *= kAlbedo;
  // The sun's light is added now with the cosine in the throughput, if nothing stands between.
  const Vector3 sun = sun_direction(random);
  const float cosine = dot(sun, surface.normal);
  if (cosine > 0) {
    PathState lit = state;
    lit.throughput *= cosine * std::numbers::inv_pi_v<float>;
    occlusion_.add({.org = surface.origin, .dir = sun}, lit);
  }
  if (bounce < config_.bounces) {
    next_wave_.add({.org = surface.origin, .dir = cosine_direction(surface.normal, random)}, state);
  }
}

Status Renderer::shade_occlusion(Store& store, bool is_sun) {
  const Status status = trace(store, Query::any, occlusion_, [&](std::size_t index, const Hit& hit) {
    const PathState& state = occlusion_.states[index];
    if (std::isfinite(hit.t)) {
      return;
    }
    if (is_sun) {
      add_light(state, kSunIrradiance);
    } else {
      band_[pixel_of(state)] += state.throughput;
    }
  });
  occlusion_.clear();
  return status;
}

Status Renderer::render_band(Store& store) {
  std::fill(band_.begin(), band_.end(), 0.0F);
  band_pixels_ = std::uint64_t{config_.extent.width} * (band_end_ - band_begin_);
  group_end_ = 0;
  const double total = static_cast<double>(config_.extent.height) * config_.extent.width * config_.spp;
  const double before = static_cast<double>(band_begin_) * config_.extent.width * config_.spp;
  const bool is_path = config_.view == View::path;
  const double jobs = (is_path                    ? 2.0 * (config_.bounces + 1)
                       : config_.view == View::ao ? 2
                                                  : 1) +
                      (config_.fog_density > 0 ? 2 : 0);
  while (true) {
    fraction_begin_ = (before + static_cast<double>(group_end_)) / total;
    if (!next_group()) {
      return {};
    }
    fraction_step_ = static_cast<double>(wave_.rays.size()) / total / jobs;
    if (config_.fog_density > 0) {
      RAYMILL_RETURN_IF_ERROR(shade_fog(store));
    }
    if (!is_path) {
      RAYMILL_RETURN_IF_ERROR(
          trace(store, Query::closest, wave_, [&](std::size_t index, const Hit& hit) { use_first_hit(index, hit); }));
      RAYMILL_RETURN_IF_ERROR(shade_occlusion(store, false));
      continue;
    }
    for (std::uint32_t bounce = 0; bounce <= config_.bounces && !wave_.rays.empty(); ++bounce) {
      next_wave_.clear();
      RAYMILL_RETURN_IF_ERROR(trace(store, Query::closest, wave_,
                                    [&](std::size_t index, const Hit& hit) { use_path_hit(index, hit, bounce); }));
      RAYMILL_RETURN_IF_ERROR(shade_occlusion(store, true));
      std::swap(wave_, next_wave_);
    }
    add_group_to_band();
  }
}

Status Renderer::render(Store& store, const std::function<Status(std::span<const float>)>& rows,
                        const std::function<void(double, std::uint64_t)>& progress) {
  progress_ = progress;
  const float weight = 1.0F / static_cast<float>(config_.spp);
  for (band_begin_ = 0; band_begin_ < config_.extent.height; band_begin_ = band_end_) {
    band_end_ = std::min(config_.extent.height, band_begin_ + band_rows_);
    RAYMILL_RETURN_IF_ERROR(render_band(store));
    const auto values =
        std::span(band_).first(std::size_t{band_end_ - band_begin_} * config_.extent.width * channels_of(config_.view));
    for (float& value : values) {
      value *= weight;
    }
    RAYMILL_RETURN_IF_ERROR(rows(values));
  }
  return {};
}

}  // namespace raymill::client
