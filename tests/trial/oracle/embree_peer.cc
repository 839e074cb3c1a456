#include "tests/trial/oracle/embree_peer.h"

#include <limits>
#include <string>
#include <utility>

namespace raymill::trial {
namespace {

RTCRay to_embree(const Ray& ray) {
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

}  // namespace

Result<EmbreePeer> EmbreePeer::create(std::span<const storage::Triangle> triangles) {
  EmbreePeer peer;
  peer.device_ = rtcNewDevice(nullptr);
  if (peer.device_ == nullptr) {
    return {ErrorCode::internal, "Embree made no device"};
  }
  peer.scene_ = rtcNewScene(peer.device_);
  rtcSetSceneFlags(peer.scene_, RTC_SCENE_FLAG_ROBUST);
  RTCGeometry geometry = rtcNewGeometry(peer.device_, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                               3 * sizeof(float), triangles.size() * 3));
  auto* indices = static_cast<unsigned*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                                 3 * sizeof(unsigned), triangles.size()));
  if (vertices == nullptr || indices == nullptr) {
    rtcReleaseGeometry(geometry);
    return {ErrorCode::budget_exceeded, "Embree has no memory for " + std::to_string(triangles.size()) + " triangles"};
  }
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    for (unsigned corner = 0; corner < 3; ++corner) {
      for (int axis = 0; axis < 3; ++axis) {
        *vertices++ = triangles[i].v[corner][axis];
      }
      *indices++ = static_cast<unsigned>(i * 3 + corner);
    }
  }
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(peer.scene_, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(peer.scene_);
  if (const RTCError error = rtcGetDeviceError(peer.device_); error != RTC_ERROR_NONE) {
    return {ErrorCode::internal, "Embree reports error " + std::to_string(error)};
  }
  return peer;
}

EmbreePeer::EmbreePeer(EmbreePeer&& other) noexcept
    : device_(std::exchange(other.device_, nullptr)), scene_(std::exchange(other.scene_, nullptr)) {}

EmbreePeer::~EmbreePeer() {
  if (scene_ != nullptr) {
    rtcReleaseScene(scene_);
  }
  if (device_ != nullptr) {
    rtcReleaseDevice(device_);
  }
}

std::optional<std::uint32_t> EmbreePeer::closest(const Ray& ray) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRayHit query{};
  query.ray = to_embree(ray);
  query.hit.geomID = query.hit.primID = query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(scene_, &context, &query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) {
    return std::nullopt;
  }
  return query.hit.primID;
}

bool EmbreePeer::any(const Ray& ray) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRay query = to_embree(ray);
  rtcOccluded1(scene_, &context, &query);
  return query.tfar < 0;
}

}  // namespace raymill::trial
