// The octree of localized trees, built as rays need it: what no ray enters is never modelled.
//
// A cell that a ray enters for the first time is divided, its octants' trees localized; or, if the limits
// say that it is not to be divided, its S-bounds are made. Cells are those of octree.hpp for the same
// limits, so that rays get the same answers to the bit, in whatever order they come and by however many
// threads. The first thread to enter a cell builds it; others that come to it wait. A budget counts what
// has been built so far, so which cells it leaves undivided depends on the rays; the answers do not.
#pragma once
#include <atomic>

#include "../pool.hpp"
#include "octree.hpp"

namespace csg {

/// A cell of the LazyOctree. What `state` says is there may be read by all threads.
struct LazyCell {
  enum class State : std::uint8_t { Pending, Building, Constant, Partial, Divided };

  std::atomic<State> state = State::Pending;
  bool is_full = false;                 // of a Constant one
  std::uint8_t level = 0;               // the root's is 0
  std::uint64_t path = 0;               // the octants taken from the root, three bits each, the last one lowest
  std::vector<TreeNode> tree;           // of a Pending or Partial one
  std::vector<SBound> sbounds;          // of a Partial one
  std::unique_ptr<LazyCell[]> octants;  // of a Divided one: eight
};

class LazyOctree {
 public:
  LazyOctree(const CsgTree& model, OctreeLimits limits, Bounds bounds = Bounds::None,
             SBoundPasses passes = SBoundPasses::One);

  const Box& world() const { return world_; }

  /// See octree_walk.hpp; `visit(cell, t0, t1)`.
  template <class Visit>
  void walk(const Ray& ray, const Reciprocal& reciprocal, double t0, double t1, Visit visit) const {
    struct Cells {
      const LazyOctree& octree;
      bool is_divided(LazyCell* cell) const {
        const State state = cell->state.load(std::memory_order_acquire);
        return (state > State::Building ? state : octree.built(*cell)) == State::Divided;
      }
      LazyCell* child(LazyCell* cell, int i) const { return &cell->octants[static_cast<std::size_t>(i)]; }
    };
    walk_octree(Cells{*this}, world_, root_.get(), ray, reciprocal, t0, t1, visit);
  }

  /// Passes a ray through a cell on [t0, t1); true if its search has ended.
  template <class Work>
  bool pass(const LazyCell* cell, BoundarySearch<Work>& search, Work& work, const Reciprocal& reciprocal, double t0,
            double t1) const {
    work.cell();
    if (cell->state.load(std::memory_order_relaxed) == State::Constant) {
      search.pass_constant(cell->is_full);
      return false;
    }
    return pass_tree(cell->tree, bounds_, cell->sbounds.data(), search, work, reciprocal, t0, t1);
  }

  // Of what has been built so far. Precondition: no ray is being traced.
  std::size_t bytes() const;
  std::map<std::string, double> facts() const;

 private:
  using State = LazyCell::State;

  /// What a thread needs to build a cell; used again, so that its memory is.
  struct Workshop {
    CellClassifier classifier;
    SBoundMaker maker;
    Class kinds[8];
    std::vector<TreeNode> trees[8];
    std::vector<SBound> sbounds;
  };

  State built(LazyCell& cell) const;
  State build(LazyCell& cell, Workshop& workshop) const;
  void divide(LazyCell& cell, const Box& box, Workshop& workshop) const;
  Box box_of(const LazyCell& cell) const;
  std::size_t bytes_of(const LazyCell& cell) const;
  template <class Visit>
  void for_each_cell(Visit visit) const;

  const CsgTree& model_;
  OctreeLimits limits_;
  Bounds bounds_;
  SBoundPasses passes_;
  Box world_;
  std::unique_ptr<LazyCell> root_;
  mutable std::atomic<std::size_t> committed_ = 0;  // bytes
  mutable std::atomic<std::size_t> over_budget_ = 0;
  mutable Pool<Workshop> workshops_;
};

}  // namespace csg
