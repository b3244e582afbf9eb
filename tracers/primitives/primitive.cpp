// Dispatch by kind, the change of frame, and the class of a box for convex primitives.
#include "primitive.hpp"

#include "../error_unit.hpp"
#include "block.hpp"
#include "cone.hpp"
#include "cylinder.hpp"
#include "sphere.hpp"
#include "torus.hpp"
#include "torus_1010.hpp"
#include "torus_class.hpp"
#include "torus_ferrari.hpp"

namespace csg {
namespace {

bool contains(const Leaf& leaf, const Vec3& p) {
  switch (leaf.kind) {
    case Kind::Sphere:
      return sphere::contains(leaf.size, p);
    case Kind::Block:
      return block::contains(leaf.size, p);
    case Kind::Cylinder:
      return cylinder::contains(leaf.size, p);
    case Kind::Cone:
      return cone::contains(leaf.size, p);
    case Kind::Torus:
      return torus::contains(leaf.size, p);
  }
  return false;
}

/// Whether all corners, hence the whole box, lie in the convex leaf.
bool contains_box(const Leaf& leaf, const Box& box) {
  if (!contains(leaf, to_local(leaf, box.center()))) return false;
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3 p{corner & 1 ? box.hi.x : box.lo.x, corner & 2 ? box.hi.y : box.lo.y, corner & 4 ? box.hi.z : box.lo.z};
    if (!contains(leaf, to_local(leaf, p))) return false;
  }
  return true;
}

/// Whether a plane certainly separates the box from the leaf's hull. Gilbert's iteration towards the
/// point of the Minkowski difference nearest 0 proposes the plane's normal; the supports certify it.
bool separated(const Leaf& leaf, const Box& box) {
  const Vec3 centre = box.center(), half = box.half();
  Vec3 nearest = centre - leaf.world_from_local.offset;  // a point of box − hull
  for (int step = 0; step < 12; ++step) {
    const Vec3 v = nearest;
    const Vec3 of_box =
        centre - Vec3{std::copysign(half.x, v.x), std::copysign(half.y, v.y), std::copysign(half.z, v.z)};
    const Vec3 w = of_box - support(leaf, v);
    if (dot(v, w) > 0) return true;
    const Vec3 back = w - nearest;  // nearest ← the point of the segment [nearest, w] nearest 0
    const double along = -dot(nearest, back), span = dot(back, back);
    if (!(along > 0) || !(span > 0)) return false;
    nearest = nearest + std::min(along / span, 1.0) * back;
  }
  return false;
}

/// Whether a point of the box is known that lies in the leaf: then they overlap. It is the point of the
/// box nearest the leaf's centre or, for a torus, nearest the point of its circle that the box is near.
bool surely_overlaps(const Leaf& leaf, const Box& box) {
  Vec3 inner = leaf.world_from_local.offset;
  if (leaf.kind == Kind::Torus) {
    const Vec3 towards = to_local(leaf, box.center());
    const double rho = std::sqrt(towards.x * towards.x + towards.y * towards.y);
    if (!(rho > 0)) return false;
    inner = leaf.world_from_local * Vec3{leaf.size[0] / rho * towards.x, leaf.size[0] / rho * towards.y, 0};
  }
  return contains(leaf, to_local(leaf, max(box.lo, min(box.hi, inner))));
}

/// A ray as a leaf sees it.
struct Approach {
  Vec3 to_centre;
  double dd, along;

  Approach(const Leaf& leaf, const Ray& ray)
      : to_centre(leaf.world_from_local.offset - ray.origin),
        dd(dot(ray.dir, ray.dir)),
        along(dot(to_centre, ray.dir)) {}

  /// Whether the line certainly passes outside the ball around the leaf: most lines do, and this is
  /// several times cheaper than any kernel. All in squares, times |d|², without a division.
  bool passes(double reach) const {
    const double far = dot(to_centre, to_centre);
    return far * dd - along * along > (reach * reach + kBallMargin * (reach * reach + far)) * dd;
  }
};

/// The kernel of a kind.
template <class Real>
Crossings crossings(const Leaf& leaf, const double* size, const Line<Real>& line) {
  switch (leaf.kind) {
    case Kind::Sphere:
      return sphere::crossings(size, line);
    case Kind::Block:
      return block::crossings(size, line);
    case Kind::Cylinder:
      return cylinder::crossings(size, line);
    case Kind::Cone:
      return cone::crossings(size, line);
    case Kind::Torus:
      switch (leaf.torus) {
        case TorusSolver::Ferrari:
          return torus_ferrari::crossings(size, line);
        case TorusSolver::Algorithm1010:
          return torus_1010::crossings(size, line);
        case TorusSolver::Robust:
          break;
      }
      return torus::crossings(size, line);
  }
  return {};
}

/// In float: in units of the leaf's size, from the line's point nearest its centre, with a direction
/// near 1. What a float cannot hold, the way there and the scale, stays in double; both scales are
/// powers of two.
Crossings single_crossings(const Leaf& leaf, Line<double> line) {
  const double shift = recentre(line);
  const double per_unit = 1 / leaf.unit;
  const double largest = std::max({std::fabs(line.dx), std::fabs(line.dy), std::fabs(line.dz)});
  const double per_speed = std::ldexp(1.0, -std::ilogb(largest));
  const double size[3] = {per_unit * leaf.size[0], per_unit * leaf.size[1], per_unit * leaf.size[2]};
  const auto place = [&](double x) { return static_cast<float>(per_unit * x); };
  const auto speed = [&](double x) {
    return std::fabs(x) < kParallelSingle * largest ? 0 : static_cast<float>(per_speed * x);
  };
  const Line<float> single{place(line.ox), place(line.oy), place(line.oz),
                           speed(line.dx), speed(line.dy), speed(line.dz)};
  return crossings(leaf, size, single).moved(shift, leaf.unit * per_speed);
}

}  // namespace

