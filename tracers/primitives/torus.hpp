// Torus around z: g(p) = hypot(ρ − R, z) − r ≤ 0 with ρ = hypot(x, y) and R ≥ r.
#pragma once
#include "torus_quartic.hpp"

namespace csg::torus {

/// Real roots, ascending, of s³ + p·s + q. A double root may be missed or found twice: there the
/// quartic has no extremum, only an inflection.
template <class Real>
int depressed_cubic_roots(Real p, Real q, Real roots[3]) {
  const auto polish = [&](Real s) {
    for (int step = 0; step < 2; ++step) {
      const Real slope = 3 * s * s + p;
      if (slope == 0) break;
      s -= ((s * s + p) * s + q) / slope;
    }
    return s;
  };
  const Real third = p / 3, half = q / 2;
  const Real discriminant = half * half + third * third * third;
  if (discriminant > 0) {
    const Real u = std::cbrt(-half - std::copysign(std::sqrt(discriminant), half));
    roots[0] = polish(u == 0 ? 0 : u - third / u);
    return 1;
  }
  const Real scale = std::sqrt(-third);
  if (scale == 0) {
    roots[0] = 0;
    return 1;
  }
  const Real cosine = std::clamp<Real>(-half / (scale * scale * scale), -1, 1);
  const Real angle = std::acos(cosine) / 3;
  constexpr Real kThirdTurn = static_cast<Real>(2.0943951023931953);
  roots[0] = polish(2 * scale * std::cos(angle + kThirdTurn));
  roots[1] = polish(2 * scale * std::cos(angle - kThirdTurn));
  roots[2] = polish(2 * scale * std::cos(angle));
  std::sort(roots, roots + 3);
  return 3;
}

/// The root of g in a bracket where its sign changes: Newton, bisection where Newton leaves.
template <class Real>
Real bracketed_root(const Probe<Real>& probe, Real lo, Real hi, bool lo_inside) {
  Real s = lo + (hi - lo) / 2, last_step = hi - lo;
  for (int step = 0; step < 128; ++step) {
    const auto [g, slope] = probe.distance_and_slope(s);
    if (g == 0) return s;
    if ((g < 0) == lo_inside)
      lo = s;
    else
      hi = s;
    Real next = s - g / slope;
    if (!(lo < next && next < hi) || !(2 * std::fabs(next - s) < last_step)) next = lo + (hi - lo) / 2;
    last_step = std::fabs(next - s);
    if (next == s || next == lo || next == hi) return s;
    // Newton has converged once its step no longer moves the surface point by an ulp of the scale.
    if (last_step <= 2 * std::numeric_limits<Real>::epsilon() * std::fabs(s)) return next;
    s = next;
  }
  return s;
}

/// Bracketed by the critical points of the quartic (its derivative is a depressed cubic once the
/// line is recentred), sign and root by the geometric g, which keeps r where the expanded quartic
/// loses it.
template <class Real>
Crossings crossings(const double* size, Line<Real> line) {
  const Approach<Real> to(size, line);
  if (to.misses()) return {};
  const Quartic<Real> quartic(to);
  Real critical[3];
  const int count = depressed_cubic_roots(quartic.p, quartic.q, critical);

  Crossings out;
  Real lo = to.chord.enter;
  bool inside = false;
  for (int i = 0; i <= count; ++i) {
    const bool last = i == count;
    const Real at = last ? to.chord.leave : critical[i];
    if (!last && !(lo < at && at < to.chord.leave)) continue;
    const bool now_inside = !last && to.probe.distance(at) < 0;
    if (now_inside != inside) {
      to.add(out, bracketed_root(to.probe, lo, at, inside));
      inside = now_inside;
    }
    lo = at;
  }
  return out;
}

inline Vec3 gradient(const double* size, std::uint8_t, const Vec3& p) {
  const double rho = std::hypot(p.x, p.y), s = rho > 0 ? (rho - size[0]) / rho : 0;
  return {s * p.x, s * p.y, p.z};
}
/// Of the convex hull: a disc swept by a ball.
inline Vec3 support(const double* size, const Vec3& v) {
  const double flat = std::hypot(v.x, v.y), n = std::hypot(v.x, v.y, v.z);
  const double s = flat > 0 ? size[0] / flat : 0, b = n > 0 ? size[1] / n : 0;
  return {(s + b) * v.x, (s + b) * v.y, b * v.z};
}

}  // namespace csg::torus
