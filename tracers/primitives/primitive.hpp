// The five primitives behind one door: crossings, normals, support points, classes of boxes.
#pragma once
#include "../csg/csg_tree.hpp"
#include "../tracer.hpp"
#include "crossings.hpp"

namespace csg {

/// A world point in the leaf's local frame.
inline Vec3 to_local(const Leaf& leaf, const Vec3& p) {
  const Vec3 from_centre = p - leaf.world_from_local.offset;
  return leaf.is_translation ? from_centre : leaf.local_from_world * from_centre;
}

/// Where the whole line of the ray crosses the leaf (rule 1): a pure function of leaf and ray.
Crossings crossings(const Leaf& leaf, const Ray& ray);

/// The leaf's outward normal, world, not normalized, at the point `p` of its piece of surface `face`.
Vec3 leaf_normal(const Leaf& leaf, std::uint8_t face, const Vec3& p);

/// The world point of the leaf's convex hull that is farthest along `v`.
Vec3 support(const Leaf& leaf, const Vec3& v);

/// Distance of the point farthest from the centre, in the local frame.
double local_radius(const Leaf& leaf);

/// Figure 3's classes of a cell with respect to a halfspace.
enum class Class : std::uint8_t { Empty, Partial, Full };

/// Empty or Full only if it holds for the whole closed box; Partial if in doubt.
Class classify(const Leaf& leaf, const Box& box);

}  // namespace csg
