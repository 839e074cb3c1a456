#include "tests/bench/in_core/embree_calls.h"

#include <algorithm>
#include <array>
#include <limits>

namespace raymill::bench {
namespace {

// Embree's manual: streams of some hundred rays are enough.
constexpr std::size_t kStreamRays = 256;

template <int N>
struct Packet;
template <>
struct Packet<8> {
  using RayHits = RTCRayHit8;
  using Rays = RTCRay8;
  static constexpr auto intersect = &rtcIntersect8;
  static constexpr auto occluded = &rtcOccluded8;
};
template <>
struct Packet<16> {
  using RayHits = RTCRayHit16;
  using Rays = RTCRay16;
  static constexpr auto intersect = &rtcIntersect16;
  static constexpr auto occluded = &rtcOccluded16;
};

template <typename Rays>
void put(Rays& packet, std::size_t lane, const Ray& ray) {
  packet.org_x[lane] = ray.org[0];
  packet.org_y[lane] = ray.org[1];
  packet.org_z[lane] = ray.org[2];
  packet.tnear[lane] = ray.tnear;
  packet.dir_x[lane] = ray.dir[0];
  packet.dir_y[lane] = ray.dir[1];
  packet.dir_z[lane] = ray.dir[2];
  packet.tfar[lane] = ray.tfar;
  packet.time[lane] = 0;
  packet.mask[lane] = ~0U;
  packet.id[lane] = 0;
  packet.flags[lane] = 0;
}

Hit occlusion(float tfar) {
  Hit hit;
  hit.t = tfar < 0 ? 0 : std::numeric_limits<float>::infinity();
  return hit;
}

template <int N>
void trace_packets(RTCScene scene, RTCIntersectContext& context, Query query, std::span<const Ray> rays,
                   std::span<Hit> hits) {
  for (std::size_t begin = 0; begin < rays.size(); begin += N) {
    const std::size_t count = std::min<std::size_t>(N, rays.size() - begin);
    alignas(64) std::array<int, N> valid;
    for (std::size_t i = 0; i < N; ++i) {
      valid[i] = i < count ? -1 : 0;
    }
    if (query == Query::any) {
      typename Packet<N>::Rays packet{};
      for (std::size_t i = 0; i < count; ++i) {
        put(packet, i, rays[begin + i]);
      }
      Packet<N>::occluded(valid.data(), scene, &context, &packet);
      for (std::size_t i = 0; i < count; ++i) {
        hits[begin + i] = occlusion(packet.tfar[i]);
      }
      continue;
    }
    typename Packet<N>::RayHits packet{};
    for (std::size_t i = 0; i < count; ++i) {
      put(packet.ray, i, rays[begin + i]);
      packet.hit.geomID[i] = packet.hit.primID[i] = packet.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
    }
    Packet<N>::intersect(valid.data(), scene, &context, &packet);
    for (std::size_t i = 0; i < count; ++i) {
      hits[begin + i] = packet.hit.geomID[i] == RTC_INVALID_GEOMETRY_ID
                            ? Hit{}
                            : Hit{packet.ray.tfar[i], packet.hit.u[i], packet.hit.v[i], packet.hit.primID[i]};
    }
  }
}

void trace_streams(RTCScene scene, RTCIntersectContext& context, Query query, std::span<const Ray> rays,
                   std::span<Hit> hits) {
  for (std::size_t begin = 0; begin < rays.size(); begin += kStreamRays) {
    const std::size_t count = std::min(kStreamRays, rays.size() - begin);
    if (query == Query::any) {
      std::array<RTCRay, kStreamRays> stream;
      for (std::size_t i = 0; i < count; ++i) {
        stream[i] = EmbreeScene::embree_ray(rays[begin + i]);
      }
      rtcOccluded1M(scene, &context, stream.data(), static_cast<unsigned>(count), sizeof(RTCRay));
      for (std::size_t i = 0; i < count; ++i) {
        hits[begin + i] = occlusion(stream[i].tfar);
      }
      continue;
    }
    std::array<RTCRayHit, kStreamRays> stream;
    for (std::size_t i = 0; i < count; ++i) {
      stream[i] = EmbreeScene::embree_query(rays[begin + i]);
    }
    rtcIntersect1M(scene, &context, stream.data(), static_cast<unsigned>(count), sizeof(RTCRayHit));
    for (std::size_t i = 0; i < count; ++i) {
      hits[begin + i] = EmbreeScene::hit_of(stream[i]);
    }
  }
}

void trace_singly(const EmbreeScene& scene, Query query, std::span<const Ray> rays, std::span<Hit> hits) {
  for (std::size_t i = 0; i < rays.size(); ++i) {
    hits[i] = query == Query::closest ? scene.closest_hit(rays[i]) : occlusion(scene.any_hit(rays[i]) ? -1.0F : 0.0F);
  }
}

}  // namespace

void trace_by_embree(const EmbreeScene& scene, const EmbreeBatch& batch, std::span<const Ray> rays,
                     std::span<Hit> hits) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = batch.coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
  switch (batch.call) {
    case EmbreeCall::single:
      return trace_singly(scene, batch.query, rays, hits);
    case EmbreeCall::packet8:
      return trace_packets<8>(scene.handle(), context, batch.query, rays, hits);
    case EmbreeCall::packet16:
      return trace_packets<16>(scene.handle(), context, batch.query, rays, hits);
    case EmbreeCall::stream:
      return trace_streams(scene.handle(), context, batch.query, rays, hits);
  }
}

}  // namespace raymill::bench
