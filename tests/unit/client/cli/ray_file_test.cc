#include "client/cli/ray_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <set>
#include <vector>

#include "client/cli/npy.h"
#include "tests/unit/client/cli/folder.h"

namespace raymill::client {
namespace {

template <typename T>
std::string rows_of(const std::string& descr, std::uint64_t rows, unsigned columns) {
  std::string text = npy_header(descr, rows, columns);
  for (std::uint64_t i = 0; i < rows * columns; ++i) {
    const T value = static_cast<T>(i) + static_cast<T>(0.25);
    text.append(reinterpret_cast<const char*>(&value), sizeof value);
  }
  return text;
}

class RayFileTest : public FolderTest {
 protected:
  void expect_refused(const std::string& bytes, const std::string& reason) {
    write("bad.npy", bytes);
    const auto reader = RayFileReader::open(path("bad.npy"));
    ASSERT_FALSE(reader);
    EXPECT_EQ(reader.status().code(), ErrorCode::bad_rays);
    EXPECT_NE(reader.status().message().find("bad.npy"), std::string::npos) << reader.status().message();
    EXPECT_NE(reader.status().message().find(reason), std::string::npos) << reader.status().message();
  }
};

TEST_F(RayFileTest, SixColumnsAreOriginAndDirection) {
  write("rays.npy", rows_of<float>("'<f4'", 3, 6));
  auto reader = RayFileReader::open(path("rays.npy"));
  ASSERT_TRUE(reader) << reader.status().message();
  EXPECT_EQ(reader->count(), 3U);
  std::vector<Ray> rays(10);
  const auto count = reader->read(rays);
  ASSERT_TRUE(count);
  ASSERT_EQ(*count, 3U);
  EXPECT_EQ(rays[1].org, (std::array<float, 3>{6.25F, 7.25F, 8.25F}));
  EXPECT_EQ(rays[1].dir, (std::array<float, 3>{9.25F, 10.25F, 11.25F}));
  EXPECT_EQ(rays[1].tnear, 0);
  EXPECT_TRUE(std::isinf(rays[1].tfar));
  EXPECT_EQ(*reader->read(rays), 0U);
}

TEST_F(RayFileTest, EightColumnsHoldTheInterval) {
  write("rays.npy", rows_of<double>("'<f8'", 20000, 8));
  auto reader = RayFileReader::open(path("rays.npy"));
  ASSERT_TRUE(reader) << reader.status().message();
  std::vector<Ray> rays(3000);
  std::uint64_t total = 0;
  while (true) {
    const auto count = reader->read(rays);
    ASSERT_TRUE(count);
    if (*count == 0) {
      break;
    }
    for (std::size_t i = 0; i < *count; ++i) {
      const auto first = static_cast<float>(static_cast<double>((total + i) * 8) + 0.25);
      ASSERT_EQ(rays[i].org[0], first);
      ASSERT_EQ(rays[i].tnear, static_cast<float>(static_cast<double>((total + i) * 8 + 3) + 0.25));
      ASSERT_EQ(rays[i].tfar, static_cast<float>(static_cast<double>((total + i) * 8 + 7) + 0.25));
    }
    total += *count;
  }
  EXPECT_EQ(total, 20000U);
}

// ray_rounding.h says why.
TEST_F(RayFileTest, WideRaysAreRoundedIntoTheirInterval) {
  const double row[8] = {0.1, 0.2, 0.3, 0.7, 0, 0, 0.1, 0.7000009};
  std::string file = npy_header("'<f8'", 1, 8);
  file.append(reinterpret_cast<const char*>(row), sizeof row);
  write("rays.npy", file);
  auto reader = RayFileReader::open(path("rays.npy"));
  ASSERT_TRUE(reader) << reader.status().message();
  Ray ray;
  ASSERT_EQ(*reader->read(std::span(&ray, 1)), 1U);
  EXPECT_EQ(ray.org, (std::array<float, 3>{0.1F, 0.2F, 0.3F}));
  EXPECT_EQ(ray.dir[2], 0.1F);
  EXPECT_GE(double(ray.tnear), 0.7);
  EXPECT_LE(double(ray.tfar), 0.7000009);
  EXPECT_LT(ray.tnear, ray.tfar);
}

TEST_F(RayFileTest, WideRaysOfSixColumnsGoOn) {
  write("rays.npy", rows_of<double>("'<f8'", 2, 6));
  auto reader = RayFileReader::open(path("rays.npy"));
  ASSERT_TRUE(reader) << reader.status().message();
  std::vector<Ray> rays(2);
  ASSERT_EQ(*reader->read(rays), 2U);
  EXPECT_EQ(rays[1].org, (std::array<float, 3>{6.25F, 7.25F, 8.25F}));
  EXPECT_EQ(rays[1].dir, (std::array<float, 3>{9.25F, 10.25F, 11.25F}));
  EXPECT_EQ(rays[1].tnear, 0);
  EXPECT_TRUE(std::isinf(rays[1].tfar));
}

TEST_F(RayFileTest, RefusesWhatAreNoRays) {
  expect_refused("plain text", "not a .npy file");
  expect_refused(rows_of<float>("'<f4'", 3, 7), "(3, 7)");
  expect_refused(rows_of<float>("'<f4'", 18, 0), "(18,)");
  expect_refused(rows_of<float>("'>f4'", 3, 6), ">f4");
  expect_refused(rows_of<float>("'<i4'", 3, 6), "<i4");
  expect_refused(rows_of<float>("[('t', '<f4')]", 3, 6), "[('t', '<f4')]");
  std::string fortran = rows_of<float>("'<f4'", 3, 6);
  fortran.replace(fortran.find("False"), 5, "True ");
  expect_refused(fortran, "Fortran");
}

TEST_F(RayFileTest, LengthMustMatchTheHeader) {
  const std::string good = rows_of<float>("'<f4'", 3, 6);
  expect_refused(good.substr(0, good.size() - 1), "promises 3 rays");
  expect_refused(good + "x", "promises 3 rays");
  expect_refused(npy_header("'<f4'", ~std::uint64_t{0}, 6), "promises");
  expect_refused(npy_header("'<f8'", std::uint64_t{1} << 60, 8), "promises");
  EXPECT_EQ(RayFileReader::open(path("missing.npy")).status().code(), ErrorCode::not_found);
  EXPECT_EQ(RayFileReader::open(folder_).status().code(), ErrorCode::bad_rays);
}

TEST_F(RayFileTest, EmptyFileOfRaysIsFine) {
  write("rays.npy", npy_header("'<f4'", 0, 6));
  auto reader = RayFileReader::open(path("rays.npy"));
  ASSERT_TRUE(reader);
  std::vector<Ray> rays(1);
  EXPECT_EQ(*reader->read(rays), 0U);
}

std::vector<Ray> numbered_rays(std::uint64_t count) {
  std::vector<Ray> rays(count);
  for (std::uint64_t i = 0; i < count; ++i) {
    rays[i].org[0] = static_cast<float>(i);
    rays[i].dir[2] = 1;
  }
  return rays;
}

TEST_F(RayFileTest, WriterKeepsTheOrder) {
  const auto rays = numbered_rays(5000);
  auto writer = RayFileWriter::create(path("rays.npy"), rays.size(), nullptr);
  ASSERT_TRUE(writer);
  ASSERT_TRUE(writer->append(std::span(rays).first(1234)).ok());
  ASSERT_TRUE(writer->append(std::span(rays).subspan(1234)).ok());
  EXPECT_EQ(writer->missing(), 0U);
  ASSERT_TRUE(writer->commit().ok());
  auto reader = RayFileReader::open(path("rays.npy"));
  ASSERT_TRUE(reader) << reader.status().message();
  std::vector<Ray> back(rays.size());
  ASSERT_EQ(*reader->read(back), rays.size());
  EXPECT_EQ(std::memcmp(back.data(), rays.data(), rays.size() * sizeof(Ray)), 0);
}

// In world space, where float32 has steps of half a metre; what is read back about the origin is what was written.
TEST_F(RayFileTest, RaysAboutAnOriginAreWrittenInFloat64) {
  const std::array<double, 3> origin = {4500000, -3200000, 0};
  auto rays = numbered_rays(3000);
  for (Ray& ray : rays) {
    ray.org[1] = ray.org[0] / 1024;
  }
  const std::uint64_t seed = 9;
  for (const std::uint64_t* shuffle : {static_cast<const std::uint64_t*>(nullptr), &seed}) {
    auto writer = RayFileWriter::create(path("rays.npy"), rays.size(), shuffle);
    ASSERT_TRUE(writer && writer->set_origin(origin).ok());
    ASSERT_TRUE(writer->append(rays).ok());
    ASSERT_TRUE(writer->commit().ok());
    auto reader = RayFileReader::open(path("rays.npy"));
    ASSERT_TRUE(reader) << reader.status().message();
    EXPECT_TRUE(reader->is_wide());
    std::vector<Ray> back(rays.size());
    ASSERT_EQ(*reader->read(back), rays.size());
    EXPECT_GT(back[0].org[0], 4499999.0F) << "in the world";
    reader->rewind();
    reader->set_origin(origin);
    ASSERT_EQ(*reader->read(back), rays.size());
    std::sort(back.begin(), back.end(), [](const Ray& a, const Ray& b) { return a.org[0] < b.org[0]; });
    EXPECT_EQ(std::memcmp(back.data(), rays.data(), rays.size() * sizeof(Ray)), 0);
  }
}

TEST_F(RayFileTest, Float32RaysAreMovedToTheOriginToo) {
  write("rays.npy", rows_of<float>("'<f4'", 1, 6));
  auto reader = RayFileReader::open(path("rays.npy"));
  ASSERT_TRUE(reader);
  EXPECT_FALSE(reader->is_wide());
  reader->set_origin({0.25, 1, -1});
  std::vector<Ray> rays(1);
  ASSERT_EQ(*reader->read(rays), 1U);
  EXPECT_EQ(rays[0].org, (std::array<float, 3>{0, 0.25F, 3.25F}));
  EXPECT_EQ(rays[0].dir, (std::array<float, 3>{3.25F, 4.25F, 5.25F}));
}

TEST_F(RayFileTest, ShuffledWriterKeepsEveryRay) {
  const auto rays = numbered_rays(1001);
  const std::uint64_t seed = 9;
  auto writer = RayFileWriter::create(path("rays.npy"), rays.size(), &seed);
  ASSERT_TRUE(writer);
  ASSERT_TRUE(writer->append(rays).ok());
  ASSERT_TRUE(writer->commit().ok());
  auto reader = RayFileReader::open(path("rays.npy"));
  ASSERT_TRUE(reader) << reader.status().message();
  std::vector<Ray> back(rays.size());
  ASSERT_EQ(*reader->read(back), rays.size());
  std::set<float> seen;
  std::size_t in_place = 0;
  for (std::size_t i = 0; i < back.size(); ++i) {
    seen.insert(back[i].org[0]);
    in_place += back[i].org[0] == static_cast<float>(i) ? 1 : 0;
  }
  EXPECT_EQ(seen.size(), rays.size());
  EXPECT_LT(in_place, 20U);
}

TEST_F(RayFileTest, NothingIsLeftOfAnUnfinishedFile) {
  {
    auto writer = RayFileWriter::create(path("rays.npy"), 10, nullptr);
    ASSERT_TRUE(writer);
    ASSERT_TRUE(writer->append(numbered_rays(5)).ok());
  }
  EXPECT_EQ(files(), 0U);
}

}  // namespace
}  // namespace raymill::client
