// What all space subdivisions share: cells that are Empty, Full or Partial, and the compact store of
// the Partial cells' localized trees.
#pragma once
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "../csg/sbound.hpp"
#include "../hit_rule.hpp"
#include "../params.hpp"

namespace csg {

inline constexpr std::size_t kMegabyte = 1'000'000;
/// A structure takes no more bytes than this unless it is told to.
inline constexpr std::size_t kDefaultBudget = 4'000'000'000;

/// Limits of building a structure of cells.
struct BuildLimits {
  int threads = 1;                          ///< that build; 0: one a core
  std::size_t most_bytes = kDefaultBudget;  ///< cells are divided no further once the structure takes this

  static BuildLimits of(const Params& params) {
    return {params.integer("build_threads"), static_cast<std::size_t>(params.integer("budget_mb")) * kMegabyte};
  }
};

/// The declaration of the budget, for schemes that divide space.
inline ParamSpec budget_param() {
  return {.name = "budget_mb",
          .meaning = "cells are divided no further once the structure takes this many megabytes",
          .default_value = static_cast<long>(kDefaultBudget / kMegabyte),
          .minimum = 0,
          .maximum = 1'000'000,
          .trial_values = {static_cast<long>(kDefaultBudget / kMegabyte)},
          .implied_by_default = true};
}

/// A terminal cell: Empty, Full, or the number of a localized tree.
class Cell {
 public:
  static Cell constant(bool full) { return Cell(full ? kFull : kEmpty); }
  static Cell partial(std::size_t tree) { return Cell(static_cast<std::int32_t>(tree)); }
  static Cell decode(std::int32_t code) { return Cell(code); }

  bool is_partial() const { return code_ >= 0; }
  bool is_full() const { return code_ == kFull; }
  std::size_t tree() const { return static_cast<std::size_t>(code_); }
  std::int32_t code() const { return code_; }

  static constexpr std::int32_t kEmpty = -1, kFull = -2;

 private:
  explicit Cell(std::int32_t code) : code_(code) {}
  std::int32_t code_;
};

/// Which S-bounds the localized trees carry: none, of the root, of every node.
enum class Bounds { None, Root, All };

/// How many S-bounds a tree carries.
inline std::size_t sbound_count(Bounds bounds, TreeView tree) {
  return bounds == Bounds::All ? tree.size() : bounds == Bounds::Root ? 1 : 0;
}

/// Makes the S-bounds that trees carry.
class SBoundMaker {
 public:
  SBoundMaker(const CsgTree& model, Bounds bounds, SBoundPasses passes)
      : model_(model), bounds_(bounds), passes_(passes) {}

  /// Appends those of a tree in its cell.
  void add(TreeView tree, const Box& cell, std::vector<SBound>& out) {
    if (bounds_ == Bounds::None) return;
    sbounds(model_, tree, cell, passes_, boxes_);
    for (std::size_t i = 0; i < sbound_count(bounds_, tree); ++i) out.emplace_back(boxes_[i]);
  }

 private:
  const CsgTree& model_;
  Bounds bounds_;
  SBoundPasses passes_;
  std::vector<Box> boxes_;
};

/// Passes a ray through a Partial cell's tree on [t0, t1); true if its search has ended. `sbounds`: those
/// that the tree carries.
template <class Work>
bool pass_tree(TreeView nodes, Bounds bounds, const SBound* sbounds, BoundarySearch<Work>& search, Work& work,
               const Reciprocal& reciprocal, double t0, double t1) {
  if (bounds == Bounds::None) return search.search(nodes, t0, t1);
  const Interval window{t0 - 2 * search.widest_band(), t1 + 2 * search.widest_band()};
  const auto missed = [&](const SBound& bound) {
    work.bound();
    const Interval in = slab(bound.box(), search.ray().origin, reciprocal);
    return !(std::max(in.lo, window.lo) <= std::min(in.hi, window.hi));
  };
  return search.search(nodes, t0, t1, [&](auto visit) {
    if (bounds == Bounds::Root) {
      if (missed(*sbounds)) return;
      for (std::uint32_t i = 0; i < nodes.size(); ++i)
        if (nodes[i].is_leaf()) visit(i);
      return;
    }
    for (std::uint32_t i = 0; i < nodes.size();) {
      if (missed(sbounds[i])) {
        i += static_cast<std::uint32_t>(nodes[i].subtree());
        continue;
      }
      if (nodes[i].is_leaf()) visit(i);
      ++i;
    }
  });
}

/// The localized trees of all Partial cells, back to back.
class CellTrees {
 public:
  CellTrees(const CsgTree& model, Bounds bounds = Bounds::None, SBoundPasses passes = SBoundPasses::One)
      : bounds_(bounds), maker_(model, bounds, passes) {}

