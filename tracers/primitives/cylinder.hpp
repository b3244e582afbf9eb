// Cylinder: x² + y² ≤ r², |z| ≤ h. Face 0 is the side, 1 the bottom, 2 the top.
#pragma once
#include "../error_unit.hpp"
#include "crossings.hpp"

namespace csg::cylinder {

/// As for the sphere, in the plane: the line is recentred at its point nearest the axis.
template <class Real>
Crossings crossings(const double* size, const Line<Real>& line) {
  const Real r = static_cast<Real>(size[0]), h = static_cast<Real>(size[1]);
  Chord<Real> chord;
  chord.clip_slab(line.oz, line.dz, h, 1);
  const Real dd = line.dx * line.dx + line.dy * line.dy;
  if (dd <= kParallel * kParallel * line.dz * line.dz) {
    if (!(line.ox * line.ox + line.oy * line.oy < r * r)) return {};
  } else {
    const Real shift = -(line.ox * line.dx + line.oy * line.dy) / dd;
    const Real x = line.ox + shift * line.dx, y = line.oy + shift * line.dy;
    const Real distance = std::sqrt(x * x + y * y);
    if (!(distance < r)) return {};
    const Real half = std::sqrt((r - distance) * (r + distance) / dd);
    chord.clip(shift - half, shift + half, 0, 0);
  }
  return chord.crossings();
}

inline Vec3 gradient(const double*, std::uint8_t face, const Vec3& p) {
  if (face == 0) return {p.x, p.y, 0};
  return {0, 0, face == 1 ? -1.0 : 1.0};
}
inline bool contains(const double* size, const Vec3& p) {
  return p.x * p.x + p.y * p.y <= size[0] * size[0] && std::fabs(p.z) <= size[1];
}
inline Vec3 support(const double* size, const Vec3& v) {
  const double n = std::hypot(v.x, v.y), s = n > 0 ? size[0] / n : 0;
  return {s * v.x, s * v.y, std::copysign(size[1], v.z)};
}

}  // namespace csg::cylinder
