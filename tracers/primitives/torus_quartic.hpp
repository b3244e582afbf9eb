// A line in a torus' own units, and what is algebraic along it: shared by the torus' solvers.
#pragma once
#include <algorithm>
#include <limits>

#include "crossings.hpp"

namespace csg::torus {

/// A line with a unit direction whose origin is its point nearest the torus' centre.
template <class Real>
struct Probe {
  Line<Real> line;
  Real major, minor;

  Real distance(Real s) const {
    const Real x = line.ox + s * line.dx, y = line.oy + s * line.dy, z = line.oz + s * line.dz;
    const Real tube = std::sqrt(x * x + y * y) - major;
    return std::sqrt(tube * tube + z * z) - minor;
  }
  /// g and dg/ds.
  std::pair<Real, Real> distance_and_slope(Real s) const {
    const Real x = line.ox + s * line.dx, y = line.oy + s * line.dy, z = line.oz + s * line.dz;
    const Real rho = std::sqrt(x * x + y * y), tube = rho - major;
    const Real from_circle = std::sqrt(tube * tube + z * z);
    const Real rho_slope = rho > 0 ? (x * line.dx + y * line.dy) / rho : 0;
    const Real slope = from_circle > 0 ? (tube * rho_slope + z * line.dz) / from_circle : 0;
    return {from_circle - minor, slope};
  }
};

/// Where the line may meet the torus at all, and the way back to the line's own parameter.
template <class Real>
struct Approach {
  Probe<Real> probe;
  Chord<Real> chord;  ///< of the bounding disc |z| ≤ r, |p| ≤ R + r: outside it g > 0
  Real squared = 0;   ///< distance² of the line from the centre
  Real shift = 0, unit = 1, speed = 1;

  /// In units of a power of two near R, so that sixth powers stay in range and no library function
  /// (cbrt) makes the bits depend on the scale.
  Approach(const double* size, Line<Real> line) {
    shift = recentre(line);
    unit = std::ldexp(Real{1}, std::ilogb(size[0]));
    const Real major = static_cast<Real>(size[0]) / unit, minor = static_cast<Real>(size[1]) / unit;
    line.ox /= unit, line.oy /= unit, line.oz /= unit;
    const Real outer = major + minor;
    squared = line.ox * line.ox + line.oy * line.oy + line.oz * line.oz;
    if (!(squared < outer * outer)) {
      chord.clear();
      return;
    }
    speed = std::sqrt(line.dx * line.dx + line.dy * line.dy + line.dz * line.dz);
    line.dx /= speed, line.dy /= speed, line.dz /= speed;
    const Real half = std::sqrt((outer - std::sqrt(squared)) * (outer + std::sqrt(squared)));
    chord.clip(-half, half, 0, 0);
    chord.clip_slab(line.oz, line.dz, minor, 0);
    probe = {line, major, minor};
  }

  bool misses() const { return !(chord.enter < chord.leave); }

  /// Moving back may round two roots out of order: then they are the same.
  void add(Crossings& out, Real s) const {
    const Real t = shift + unit * s / speed;
    out.add(out.count ? std::max<double>(t, out.t[out.count - 1]) : t, 0);
  }
};

/// s⁴ + 2p·s² + 4q·s + w = (|o|² + s² + R² − r²)² − 4R²ρ(s)², which is 0 on the surface. A recentred
/// line has no cubic term. A quarter of the derivative is s³ + p·s + q.
template <class Real>
struct Quartic {
  Real p, q, w;

  explicit Quartic(const Approach<Real>& to) {
    const auto& [line, major, minor] = to.probe;
    const Real flat = line.dx * line.dx + line.dy * line.dy;
    p = to.squared + (major - minor) * (major + minor) - 2 * major * major * flat;
    q = -2 * major * major * (line.ox * line.dx + line.oy * line.dy);
    const Real power = to.squared + (major - minor) * (major + minor);
    w = power * power - 4 * major * major * (line.ox * line.ox + line.oy * line.oy);
  }
};

/// Ascending, by insertion: there are at most four.
template <class Real>
void sort_roots(Real* first, const Real* last) {
  for (Real* end = first; end != last; ++end)
    for (Real* at = end; at != first && at[0] < at[-1]; --at) std::swap(at[0], at[-1]);
}

}  // namespace csg::torus
