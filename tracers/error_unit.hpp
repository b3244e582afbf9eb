// The one place where rounding is turned into tolerances (rules 3, 9 and 12 of the hit rule).
//
// Nothing else in the tracers compares against a small number: every tolerance is a multiple of
// E = u·(|o| + size), so that a scene scaled by a power of two gives bit-identical answers.
#pragma once
#include <algorithm>
#include <cmath>
#include <limits>

#include "vec.hpp"

namespace csg {

/// u of Real: half an ulp of 1.
template <class Real>
inline constexpr Real kUnitRoundoff = std::numeric_limits<Real>::epsilon() / 2;

/// Crossings of planes that are the same in the source differ by at most 3 to 4 E (measured); the
/// band is four times as wide.
inline constexpr double kBandInE = 16;

/// A band is widened by 1/cos θ where the surface is grazed, and no further than this.
inline constexpr double kMinCosine = 0x1p-10;

/// P = size·2⁻³⁰: classes of cells and S-boxes hold for boxes that are this much larger.
inline constexpr int kPadExponent = -30;

/// A transform may spoil a crossing by its condition number; P covers E times this much.
inline constexpr double kConditionCovered = 0x1p12;

/// A line is taken to miss a ball only if it does by this much, relative to the ball and to the
/// distance of the ray's origin, in squares: 64 u, where rounding costs less than 16.
inline constexpr double kBallMargin = 0x1p-47;

/// Farthest origin, in sizes, for which 4·bb_max + the kernel's error ≤ P. Rays from farther are
/// moved to where they enter the world, once, before any scheme sees them.
inline constexpr double kFarthestOrigin = 32;

/// Directions are taken as parallel to an axis if they drift from it by less than this in the
/// time that they move by 1 along another: 2⁻⁹⁰ of any reachable path is far below P.
inline constexpr double kParallel = 0x1p-90;

/// Tie band of a ray, in units of its parameter t.
inline double tie_band(const Vec3& origin, double dir_length, double size) {
  return kBandInE * kUnitRoundoff<double> * (length(origin) + size) / dir_length;
}

/// The band at a surface whose normal is at an angle with this |cosine| to the ray.
inline double tie_band_at(double band, double cosine) { return band / std::max(std::fabs(cosine), kMinCosine); }

/// How far off the surface a shadow ray starts, in model units: 16·band·|d|.
inline double shadow_offset(double band, double dir_length) { return 16 * band * dir_length; }

}  // namespace csg