  Cell add(TreeView tree, const Box& cell) {
    maker_.add(tree, cell, sbounds_);
    return add_nodes(tree);
  }
  /// With its S-bounds, made before; `sbounds` moves on past them.
  Cell add(TreeView tree, const SBound*& sbounds) {
    const std::size_t count = sbound_count(bounds_, tree);
    sbounds_.insert(sbounds_.end(), sbounds, sbounds + count);
    sbounds += count;
    return add_nodes(tree);
  }
  SBoundMaker maker() const { return maker_; }

  std::size_t count() const { return first_.size() - 1; }
  TreeView tree(std::size_t number) const {
    return {nodes_.data() + first_[number], nodes_.data() + first_[number + 1]};
  }
  /// S-bound of the root of a tree. Precondition: bounds are not None.
  const SBound& root_bound(std::size_t number) const { return *sbounds_of(number); }

  /// Passes a ray through a cell on [t0, t1); true if its search has ended.
  template <class Work>
  bool pass(Cell cell, BoundarySearch<Work>& search, Work& work, const Reciprocal& reciprocal, double t0,
            double t1) const {
    work.cell();
    if (!cell.is_partial()) {
      search.pass_constant(cell.is_full());
      return false;
    }
    return pass_tree(tree(cell.tree()), bounds_, sbounds_of(cell.tree()), search, work, reciprocal, t0, t1);
  }

  void shrink() {
    nodes_.shrink_to_fit();
    first_.shrink_to_fit();
    sbounds_.shrink_to_fit();
  }
  std::size_t bytes() const {
    return nodes_.size() * sizeof(TreeNode) + first_.size() * sizeof(first_[0]) + sbounds_.size() * sizeof(SBound);
  }
  /// That a tree takes here.
  std::size_t bytes_of(TreeView tree) const {
    return tree.size_bytes() + sizeof(first_[0]) + sbound_count(bounds_, tree) * sizeof(SBound);
  }
  void describe(std::map<std::string, double>& facts) const {
    facts["partial_cells"] = static_cast<double>(count());
    const double leaves = (static_cast<double>(nodes_.size()) + static_cast<double>(count())) / 2;
    facts["mean_halfspaces"] = count() ? leaves / static_cast<double>(count()) : 0;
    int most = 0;
    for (std::size_t i = 0; i < count(); ++i) most = std::max(most, leaf_count(tree(i)));
    facts["max_halfspaces"] = most;
  }

 private:
  Cell add_nodes(TreeView tree) {
    nodes_.insert(nodes_.end(), tree.begin(), tree.end());
    first_.push_back(nodes_.size());
    return Cell::partial(first_.size() - 2);
  }
  const SBound* sbounds_of(std::size_t number) const {
    return sbounds_.data() + (bounds_ == Bounds::All ? first_[number] : number);
  }

  Bounds bounds_;
  SBoundMaker maker_;
  std::vector<TreeNode> nodes_;
  std::vector<std::size_t> first_{0};
  std::vector<SBound> sbounds_;  // Bounds::Root: one a tree; Bounds::All: one a node
};

/// Traces a batch through a subdivision of space. `walk(ray, reciprocal, t0, t1, visit)` calls
/// `visit(cell, t0, t1)` for the cells along the ray, in order, with intervals that meet to the bit and
/// fill [t0, t1), until `visit` returns true. `trees.pass` is CellTrees' or another's.
template <class Trees, class Walk>
void trace_cells(const CsgTree& model, const Box& world, const Trees& trees, std::span<const Ray> rays,
                 std::span<Hit> hits, Counters* counters, Walk walk) {
  for_each_ray(rays, hits, counters, [&](const Ray& ray, SearchScratch& scratch, auto& work) {
    BoundarySearch search(model, ray, scratch, work);
    const Reciprocal reciprocal(ray.dir);
    const Interval in = slab(world, ray.origin, reciprocal);
    if (!(in.lo < in.hi) || !(search.skip() < in.hi) || !(in.lo < ray.t_max)) return search.hit();
    if (search.skip() < in.lo) search.pass_constant(false);
    walk(ray, reciprocal, std::max(in.lo, search.skip()), in.hi, [&](auto cell, double t0, double t1) {
      return trees.pass(cell, search, work, reciprocal, t0, t1) || !(t1 < ray.t_max);
    });
    return search.hit();
  });
}

}  // namespace csg
