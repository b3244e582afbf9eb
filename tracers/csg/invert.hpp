// The inverse of a linear map together with its condition, free of over- and underflow.
#pragma once
#include "../vec.hpp"

namespace csg {

/// Transforms with a larger condition are refused as singular: six printed digits cannot mean them.
inline constexpr double kMaxCondition = 1e15;

struct Inverse {
  Mat3 matrix;
  double condition = kInfinity;  ///< ‖M‖·‖M⁻¹‖/3 in the Frobenius norm: 1 for a similarity
  double scale = 1;              ///< a power of two near the largest entry

  bool usable() const { return condition <= kMaxCondition; }  // false for NaN, too
};

inline Mat3 scaled_by_power_of_two(const Mat3& m, int exponent) {
  Mat3 result;
  for (int c = 0; c < 3; ++c) {
    for (int r = 0; r < 3; ++r) result.col[c][r] = std::ldexp(m.col[c][r], exponent);
  }
  return result;
}

/// Works on M scaled to entries near 1, so that maps of any magnitude are judged by shape alone.
inline Inverse invert(const Mat3& m) {
  double largest = 0;
  for (const Vec3& column : m.col) {
    for (int r = 0; r < 3; ++r) largest = std::max(largest, std::abs(column[r]));
  }
  if (!(largest > 0 && largest < kInfinity)) return {};
  const int exponent = std::ilogb(largest);
  const Mat3 near_one = scaled_by_power_of_two(m, -exponent);
  if (!(std::abs(determinant(near_one)) > 0)) return {};
  const Mat3 result = inverse(near_one);
  return {scaled_by_power_of_two(result, -exponent), frobenius(near_one) * frobenius(result) / 3,
          std::ldexp(1.0, exponent)};
}

}  // namespace csg
