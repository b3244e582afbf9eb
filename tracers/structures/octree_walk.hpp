// The way of a ray through an octree, whatever its cells are stored in.
#pragma once
#include "../slab.hpp"
#include "../tracer.hpp"

namespace csg {

inline constexpr int kDeepestOctree = 20;

/// Front to back through terminal cells. An interval [t0, t1) is cut where the ray crosses a
/// cell's three middle planes, so that neighbours share their ends to the bit and no point on the
/// ray is ever computed. The child is known from which planes lie behind.
///
/// `cells.is_divided(link)` and `cells.child(link, octant)` say what a cell is; `visit(link, t0, t1)`
/// is called for those that are not divided, until it returns true.
template <class Link, class Cells, class Visit>
void walk_octree(const Cells& cells, const Box& world, Link root, const Ray& ray, const Reciprocal& reciprocal,
                 double t0, double t1, Visit visit) {
  struct Task {
    Link link;
    double half, centre[3], t0, t1;
  };
  Task stack[3 * kDeepestOctree + 4];
  int top = 0;
  const Vec3 middle = world.center();
  stack[top++] = {root, world.half().x, {middle.x, middle.y, middle.z}, t0, t1};
  while (top > 0) {
    const Task task = stack[--top];
    if (!cells.is_divided(task.link)) {
      if (visit(task.link, task.t0, task.t1)) return;
      continue;
    }
    // The child at t0, and the cuts in ascending order.
    int child = 0;
    double cut[3];
    int axis_of[3], cuts = 0;
    for (int axis = 0; axis < 3; ++axis) {
      if (reciprocal.parallel[axis]) {
        child |= (ray.origin[axis] >= task.centre[axis]) << axis;
        continue;
      }
      const double t = reciprocal.plane(axis, task.centre[axis], ray.origin);
      const bool forward = reciprocal.forward[axis];
      child |= ((task.t0 < t) != forward) << axis;
      if (!(task.t0 < t && t < task.t1)) continue;
      int at = cuts++;
      for (; at > 0 && cut[at - 1] > t; --at) cut[at] = cut[at - 1], axis_of[at] = axis_of[at - 1];
      cut[at] = t, axis_of[at] = axis;
    }
    Task part[4];
    int parts = 0;
    double from = task.t0;
    for (int i = 0; i <= cuts; ++i) {
      const double to = i < cuts ? cut[i] : task.t1;
      if (from < to) {
        Task& next = part[parts++];
        next.link = cells.child(task.link, child);
        next.half = 0.5 * task.half;
        for (int axis = 0; axis < 3; ++axis)
          next.centre[axis] = task.centre[axis] + (child >> axis & 1 ? next.half : -next.half);
        next.t0 = from, next.t1 = to;
      }
      if (i < cuts) child ^= 1 << axis_of[i];
      from = to;
    }
    while (parts > 0) stack[top++] = part[--parts];
  }
}

}  // namespace csg
