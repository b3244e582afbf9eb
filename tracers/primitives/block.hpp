// Block: |x| ≤ a, |y| ≤ b, |z| ≤ c. Faces 2·axis (low) and 2·axis + 1 (high).
#pragma once
#include "crossings.hpp"

namespace csg::block {

template <class Real>
Crossings crossings(const double* size, const Line<Real>& line) {
  Chord<Real> chord;
  chord.clip_slab(line.ox, line.dx, static_cast<Real>(size[0]), 0);
  chord.clip_slab(line.oy, line.dy, static_cast<Real>(size[1]), 2);
  chord.clip_slab(line.oz, line.dz, static_cast<Real>(size[2]), 4);
  return chord.crossings();
}

inline Vec3 gradient(const double*, std::uint8_t face, const Vec3&) {
  Vec3 n;
  n[face / 2] = face % 2 ? 1 : -1;
  return n;
}
inline bool contains(const double* size, const Vec3& p) {
  return std::fabs(p.x) <= size[0] && std::fabs(p.y) <= size[1] && std::fabs(p.z) <= size[2];
}
inline Vec3 support(const double* size, const Vec3& v) {
  return {std::copysign(size[0], v.x), std::copysign(size[1], v.y), std::copysign(size[2], v.z)};
}

}  // namespace csg::block
