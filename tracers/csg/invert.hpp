// The inverse of a linear map, its condition and its largest stretch, free of over- and underflow.
#pragma once
#include "../vec.hpp"

namespace csg {

/// Transforms with a larger condition are refused as singular: six printed digits cannot mean them.
inline constexpr double kMaxCondition = 1e15;

struct Inverse {
  Mat3 matrix;
  double condition = kInfinity;  ///< ‖M‖·‖M⁻¹‖/3 in the Frobenius norm: 1 for a similarity

  bool usable() const { return condition <= kMaxCondition; }  // false for NaN, too
};

inline Mat3 scaled_by_power_of_two(const Mat3& m, int exponent) {
  Mat3 result;
  for (int c = 0; c < 3; ++c) {
    for (int r = 0; r < 3; ++r) result.col[c][r] = std::ldexp(m.col[c][r], exponent);
  }
  return result;
}

inline double largest_entry(const Mat3& m) {
  double largest = 0;
  for (const Vec3& column : m.col) {
    for (int r = 0; r < 3; ++r) largest = std::max(largest, std::abs(column[r]));
  }
  return largest;
}

/// M⁻¹ by elimination with complete pivoting, column by column: M·M⁻¹ − 1 is of the order of
/// u·condition, which the pads count on; cofactors lose u·‖M‖³/|det M|. In long double, so that of a map of
/// condition near 1 the inverse is the nearest there is.
inline Mat3 eliminated(const Mat3& m) {
  long double a[3][6];  // M | 1
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) a[r][c] = m.col[c][r], a[r][c + 3] = r == c;
  int unknown[3] = {0, 1, 2};  // which one stands in a column
  for (int k = 0; k < 3; ++k) {
    int row = k, column = k;
    for (int r = k; r < 3; ++r)
      for (int c = k; c < 3; ++c)
        if (std::fabs(a[r][c]) > std::fabs(a[row][column])) row = r, column = c;
    for (int c = 0; c < 6; ++c) std::swap(a[k][c], a[row][c]);
    for (int r = 0; r < 3; ++r) std::swap(a[r][k], a[r][column]);
    std::swap(unknown[k], unknown[column]);
    for (int r = k + 1; r < 3; ++r) {
      const long double factor = a[r][k] / a[k][k];
      for (int c = k; c < 6; ++c) a[r][c] -= factor * a[k][c];
    }
  }
  Mat3 inverse;
  for (int c = 0; c < 3; ++c) {
    long double column[3];
    for (int r = 2; r >= 0; --r) {
      column[r] = a[r][c + 3];
      for (int i = r + 1; i < 3; ++i) column[r] -= a[r][i] * column[i];
      column[r] /= a[r][r];
      inverse.col[c][unknown[r]] = static_cast<double>(column[r]);
    }
  }
  return inverse;
}

inline bool is_identity(const Mat3& m) {
  for (int c = 0; c < 3; ++c) {
    for (int r = 0; r < 3; ++r) {
      if (m.col[c][r] != (c == r ? 1.0 : 0.0)) return false;
    }
  }
  return true;
}

/// Works on M scaled to entries near 1, so that maps of any magnitude are judged by shape alone.
inline Inverse invert(const Mat3& m) {
  if (is_identity(m)) return {Mat3{}, frobenius(m) * frobenius(m) / 3};  // most maps are translations
  const double largest = largest_entry(m);
  if (!(largest > 0 && largest < kInfinity)) return {};
  const int exponent = std::ilogb(largest);
  const Mat3 near_one = scaled_by_power_of_two(m, -exponent);
  const Mat3 result = eliminated(near_one);
  return {scaled_by_power_of_two(result, -exponent), frobenius(near_one) * frobenius(result) / 3};
}

/// An upper bound of the largest stretch, tight for similarities: ‖MᵀM‖₂ ≤ ‖MᵀM‖₁, of M scaled to
/// entries near 1. Precondition: M is finite and not zero.
inline double largest_stretch(const Mat3& m) {
  const int exponent = std::ilogb(largest_entry(m));
  const Mat3 near_one = scaled_by_power_of_two(m, -exponent);
  double most = 0;
  for (const Vec3& column : near_one.col) {
    const Vec3 products = transposed_times(near_one, column);
    most = std::max(most, std::fabs(products.x) + std::fabs(products.y) + std::fabs(products.z));
  }
  return std::ldexp(std::sqrt(most), exponent);
}

}  // namespace csg
