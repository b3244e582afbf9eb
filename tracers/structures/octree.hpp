// SDSM, the Spatially Divided Solid Model: an octree of localized CSG trees (the paper's section
// 3.1.3), shared by sdsm, hybrid_sdsm, embree_cells and sphere_tracing. Built whole, before the first ray;
// lazy_octree.hpp is the same octree built as rays need it.
#pragma once
#include "../params.hpp"
#include "cells.hpp"
#include "octree_walk.hpp"

namespace csg {

/// Limits of the subdivision: the paper's d and h; and of building it.
struct OctreeLimits {
  int d;  ///< maximum level; the root is level 0
  int h;  ///< a cell with this many halfspaces, or fewer, is not divided
  BuildLimits build{};
  double margin = 0;  ///< cells' trees hold so far around them, in halves of their sides, besides P

  static OctreeLimits of(const Params& params);

  /// Whether a Partial cell is to be divided. One hardly thicker than the pad of classes has nothing to
  /// gain from it.
  bool divides(const CsgTree& model, TreeView tree, const Box& cell, int level) const {
    return level < d && leaf_count(tree) > h && !(cell.half().x < 8 * model.pad());
  }
};

/// The declarations of d, h and the limits of building, for schemes built on the octree.
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
        for (int i = 0; i < 8; ++i) todo.emplace_back(children_[static_cast<std::size_t>(link + i)], octant(box, i));
      else if (cell_of(link).is_partial())
        visit(cell_of(link), box);
    }
  }

  /// See octree_walk.hpp; `visit(cell, t0, t1)`.
  template <class Visit>
  void walk(const Ray& ray, const Reciprocal& reciprocal, double t0, double t1, Visit visit) const {
    struct Cells {
      const std::int32_t* children;
      bool is_divided(std::int32_t link) const { return link >= 0; }
      std::int32_t child(std::int32_t link, int i) const {
        return children[static_cast<std::size_t>(link) + static_cast<std::size_t>(i)];
      }
    };
    walk_octree(Cells{children_.data()}, world_, root_, ray, reciprocal, t0, t1,
                [&](std::int32_t link, double from, double to) { return visit(cell_of(link), from, to); });
  }

  /// Passes a ray through a cell on [t0, t1); true if its search has ended.
  template <class Work>
  bool pass(Cell cell, BoundarySearch<Work>& search, Work& work, const Reciprocal& reciprocal, double t0,
            double t1) const {
    return trees_.pass(cell, search, work, reciprocal, t0, t1);
  }

  std::size_t bytes() const { return children_.size() * sizeof(children_[0]) + trees_.bytes(); }
  std::map<std::string, double> facts() const;

  static constexpr int kDeepest = kDeepestOctree;

 private:
  class Divider;

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
  std::size_t over_budget_ = 0;  // cells not divided for want of memory
};

/// The octree's root: a cube around the model's world. Cells of equal sides fit the primitives best, and
/// d then means the same on every axis.
Box octree_world(const CsgTree& model);

}  // namespace csg
