// The one place where rounding is turned into tolerances (rules 3, 9 and 12 of the hit rule), and the
// knobs by which the accuracy study turns it off.
//
// Nothing else in the tracers compares against a small number: every tolerance is a multiple of
// E = u·(|o| + size), so that a scene scaled by a power of two gives bit-identical answers.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>

#include "vec.hpp"

namespace csg {

/// u of Real: half an ulp of 1.
template <class Real>
inline constexpr Real kUnitRoundoff = std::numeric_limits<Real>::epsilon() / 2;

/// A line is taken to miss a ball only if it does by this much, relative to the ball and to the
/// distance of the ray's origin, in squares: 64 u, where rounding costs less than 16.
inline constexpr double kBallMargin = 0x1p-47;

/// Directions are taken as parallel to an axis if they drift from it by less than this in the
/// time that they move by 1 along another: 2⁻⁹⁰ of any reachable path is far below P.
inline constexpr double kParallel = 0x1p-90;
/// The same for float kernels, whose squares of smaller entries would underflow.
inline constexpr double kParallelSingle = 0x1p-40;

/// Scalar of the kernels. Float32 keeps double where it costs nothing that matters: rays, transforms,
/// the moving of a line's origin to the primitive, cells, and normals. A crossing's error is then
/// u₃₂ of the primitive, not of its distance.
enum class Precision : std::uint8_t { Float64, Float32 };

enum class TorusSolver : std::uint8_t { Robust, Ferrari, Algorithm1010 };

/// How crossings are computed and told apart. Both precisions are right, each within its own E; the
/// other knobs are right at their defaults only, and are there to measure what that is worth.
struct Numerics {
  Precision precision = Precision::Float64;
  TorusSolver torus = TorusSolver::Robust;
  /// Width of the tie band in E. Crossings of planes that are the same in the source differ by at most
  /// 3 to 4 E (measured); the band is four times as wide.
  double band_in_E = 16;
  std::optional<double> fixed_band{};    ///< model units, instead of a multiple of E
  std::optional<double> fixed_shadow{};  ///< model units, instead of 16 bands

  bool operator==(const Numerics&) const = default;
};

/// What a precision can tell apart, by its unit roundoff: 4·bb_max + the kernel's error ≤ P.
struct Limits {
  /// A band is widened by 1/cos θ where the surface is grazed, and no further than by this cosine:
  /// beyond it, surfaces that are the same but for rounding are told apart.
  double min_cosine;
  int pad_exponent;          ///< P = 2^this·size
  double condition_covered;  ///< of a transform: P covers E times this much

  static constexpr Limits of(Precision precision) {
    return precision == Precision::Float64 ? Limits{0x1p-20, -20, 0x1p12} : Limits{0x1p-5, -12, 0x1p8};
  }
};

/// What follows from the numerics for a model of a size (its extent and distance from 0).
class Tolerances {
 public:
  Tolerances() = default;
  Tolerances(const Numerics& numerics, double size)
      : numerics_(numerics), limits_(Limits::of(numerics.precision)), size_(size) {
    if (numerics.precision == Precision::Float32) coarse_ = kUnitRoundoff<float> * size;
  }

  /// Tie band of a ray, in units of its parameter t.
  double band(const Vec3& origin, double dir_length) const {
    if (numerics_.fixed_band) return *numerics_.fixed_band / dir_length;
    return numerics_.band_in_E * (kUnitRoundoff<double> * (length(origin) + size_) + coarse_) / dir_length;
  }

  /// The band at a surface whose normal is at an angle with this |cosine| to the ray: wider where it is
  /// grazed, up to a limit.
  double band_at(double band, double cosine) const { return band / std::max(std::fabs(cosine), limits_.min_cosine); }

  /// How far off the surface that a ray from `origin` has hit a shadow ray starts, in model units.
  double shadow_offset(const Vec3& origin) const {
    return numerics_.fixed_shadow ? *numerics_.fixed_shadow : 16 * band(origin, 1);
  }

  /// P: classes of cells and S-boxes hold for boxes that are this much larger.
  double pad() const { return std::ldexp(size_, limits_.pad_exponent); }
  /// P for a leaf whose transform has this condition, which may spoil a crossing as much.
  double pad(double condition) const { return pad() * std::max(1.0, condition / limits_.condition_covered); }

  /// Farthest origin for which 4·bb_max + the kernel's error ≤ P. Rays from farther are moved to where
  /// they enter the world, once, before any scheme sees them.
  double farthest_origin() const { return 32 * size_; }

 private:
  Numerics numerics_;
  Limits limits_ = Limits::of(Precision::Float64);
  double size_ = 0, coarse_ = 0;
};

}  // namespace csg
