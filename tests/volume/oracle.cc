// raymill-volume-oracle: what OpenVDB and plain float64 sums say of a .vdb, to hold Raymill's answers against; and the
// files that the trial needs.
//
//   make KIND OUT.vdb [SIZE]               fog, sphere, torus, ball (level sets), empty, one-voxel, int, mixed
//   surface FILE.vdb RAYS.f32 OUT.f32      (t, normal) of LevelSetRayIntersector; t = inf: no hit
//   depth FILE.vdb RAYS.f32 OUT.f64 STEP   sum of trilinear samples in the middle of steps of at most STEP voxels
//   above FILE.vdb RAYS.f32 OUT.f64 STEP THRESHOLD   of such samples: (t in which they are above it, changes, step in
//   t) surface-of FOG.vdb OUT.vdb             the level set where a fog of 0 to 1 is a half
//
// Rays: 8 float32 each, org, tnear, dir, tfar. World space.
#include <openvdb/io/File.h>
#include <openvdb/math/Ray.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/Interpolation.h>
#include <openvdb/tools/LevelSetSphere.h>
#include <openvdb/tools/RayIntersector.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <limits>
#include <string>
#include <vector>

namespace {

using openvdb::Coord;
using openvdb::FloatGrid;
using openvdb::Vec3d;

struct Ray {
  float org[3], tnear, dir[3], tfar;
};
static_assert(sizeof(Ray) == 32);

std::vector<Ray> read_rays(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::vector<char> bytes((std::istreambuf_iterator<char>(file)), {});
  std::vector<Ray> rays(bytes.size() / sizeof(Ray));
  std::copy_n(bytes.begin(), rays.size() * sizeof(Ray), reinterpret_cast<char*>(rays.data()));
  return rays;
}

template <typename T>
void write_all(const std::string& path, const std::vector<T>& values) {
  std::ofstream file(path, std::ios::binary);
  file.write(reinterpret_cast<const char*>(values.data()), static_cast<std::streamsize>(values.size() * sizeof(T)));
  if (!file.flush()) {
    throw std::runtime_error("cannot write " + path);
  }
}

FloatGrid::Ptr read_float_grid(const std::string& path) {
  openvdb::io::File file(path);
  file.open();
  for (auto name = file.beginName(); name != file.endName(); ++name) {
    if (const auto grid = openvdb::gridPtrCast<FloatGrid>(file.readGrid(name.gridName()))) {
      return grid;
    }
  }
  throw std::runtime_error(path + " has no float grid");
}

// Waves of several lengths, 0 in a part of the space: what smoke looks like to a sampler.
FloatGrid::Ptr make_fog(int size) {
  const FloatGrid::Ptr grid = FloatGrid::create(0);
  grid->setName("density");
  grid->setGridClass(openvdb::GRID_FOG_VOLUME);
  grid->setTransform(openvdb::math::Transform::createLinearTransform(0.05));
  FloatGrid::Accessor values = grid->getAccessor();
  std::vector<double> wave_x(size), wave_y(size), wave_z(size);
  for (int i = 0; i < size; ++i) {
    wave_x[i] = std::sin(i * 0.11) + 0.5 * std::sin(i * 0.43);
    wave_y[i] = std::sin(i * 0.07 + 1) + 0.5 * std::sin(i * 0.37);
    wave_z[i] = std::sin(i * 0.05 + 2) + 0.5 * std::sin(i * 0.31);
  }
  for (int x = 0; x < size; ++x) {
    for (int y = 0; y < size; ++y) {
      for (int z = 0; z < size; ++z) {
        const double value = (wave_x[x] + wave_y[y] + wave_z[z] + 4.5) / 9;
        if (value > 0.1) {
          values.setValue(Coord(x - size / 2, y - size / 2, z - size / 2), static_cast<float>(value));
        }
      }
    }
  }
  return grid;
}

FloatGrid::Ptr make_torus(int size) {
  const double voxel = 2.0 / size, band = 3 * voxel;
  const FloatGrid::Ptr grid = FloatGrid::create(static_cast<float>(band));
  grid->setName("torus");
  grid->setGridClass(openvdb::GRID_LEVEL_SET);
  grid->setTransform(openvdb::math::Transform::createLinearTransform(voxel));
  FloatGrid::Accessor values = grid->getAccessor();
  for (int x = -size; x <= size; ++x) {
    for (int y = -size; y <= size; ++y) {
      for (int z = -size / 2; z <= size / 2; ++z) {
        const double ring = std::hypot(x * voxel, y * voxel) - 0.6;
        const double distance = std::hypot(ring, z * voxel) - 0.25;
        if (std::fabs(distance) < band) {
          values.setValue(Coord(x, y, z), static_cast<float>(distance));
        } else if (distance < 0) {
          values.setValueOff(Coord(x, y, z), static_cast<float>(-band));
        }
      }
    }
  }
  grid->pruneGrid();
  return grid;
}

// The level set of tests/extremes/volume_rows.cc, voxel by voxel.
FloatGrid::Ptr make_ball(int size) {
  const double voxel = 1.0 / size, band = 3 * voxel;
  const FloatGrid::Ptr grid = FloatGrid::create(static_cast<float>(band));
  grid->setName("ball");
  grid->setGridClass(openvdb::GRID_LEVEL_SET);
  grid->setTransform(openvdb::math::Transform::createLinearTransform(voxel));
  FloatGrid::Accessor values = grid->getAccessor();
  for (int x = 0; x <= size; ++x) {
    for (int y = 0; y <= size; ++y) {
      for (int z = 0; z <= size; ++z) {
        const double distance = std::sqrt(std::pow(x * voxel - 0.501, 2) + std::pow(y * voxel - 0.4993, 2) +
                                          std::pow(z * voxel - 0.5007, 2)) -
                                0.3;
        if (std::fabs(distance) < band) {
          values.setValue(Coord(x, y, z), static_cast<float>(distance));
        } else if (distance < 0) {
          values.setValueOff(Coord(x, y, z), static_cast<float>(-band));
        }
      }
    }
  }
  return grid;
}

void make(const std::string& kind, const std::string& path, int size) {
  openvdb::GridPtrVec grids;
  if (kind == "fog") {
    grids.push_back(make_fog(size));
  } else if (kind == "torus") {
    grids.push_back(make_torus(size));
  } else if (kind == "ball") {
    grids.push_back(make_ball(size));
  } else if (kind == "sphere") {
    grids.push_back(openvdb::tools::createLevelSetSphere<FloatGrid>(1, openvdb::Vec3f(0.1F, 0.2F, -0.3F), 2.0F / size));
    grids.back()->setName("sphere");
  } else if (kind == "empty") {
    grids.push_back(FloatGrid::create(0));
    grids.back()->setName("nothing");
  } else if (kind == "one-voxel") {
    const FloatGrid::Ptr grid = FloatGrid::create(0);
    grid->setName("one");
    grid->tree().setValue(Coord(3, -4, 5), 2);
    grids.push_back(grid);
  } else if (kind == "int" || kind == "mixed") {
    const openvdb::Int32Grid::Ptr grid = openvdb::Int32Grid::create(0);
    grid->setName("counts");
    grid->tree().setValue(Coord(0, 0, 0), 1);
    grids.push_back(grid);
    if (kind == "mixed") {
      grids.push_back(make_fog(20));
    }
  } else {
    throw std::runtime_error("no kind " + kind);
  }
  openvdb::io::File(path).write(grids);
}

void surface(const std::string& path, const std::string& rays_path, const std::string& out) {
  const FloatGrid::Ptr grid = read_float_grid(path);
  const openvdb::tools::LevelSetRayIntersector<FloatGrid> intersector(*grid);
  std::vector<float> answers;
  for (const Ray& ray : read_rays(rays_path)) {
    Vec3d dir(ray.dir[0], ray.dir[1], ray.dir[2]);
    const double length = dir.length();
    dir.normalize();  // it takes no other
    const openvdb::math::Ray<double> world(Vec3d(ray.org[0], ray.org[1], ray.org[2]), dir, ray.tnear * length,
                                           std::min(double(ray.tfar), 1e9) * length);
    Vec3d point, normal(0, 0, 0);
    double t = 0;
    const bool hit = intersector.intersectsWS(world, point, normal, t);
    answers.push_back(hit ? static_cast<float>(t / length) : std::numeric_limits<float>::infinity());
    for (int axis = 0; axis < 3; ++axis) {
      answers.push_back(static_cast<float>(normal[axis]));
    }
  }
  write_all(out, answers);
}

// A fog's values across three voxels to each side of its surface are distances from it.
void surface_of(const std::string& path, const std::string& out) {
  const FloatGrid::Ptr fog = read_float_grid(path);
  const float band = static_cast<float>(3 * fog->voxelSize()[0]);
  const FloatGrid::Ptr grid = FloatGrid::create(band / 2);
  grid->setName("surface");
  grid->setGridClass(openvdb::GRID_LEVEL_SET);
  grid->setTransform(fog->transform().copy());
  FloatGrid::Accessor values = grid->getAccessor();
  for (auto voxel = fog->cbeginValueOn(); voxel; ++voxel) {
    const float distance = (0.5F - *voxel) * band;
    if (voxel.isVoxelValue()) {
      values.setValue(voxel.getCoord(), distance);
    } else {
      grid->fill(voxel.getBoundingBox(), distance);
    }
  }
  openvdb::io::File(out).write({grid});
}

// Calls ray(direction's length) before, and sample(value, size of a step in t) at each step of each ray.
template <typename Begin, typename Sample>
void march(const std::string& path, const std::string& rays_path, double step, Begin&& ray_begins, Sample&& sample) {
  const FloatGrid::Ptr grid = read_float_grid(path);
  const auto values = grid->getConstAccessor();
  const openvdb::CoordBBox active = grid->evalActiveVoxelBoundingBox();
  for (const Ray& ray : read_rays(rays_path)) {
    const Vec3d org(ray.org[0], ray.org[1], ray.org[2]), dir(ray.dir[0], ray.dir[1], ray.dir[2]);
    const Vec3d o = grid->worldToIndex(org), d = grid->worldToIndex(org + dir) - o;
    double begin = ray.tnear, end = ray.tfar;
    for (int axis = 0; axis < 3; ++axis) {
      const double a = (active.min()[axis] - 1 - o[axis]) / d[axis], b = (active.max()[axis] + 1 - o[axis]) / d[axis];
      begin = std::max(begin, std::min(a, b));
      end = std::min(end, std::max(a, b));
    }
    ray_begins(dir.length());
    if (begin < end) {
      const double steps = std::ceil((end - begin) * d.length() / step), size = (end - begin) / steps;
      for (double i = 0; i < steps; ++i) {
        // In float64 where OpenVDB's own sampler is of float32.
        const Vec3d p = o + d * (begin + (i + 0.5) * size);
        const Coord cell = Coord::floor(p);
        double value = 0;
        for (int corner = 0; corner < 8; ++corner) {
          double weight = values.getValue(cell.offsetBy(corner & 1, corner >> 1 & 1, corner >> 2));
          for (int axis = 0; axis < 3; ++axis) {
            const double part = p[axis] - cell[axis];
            weight *= (corner >> axis & 1) != 0 ? part : 1 - part;
          }
          value += weight;
        }
        sample(value, size);
      }
    }
  }
}

void depth(const std::string& path, const std::string& rays_path, const std::string& out, double step) {
  std::vector<double> answers;
  double length = 1;
  march(
      path, rays_path, step,
      [&](double dir_length) {
        length = dir_length;
        answers.push_back(0);
      },
      [&](double value, double size) { answers.back() += value * size * length; });
  write_all(out, answers);
}

void above(const std::string& path, const std::string& rays_path, const std::string& out, double step,
           double threshold) {
  struct Answer {
    double t, changes, step;
  };
  std::vector<Answer> answers;
  bool was_above = false;
  march(
      path, rays_path, step,
      [&](double) {
        was_above = false;
        answers.push_back({0, 0, 0});
      },
      [&](double value, double size) {
        Answer& answer = answers.back();
        const bool is_above = value > threshold;
        answer.t += is_above ? size : 0;
        answer.changes += is_above != was_above ? 1 : 0;
        answer.step = size;
        was_above = is_above;
      });
  write_all(out, answers);
}

}  // namespace

int main(int count, char** words) {
  const std::vector<std::string> word(words + 1, words + count);
  try {
    openvdb::initialize();
    if (word.size() >= 3 && word[0] == "make") {
      make(word[1], word[2], word.size() > 3 ? std::atoi(word[3].c_str()) : 64);
    } else if (word.size() == 4 && word[0] == "surface") {
      surface(word[1], word[2], word[3]);
    } else if (word.size() == 3 && word[0] == "surface-of") {
      surface_of(word[1], word[2]);
    } else if (word.size() == 6 && word[0] == "above") {
      above(word[1], word[2], word[3], std::atof(word[4].c_str()), std::atof(word[5].c_str()));
    } else if (word.size() == 5 && word[0] == "depth") {
      depth(word[1], word[2], word[3], std::atof(word[4].c_str()));
    } else {
      std::fprintf(
          stderr,
          "make KIND OUT [SIZE] | surface FILE RAYS OUT | depth FILE RAYS OUT STEP | above ... | surface-of ...\n");
      return 2;
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}
