// Building localized trees: pruning upwards, then copying what stays.
#include "localized_tree.hpp"

namespace csg {
namespace {

/// Fills in what follows from parents and order: sizes of subtrees, and values where all is outside.
void finish(std::vector<TreeNode>& tree) {
  for (TreeNode& node : tree)
    if (!node.is_leaf()) node.set_subtree(1), node.clear_base();
  for (std::uint32_t i = static_cast<std::uint32_t>(tree.size()) - 1; i > 0; --i) {
    const TreeNode& node = tree[i];
    TreeNode& parent = tree[node.parent()];
    parent.set_subtree(parent.subtree() + node.subtree());
    const bool holds = !node.is_leaf() && node.base() >= node.threshold();
    if (holds != node.complemented()) parent.add_to_base();
  }
}

}  // namespace

std::vector<TreeNode> global_tree(const CsgTree& source) {
  const std::vector<Node>& nodes = source.nodes();
  if (nodes.size() >= (1u << 28)) throw ModelError("the model has more than 2^28 nodes");
  struct Task {
    std::int32_t node;
    std::uint32_t parent;
    bool complemented;
  };
  std::vector<TreeNode> tree;
  tree.reserve(nodes.size());
  std::vector<Task> todo{{static_cast<std::int32_t>(nodes.size()) - 1, 0, false}};
  while (!todo.empty()) {
    const Task task = todo.back();
    todo.pop_back();
    const Node& node = nodes[static_cast<std::size_t>(task.node)];
    const auto index = static_cast<std::uint32_t>(tree.size());
    tree.push_back(node.op == Op::Leaf ? TreeNode::make_leaf(node.left)
                                       : TreeNode::make_operator(node.op == Op::Union));
    tree.back().set_parent(task.parent);
    tree.back().set_complemented(task.complemented);
    if (node.op == Op::Leaf) continue;
    todo.push_back({node.right, index, node.op == Op::Difference});
    todo.push_back({node.left, index, false});
  }
  finish(tree);
  return tree;
}

Class Localizer::localize(TreeView tree, std::span<const Class> class_of, std::vector<TreeNode>& localized) {
  verdicts_.assign(tree.size(), {});
  std::size_t leaf = class_of.size();
  for (std::size_t i = tree.size(); i-- > 0;) {
    const TreeNode& node = tree[i];
    Verdict& verdict = verdicts_[i];
    if (node.is_leaf())
      verdict.result = class_of[--leaf];
    else if (verdict.decided)
      verdict.result = node.is_union() ? Class::Full : Class::Empty;
    else if (verdict.partial == 0)
      verdict.result = node.is_union() ? Class::Empty : Class::Full;
    if (i == 0) break;
    Verdict& parent = verdicts_[node.parent()];
    if (verdict.result == Class::Partial)
      ++parent.partial;
    else
      parent.decided |= ((verdict.result == Class::Full) != node.complemented()) == tree[node.parent()].is_union();
  }

  localized.clear();
  const bool flip = tree[0].complemented();
  if (verdicts_[0].result != Class::Partial)
    return (verdicts_[0].result == Class::Full) != flip ? Class::Full : Class::Empty;

  // Copy what stays. A node with one child left is not copied: it stands for that child, `emitted_`
  // then names the nearest copied ancestor, and its complement moves onto the child's edge.
  emitted_.resize(tree.size());
  moved_.assign(tree.size(), 0);
  for (std::size_t i = 0; i < tree.size();) {
    const TreeNode& node = tree[i];
    const Verdict& verdict = verdicts_[i];
    if (verdict.result != Class::Partial) {
      i += static_cast<std::size_t>(node.subtree());
      continue;
    }
    const bool stands_for_child = !node.is_leaf() && verdict.partial == 1;
    const std::uint32_t above = i == 0 ? 0 : emitted_[node.parent()];
    const bool inherited = i != 0 && moved_[node.parent()];
    const bool complemented = node.complemented() != inherited;
    if (stands_for_child) {
      emitted_[i] = above;
      moved_[i] = complemented;
    } else {
      emitted_[i] = static_cast<std::uint32_t>(localized.size());
      localized.push_back(node);
      localized.back().set_parent(above);
      localized.back().set_complemented(complemented);
    }
    ++i;
  }
  finish(localized);
  return Class::Partial;
}

Class CellClassifier::localize(TreeView tree, const Box& cell, std::vector<TreeNode>& localized, double margin) {
  classes_.clear();
  for (const TreeNode& node : tree) {
    if (!node.is_leaf()) continue;
    const Leaf& leaf = tree_.leaves()[static_cast<std::size_t>(node.leaf())];
    classes_.push_back(classify(leaf, cell.padded(leaf.pad + margin)));
  }
  return localizer_.localize(tree, classes_, localized);
}

}  // namespace csg
