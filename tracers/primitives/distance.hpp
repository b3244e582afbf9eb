// Signed distances of the five primitives: negative inside, exact in the local frame.
//
// An affine map shrinks no distance by more than its smallest stretch (Hart 1996, section 3.2), so
// this times the local distance never exceeds the distance in the world: a bound, which is the
// distance itself under a similarity.
#pragma once
#include "../csg/invert.hpp"
#include "primitive.hpp"

namespace csg {

/// The distance to a primitive's surface, and the piece of it that is nearest.
struct SignedDistance {
  double value;
  std::uint8_t face;
};

namespace sphere {
inline SignedDistance distance(const double* size, const Vec3& p) { return {length(p) - size[0], 0}; }
}  // namespace sphere

namespace block {
inline SignedDistance distance(const double* size, const Vec3& p) {
  Vec3 beyond;
  double outside = 0, most = -kInfinity;
  int axis = 0;
  for (int i = 0; i < 3; ++i) {
    beyond[i] = std::fabs(p[i]) - size[i];
    if (beyond[i] > most) most = beyond[i], axis = i;
    if (beyond[i] > 0) outside += beyond[i] * beyond[i];
  }
  return {most > 0 ? std::sqrt(outside) : most, static_cast<std::uint8_t>(2 * axis + (p[axis] > 0))};
}
}  // namespace block

namespace cylinder {
inline SignedDistance distance(const double* size, const Vec3& p) {
  const double side = std::sqrt(p.x * p.x + p.y * p.y) - size[0], cap = std::fabs(p.z) - size[1];
  const bool past_both = side > 0 && cap > 0;
  const auto face = static_cast<std::uint8_t>(side >= cap ? 0 : p.z > 0 ? 2 : 1);
  return {past_both ? std::sqrt(side * side + cap * cap) : std::max(side, cap), face};
}
}  // namespace cylinder

namespace cone {
/// In the half plane of the point and the axis: the nearer of a cap and the side, two segments. The
/// cap on the point's half of the axis is never the farther one, or else the side is nearer than both.
inline SignedDistance distance(const double* size, const Vec3& p) {
  const double r0 = size[0], r1 = size[1], h = size[2];
  const double rho = std::sqrt(p.x * p.x + p.y * p.y);
  const bool upper = p.z > 0;
  const double past_rim = std::max(rho - (upper ? r1 : r0), 0.0), cap = std::fabs(p.z) - h;
  const double run = r1 - r0, rise = 2 * h;
  const double along = std::clamp(((rho - r0) * run + (p.z + h) * rise) / (run * run + rise * rise), 0.0, 1.0);
  const double out = rho - r0 - along * run, up = p.z + h - along * rise;
  const double to_cap = past_rim * past_rim + cap * cap, to_side = out * out + up * up;
  const double distance = std::sqrt(std::min(to_cap, to_side));
  const auto face = static_cast<std::uint8_t>(to_side <= to_cap ? 0 : upper ? 2 : 1);
  return {out < 0 && cap < 0 ? -distance : distance, face};
}
}  // namespace cone

namespace torus {
inline SignedDistance distance(const double* size, const Vec3& p) {
  const double tube = std::sqrt(p.x * p.x + p.y * p.y) - size[0];
  return {std::sqrt(tube * tube + p.z * p.z) - size[1], 0};
}
}  // namespace torus

/// Of a world point, in the leaf's local frame.
inline SignedDistance local_distance(const Leaf& leaf, const Vec3& p) {
  const Vec3 local = to_local(leaf, p);
  switch (leaf.kind) {
    case Kind::Sphere:
      return sphere::distance(leaf.size, local);
    case Kind::Block:
      return block::distance(leaf.size, local);
    case Kind::Cylinder:
      return cylinder::distance(leaf.size, local);
    case Kind::Cone:
      return cone::distance(leaf.size, local);
    case Kind::Torus:
      return torus::distance(leaf.size, local);
  }
  return {kInfinity, 0};
}

/// A lower bound, tight for similarities, of how much the leaf's transform stretches any vector: world
/// distances are at least this times local ones.
inline double smallest_stretch(const Leaf& leaf) {
  return leaf.is_translation ? 1 : 1 / largest_stretch(leaf.local_from_world);
}

}  // namespace csg
