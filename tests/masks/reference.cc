// raymill-mask-reference SCENE RAYS OUTPUT: the nearest hits that count, all in float64, textures sampled directly.
//
// Shares nothing with Raymill but the documented rule: barycentrics of ray and triangle, texture coordinates
// c0 + u (c1 - c0) + v (c2 - c0), times the texture's size, rounded down, wrapped; the texel counts where its alpha by
// OpenImageIO times factor times the corners' alpha is at least the cutoff. Embree finds which triangles a ray may
// meet, by boxes that are padded; the triangles are tested here (Moeller, Trumbore 1997, in float64).
//
// SCENE (little-endian): u64 triangle count, u32 mask count; masks: u32 length of a path, the path (empty: alpha 1),
// f64 factor, f64 cutoff, u32 wrap s, u32 wrap t (0 repeat, 1 mirror, 2 clamp); triangles: f32[9] corners, f32[6]
// texture coordinates, f32[3] alphas, u32 geometry id, u32 primitive id, i32 mask (-1: opaque), u32 sides (0 both, 1
// front, 2 back). RAYS: f32[8] each, org tnear dir tfar. OUTPUT: f64 t (inf: none), u32 geometry id, u32 primitive id
// each.

#include <OpenImageIO/imageio.h>
#include <embree3/rtcore.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <memory>
#include <string>
#include <vector>

namespace {

struct Mask {
  int width = 1, height = 1;
  double most = 1, factor = 1, cutoff = 0.5;
  std::uint32_t wrap_s = 0, wrap_t = 0;
  std::vector<std::uint16_t> alphas{1};
};

struct Triangle {
  std::array<std::array<float, 3>, 3> corners;
  std::array<std::array<float, 2>, 3> tex_coords;
  std::array<float, 3> alphas;
  std::uint32_t geometry_id, primitive_id;
  std::int32_t mask;
  std::uint32_t sides;
};
static_assert(sizeof(Triangle) == 88);

struct Ray {
  std::array<float, 3> org;
  float tnear;
  std::array<float, 3> dir;
  float tfar;
};

struct Answer {
  double t = std::numeric_limits<double>::infinity();
  std::uint32_t geometry_id = 0xFFFFFFFF, primitive_id = 0xFFFFFFFF;
};

struct Scene {
  std::vector<Mask> masks;
  std::vector<Triangle> triangles;
};

[[noreturn]] void fail(const std::string& sentence) {
  std::fprintf(stderr, "%s\n", sentence.c_str());
  std::exit(1);
}

template <typename T>
void read(std::FILE* file, T* values, std::size_t count) {
  if (std::fread(values, sizeof(T), count, file) != count) {
    fail("the scene ends early");
  }
}

void load_alpha(const std::string& path, Mask& mask) {
  const auto input = OIIO::ImageInput::open(path);
  if (!input) {
    fail(path + ": " + OIIO::geterror());
  }
  const OIIO::ImageSpec spec = input->spec();
  if (spec.alpha_channel < 0) {
    return;
  }
  const bool bytes = spec.format.size() == 1;
  mask.width = spec.width;
  mask.height = spec.height;
  mask.most = bytes ? 255 : 65535;
  const auto pixels = static_cast<std::size_t>(spec.width) * static_cast<std::size_t>(spec.height);
  const auto channels = static_cast<std::size_t>(spec.nchannels), alpha = static_cast<std::size_t>(spec.alpha_channel);
  mask.alphas.resize(pixels);
  std::vector<std::uint8_t> small(bytes ? pixels * channels : 0);
  std::vector<std::uint16_t> wide(bytes ? 0 : pixels * channels);
  const bool good = bytes ? input->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::UINT8, small.data())
                          : input->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::UINT16, wide.data());
  if (!good) {
    fail(path + ": " + input->geterror());
  }
  for (std::size_t i = 0; i < pixels; ++i) {
    mask.alphas[i] = bytes ? small[i * channels + alpha] : wide[i * channels + alpha];
  }
}

Scene load_scene(const char* path) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path, "rb"), &std::fclose);
  if (!file) {
    fail(std::string(path) + " cannot be opened");
  }
  Scene scene;
  std::uint64_t count = 0;
  std::uint32_t masks = 0;
  read(file.get(), &count, 1);
  read(file.get(), &masks, 1);
  for (std::uint32_t i = 0; i < masks; ++i) {
    Mask& mask = scene.masks.emplace_back();
    std::uint32_t length = 0;
    read(file.get(), &length, 1);
    std::string name(length, '\0');
    read(file.get(), name.data(), length);
    read(file.get(), &mask.factor, 1);
    read(file.get(), &mask.cutoff, 1);
    read(file.get(), &mask.wrap_s, 1);
    read(file.get(), &mask.wrap_t, 1);
    if (!name.empty()) {
      load_alpha(name, mask);
    }
  }
  scene.triangles.resize(count);
  read(file.get(), scene.triangles.data(), count);
  return scene;
}

long wrapped(double at, long size, std::uint32_t wrap) {
  const double texel = std::floor(at);
  if (wrap == 2) {
    return static_cast<long>(std::clamp(texel, 0.0, double(size - 1)));
  }
  const double period = wrap == 1 ? 2.0 * double(size) : double(size);
  const auto in = static_cast<long>(texel - std::floor(texel / period) * period);
  return in < size ? in : 2 * size - 1 - in;
}

