// Torus around z: g(p) = hypot(ρ − R, z) − r ≤ 0 with ρ = hypot(x, y) and R ≥ r.
#pragma once
#include "torus_quartic.hpp"

namespace csg::torus {

/// Where the quartic is stationary, ascending: the real roots of s³ + p·s + q. A double root may be
/// missed or found twice: there the quartic has no extremum, only an inflection.
template <class Real>
int stationary_points(const Quartic<Real>& quartic, Real points[3]) {
  const Real third = quartic.p / 3, half = quartic.q / 2;
  const Real discriminant = half * half + third * third * third;
  if (discriminant > 0) {
    const Real u = std::cbrt(-half - std::copysign(std::sqrt(discriminant), half));
    const Real s = u - third / u, slope = 3 * (s * s + third);
    points[0] = slope > 0 ? s - ((s * s + quartic.p) * s + quartic.q) / slope : s;
    return 1;
  }
  const Real scale = std::sqrt(-third);
  if (!(scale > 0)) {
    points[0] = 0;
    return 1;
  }
  // s = ±scale·y with y³ − 3y = c, 0 ≤ c ≤ 2. The largest root, 2·cos(acos(c/2)/3), is a parabola but
  // for 3e-4; two steps of Newton's give all digits. It leaves a quadratic.
  const Real c = std::min<Real>(2 * std::fabs(half) / (scale * scale * scale), 2);
  Real y = Real(1.7320508) + c * (Real(0.1606942) - c * Real(0.0133598));
  for (int step = 0; step < 2; ++step) y -= ((y * y - 3) * y - c) / (3 * (y * y - 1));
  const Real apart = std::sqrt(std::max<Real>(0, 3 * (2 - y) * (2 + y)));
  const Real side = -std::copysign(scale, half);
  points[0] = side * y;
  points[1] = -side * (y + apart) / 2;
  points[2] = -side * 2 * c / (y * (y + apart));  // the product of the three is c: no cancellation
  sort_roots(points, points + 3);
  return 3;
}

/// A root of the quartic beside its minimum at `s`, which lies at the point p inside the torus, in the
/// direction of and within `reach`, roughly: the quartic around s, with its value there from p.
template <class Real>
Real root_beside(const Quartic<double>& quartic, const Probe<Real>& probe, Real s, const Sample<Real>& p, Real reach) {
  const Line<Real>& line = probe.line;
  const Real dd = line.dx * line.dx + line.dy * line.dy + line.dz * line.dz;
  const Real across = p.rho + probe.major, other = across * across + p.z * p.z - probe.minor * probe.minor;
  const Real depth = p.distance * (p.from_circle + probe.minor) * other / (dd * dd);
  const Real bend = 6 * s * s + 2 * static_cast<Real>(quartic.p);
  // Without the cubic term a quadratic in by², of which depth < 0 leaves one positive root.
  Real by = std::copysign(std::sqrt(-2 * depth / (bend + std::sqrt(bend * bend - 4 * depth))), reach);
  if (!(std::fabs(by) < std::fabs(reach))) by = reach;
  for (int step = 0; step < 8; ++step) {
    const Real value = depth + by * by * (bend + by * (4 * s + by));
    const Real next = by - value / (by * (2 * bend + by * (12 * s + 4 * by)));
    const Real moved = std::fabs(next - by);
    if (!(0 < next / reach))
      by = by / 2;
    else if (!(next / reach < 1))
      by = (by + reach) / 2;
    else
      by = next;
    if (moved <= Real(0x1p-16) * std::fabs(by)) break;
  }
  return s + by;
}

/// A root s + rest: rounded but once, when it is moved back to the line's own parameter.
template <class Real>
struct Root {
  Real s, rest = 0;
};

/// The root of g in a bracket where its sign changes: Newton, bisection where Newton leaves it.
template <class Real>
Root<Real> bracketed_root(const Probe<Real>& probe, Real lo, Real hi, bool lo_inside, Real s) {
  const Line<Real>& line = probe.line;
  const Real dd = line.dx * line.dx + line.dy * line.dy + line.dz * line.dz;
  const Real rounding = std::numeric_limits<Real>::epsilon() / 4 * probe.major;
  Real last_step = hi - lo;
  if (!(lo < s && s < hi)) s = lo + (hi - lo) / 2;
  for (int step = 0; step < 128; ++step) {
    const Sample<Real> p = probe.at(s);
    if ((p.distance < 0) == lo_inside)
      lo = s;
    else
      hi = s;
    const Real back = p.distance * p.from_circle * p.rho / probe.scaled_slope(p);
    Real next = s - back;
    // What a step leaves of g is its second derivative's share, with |g"| ≤ |d|²(1 + |tube|/ρ)/hypot.
    const Real left = back * back * dd * (p.rho + std::fabs(p.tube)), small = rounding * p.from_circle * p.rho;
    if (lo <= next && next <= hi && left < small) return {s, -back};
    if (std::fabs(p.distance) <= rounding) return {s};
    if (!(lo < next && next < hi) || !(2 * std::fabs(back) < last_step)) next = lo + (hi - lo) / 2;
    if (next == lo || next == hi) return {s};
    last_step = std::fabs(next - s);
    s = next;
  }
  return {s};
}

/// Bracketed by the stationary points of the quartic (its derivative is a depressed cubic once the
/// line is recentred), sign and root by the geometric g, which keeps r where the expanded quartic
/// loses it. The cubic is solved in double also for Real = float: where a line runs along a thin
/// torus, three stationary points are nearly one, and the cube root of float's rounding would put
/// them off by more than such a torus is thick. All that is measured, g, is measured in Real.
template <class Real>
Crossings crossings(const double* size, const Line<Real>& line) {
  const Approach<double> to(size, {line.ox, line.oy, line.oz, line.dx, line.dy, line.dz});
  if (to.misses()) return {};
  const Probe<Real> probe(to.probe);
  const Quartic<double> quartic(to);
  double points[3];
  const int count = stationary_points(quartic, points);

  Crossings out;
  Real lo = static_cast<Real>(to.chord.enter), minimum = 0;
  bool inside = false;
  Sample<Real> lowest{};
  for (int i = 0; i <= count; ++i) {
    const bool last = i == count;
    const Real at = static_cast<Real>(last ? to.chord.leave : points[i]);
    if (!last && !(lo < at && at < to.chord.leave)) continue;
    const Sample<Real> here = probe.at(at);
    const bool now_inside = !last && here.distance < 0;
    if (now_inside) minimum = at, lowest = here;
    if (now_inside != inside) {
      const Real start = root_beside(quartic, probe, minimum, lowest, inside ? at - minimum : lo - minimum);
      const Root<Real> root = bracketed_root(probe, lo, at, inside, start);
      to.add(out, root.s, root.rest);
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
