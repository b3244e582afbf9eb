// Sphere: |p| ≤ r.
#pragma once
#include "crossings.hpp"

namespace csg::sphere {

/// (r − L)(r + L) with L the distance of the recentred line: 0.99 E at any distance, where the
/// textbook discriminant loses everything.
template <class Real>
Crossings crossings(const double* size, Line<Real> line) {
  const Real r = static_cast<Real>(size[0]);
  const Real shift = recentre(line);
  const Real distance = std::sqrt(line.ox * line.ox + line.oy * line.oy + line.oz * line.oz);
  Chord<Real> chord;
  if (!(distance < r)) return {};
  const Real dd = line.dx * line.dx + line.dy * line.dy + line.dz * line.dz;
  const Real half = std::sqrt((r - distance) * (r + distance) / dd);
  chord.clip(-half, half, 0, 0);
  return chord.crossings(shift);
}

inline Vec3 gradient(const double*, std::uint8_t, const Vec3& p) { return p; }
inline bool contains(const double* size, const Vec3& p) { return dot(p, p) <= size[0] * size[0]; }
inline Vec3 support(const double* size, const Vec3& v) {
  const double n = std::hypot(v.x, v.y, v.z);
  return n > 0 ? (size[0] / n) * v : Vec3{};
}

}  // namespace csg::sphere
