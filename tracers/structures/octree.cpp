#include "octree.hpp"

#include "subdivision.hpp"

namespace csg {

std::vector<ParamSpec> octree_params() {
  return {{.name = "d",
           .meaning = "maximum level of subdivision; the root is level 0",
           .default_value = 6L,
           .minimum = 0,
           .maximum = Octree::kDeepest,
           .trial_values = {0L, 2L, 5L}},
          {.name = "h",
           .meaning = "a cell of at most this many halfspaces is not divided",
           .default_value = 7L,
           .minimum = 1,
           .maximum = 1000000,
           .trial_values = {1L, 4L, 10L}},
          build_threads_param(),
          budget_param()};
}

OctreeLimits OctreeLimits::of(const Params& params) {
  return {params.integer("d"), params.integer("h"), BuildLimits::of(params)};
}

Box octree_world(const CsgTree& model) {
  const Vec3 centre = model.world().center(), half = model.world().half();
  const double side = std::max({half.x, half.y, half.z});
  return {centre - Vec3{side, side, side}, centre + Vec3{side, side, side}};
}

/// As Subdivision asks for it. A slot is an index into `children_`.
class Octree::Divider {
 public:
  using Place = Box;
  using Parts = CellParts<Box, 8>;
  static constexpr std::size_t kRoot = ~std::size_t{0};  // a slot that is none of them

  Divider(Octree& octree, const CsgTree& model, const OctreeLimits& limits)
      : octree_(octree), model_(model), limits_(limits), classifier_(model) {}

  static const Box& box(const Box& cell) { return cell; }

  Class localize(TreeView tree, const Box& cell, std::vector<TreeNode>& localized) {
    return classifier_.localize(tree, cell, localized, margin_of(cell));
  }
  void divide(TreeView tree, const Box& cell, Parts& parts) {
    for (int i = 0; i < 8; ++i) parts.places[i] = octant(cell, i);
    classifier_.localize_octants(tree, cell, cell.center(), parts.kinds, parts.trees, margin_of(cell) / 2);
  }
  bool divides(TreeView tree, const Box& cell, int level) const { return limits_.divides(model_, tree, cell, level); }

  std::size_t open(std::size_t slot, const Box&) {
    const std::size_t first = octree_.children_.size();
    set_link(slot, static_cast<std::int32_t>(first));
    octree_.children_.resize(first + 8);
    return first;
  }
  void close(std::size_t slot, const Box&, Cell cell) { set_link(slot, link(cell)); }
  std::size_t bytes() const { return octree_.bytes(); }

 private:
  double margin_of(const Box& cell) const { return limits_.margin * cell.half().x; }

  void set_link(std::size_t slot, std::int32_t link) {
    (slot == kRoot ? octree_.root_ : octree_.children_[slot]) = link;
  }

  Octree& octree_;
  const CsgTree& model_;
  OctreeLimits limits_;
  CellClassifier classifier_;
};

Octree::Octree(const CsgTree& model, OctreeLimits limits, Bounds bounds, SBoundPasses passes)
    : world_(octree_world(model)), trees_(model, bounds, passes) {
  if (model.world().empty()) return;
  Subdivision<Divider> subdivision({*this, model, limits}, trees_, limits.build);
  subdivision.build(global_tree(model), world_, Divider::kRoot);
  deepest_level_ = subdivision.deepest_level();
  over_budget_ = subdivision.over_budget();
  children_.shrink_to_fit();
  trees_.shrink();
}

std::map<std::string, double> Octree::facts() const {
  std::map<std::string, double> facts{{"cells", static_cast<double>(children_.size() / 8 * 7 + 1)},
                                      {"divided_cells", static_cast<double>(children_.size() / 8)},
                                      {"deepest_level", deepest_level_}};
  if (over_budget_ > 0) facts["cells_over_budget"] = static_cast<double>(over_budget_);
  trees_.describe(facts);
  return facts;
}

}  // namespace csg
