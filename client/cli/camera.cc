#include "client/cli/camera.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

namespace raymill::client {

namespace {

constexpr double kDefaultFovDegrees = 40;
constexpr std::size_t kMaxNamesInMessage = 8;

Vector operator-(const Vector& a, const Vector& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
Vector operator+(const Vector& a, const Vector& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }
Vector operator*(const Vector& a, double s) { return {a[0] * s, a[1] * s, a[2] * s}; }
double dot(const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
Vector cross(const Vector& a, const Vector& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
bool normalise(Vector& a) {
  const double length = std::sqrt(dot(a, a));
  a = a * (1 / length);
  return length > 0 && std::isfinite(length);
}
std::array<float, 3> rounded(const Vector& a) {
  return {static_cast<float>(a[0]), static_cast<float>(a[1]), static_cast<float>(a[2])};
}

// The camera looks along -z of its space, with y up (glTF 2.0, 5.12). Scale and shear of the node are left out.
bool orient(Camera& camera, Vector forward, const Vector& up) {
  if (!normalise(forward)) {
    return false;
  }
  Vector right = cross(forward, up);
  if (!normalise(right)) {
    // Straight up or down: any direction will do for the right hand.
    right = cross(forward, std::abs(forward[2]) < 0.9 ? Vector{0, 0, 1} : Vector{1, 0, 0});
    normalise(right);
  }
  camera.forward = forward;
  camera.right = right;
  camera.up = cross(right, forward);
  return true;
}

}  // namespace

Ray Camera::ray(double x, double y, Extent extent) const {
  const double scale = 2 * half_height / extent.height;
  const double across = (x - 0.5 * extent.width) * scale;
  const double along = (0.5 * extent.height - y) * scale;
  const Vector offset = right * across + up * along;
  Ray ray;
  if (perspective) {
    Vector direction = forward + offset;
    normalise(direction);
    ray.org = rounded(origin);
    ray.dir = rounded(direction);
  } else {
    ray.org = rounded(origin + offset);
    ray.dir = rounded(forward);
  }
  return ray;
}

Result<Camera> look_at(const Vector& origin, const Vector& target, double yfov_radians) {
  Camera camera;
  camera.origin = origin;
  if (!(yfov_radians > 0 && yfov_radians < std::numbers::pi)) {
    return Status(ErrorCode::invalid_argument, "a camera's field of view lies between 0 and 180 degrees");
  }
  camera.half_height = std::tan(yfov_radians / 2);
  if (!orient(camera, target - origin, {0, 1, 0})) {
    return Status(ErrorCode::invalid_argument, "a camera must look at a point other than its own position");
  }
  return camera;
}

Camera framed(const std::array<float, 3>& lower, const std::array<float, 3>& upper, Extent extent) {
  Vector centre{}, half{};
  for (int axis = 0; axis < 3; ++axis) {
    // An empty scene has an inverted box; a camera at the origin is as good as any.
    const bool empty = !(lower[axis] <= upper[axis]);
    centre[axis] = empty ? 0 : 0.5 * (double(lower[axis]) + upper[axis]);
    half[axis] = empty ? 0 : 0.5 * (double(upper[axis]) - lower[axis]);
  }
  Camera camera;
  camera.half_height = std::tan(kDefaultFovDegrees * std::numbers::pi / 360);
  orient(camera, {-0.6, -0.45, -0.75}, {0, 1, 0});
  const double half_width = camera.half_height * extent.width / extent.height;
  // The least distance from the centre at which every corner of the box falls inside the picture.
  double distance = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const Vector p{corner & 1 ? half[0] : -half[0], corner & 2 ? half[1] : -half[1], corner & 4 ? half[2] : -half[2]};
    const double needed =
        std::max(std::abs(dot(p, camera.right)) / half_width, std::abs(dot(p, camera.up)) / camera.half_height);
    distance = std::max(distance, needed - dot(p, camera.forward));
  }
  camera.origin = centre - camera.forward * std::max(distance * 1.05, 1e-3);
  return camera;
}

Result<std::vector<NamedCamera>> scene_cameras(const std::string& metadata_json, const Vector& zero) {
  using nlohmann::json;
  // Geometries can be millions: only the cameras are kept while parsing.
  const auto keep = [](int depth, json::parse_event_t event, json& value) {
    return !(depth == 1 && event == json::parse_event_t::key && value != "cameras");
  };
  const json metadata = json::parse(metadata_json, keep, false);
  std::vector<NamedCamera> cameras;
  if (!metadata.is_object() || !metadata.contains("cameras")) {
    return cameras;
  }
  try {
    for (const json& entry : metadata.at("cameras")) {
      const auto matrix = entry.at("world_from_camera").get<std::vector<double>>();
      if (matrix.size() != 16) {
        continue;
      }
      NamedCamera named{.name = entry.value("name", ""), .camera = {}};
      named.camera.origin = Vector{matrix[12], matrix[13], matrix[14]} - zero;
      named.camera.perspective = entry.value("perspective", true);
      const double height =
          named.camera.perspective ? std::tan(entry.value("yfov_radians", 0.0) / 2) : entry.value("ymag", 0.0);
      named.camera.half_height = height;
      if (height > 0 && std::isfinite(height) &&
          orient(named.camera, {-matrix[8], -matrix[9], -matrix[10]}, {matrix[4], matrix[5], matrix[6]})) {
        cameras.push_back(std::move(named));
      }
    }
  } catch (const json::exception& error) {
    return Status(ErrorCode::corrupt, std::string("the store's cameras cannot be read: ") + error.what());
  }
  return cameras;
}

Result<Camera> choose_camera(const std::string& text, const StoreInfo& info, Extent extent) {
  if (text == "frame") {
    return framed(info.bounds_min, info.bounds_max, extent);
  }
  RAYMILL_ASSIGN_OR_RETURN(const std::vector<NamedCamera> cameras, scene_cameras(info.metadata_json, info.origin));
  if (text.empty()) {
    return cameras.empty() ? framed(info.bounds_min, info.bounds_max, extent) : cameras.front().camera;
  }
  for (const NamedCamera& named : cameras) {
    if (named.name == text) {
      return named.camera;
    }
  }
  std::size_t index = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), index);
  if (error == std::errc() && end == text.data() + text.size() && index < cameras.size()) {
    return cameras[index].camera;
  }
  if (const auto numbers = parse_numbers(text); numbers && (numbers->size() == 6 || numbers->size() == 7)) {
    const std::vector<double>& n = *numbers;
    const double fov_degrees = n.size() == 7 ? n[6] : kDefaultFovDegrees;
    return look_at(Vector{n[0], n[1], n[2]} - info.origin, Vector{n[3], n[4], n[5]} - info.origin,
                   fov_degrees * std::numbers::pi / 180);
  }
  std::string names;
  for (std::size_t i = 0; i < std::min(cameras.size(), kMaxNamesInMessage); ++i) {
    names += (i == 0 ? "" : ", ") + std::to_string(i) + " '" + cameras[i].name + "'";
  }
  return Status(ErrorCode::invalid_argument,
                "no camera '" + text +
                    "': give frame, six or seven numbers (ox,oy,oz,lx,ly,lz[,fov]), or a camera of "
                    "the scene (" +
                    (names.empty() ? "it has none" : names) + ")");
}

}  // namespace raymill::client