bool counts(const Scene& scene, const Triangle& triangle, double u, double v) {
  if (triangle.mask < 0) {
    return true;
  }
  const Mask& mask = scene.masks[static_cast<std::size_t>(triangle.mask)];
  const auto at = [&](double c0, double c1, double c2) { return c0 + u * (c1 - c0) + v * (c2 - c0); };
  const auto& c = triangle.tex_coords;
  const long x = wrapped(at(c[0][0], c[1][0], c[2][0]) * mask.width, mask.width, mask.wrap_s);
  const long y = wrapped(at(c[0][1], c[1][1], c[2][1]) * mask.height, mask.height, mask.wrap_t);
  const double texel = mask.alphas[static_cast<std::size_t>(y * mask.width + x)] / mask.most;
  const double corners = at(triangle.alphas[0], triangle.alphas[1], triangle.alphas[2]);
  return texel * mask.factor * corners >= mask.cutoff;
}

using Vector = std::array<double, 3>;
Vector cross(const Vector& a, const Vector& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
double dot(const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

bool intersect(const Ray& ray, const Triangle& triangle, double& t, double& u, double& v) {
  Vector e1, e2, s, dir;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    e1[axis] = double(triangle.corners[1][axis]) - triangle.corners[0][axis];
    e2[axis] = double(triangle.corners[2][axis]) - triangle.corners[0][axis];
    s[axis] = double(ray.org[axis]) - triangle.corners[0][axis];
    dir[axis] = ray.dir[axis];
  }
  const Vector p = cross(dir, e2), q = cross(s, e1);
  const double det = dot(e1, p);
  if (det == 0) {
    return false;
  }
  // det > 0: from the side where the corners go counterclockwise.
  if ((triangle.sides == 1 && det < 0) || (triangle.sides == 2 && det > 0)) {
    return false;
  }
  u = dot(s, p) / det;
  v = dot(dir, q) / det;
  t = dot(e2, q) / det;
  return u >= 0 && v >= 0 && u + v <= 1;
}

// A ray that Embree traces, with the ray that it stands for.
struct Query {
  RTCIntersectContext context;
  const Ray* ray;
  Answer answer;
};

void bounds(const RTCBoundsFunctionArguments* args) {
  const Triangle& triangle = static_cast<const Scene*>(args->geometryUserPtr)->triangles[args->primID];
  std::array<float, 6> box{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto [low, high] =
        std::minmax({triangle.corners[0][axis], triangle.corners[1][axis], triangle.corners[2][axis]});
    const float pad = 1e-5F * (std::fabs(low) + std::fabs(high)) + 1e-5F * (high - low) + 1e-30F;
    box[axis] = low - pad;
    box[axis + 3] = high + pad;
  }
  *args->bounds_o = {box[0], box[1], box[2], 0, box[3], box[4], box[5], 0};
}

void test(const RTCIntersectFunctionNArguments* args) {
  const auto& scene = *static_cast<const Scene*>(args->geometryUserPtr);
  const Triangle& triangle = scene.triangles[args->primID];
  auto& query = *reinterpret_cast<Query*>(args->context);
  double t = 0, u = 0, v = 0;
  if (!intersect(*query.ray, triangle, t, u, v) || !(t >= query.ray->tnear && t <= query.ray->tfar) ||
      t > query.answer.t || !counts(scene, triangle, u, v)) {
    return;
  }
  Answer& best = query.answer;
  if (t < best.t || triangle.geometry_id < best.geometry_id ||
      (triangle.geometry_id == best.geometry_id && triangle.primitive_id < best.primitive_id)) {
    best = {t, triangle.geometry_id, triangle.primitive_id};
  }
  // Embree goes on as far as there may be a nearer one, its own roundings included.
  auto* hit = reinterpret_cast<RTCRayHit*>(args->rayhit);
  hit->ray.tfar = std::min(hit->ray.tfar, static_cast<float>(best.t) * 1.0001F);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) {
    fail("usage: raymill-mask-reference SCENE RAYS OUTPUT");
  }
  Scene scene = load_scene(argv[1]);
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> rays(std::fopen(argv[2], "rb"), &std::fclose);
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> out(std::fopen(argv[3], "wb"), &std::fclose);
  if (!rays || !out) {
    fail("the rays or the output cannot be opened");
  }
  RTCDevice device = rtcNewDevice(nullptr);
  RTCScene tree = rtcNewScene(device);
  rtcSetSceneFlags(tree, RTC_SCENE_FLAG_ROBUST);
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER);
  rtcSetGeometryUserPrimitiveCount(geometry, static_cast<unsigned>(scene.triangles.size()));
  rtcSetGeometryUserData(geometry, &scene);
  rtcSetGeometryBoundsFunction(geometry, &bounds, nullptr);
  rtcSetGeometryIntersectFunction(geometry, &test);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(tree, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(tree);
  Ray ray;
  while (std::fread(&ray, sizeof ray, 1, rays.get()) == 1) {
    Query query{};
    rtcInitIntersectContext(&query.context);
    query.ray = &ray;
    query.answer = {};
    RTCRayHit hit{};
    hit.ray = {ray.org[0], ray.org[1], ray.org[2], ray.tnear,  ray.dir[0], ray.dir[1],
               ray.dir[2], 0,          ray.tfar,   0xFFFFFFFF, 0,          0};
    hit.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    rtcIntersect1(tree, &query.context, &hit);
    std::fwrite(&query.answer.t, sizeof query.answer.t, 1, out.get());
    std::fwrite(&query.answer.geometry_id, sizeof query.answer.geometry_id, 1, out.get());
    std::fwrite(&query.answer.primitive_id, sizeof query.answer.primitive_id, 1, out.get());
  }
  rtcReleaseScene(tree);
  rtcReleaseDevice(device);
  return std::fflush(out.get()) == 0 ? 0 : 1;
}
