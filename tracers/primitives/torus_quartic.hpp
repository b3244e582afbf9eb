// A line in a torus' own units, and what is algebraic along it: shared by the torus' solvers.
#pragma once
#include <algorithm>
#include <limits>

#include "crossings.hpp"

namespace csg::torus {

/// A point of the line, seen from the torus' circle ρ = R, z = 0.
template <class Real>
struct Sample {
  Real rho, radial;  ///< distance from the axis, and ρ·dρ/ds
  Real tube, z;      ///< ρ − R and height
  Real from_circle;  ///< hypot(tube, z)
  Real distance;     ///< g, from the surface; negative inside
};

/// A line whose origin is its point nearest the torus' centre.
template <class Real>
struct Probe {
  Line<Real> line;
  Real major, minor;

  template <class Other>
  explicit operator Probe<Other>() const {
    const auto to = [](Real x) { return static_cast<Other>(x); };
    return {{to(line.ox), to(line.oy), to(line.oz), to(line.dx), to(line.dy), to(line.dz)}, to(major), to(minor)};
  }

  Sample<Real> at(Real s) const {
    const Real x = line.ox + s * line.dx, y = line.oy + s * line.dy, z = line.oz + s * line.dz;
    const Real rho = std::sqrt(x * x + y * y), tube = rho - major, from_circle = std::sqrt(tube * tube + z * z);
    return {rho, x * line.dx + y * line.dy, tube, z, from_circle, from_circle - minor};
  }
  /// dg/ds times ρ·hypot(tube, z), which may be 0.
  Real scaled_slope(const Sample<Real>& p) const { return p.tube * p.radial + p.rho * p.z * line.dz; }
};

/// Where the line may meet the torus at all, and the way back to the line's own parameter.
template <class Real>
struct Approach {
  Probe<Real> probe{};
  Chord<Real> chord;  ///< of the bounding disc |z| ≤ r, |p| ≤ R + r: outside it g > 0
  Real squared = 0;   ///< distance² of the line from the centre
  Real shift = 0, back = 1;

  /// Lengths in units of a power of two near R, directions near |d|: sixth powers stay in range, no
  /// library function (cbrt) makes the bits depend on the scale, and neither way is rounded.
  Approach(const double* size, Line<Real> line) {
    shift = recentre(line);
    const Real unit = std::ldexp(Real{1}, std::ilogb(size[0]));
    const Real major = static_cast<Real>(size[0]) / unit, minor = static_cast<Real>(size[1]) / unit;
    line.ox /= unit, line.oy /= unit, line.oz /= unit;
    const Real outer = major + minor;
    squared = line.ox * line.ox + line.oy * line.oy + line.oz * line.oz;
    if (!(squared < outer * outer)) {
      chord.clear();
      return;
    }
    const Real largest = std::max({std::fabs(line.dx), std::fabs(line.dy), std::fabs(line.dz)});
    const Real pace = std::ldexp(Real{1}, std::ilogb(largest));
    line.dx /= pace, line.dy /= pace, line.dz /= pace;
    back = unit / pace;
    const Real speed = std::sqrt(line.dx * line.dx + line.dy * line.dy + line.dz * line.dz);
    const Real half = std::sqrt((outer - std::sqrt(squared)) * (outer + std::sqrt(squared))) / speed;
    constexpr Real kWider = 1 + 4 * std::numeric_limits<Real>::epsilon();  // a root may lie on the disc's rim
    chord.clip(-kWider * half, kWider * half, 0, 0);
    chord.clip_slab(line.oz, line.dz, kWider * minor, 0);
    probe = {line, major, minor};
  }

  bool misses() const { return !(chord.enter < chord.leave); }

  /// The crossing at s + rest. Moving back may round two out of order: then they are the same.
  void add(Crossings& out, Real s, Real rest = 0) const {
    const Real by = back * s, sum = shift + by, by_in_sum = sum - shift;
    const Real lost = (shift - (sum - by_in_sum)) + (by - by_in_sum);
    const Real t = sum + (lost + back * rest);
    out.add(out.count ? std::max<double>(t, out.t[out.count - 1]) : t, 0);
  }
};

/// s⁴ + 2p·s² + 4q·s + w = ((|p(s)|² + R² − r²)² − 4R²ρ(s)²) / |d|⁴, which is 0 on the surface. A
/// recentred line has no cubic term. A quarter of the derivative is s³ + p·s + q.
template <class Real>
struct Quartic {
  Real p, q, w;

  explicit Quartic(const Approach<Real>& to) {
    const auto& [line, major, minor] = to.probe;
    const Real flat = line.dx * line.dx + line.dy * line.dy, dd = flat + line.dz * line.dz;
    const Real power = (to.squared + (major - minor) * (major + minor)) / dd, ratio = 2 * major * major / (dd * dd);
    p = power - ratio * flat;
    q = -ratio * (line.ox * line.dx + line.oy * line.dy);
    w = power * power - 2 * ratio * (line.ox * line.ox + line.oy * line.oy);
  }
};

/// Ascending, by insertion: there are at most four.
template <class Real>
void sort_roots(Real* first, const Real* last) {
  for (Real* end = first; end != last; ++end)
    for (Real* at = end; at != first && at[0] < at[-1]; --at) std::swap(at[0], at[-1]);
}

}  // namespace csg::torus
