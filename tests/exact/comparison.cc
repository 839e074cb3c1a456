#include "tests/exact/comparison.h"

#include <algorithm>
#include <limits>
#include <numeric>

#include "tests/exact/rational_oracle.h"
#include "tests/support/kernel_harness.h"
#include "tests/support/rays.h"
#include "traversal/exact_triangle.h"

namespace raymill::tests {
namespace {

using traversal::ExactCorners;

ExactCorners exact_corners(const Triangle& triangle) {
  ExactCorners corners;
  for (std::size_t k = 0; k < 3; ++k) {
    corners[k] = {triangle.v[k].x, triangle.v[k].y, triangle.v[k].z};
  }
  return corners;
}

// Brute force by the triangle test alone, in an order that is drawn.
Hit closest_by_test(Random& random, const std::vector<Triangle>& triangles, const Ray& ray) {
  std::vector<std::size_t> order(triangles.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  for (std::size_t i = order.size(); i > 1; --i) {
    std::swap(order[i - 1], order[random.below(static_cast<std::uint32_t>(i))]);
  }
  const traversal::ExactRay line{ray.org, ray.dir};
  float tfar = std::min(ray.tfar, std::numeric_limits<float>::max());
  const Triangle* best = nullptr;
  Hit hit;
  for (const std::size_t i : order) {
    const Triangle& triangle = triangles[i];
    traversal::ExactHit next;
    if (!traversal::exact_hit(line, exact_corners(triangle), {ray.tnear, tfar, best != nullptr}, next)) {
      continue;
    }
    if (best != nullptr && next.t == tfar) {
      const int later = traversal::exact_order(line, exact_corners(triangle), exact_corners(*best));
      const bool ids_later = triangle.geometry_id > best->geometry_id ||
                             (triangle.geometry_id == best->geometry_id && triangle.primitive_id > best->primitive_id);
      if (later > 0 || (later == 0 && ids_later)) {
        continue;
      }
    }
    best = &triangle;
    tfar = next.t;
    hit = {next.t, static_cast<float>(next.u), static_cast<float>(next.v), triangle.primitive_id, triangle.geometry_id};
    hit.v = std::min(hit.v, 1 - hit.u);
  }
  return hit;
}

class Comparison {
 public:
  Comparison(Random& random, Adversary adversary)
      : random_(random), scene_(adversarial_scene(random, adversary)), triangles_(triangles_of(scene_)) {}

  void draw_rays(Adversary adversary, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) {
      Ray r = adversarial_ray(random_, scene_, adversary);
      Hit oracle = rational_closest(triangles_, r);
      if (oracle.primitive_id != kNoId && random_.below(2) == 0) {
        r = at_the_end(random_, r, oracle.t);
        oracle = rational_closest(triangles_, r);
      }
      rays_.push_back(r);
      oracle_.push_back(oracle);
      result_.hits += oracle.primitive_id != kNoId ? 1 : 0;
    }
    result_.rays = rays_.size();
  }

  void test_alone() {
    for (std::size_t i = 0; i < rays_.size(); ++i) {
      judge(i, closest_by_test(random_, triangles_, rays_[i]), "the triangle test");
    }
  }
  void kernels() {
    const unsigned width = random_.below(2) == 0 ? 4 : 8;
    const LoadedPages pages = load_pages(build_pages(scene_, width));
    for (const traversal::Isa isa : traversal::runnable_isas()) {
      const std::string name = std::string(to_string(isa)) + ", width " + std::to_string(width);
      KernelRun run{.isa = isa, .mode = Mode::exact, .batch_rays = 100};
      const auto closest = run_kernel(pages, rays_, run).hits;
      run.query = Query::any;
      const auto any = run_kernel(pages, rays_, run).hits;
      for (std::size_t i = 0; i < rays_.size(); ++i) {
        judge(i, closest[i], name);
        if ((any[i].t == 0) != (oracle_[i].primitive_id != kNoId)) {
          differ(i, any[i], name + ", any hit");
        }
      }
    }
  }
  [[nodiscard]] const Compared& result() const { return result_; }

 private:
  void judge(std::size_t i, const Hit& hit, const std::string& who) {
    if (!agrees(hit, oracle_[i])) {
      differ(i, hit, who);
    }
  }
  void differ(std::size_t i, const Hit& hit, const std::string& who) {
    if (result_.differences++ == 0) {
      result_.first =
          who + ": " + text_of(rays_[i]) + "\n  gave   " + text_of(hit) + "\n  oracle " + text_of(oracle_[i]);
    }
  }

  Random& random_;
  const Scene scene_;
  const std::vector<Triangle> triangles_;
  std::vector<Ray> rays_;
  std::vector<Hit> oracle_;
  Compared result_;
};

}  // namespace

Compared compare_adversary(Random& random, Adversary adversary, std::size_t ray_count) {
  Comparison comparison(random, adversary);
  comparison.draw_rays(adversary, ray_count);
  comparison.test_alone();
  comparison.kernels();
  return comparison.result();
}

}  // namespace raymill::tests
