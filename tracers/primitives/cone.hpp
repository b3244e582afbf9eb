// Cone (a frustum if no radius is zero): x² + y² ≤ w(z)², w from r0 at z = −h to r1 at z = +h,
// |z| ≤ h. Face 0 is the side, 1 the bottom, 2 the top.
#pragma once
#include "crossings.hpp"

namespace csg::cone {

/// The double cone x² + y² − w² ≤ 0, from which the slab |z| ≤ h, where w ≥ 0, takes one nappe.
/// Lagrange's identity in the metric (+, +, −) gives the discriminant without the cancellation of
/// b² − ac.
template <class Real>
Crossings crossings(const double* size, Line<Real> line) {
  const Real r0 = static_cast<Real>(size[0]), r1 = static_cast<Real>(size[1]), h = static_cast<Real>(size[2]);
  const Real slope = (r1 - r0) / (2 * h);
  Chord<Real> chord;
  const Real shift = recentre(line);
  chord.clip_slab(line.oz, line.dz, h, 1);
  const Real w = (r0 + r1) / 2 + slope * line.oz, dw = slope * line.dz;

  const Real a = line.dx * line.dx + line.dy * line.dy - dw * dw;
  const Real b = line.ox * line.dx + line.oy * line.dy - w * dw;
  const Real rho = std::sqrt(line.ox * line.ox + line.oy * line.oy);
  const Real c = (rho - w) * (rho + w);
  const Real mx = line.ox * dw - w * line.dx, my = line.oy * dw - w * line.dy;
  const Real m = std::sqrt(mx * mx + my * my), n = std::fabs(line.ox * line.dy - line.oy * line.dx);
  // Where −ac adds to b² nothing cancels, and along a generator only this form is consistent with a.
  const Real discriminant = (a < 0) != (c < 0) ? b * b - a * c : (m - n) * (m + n);

  constexpr Real kEnd = std::numeric_limits<Real>::infinity();
  if (a > 0) {  // shallower than the cone: one chord
    if (!(discriminant > 0)) return {};
    const Real q = -(b + std::copysign(std::sqrt(discriminant), b));
    const Real s = q / a, t = q == 0 ? 0 : c / q;
    chord.clip(std::min(s, t), std::max(s, t), 0, 0);
  } else if (a < 0) {  // steeper: inside, outside between the roots, inside on the other nappe
    const Real q = -(b + std::copysign(std::sqrt(std::max<Real>(discriminant, 0)), b));
    const Real s = q / a, t = q == 0 ? 0 : c / q;
    if (dw > 0)
      chord.clip(std::max(s, t), kEnd, 0, 0);
    else
      chord.clip(-kEnd, std::min(s, t), 0, 0);
  } else if (b != 0) {  // along a generator: one root
    const Real s = -c / (2 * b);
    if (b < 0)
      chord.clip(s, kEnd, 0, 0);
    else
      chord.clip(-kEnd, s, 0, 0);
  } else if (!(c < 0)) {
    return {};
  }
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
