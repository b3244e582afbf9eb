// Cone (a frustum if no radius is zero): x² + y² ≤ w(z)², w from r0 at z = −h to r1 at z = +h,
// |z| ≤ h. Face 0 is the side, 1 the bottom, 2 the top.
#pragma once
#include "crossings.hpp"

namespace csg::cone {

/// The wall along a line: ρ − w is convex, and negative inside, where |z| ≤ h.
template <class Real>
struct Wall {
  Line<Real> line;
  Real w, dw;

  Real radius(Real s) const { return w + s * dw; }
  Real squared(Real s) const {
    const Real x = line.ox + s * line.dx, y = line.oy + s * line.dy;
    return x * x + y * y;
  }
  bool encloses(Real s) const { return squared(s) < radius(s) * radius(s); }

  /// The root between a point outside and one inside, from a guess: Newton, which on a convex function
  /// does not overshoot from outside, and bisection where it leaves the bracket.
  Real root(Real outside, Real inside, Real guess, Real rounding) const {
    const auto within = [&](Real s) { return std::min(outside, inside) < s && s < std::max(outside, inside); };
    Real s = within(guess) ? guess : outside;
    for (int step = 0; step < 128; ++step) {
      const Real x = line.ox + s * line.dx, y = line.oy + s * line.dy;
      const Real rho = std::sqrt(x * x + y * y), g = rho - radius(s);
      (g > 0 ? outside : inside) = s;
      const Real next = s - g * rho / (x * line.dx + y * line.dy - dw * rho);
      const bool stays = within(next);
      if (std::fabs(g) <= rounding) return stays && g > 0 ? next : s;
      const Real middle = outside + (inside - outside) / 2;
      if (!stays && !within(middle)) return s;
      s = stays ? next : middle;
    }
    return s;
  }
};

/// The quadratic x² + y² − w² only guesses the roots: its gradient vanishes at the apex, and along a
/// generator its leading coefficient is all rounding. What decides is where ρ − w is negative; the
/// place where it is least is asked if the middle of the guess is not inside.
template <class Real>
Crossings crossings(const double* size, Line<Real> line) {
  const Real r0 = static_cast<Real>(size[0]), r1 = static_cast<Real>(size[1]), h = static_cast<Real>(size[2]);
  const Real slope = (r1 - r0) / (2 * h), extent = std::max({r0, r1, h});
  const Real shift = recentre(line);
  const Real flat2 = line.dx * line.dx + line.dy * line.dy;
  const Real half = 2 * extent / std::sqrt(flat2 + line.dz * line.dz);  // of a ball well around the cone
  Chord<Real> chord;
  chord.clip(-half, half, 0, 0);
  chord.clip_slab(line.oz, line.dz, h, 1);
  const Real enter = chord.enter, leave = chord.leave;
  if (!(enter < leave)) return {};

  const Wall<Real> wall{line, (r0 + r1) / 2 + slope * line.oz, slope * line.dz};
  const Real w = wall.w, dw = wall.dw;
  // At a cap the radius is known: computed, it would have z's rounding times the slope.
  const auto encloses_end = [&](Real s, std::uint8_t face) {
    const Real radius = face == 0 ? wall.radius(s) : face == 1 ? r0 : r1;
    return wall.squared(s) < radius * radius;
  };
  const bool starts_inside = encloses_end(enter, chord.enter_face), ends_inside = encloses_end(leave, chord.leave_face);
  if (starts_inside && ends_inside) return chord.crossings(shift);

  const Real along = line.ox * line.dx + line.oy * line.dy;
  const Real a = flat2 - dw * dw, b = along - w * dw, c = line.ox * line.ox + line.oy * line.oy - w * w;
  const Real q = -(b + std::copysign(std::sqrt(std::max<Real>(b * b - a * c, 0)), b));
  const Real s = q / a, t = c / q;
  const Real first = a > 0 ? std::min(s, t) : std::max(s, t), second = a > 0 ? std::max(s, t) : std::min(s, t);
  Real deepest = starts_inside ? enter : ends_inside ? leave : first + (second - first) / 2;
  if (!starts_inside && !ends_inside && !(enter < deepest && deepest < leave && wall.encloses(deepest))) {
    const Real flat = std::sqrt(flat2), least = (flat - std::fabs(dw)) * (flat + std::fabs(dw));
    if (!(least > 0)) return {};  // steeper than the wall: least at an end
    const Real nearest = std::fabs(line.ox * line.dy - line.oy * line.dx) / flat;
    deepest = -along / flat2 + dw * nearest / (flat * std::sqrt(least));
    if (!(enter < deepest && deepest < leave && wall.encloses(deepest))) return {};
  }

  const Real rounding = std::numeric_limits<Real>::epsilon() * extent;
  if (!starts_inside) chord.clip(wall.root(enter, deepest, first, rounding), leave, 0, chord.leave_face);
  if (!ends_inside) chord.clip(enter, wall.root(leave, deepest, second, rounding), chord.enter_face, 0);
  return chord.crossings(shift);
}

inline Vec3 gradient(const double* size, std::uint8_t face, const Vec3& p) {
  if (face != 0) return {0, 0, face == 1 ? -1.0 : 1.0};
  const double slope = (size[1] - size[0]) / (2 * size[2]);
  return {p.x, p.y, -slope * std::hypot(p.x, p.y)};
}
inline bool contains(const double* size, const Vec3& p) {
  const double w = (size[0] + size[1]) / 2 + (size[1] - size[0]) / (2 * size[2]) * p.z;
  return std::fabs(p.z) <= size[2] && p.x * p.x + p.y * p.y <= w * w;
}
inline Vec3 support(const double* size, const Vec3& v) {
  const double n = std::hypot(v.x, v.y);
  const bool top = size[1] * n + size[2] * v.z > size[0] * n - size[2] * v.z;
  const double s = n > 0 ? size[top] / n : 0;
  return {s * v.x, s * v.y, top ? size[2] : -size[2]};
}

}  // namespace csg::cone
