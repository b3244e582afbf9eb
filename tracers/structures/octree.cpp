#include "octree.hpp"

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
           .trial_values = {1L, 4L, 10L}}};
}

namespace {

/// A cube: cells of equal sides fit the primitives best, and d then means the same on every axis.
Box cube_around(const Box& box) {
  const Vec3 centre = box.center(), half = box.half();
  const double side = std::max({half.x, half.y, half.z});
  return {centre - Vec3{side, side, side}, centre + Vec3{side, side, side}};
}

}  // namespace

/// Divides cells top down. Recursion is no deeper than d.
class Octree::Builder {
 public:
  Builder(Octree& octree, const CsgTree& model, OctreeLimits limits)
      : octree_(octree),
        model_(model),
        limits_(limits),
        classifier_(model),
        trees_of_level_(static_cast<std::size_t>(limits.d) + 1) {}

  std::int32_t divide(TreeView parent_tree, const Box& cell, int level) {
    std::vector<TreeNode>& tree = trees_of_level_[static_cast<std::size_t>(level)];
    octree_.deepest_level_ = std::max(octree_.deepest_level_, level);
    const Class kind = classifier_.localize(parent_tree, cell, tree, limits_.margin * cell.half().x);
    if (kind != Class::Partial) return link(Cell::constant(kind == Class::Full));
    // A cell hardly thicker than the pad of classes has nothing to gain from being divided.
    const bool thin = cell.half().x < 8 * model_.pad();
    if (level == limits_.d || leaf_count(tree) <= limits_.h || thin) return link(octree_.trees_.add(tree, cell));
    const std::size_t first = octree_.children_.size();
    octree_.children_.resize(first + 8);
    for (int child = 0; child < 8; ++child) {
      const std::int32_t made = divide(tree, child_box(cell, child), level + 1);
      octree_.children_[first + static_cast<std::size_t>(child)] = made;
    }
    return static_cast<std::int32_t>(first);
  }

 private:
  Octree& octree_;
  const CsgTree& model_;
  OctreeLimits limits_;
  CellClassifier classifier_;
  std::vector<std::vector<TreeNode>> trees_of_level_;
};

Octree::Octree(const CsgTree& model, OctreeLimits limits, Bounds bounds, SBoundPasses passes)
    : world_(cube_around(model.world())), trees_(model, bounds, passes) {
  if (model.world().empty()) return;
  root_ = Builder(*this, model, limits).divide(global_tree(model), world_, 0);
  children_.shrink_to_fit();
  trees_.shrink();
}

std::map<std::string, double> Octree::facts() const {
  std::map<std::string, double> facts{{"cells", static_cast<double>(children_.size() / 8 * 7 + 1)},
                                      {"deepest_level", deepest_level_}};
  trees_.describe(facts);
  return facts;
}

}  // namespace csg
