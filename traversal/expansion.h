// Expansion: a number that stands exactly as a sum of float64 parts. Immutable values but for push().
//
// Shewchuk 1997, "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates" (Discrete &
// Computational Geometry 18); each function names its theorem or figure. Parts rise in magnitude and are strongly
// nonoverlapping (his section 2.4), which round-to-even keeps through every operation here; zeros are left out, so a
// small number is short, whatever its type has room for. Where we differ: two_product takes the machine's fused
// multiply-add, rounded once by definition, in place of Dekker's splitting; the type's capacity counts the most parts
// that its operations can make, so nothing can run over.
//
// Needs rounding to nearest with denormals kept (IeeeScope), and exact products: no part may underflow. The callers'
// parts are multiples of 2^-894 below 2^781: exact_triangle.cc shows it.
#pragma once

#include <array>
#include <cassert>
#include <cmath>

namespace raymill::traversal {

/// high + low is the exact result, high the rounded one.
struct ExactPair {
  double high, low;
};

/// Theorem 7 (Knuth).
inline ExactPair two_sum(double a, double b) {
  const double high = a + b, b_virtual = high - a, a_virtual = high - b_virtual;
  return {high, (a - a_virtual) + (b - b_virtual)};
}

inline ExactPair two_product(double a, double b) {
  const double high = a * b;
  return {high, std::fma(a, b, -high)};
}

template <int kMost>
class Expansion {
 public:
  Expansion() = default;

  /// The next larger part; zero is none.
  void push(double part) {
    if (part != 0) {
      assert(size_ < kMost);
      parts_[static_cast<unsigned>(size_++)] = part;
    }
  }

  [[nodiscard]] int size() const { return size_; }
  double operator[](int i) const { return parts_[static_cast<unsigned>(i)]; }
  [[nodiscard]] int sign() const { return size_ == 0 ? 0 : (*this)[size_ - 1] > 0 ? 1 : -1; }
  /// Off by less than a rounding of the largest part.
  [[nodiscard]] double estimate() const {
    double sum = 0;
    for (int i = 0; i < size_; ++i) {
      sum += (*this)[i];
    }
    return sum;
  }

 private:
  std::array<double, kMost> parts_;
  int size_ = 0;
};

template <int kMost>
Expansion<kMost> operator-(const Expansion<kMost>& e) {
  Expansion<kMost> negative;
  for (int i = 0; i < e.size(); ++i) {
    negative.push(-e[i]);
  }
  return negative;
}

/// a - b; float32 is exact in float64.
inline Expansion<2> exact_difference(float a, float b) {
  const ExactPair pair = two_sum(double(a), -double(b));
  Expansion<2> difference;
  difference.push(pair.low);
  difference.push(pair.high);
  return difference;
}

/// FAST-EXPANSION-SUM (theorem 13), with room for kMost parts: at most those of e and f together.
template <int kMost, int M, int N>
Expansion<kMost> merged_sum(const Expansion<M>& e, const Expansion<N>& f) {
  Expansion<kMost> sum;
  double q = 0;
  for (int i = 0, j = 0; i < e.size() || j < f.size();) {
    const bool of_e = j == f.size() || (i < e.size() && std::fabs(e[i]) < std::fabs(f[j]));
    const ExactPair next = two_sum(q, of_e ? e[i++] : f[j++]);
    sum.push(next.low);
    q = next.high;
  }
  sum.push(q);
  return sum;
}

template <int M, int N>
Expansion<M + N> operator+(const Expansion<M>& e, const Expansion<N>& f) {
  return merged_sum<M + N>(e, f);
}
template <int M, int N>
Expansion<M + N> operator-(const Expansion<M>& e, const Expansion<N>& f) {
  return merged_sum<M + N>(e, -f);
}

/// SCALE-EXPANSION (theorem 19).
template <int M>
Expansion<2 * M> operator*(const Expansion<M>& e, double b) {
  Expansion<2 * M> product;
  double q = 0;
  for (int i = 0; i < e.size(); ++i) {
    const ExactPair term = two_product(e[i], b);
    const ExactPair low = two_sum(q, term.low);
    product.push(low.low);
    const ExactPair high = two_sum(term.high, low.high);
    product.push(high.low);
    q = high.high;
  }
  product.push(q);
  return product;
}

template <int M, int N>
Expansion<2 * M * N> operator*(const Expansion<M>& e, const Expansion<N>& f) {
  Expansion<2 * M * N> product;
  for (int i = 0; i < f.size(); ++i) {
    product = merged_sum<2 * M * N>(product, e * f[i]);
  }
  return product;
}

/// COMPRESS (theorem 23): the same number in as few parts as it needs, the largest of them within an ulp of it. After
/// the walk down each part is at most an ulp of the next, 52 bits less, so a number that is a multiple of 2^a below 2^b
/// has at most (b - a) / 52 + 1 parts; the walk up makes no more.
template <int kMost, int M>
Expansion<kMost> compressed(const Expansion<M>& e) {
  Expansion<M> down;  // largest first
  double q = 0;
  for (int i = e.size() - 1; i >= 0; --i) {
    const ExactPair sum = two_sum(q, e[i]);
    if (sum.low != 0) {
      down.push(sum.high);
      q = sum.low;
    } else {
      q = sum.high;
    }
  }
  Expansion<kMost> up;
  for (int i = down.size() - 1; i >= 0; --i) {
    const ExactPair sum = two_sum(down[i], q);
    up.push(sum.low);
    q = sum.high;
  }
  up.push(q);
  return up;
}

}  // namespace raymill::traversal