Crossings crossings(const Leaf& leaf, const Ray& ray) {
  const Approach approach(leaf, ray);
  if (approach.passes(leaf.reach)) return {};
  // From the line's point nearest the centre, so that changing the frame rounds what is small.
  const double shift = approach.along / approach.dd;
  const Vec3 nearest = shift * ray.dir - approach.to_centre;
  const bool moved = leaf.is_translation;
  const Vec3 o = moved ? nearest : leaf.local_from_world * nearest;
  const Vec3 d = moved ? ray.dir : leaf.local_from_world * ray.dir;
  const Line<double> line{o.x, o.y, o.z, d.x, d.y, d.z};
  const Crossings found =
      leaf.precision == Precision::Float32 ? single_crossings(leaf, line) : crossings(leaf, leaf.size, line);
  return found.moved(shift);
}

Vec3 leaf_normal(const Leaf& leaf, std::uint8_t face, const Vec3& p) {
  const Vec3 local = to_local(leaf, p);
  Vec3 gradient;
  switch (leaf.kind) {
    case Kind::Sphere:
      gradient = sphere::gradient(leaf.size, face, local);
      break;
    case Kind::Block:
      gradient = block::gradient(leaf.size, face, local);
      break;
    case Kind::Cylinder:
      gradient = cylinder::gradient(leaf.size, face, local);
      break;
    case Kind::Cone:
      gradient = cone::gradient(leaf.size, face, local);
      break;
    case Kind::Torus:
      gradient = torus::gradient(leaf.size, face, local);
      break;
  }
  return leaf.is_translation ? gradient : transposed_times(leaf.local_from_world, gradient);
}

Vec3 support(const Leaf& leaf, const Vec3& v) {
  const Vec3 local = transposed_times(leaf.world_from_local.linear, v);
  switch (leaf.kind) {
    case Kind::Sphere:
      return leaf.world_from_local * sphere::support(leaf.size, local);
    case Kind::Block:
      return leaf.world_from_local * block::support(leaf.size, local);
    case Kind::Cylinder:
      return leaf.world_from_local * cylinder::support(leaf.size, local);
    case Kind::Cone:
      return leaf.world_from_local * cone::support(leaf.size, local);
    case Kind::Torus:
      return leaf.world_from_local * torus::support(leaf.size, local);
  }
  return {};
}

double local_radius(const Leaf& leaf) {
  const double* size = leaf.size;
  switch (leaf.kind) {
    case Kind::Sphere:
      return size[0];
    case Kind::Block:
      return std::hypot(size[0], size[1], size[2]);
    case Kind::Cylinder:
      return std::hypot(size[0], size[1]);
    case Kind::Cone:
      return std::hypot(std::max(size[0], size[1]), size[2]);
    case Kind::Torus:
      return size[0] + size[1];
  }
  return 0;
}

Class classify(const Leaf& leaf, const Box& box) {
  const Box common = intersection(leaf.bounds, box);
  if (common.empty()) return Class::Empty;
  if (common == leaf.bounds) return Class::Partial;  // all of the leaf lies in the box
  if (leaf.kind == Kind::Torus) {
    const Mat3& local = leaf.local_from_world;
    const Vec3 half = box.half();
    const Mat3 edges{{half.x * local.col[0], half.y * local.col[1], half.z * local.col[2]}};
    const Class kind = torus::classify(leaf.size, to_local(leaf, box.center()), edges, 1);
    if (kind != Class::Partial) return kind;
    return !surely_overlaps(leaf, box) && separated(leaf, box) ? Class::Empty : Class::Partial;
  }
  if (!surely_overlaps(leaf, box) && separated(leaf, box)) return Class::Empty;
  return contains_box(leaf, box) ? Class::Full : Class::Partial;
}

}  // namespace csg
