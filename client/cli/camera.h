// Cameras: from the scene, from the command line, or framed on the bounds; and the rays through their pixels.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "client/cli/parse.h"
#include "storage/base/status.h"
#include "traversal/service.h"

namespace raymill::client {

using Vector = std::array<double, 3>;

/// In the space of a store, whose zero is StoreInfo::origin.
struct Camera {
  Vector origin{};
  Vector right{1, 0, 0};
  Vector up{0, 1, 0};
  Vector forward{0, 0, -1};  ///< right, up and forward have length one and are square to each other
  bool perspective = true;
  double half_height = 0.5;  ///< perspective: of the picture at distance one; else in scene units

  /// The ray through (x, y), in pixels from the top left corner; dir has length one, so t is a distance.
  [[nodiscard]] Ray ray(double x, double y, Extent extent) const;
};

/// A camera at `origin` that looks at `target`, y up, `yfov_radians` high.
Result<Camera> look_at(const Vector& origin, const Vector& target, double yfov_radians);

/// A three-quarter view from above, y up, that holds the whole box.
Camera framed(const std::array<float, 3>& lower, const std::array<float, 3>& upper, Extent extent);

struct NamedCamera {
  std::string name;
  Camera camera;
};
/// The cameras of StoreInfo::metadata_json, in file order, relative to `zero`; those with a matrix that cannot be used
/// are left out.
Result<std::vector<NamedCamera>> scene_cameras(const std::string& metadata_json, const Vector& zero = {});

/// What `--camera TEXT` names: the empty text (the scene's first camera, else a framed one), "frame", a name, an index,
/// or "ox,oy,oz,lx,ly,lz[,fov]" in world space (position, point looked at, vertical field of view in degrees, 40 where
/// left out). Errors: invalid_argument, with the names there are.
Result<Camera> choose_camera(const std::string& text, const StoreInfo& info, Extent extent);

}  // namespace raymill::client
