#include "client/cli/camera.h"

#include <gtest/gtest.h>

#include <cmath>

namespace raymill::client {
namespace {

constexpr Extent kExtent{.width = 200, .height = 100};

StoreInfo with_cameras(const std::string& cameras) {
  StoreInfo info;
  info.bounds_min = {-1, -2, -3};
  info.bounds_max = {4, 5, 6};
  info.metadata_json = R"({"geometries":[{"node":"cameras","mesh":"x"}],"cameras":[)" + cameras + R"(],"import":{}})";
  return info;
}

// At (1, 2, 3), turned by 90 degrees about y: looks along -x.
const std::string kSide = R"({"name":"side","perspective":true,"yfov_radians":1.5707963267948966,"aspect_ratio":0,
  "ymag":0,"world_from_camera":[0,0,-1,0, 0,1,0,0, 1,0,0,0, 1,2,3,1]})";

TEST(Camera, LooksAlongMinusZOfItsNode) {
  const auto camera = choose_camera("side", with_cameras(kSide), kExtent);
  ASSERT_TRUE(camera) << camera.status().message();
  const Ray centre = camera->ray(100, 50, kExtent);
  EXPECT_EQ(centre.org, (std::array<float, 3>{1, 2, 3}));
  EXPECT_FLOAT_EQ(centre.dir[0], -1);
  EXPECT_NEAR(centre.dir[1], 0, 1e-6);
  EXPECT_NEAR(centre.dir[2], 0, 1e-6);
  // 90 degrees high: the top edge leaves at 45 degrees; the right edge lies towards -z.
  const Ray top = camera->ray(100, 0, kExtent);
  EXPECT_NEAR(top.dir[1], std::sqrt(0.5), 1e-6);
  EXPECT_LT(camera->ray(200, 50, kExtent).dir[2], 0);
}

TEST(Camera, StandsInTheSpaceOfTheStore) {
  StoreInfo info = with_cameras(kSide);
  info.origin = {1, 1, 1};
  EXPECT_EQ(choose_camera("side", info, kExtent)->origin, (Vector{0, 1, 2})) << "the scene's are in world space";
  const auto given = choose_camera("1,1,11,1,1,1", info, kExtent);
  ASSERT_TRUE(given) << given.status().message();
  EXPECT_EQ(given->origin, (Vector{0, 0, 10}));
  EXPECT_EQ(given->forward, (Vector{0, 0, -1}));
  const Vector framed = choose_camera("frame", info, kExtent)->origin;
  info.origin = {};
  EXPECT_EQ(choose_camera("frame", info, kExtent)->origin, framed) << "bounds are relative already";
}

TEST(Camera, ChosenByNameIndexNumbersOrFrame) {
  const StoreInfo info = with_cameras(kSide);
  EXPECT_EQ(choose_camera("", info, kExtent)->origin, (Vector{1, 2, 3}));
  EXPECT_EQ(choose_camera("0", info, kExtent)->origin, (Vector{1, 2, 3}));
  const auto given = choose_camera("0,0,10,0,0,0,90", info, kExtent);
  ASSERT_TRUE(given) << given.status().message();
  EXPECT_EQ(given->origin, (Vector{0, 0, 10}));
  EXPECT_NEAR(given->half_height, 1, 1e-12);
  EXPECT_TRUE(choose_camera("frame", info, kExtent));
  for (const char* text : {"front", "1", "-1", "1,2,3", "0,0,0,0,0,0", "0,0,0,0,0,1,180"}) {
    const auto camera = choose_camera(text, info, kExtent);
    ASSERT_FALSE(camera) << text;
    EXPECT_EQ(camera.status().code(), ErrorCode::invalid_argument);
  }
  EXPECT_NE(choose_camera("front", info, kExtent).status().message().find("0 'side'"), std::string::npos);
}

TEST(Camera, UnusableOnesAreLeftOut) {
  const auto cameras = scene_cameras(
      with_cameras(
          R"({"name":"flat","perspective":true,"yfov_radians":0,"world_from_camera":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]},
                      {"name":"zero","perspective":true,"yfov_radians":1,"world_from_camera":[0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,1]},
                      {"name":"short","perspective":true,"yfov_radians":1,"world_from_camera":[1]})")
          .metadata_json);
  ASSERT_TRUE(cameras);
  EXPECT_TRUE(cameras->empty());
  EXPECT_TRUE(scene_cameras("")->empty());
  EXPECT_TRUE(scene_cameras("not json")->empty());
  EXPECT_EQ(scene_cameras(R"({"cameras":[1]})").status().code(), ErrorCode::corrupt);
}

TEST(Camera, OrthographicRaysAreParallel) {
  const auto camera = choose_camera(
      "",
      with_cameras(
          R"({"name":"plan","perspective":false,"ymag":5,"world_from_camera":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,9,1]})"),
      kExtent);
  ASSERT_TRUE(camera);
  const Ray corner = camera->ray(0, 0, kExtent);
  EXPECT_EQ(corner.org, (std::array<float, 3>{-10, 5, 9}));
  EXPECT_EQ(corner.dir, (std::array<float, 3>{0, 0, -1}));
}

TEST(Camera, FrameHoldsEveryCorner) {
  for (const Extent extent : {Extent{1600, 100}, Extent{100, 1600}, Extent{64, 64}}) {
    const Camera camera = framed({-1, -20, 3}, {100, 5, 6}, extent);
    for (int corner = 0; corner < 8; ++corner) {
      const double p[3] = {corner & 1 ? -1.0 : 100.0, corner & 2 ? -20.0 : 5.0, corner & 4 ? 3.0 : 6.0};
      double x = 0, y = 0, z = 0;
      for (int axis = 0; axis < 3; ++axis) {
        const double d = p[axis] - camera.origin[axis];
        x += d * camera.right[axis];
        y += d * camera.up[axis];
        z += d * camera.forward[axis];
      }
      EXPECT_GT(z, 0);
      EXPECT_LE(std::abs(y / z), camera.half_height);
      EXPECT_LE(std::abs(x / z), camera.half_height * extent.width / extent.height);
    }
  }
}

}  // namespace
}  // namespace raymill::client
