// SDSM, the Spatially Divided Solid Model: an octree of localized CSG trees (the paper's section
// 3.1.3), shared by sdsm, hybrid_sdsm and embree_cells.
#pragma once
#include "../params.hpp"
#include "cells.hpp"

namespace csg {

/// Limits of the subdivision: the paper's d and h.
struct OctreeLimits {
  int d;  ///< maximum level; the root is level 0
  int h;  ///< a cell with this many halfspaces, or fewer, is not divided
  double margin = 0;  ///< cells' trees hold so far around them, in halves of their sides, besides P
};

/// The declarations of d and h, for schemes built on the octree.
std::vector<ParamSpec> octree_params();

class Octree {
 public:
  Octree(const CsgTree& model, OctreeLimits limits, Bounds bounds = Bounds::None,
         SBoundPasses passes = SBoundPasses::One);

  /// A link: eight children, or a terminal cell.
  using Link = std::int32_t;
  Link root() const { return root_; }
  static bool is_cell(Link link) { return link < 0; }
  static Cell cell(Link link) { return cell_of(link); }
  Link child(Link link, int number) const { return children_[static_cast<std::size_t>(link + number)]; }
  static Box child_box(const Box& box, int child) {
    const Vec3 centre = box.center();
    Box out = box;
    for (int axis = 0; axis < 3; ++axis) (child >> axis & 1 ? out.lo : out.hi)[axis] = centre[axis];
    return out;
  }

  const Box& world() const { return world_; }
  const CellTrees& trees() const { return trees_; }

  /// Calls `visit(cell, box)` for each Partial cell.
  template <class Visit>
  void for_each_partial(Visit visit) const {
    std::vector<std::pair<std::int32_t, Box>> todo{{root_, world_}};
    while (!todo.empty()) {
      const auto [link, box] = todo.back();
      todo.pop_back();
      if (link >= 0)
        for (int child = 0; child < 8; ++child)
          todo.emplace_back(children_[static_cast<std::size_t>(link + child)], child_box(box, child));
      else if (cell_of(link).is_partial())
        visit(cell_of(link), box);
    }
  }

  /// Front to back through terminal cells. An interval [t0, t1) is cut where the ray crosses a
  /// cell's three middle planes, so that neighbours share their ends to the bit and no point on the
  /// ray is ever computed. The child is known from which planes lie behind.
  template <class Visit>
  void walk(const Ray& ray, const Reciprocal& reciprocal, double t0, double t1, Visit visit) const {
    struct Task {
      std::int32_t link;
      double half, centre[3], t0, t1;
    };
    Task stack[3 * kDeepest + 4];
    int top = 0;
    const Vec3 middle = world_.center();
    stack[top++] = {root_, world_.half().x, {middle.x, middle.y, middle.z}, t0, t1};
    while (top > 0) {
      const Task task = stack[--top];
      if (task.link < 0) {
        if (visit(cell_of(task.link), task.t0, task.t1)) return;
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
          next.link = children_[static_cast<std::size_t>(task.link) + static_cast<std::size_t>(child)];
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

  std::size_t bytes() const { return children_.size() * sizeof(children_[0]) + trees_.bytes(); }
  std::map<std::string, double> facts() const;

  static constexpr int kDeepest = 20;

 private:
  class Builder;

  // A link to a cell: ≥ 0 the first of its eight children; else Empty, Full, or a tree.
  static constexpr std::int32_t kEmptyLink = -1, kFullLink = -2, kFirstPartial = -3;
  static std::int32_t link(Cell cell) {
    return cell.is_partial() ? kFirstPartial - cell.code() : cell.is_full() ? kFullLink : kEmptyLink;
  }
  static Cell cell_of(std::int32_t link) {
    return link <= kFirstPartial ? Cell::partial(static_cast<std::size_t>(kFirstPartial - link))
                                 : Cell::constant(link == kFullLink);
  }

  Box world_;
  std::int32_t root_ = kEmptyLink;
  std::vector<std::int32_t> children_;
  CellTrees trees_;
  int deepest_level_ = 0;
};

}  // namespace csg
