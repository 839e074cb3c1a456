// Volumes from formulas, without OpenVDB: as images in memory for a kernel, and as files whose reader is a script that
// prints what raymill-vdb would.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "storage/base/aligned.h"
#include "storage/base/volume.h"
#include "storage/volume/affine.h"
#include "storage/volume/volume_page.h"
#include "tests/support/temp_folder.h"
#include "traversal/query.h"

namespace raymill::tests {

struct TestVolume {
  storage::GridInfo grid;
  std::function<float(int x, int y, int z)> value;  ///< at a point of index space
};

/// Waves in a cube of so many cells, 0 in a part of it and around it; turned, stretched and moved in the world.
TestVolume wavy_fog(int cells);
/// A ball around `centre` of the cube of so many cells of 1 / cells; distances beyond three cells are cut off.
TestVolume ball(int cells, const storage::Point3& centre, double radius);

/// Calls use(origin, values) for each brick of the volume in tree order.
void for_each_brick(const TestVolume& volume,
                    const std::function<Status(const storage::Index3&, const std::vector<float>&)>& use);

struct BuiltVolume {
  storage::Volume volume;
  std::vector<storage::PageBuffer> pages;  ///< [page]
};
BuiltVolume build_volume(const TestVolume& volume, std::uint32_t page_bytes, std::optional<std::int32_t> step_exponent);

/// Writes FOLDER/name and what its reader prints, and makes that reader the one that imports use from now on.
/// `cut_bytes`: so many are left away at the end of the bricks.
std::string write_volume_file(const TempFolder& folder, const std::string& name, const TestVolume& volume,
                              std::size_t cut_bytes = 0);

/// Where the ray is in the box of the volume's cells, cut to its own interval; empty: begin >= end.
struct Way {
  double begin = 0, end = 0;
};
Way way_through(const TestVolume& volume, const Ray& ray);
/// The trilinear field at t of the ray.
double field_at(const TestVolume& volume, const Ray& ray, double t);
/// The integral of the field over world length by so many equal steps.
double dense_depth(const TestVolume& volume, const Ray& ray, int steps);

/// Rays from around the volume through it; some parallel to axes of its index space, some with an interval.
std::vector<Ray> rays_through(const TestVolume& volume, std::size_t count, unsigned seed);

}  // namespace raymill::tests
