#include "traversal/crossing.h"

#include "traversal/expansion.h"

namespace raymill::traversal {
namespace {

Expansion<2> exact_product(double a, double b) {
  const ExactPair pair = two_product(a, b);
  Expansion<2> product;
  product.push(pair.low);
  product.push(pair.high);
  return product;
}

// The sign of the edge function px qy - py qx, and its value within a rounding. Where it is zero, its sign after the
// origin has moved by a step along x that is less than any number, and by one along y that is less than any fraction of
// that: for a step along x it changes by py - qy times the step, for one along y by qx - px times it. Zero only where p
// is q. Products are multiples of 2^-956 below 2^262, so nothing underflows or overflows.
int side_of_origin(const AcrossRay& corners, unsigned p, unsigned q, double& edge) {
  const double px = corners.x[p], py = corners.y[p], qx = corners.x[q], qy = corners.y[q];
  const auto exact = exact_product(px, qy) - exact_product(py, qx);
  edge = exact.estimate();
  if (exact.sign() != 0) {
    return exact.sign();
  }
  if (py != qy) {
    return py > qy ? 1 : -1;
  }
  return qx > px ? 1 : qx < px ? -1 : 0;
}

}  // namespace

bool owns_crossing(const AcrossRay& corners, EdgeFunctions& edges) {
  const int of_u = side_of_origin(corners, 2, 1, edges.u);
  const int of_v = side_of_origin(corners, 0, 2, edges.v);
  const int of_w = side_of_origin(corners, 1, 0, edges.w);
  return of_u != 0 && of_u == of_v && of_v == of_w;
}

}  // namespace raymill::traversal
