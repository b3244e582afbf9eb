// What all space subdivisions share: cells that are Empty, Full or Partial, and the compact store of
// the Partial cells' localized trees.
#pragma once
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "../csg/sbound.hpp"
#include "../hit_rule.hpp"

namespace csg {

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

/// The localized trees of all Partial cells, back to back.
class CellTrees {
 public:
  CellTrees(const CsgTree& model, Bounds bounds = Bounds::None, SBoundPasses passes = SBoundPasses::One)
      : model_(&model), bounds_(bounds), passes_(passes) {}

  /// Throws std::runtime_error when the trees outgrow kMostBytes.
  Cell add(TreeView tree, const Box& cell) {
    if (bytes() > kMostBytes)
      throw std::runtime_error("the structure would exceed 4 GiB: divide less (d, n) or raise h");
    nodes_.insert(nodes_.end(), tree.begin(), tree.end());
    first_.push_back(nodes_.size());
    if (bounds_ != Bounds::None) {
      sbounds(*model_, tree, cell, passes_, boxes_);
      const std::size_t kept = bounds_ == Bounds::All ? boxes_.size() : 1;
      for (std::size_t i = 0; i < kept; ++i) sbounds_.emplace_back(boxes_[i]);
    }
    return Cell::partial(first_.size() - 2);
  }

  std::size_t count() const { return first_.size() - 1; }
  TreeView tree(std::size_t number) const {
    return {nodes_.data() + first_[number], nodes_.data() + first_[number + 1]};
  }
  /// S-bound of the root of a tree. Precondition: bounds are not None.
  const SBound& root_bound(std::size_t number) const {
    return sbounds_[bounds_ == Bounds::All ? first_[number] : number];
  }

  /// Passes a ray through a cell on [t0, t1); true if its search has ended.
  template <class Work>
  bool pass(Cell cell, BoundarySearch<Work>& search, Work& work, const Reciprocal& reciprocal, double t0,
            double t1) const {
    work.cell();
    if (!cell.is_partial()) {
      search.pass_constant(cell.is_full());
      return false;
    }
    const TreeView nodes = tree(cell.tree());
    if (bounds_ == Bounds::None) return search.search(nodes, t0, t1);
    const Interval window{t0 - 2 * search.widest_band(), t1 + 2 * search.widest_band()};
    const auto missed = [&](const SBound& bound) {
      work.bound();
      const Interval in = slab(bound.box(), search.ray().origin, reciprocal);
      return !(std::max(in.lo, window.lo) <= std::min(in.hi, window.hi));
    };
    return search.search(nodes, t0, t1, [&](auto visit) {
      if (bounds_ == Bounds::Root) {
        if (missed(sbounds_[cell.tree()])) return;
        for (std::uint32_t i = 0; i < nodes.size(); ++i)
          if (nodes[i].is_leaf()) visit(i);
        return;
      }
      const SBound* bounds = sbounds_.data() + first_[cell.tree()];
      for (std::uint32_t i = 0; i < nodes.size();) {
        if (missed(bounds[i])) {
          i += static_cast<std::uint32_t>(nodes[i].subtree());
          continue;
        }
        if (nodes[i].is_leaf()) visit(i);
        ++i;
      }
    });
  }

  static constexpr std::size_t kMostBytes = std::size_t{4} << 30;

  void shrink() {
    nodes_.shrink_to_fit();
    first_.shrink_to_fit();
    sbounds_.shrink_to_fit();
  }
  std::size_t bytes() const {
    return nodes_.size() * sizeof(TreeNode) + first_.size() * sizeof(first_[0]) + sbounds_.size() * sizeof(SBound);
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
  const CsgTree* model_;
  Bounds bounds_;
  SBoundPasses passes_;
  std::vector<TreeNode> nodes_;
  std::vector<std::size_t> first_{0};
  std::vector<SBound> sbounds_;  // Bounds::Root: one a tree; Bounds::All: one a node
  std::vector<Box> boxes_;
};

/// Traces a batch through a subdivision of space. `walk(ray, reciprocal, t0, t1, visit)` calls
/// `visit(cell, t0, t1)` for the cells along the ray, in order, with intervals that meet to the bit and
/// fill [t0, t1), until `visit` returns true.
template <class Walk>
void trace_cells(const CsgTree& model, const Box& world, const CellTrees& trees, std::span<const Ray> rays,
                 std::span<Hit> hits, Counters* counters, Walk walk) {
  for_each_ray(rays, hits, counters, [&](const Ray& ray, SearchScratch& scratch, auto& work) {
    BoundarySearch search(model, ray, scratch, work);
    const Reciprocal reciprocal(ray.dir);
    const Interval in = slab(world, ray.origin, reciprocal);
    if (!(in.lo < in.hi) || !(search.skip() < in.hi) || !(in.lo < ray.t_max)) return search.hit();
    if (search.skip() < in.lo) search.pass_constant(false);
    walk(ray, reciprocal, std::max(in.lo, search.skip()), in.hi, [&](Cell cell, double t0, double t1) {
      return trees.pass(cell, search, work, reciprocal, t0, t1) || !(t1 < ray.t_max);
    });
    return search.hit();
  });
}

}  // namespace csg
