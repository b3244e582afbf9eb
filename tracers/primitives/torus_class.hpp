// Class of a box with respect to a torus, which is not convex: corners prove nothing. The box is
// seen in the torus' half plane (ρ, z), where the torus is a disc of radius r around (R, 0).
#pragma once
#include "../error_unit.hpp"
#include "primitive.hpp"

namespace csg::torus {

inline double flat_square(double x, double y) { return x * x + y * y; }

inline bool contains(const double* size, const Vec3& p) {
  const double off = std::sqrt(flat_square(p.x, p.y)) - size[0];
  return flat_square(off, p.z) <= size[1] * size[1];
}

/// Squared distance of the point nearest 0 of the segment [a, b] in the xy plane.
inline double segment_distance_square(const Vec3& a, const Vec3& b) {
  const double dx = b.x - a.x, dy = b.y - a.y, dd = flat_square(dx, dy);
  const double s = dd > 0 ? std::clamp(-(a.x * dx + a.y * dy) / dd, 0.0, 1.0) : 0;
  return flat_square(a.x + s * dx, a.y + s * dy);
}

/// Range of ρ over the parallelepiped centre ± e₁ ± e₂ ± e₃, up to rounding.
inline std::pair<double, double> rho_range(const Vec3& centre, const Mat3& edges) {
  Vec3 corner[8];
  double nearest = kInfinity, farthest = 0;
  for (int i = 0; i < 8; ++i) {
    corner[i] = centre + edges * Vec3{i & 1 ? 1.0 : -1.0, i & 2 ? 1.0 : -1.0, i & 4 ? 1.0 : -1.0};
    farthest = std::max(farthest, flat_square(corner[i].x, corner[i].y));
  }
  // The projection is a zonogon: it contains 0 iff 0 is inside all three strips along its edges.
  bool contains_axis = true;
  for (int i = 0; i < 3; ++i) {
    const auto across = [&](const Vec3& v) { return edges.col[i].x * v.y - edges.col[i].y * v.x; };
    double width = 0;
    for (const Vec3& edge : edges.col) width += std::fabs(across(edge));
    contains_axis = contains_axis && std::fabs(across(centre)) <= width;
  }
  if (contains_axis) return {0, std::sqrt(farthest)};
  for (int i = 0; i < 8; ++i)
    for (int bit = 1; bit < 8; bit *= 2)
      if (!(i & bit)) nearest = std::min(nearest, segment_distance_square(corner[i], corner[i | bit]));
  return {std::sqrt(nearest), std::sqrt(farthest)};
}

/// Exact for boxes aligned with the torus; for others it is split `splits` times where in doubt. Each
/// part grows by what rounding costs it: under a bad condition its corners are so far away that
/// otherwise a torus where the parts meet would be in none.
inline Class classify(const double* size, const Vec3& centre, const Mat3& edges, int splits) {
  const double major = size[0], minor = size[1];
  const auto [rho_lo, rho_hi] = rho_range(centre, edges);
  const double rounding = 16 * kUnitRoundoff<double> * (rho_hi + std::fabs(centre.z));
  const double z_half = std::fabs(edges.col[0].z) + std::fabs(edges.col[1].z) + std::fabs(edges.col[2].z);
  const double z_lo = std::max(0.0, std::fabs(centre.z) - z_half - rounding), z_hi = std::fabs(centre.z) + z_half;
  const double off_lo = std::max({0.0, rho_lo - rounding - major, major - rho_hi - rounding});
  const double off_hi = std::max(std::fabs(rho_lo - major), std::fabs(rho_hi - major));
  if (flat_square(off_lo, z_lo) > minor * minor) return Class::Empty;
  if (flat_square(off_hi, z_hi) < minor * minor) return Class::Full;
  if (splits == 0) return Class::Partial;

  const Mat3 half{{0.5 * edges.col[0], 0.5 * edges.col[1], 0.5 * edges.col[2]}};
  Class all = Class::Partial;
  for (int i = 0; i < 8; ++i) {
    const Vec3 at = centre + half * Vec3{i & 1 ? 1.0 : -1.0, i & 2 ? 1.0 : -1.0, i & 4 ? 1.0 : -1.0};
    const Class part = classify(size, at, half, splits - 1);
    if (part == Class::Partial || (i > 0 && part != all)) return Class::Partial;
    all = part;
  }
  return all;
}

}  // namespace csg::torus
