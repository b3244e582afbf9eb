// The upward, update and downward phases of S-bounds.
#include "sbound.hpp"

namespace csg {
namespace {

/// One up-clip-down pass; true if a box became smaller.
bool pass(TreeView tree, const Box& cell, std::vector<Box>& bound, std::vector<Box>& combined) {
  combined.resize(tree.size());
  for (std::size_t i = 0; i < tree.size(); ++i)
    combined[i] = tree[i].is_leaf() ? bound[i] : tree[i].is_union() ? Box{} : cell;
  for (std::size_t i = tree.size(); i-- > 1;) {
    combined[i] = intersection(combined[i], bound[i]);
    const Box outside = tree[i].complemented() ? cell : combined[i];
    Box& parent = combined[tree[i].parent()];
    parent = tree[tree[i].parent()].is_union() ? hull(parent, outside) : intersection(parent, outside);
  }
  const Box root = intersection(combined[0], bound[0]);
  combined[0] = tree[0].complemented() ? cell : intersection(root, cell);
  bool changed = false;
  for (std::size_t i = 0; i < tree.size(); ++i) {
    if (i > 0) combined[i] = intersection(combined[i], combined[tree[i].parent()]);
    changed = changed || combined[i] != bound[i];
    bound[i] = combined[i];
  }
  return changed;
}

}  // namespace

void sbounds(const CsgTree& model, TreeView tree, const Box& cell, SBoundPasses passes, std::vector<Box>& out) {
  out.resize(tree.size());
  const Box padded_cell = cell.padded(model.pad());
  for (std::size_t i = 0; i < tree.size(); ++i) {
    out[i] = Box::everything();
    if (!tree[i].is_leaf()) continue;
    const Leaf& leaf = model.leaves()[static_cast<std::size_t>(tree[i].leaf())];
    out[i] = leaf.bounds.padded(leaf.pad);
  }
  std::vector<Box> combined;
  // Any number of passes is sound; real trees settle within a few.
  constexpr int kMostPasses = 64;
  const int most = passes == SBoundPasses::One ? 1 : kMostPasses;
  for (int i = 0; i < most && pass(tree, padded_cell, out, combined); ++i) {
  }
}

}  // namespace csg
