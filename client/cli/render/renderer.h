// Renderer: pictures by batches of rays. Each wave (the camera's rays, occlusion rays, a bounce, the rays to the sun)
// is one job. The picture is made in bands of rows and groups of samples, as many at once as the memory given holds.
// Every random number depends on the seed, the pixel and the sample alone, and a pixel's samples are summed in their
// order, so the picture does not depend on memory, threads or machine. Thread-confined.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "client/cli/batch.h"
#include "client/cli/camera.h"
#include "client/cli/random.h"
#include "client/cli/sampling.h"
#include "storage/base/status.h"

namespace raymill::client {

enum class View : std::uint8_t {
  depth,   ///< distance to the first hit, +inf where there is none; one ray through each pixel's centre
  normal,  ///< the first hit's normal in world space, 0 where there is none; one ray through each pixel's centre
  ao,      ///< share of the hemisphere that is open for a given reach; 1 where nothing is hit
  path     ///< diffuse grey surfaces under a sky and a sun
};
constexpr std::uint32_t channels_of(View view) { return view == View::depth || view == View::ao ? 1 : 3; }

struct RenderConfig {
  View view = View::depth;
  Mode mode = Mode::watertight;
  Extent extent;
  std::uint32_t spp = 1;      ///< samples a pixel
  std::uint32_t bounces = 4;  ///< View::path: diffuse bounces after the first hit
  std::uint64_t seed = 1;
  float ao_radius = 0;             ///< View::ao: reach, scene units
  double fog_density = 0;          ///< View::ao, View::path: extinction where a voxel holds 1; 0: no fog is looked for
  std::uint64_t memory_bytes = 0;  ///< for the waves and a band of the picture
};

class Renderer {
 public:
  /// Takes its memory here.
  explicit Renderer(const RenderConfig& config);

  /// Camera and reach are known once the store is open, after the memory was taken.
  void set_camera(const Camera& camera) { camera_ = camera; }
  void set_ao_radius(float radius) { config_.ao_radius = radius; }

  /// Hands the picture's rows to `rows` from the top. `progress` gets a fraction and the rays so far.
  Status render(Store& store, const std::function<Status(std::span<const float>)>& rows,
                const std::function<void(double, std::uint64_t)>& progress);

  [[nodiscard]] const JobStats& stats() const { return stats_.total(); }
  /// What the picture's rows and the waves take, bytes.
  [[nodiscard]] static std::uint64_t least_memory_bytes(const RenderConfig& config);

 private:
  struct PathState {
    std::uint32_t slot = 0;  ///< which of the group's paths
    float throughput = 1;
  };
  struct Wave {
    std::vector<Ray> rays;
    std::vector<PathState> states;
    void clear() {
      rays.clear();
      states.clear();
    }
    void add(const Ray& ray, const PathState& state) {
      rays.push_back(ray);
      states.push_back(state);
    }
  };

  Status render_band(Store& store);
  /// Dims what the camera's rays will see by the fog before it, and adds the fog's own light.
  Status shade_fog(Store& store);
  /// Fills the next wave with camera rays; false when the band has them all.
  bool next_group();
  Status trace(Store& store, Query query, const Wave& wave, const std::function<void(std::size_t, const Hit&)>& use);
  void use_first_hit(std::size_t index, const Hit& hit);
  void use_path_hit(std::size_t index, const Hit& hit, std::uint32_t bounce);
  Status shade_occlusion(Store& store, bool is_sun);
  void add_light(const PathState& state, const Vector3& light);
  /// The pixel of a path in the band.
  [[nodiscard]] std::size_t pixel_of(const PathState& state) const;
  void add_group_to_band();
  [[nodiscard]] Random random_of(const PathState& state, std::uint32_t dimension) const;

  RenderConfig config_;
  Camera camera_;
  std::size_t wave_size_ = 0;
  std::uint32_t band_rows_ = 0;
  std::uint32_t band_begin_ = 0;  ///< first row
  std::uint32_t band_end_ = 0;
  std::uint64_t band_pixels_ = 0;
  std::uint64_t group_begin_ = 0;  ///< first path of the group; a band's path is sample x pixels + pixel
  std::uint64_t group_end_ = 0;
  std::vector<float> band_;
  std::vector<Vector3> light_;  ///< View::path: what each path of the group brings, added to the band in order
  Wave wave_, next_wave_, occlusion_;
  RunStats stats_;
  std::function<void(double, std::uint64_t)> progress_;
  double fraction_begin_ = 0, fraction_step_ = 0;
  std::uint64_t rays_before_ = 0;
};

}  // namespace raymill::client
