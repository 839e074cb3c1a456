#include "client/cli/bench/embree_scene.h"

#include <sys/mman.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstring>
#include <limits>
#include <numeric>
#include <span>
#include <utility>

namespace raymill::client {
namespace {

constexpr std::uint64_t kCornerBytes = 3 * sizeof(float);
// Room for as many triangles as a geometry can count; untouched parts cost nothing.
constexpr std::uint64_t kMostTriangles = std::numeric_limits<std::uint32_t>::max() / 3;

// Writes the corners of the scene's triangles one after the other.
class Corners final : public storage::TriangleSink {
 public:
  explicit Corners(std::byte* out) : out_(out) {}
  Status add(std::span<const storage::Triangle> triangles) override {
    if (triangles.size() > kMostTriangles - count_) {
      return {ErrorCode::unsupported, "the scene has more triangles than one geometry of Embree takes"};
    }
    for (const storage::Triangle& triangle : triangles) {
      std::memcpy(out_ + 3 * kCornerBytes * count_++, triangle.v.data(), 3 * kCornerBytes);
    }
    return {};
  }
  [[nodiscard]] std::uint64_t count() const { return count_; }

 private:
  std::byte* out_;
  std::uint64_t count_ = 0;
};

void attach(RTCGeometry geometry, RTCScene scene) {
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(scene, geometry);
  rtcReleaseGeometry(geometry);
}

}  // namespace

Result<EmbreeScene> EmbreeScene::create(const Config& config,
                                        const std::function<Status(storage::TriangleSink&)>& fill) {
  EmbreeScene made;
  // Embree reads 16 bytes at a corner.
  made.vertices_ = storage::MappedMemory(3 * kCornerBytes * kMostTriangles + 16);
  if (made.vertices_.data() == nullptr) {
    return {ErrorCode::budget_exceeded, "the system gives no room for the vertices"};
  }
  Corners corners(made.vertices_.data());
  RAYMILL_RETURN_IF_ERROR(fill(corners));
  made.triangles_ = corners.count();
  made.indices_ = storage::MappedMemory(3 * sizeof(std::uint32_t) * made.triangles_ + 16);
  if (made.indices_.data() == nullptr) {
    return {ErrorCode::budget_exceeded, "the system gives no room for the indices"};
  }
  auto* indices = reinterpret_cast<std::uint32_t*>(made.indices_.data());
  for (std::uint64_t i = 0; i < 3 * made.triangles_; ++i) {
    indices[i] = static_cast<std::uint32_t>(i);
  }

  const auto begin = std::chrono::steady_clock::now();
  RAYMILL_RETURN_IF_ERROR(made.make_device(config));
  RTCGeometry geometry = rtcNewGeometry(made.device_, RTC_GEOMETRY_TYPE_TRIANGLE);
  rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, made.vertices_.data(), 0,
                             kCornerBytes, 3 * made.triangles_);
  rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, made.indices_.data(), 0,
                             3 * sizeof(std::uint32_t), made.triangles_);
  attach(geometry, made.scene_);
  RAYMILL_RETURN_IF_ERROR(made.commit(begin));
  if (!config.keep_arrays) {
    for (const storage::MappedMemory* array : {&made.vertices_, &made.indices_}) {
      ::madvise(array->data(), array->size(), MADV_DONTNEED);
    }
  }
  return made;
}

Status EmbreeScene::make_device(const Config& config) {
  device_ = rtcNewDevice(config.device.empty() ? nullptr : config.device.c_str());
  if (device_ == nullptr) {
    return {ErrorCode::internal, "Embree made no device"};
  }
  scene_ = rtcNewScene(device_);
  rtcSetSceneFlags(scene_, config.robust ? RTC_SCENE_FLAG_ROBUST : RTC_SCENE_FLAG_NONE);
  return {};
}

Status EmbreeScene::commit(std::chrono::steady_clock::time_point begin) {
  rtcCommitScene(scene_);
  if (const RTCError error = rtcGetDeviceError(device_); error != RTC_ERROR_NONE) {
    return {ErrorCode::internal, "Embree reports error " + std::to_string(error)};
  }
  build_seconds_ = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return {};
}

