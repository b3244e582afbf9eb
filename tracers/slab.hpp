// Ray against axis-aligned planes and boxes, with the case of a parallel ray made explicit.
#pragma once
#include "error_unit.hpp"
#include "vec.hpp"

namespace csg {

struct Interval {
  double lo = -kInfinity, hi = kInfinity;
  bool empty() const { return !(lo <= hi); }
};

/// 1/d by axis, with flags where the ray is parallel to the axis' planes, and where it goes up.
struct Reciprocal {
  Vec3 inv;
  bool parallel[3], forward[3];

  explicit Reciprocal(const Vec3& dir) {
    const double largest = std::max({std::fabs(dir.x), std::fabs(dir.y), std::fabs(dir.z)});
    for (int axis = 0; axis < 3; ++axis) {
      parallel[axis] = std::fabs(dir[axis]) <= kParallel * largest;
      forward[axis] = dir[axis] > 0;
      inv[axis] = parallel[axis] ? 0 : 1 / dir[axis];
    }
  }

  /// The ray's parameter at the plane `axis` = `at`: the one expression by which all cells meet.
  double plane(int axis, double at, const Vec3& origin) const { return (at - origin[axis]) * inv[axis]; }
};

/// The ray's interval in a box; empty if the box is. Boxes carry their pad: nothing is widened here.
inline Interval slab(const Box& box, const Vec3& origin, const Reciprocal& ray) {
  Interval in;
  for (int axis = 0; axis < 3; ++axis) {
    if (ray.parallel[axis]) {
      if (!(box.lo[axis] <= origin[axis] && origin[axis] <= box.hi[axis])) return {kInfinity, -kInfinity};
      continue;
    }
    const double a = ray.plane(axis, box.lo[axis], origin), b = ray.plane(axis, box.hi[axis], origin);
    in.lo = std::max(in.lo, ray.forward[axis] ? a : b);
    in.hi = std::min(in.hi, ray.forward[axis] ? b : a);
  }
  return in;
}

}  // namespace csg