namespace {

void attach_triangles(RTCDevice device, RTCScene scene, std::span<const storage::Triangle> triangles) {
  if (triangles.empty()) {
    return;
  }
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* corners = static_cast<std::byte*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, kCornerBytes, 3 * triangles.size()));
  auto* indices = static_cast<std::uint32_t*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(std::uint32_t), triangles.size()));
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    std::memcpy(corners + 3 * kCornerBytes * i, triangles[i].v.data(), 3 * kCornerBytes);
  }
  std::iota(indices, indices + 3 * triangles.size(), 0U);
  attach(geometry, scene);
}

}  // namespace

Result<EmbreeScene> EmbreeScene::create(const Config& config, const PlacedTriangles& scene) {
  EmbreeScene made;
  const auto begin = std::chrono::steady_clock::now();
  RAYMILL_RETURN_IF_ERROR(made.make_device(config));
  attach_triangles(made.device_, made.scene_, scene.world);
  made.triangles_ = scene.world.size();
  for (const std::vector<storage::Triangle>& triangles : scene.objects) {
    RTCScene object = rtcNewScene(made.device_);
    made.objects_.push_back(object);
    rtcSetSceneFlags(object, config.robust ? RTC_SCENE_FLAG_ROBUST : RTC_SCENE_FLAG_NONE);
    attach_triangles(made.device_, object, triangles);
    rtcCommitScene(object);
    made.triangles_ += triangles.size();
  }
  for (const PlacedTriangles::Place& place : scene.places) {
    RTCGeometry geometry = rtcNewGeometry(made.device_, RTC_GEOMETRY_TYPE_INSTANCE);
    rtcSetGeometryInstancedScene(geometry, made.objects_[place.object]);
    std::array<float, 12> matrix{};
    std::transform(place.world_from_object.begin(), place.world_from_object.end(), matrix.begin(),
                   [](double x) { return static_cast<float>(x); });
    rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, matrix.data());
    attach(geometry, made.scene_);
  }
  RAYMILL_RETURN_IF_ERROR(made.commit(begin));
  return made;
}

EmbreeScene::EmbreeScene(EmbreeScene&& other) noexcept
    : vertices_(std::move(other.vertices_)),
      indices_(std::move(other.indices_)),
      device_(std::exchange(other.device_, nullptr)),
      scene_(std::exchange(other.scene_, nullptr)),
      objects_(std::exchange(other.objects_, {})),
      triangles_(other.triangles_),
      build_seconds_(other.build_seconds_) {}

EmbreeScene::~EmbreeScene() {
  if (scene_ != nullptr) {
    rtcReleaseScene(scene_);
  }
  for (RTCScene object : objects_) {
    rtcReleaseScene(object);
  }
  if (device_ != nullptr) {
    rtcReleaseDevice(device_);
  }
}

RTCRay EmbreeScene::embree_ray(const Ray& ray) {
  RTCRay out{};
  out.org_x = ray.org[0];
  out.org_y = ray.org[1];
  out.org_z = ray.org[2];
  out.tnear = ray.tnear;
  out.dir_x = ray.dir[0];
  out.dir_y = ray.dir[1];
  out.dir_z = ray.dir[2];
  out.tfar = ray.tfar;
  out.mask = ~0U;
  return out;
}

RTCRayHit EmbreeScene::embree_query(const Ray& ray) {
  RTCRayHit query{};
  query.ray = embree_ray(ray);
  query.hit.geomID = query.hit.primID = query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  return query;
}

Hit EmbreeScene::hit_of(const RTCRayHit& query) {
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) {
    return {};
  }
  return {query.ray.tfar, query.hit.u, query.hit.v, query.hit.primID};
}

Hit EmbreeScene::closest_hit(const Ray& ray) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRayHit query = embree_query(ray);
  rtcIntersect1(scene_, &context, &query);
  return hit_of(query);
}

bool EmbreeScene::any_hit(const Ray& ray) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRay query = embree_ray(ray);
  rtcOccluded1(scene_, &context, &query);
  return query.tfar < 0;
}

}  // namespace raymill::client
