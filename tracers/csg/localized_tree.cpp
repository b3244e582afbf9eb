// Building localized trees: pruning upwards, then copying what stays.
#include "localized_tree.hpp"

#include <bit>

namespace csg {
namespace {

/// Whether the child adds to its parent's base, or the root is Full, where every leaf is outside.
bool holds_outside(const TreeNode& node) {
  return (!node.is_leaf() && node.base() >= node.threshold()) != node.complemented();
}

/// Fills in what follows from parents and order: sizes of subtrees, and values where all is outside.
void finish(std::vector<TreeNode>& tree) {
  for (TreeNode& node : tree)
    if (!node.is_leaf()) node.set_subtree(1), node.clear_base();
  for (std::uint32_t i = static_cast<std::uint32_t>(tree.size()) - 1; i > 0; --i) {
    const TreeNode& node = tree[i];
    TreeNode& parent = tree[node.parent()];
    parent.set_subtree(parent.subtree() + node.subtree());
    if (holds_outside(node)) parent.add_to_base();
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

std::vector<TreeNode> balanced(TreeView tree) {
  struct Task {
    std::size_t begin, end;  // of `operands`: one that stands for itself, or some of a chain's
    std::uint32_t parent;
    bool is_union;
  };
  std::vector<TreeNode> out;
  out.reserve(tree.size());
  std::vector<std::uint32_t> operands{0}, chain;
  std::vector<Task> todo{{0, 1, 0, true}};
  const auto push_children = [&](std::uint32_t node) {
    const std::uint32_t left = node + 1;
    chain.push_back(left + static_cast<std::uint32_t>(tree[left].subtree()));
    chain.push_back(left);
  };
  while (!todo.empty()) {
    Task task = todo.back();
    todo.pop_back();
    const auto index = static_cast<std::uint32_t>(out.size());
    if (task.end - task.begin == 1) {
      const std::uint32_t node = operands[task.begin];
      out.push_back(tree[node]);
      if (!tree[node].is_leaf()) {
        task = {operands.size(), 0, task.parent, tree[node].is_union()};
        for (push_children(node); !chain.empty();) {
          const std::uint32_t next = chain.back();
          chain.pop_back();
          const bool goes_on = !tree[next].is_leaf() && !tree[next].complemented();
          if (goes_on && tree[next].is_union() == task.is_union)
            push_children(next);
          else
            operands.push_back(next);
        }
        task.end = operands.size();
      }
    } else {
      out.push_back(TreeNode::make_operator(task.is_union));
    }
    out.back().set_parent(task.parent);
    if (out.back().is_leaf()) continue;
    const std::size_t middle = (task.begin + task.end) / 2;
    todo.push_back({middle, task.end, index, task.is_union});
    todo.push_back({task.begin, middle, index, task.is_union});
  }
  finish(out);
  return out;
}

bool Localizer::mark(std::uint32_t node) {
  if (is_marked(node)) return false;
  marks_[node / 64] |= std::uint64_t{1} << node % 64;
  verdicts_[node] = {};
  return true;
}

void Localizer::mark_ancestors(TreeView tree, std::uint32_t node) {
  while (node != 0) {
    const std::uint32_t parent = tree[node].parent();
    const bool first = mark(parent);
    Verdict& verdict = verdicts_[parent];
    ++verdict.visited;
    verdict.visited_base = static_cast<std::uint8_t>(verdict.visited_base + holds_outside(tree[node]));
    if (!first) return;
    node = parent;
  }
}

/// Precondition: all visited nodes below it have been judged.
void Localizer::judge(TreeView tree, std::uint32_t i) {
  const TreeNode& node = tree[i];
  Verdict& verdict = verdicts_[i];
  if (!node.is_leaf()) {
    const int outside = 2 - verdict.visited, holding = node.base() - verdict.visited_base;  // of those not visited
    if (verdict.decided || (node.is_union() ? holding > 0 : holding < outside))
      verdict.result = node.is_union() ? Class::Full : Class::Empty;
    else if (verdict.partial == 0)
      verdict.result = node.is_union() ? Class::Empty : Class::Full;
  }
  if (i == 0) return;
  Verdict& parent = verdicts_[node.parent()];
  if (verdict.result == Class::Partial)
    ++parent.partial;
  else
    parent.decided |= ((verdict.result == Class::Full) != node.complemented()) == tree[node.parent()].is_union();
}

/// Copies what stays. A node with one child left is not copied: it stands for that child, and its
/// complement moves onto the child's edge.
void Localizer::copy(TreeView tree, std::vector<TreeNode>& localized) {
  for (std::size_t i = 0;;) {
    // The next node visited.
    std::size_t word = i / 64;
    if (word >= marks_.size()) break;
    std::uint64_t marked = marks_[word] >> i % 64 << i % 64;
    while (marked == 0 && ++word < marks_.size()) marked = marks_[word];
    if (marked == 0) break;
    i = 64 * word + static_cast<std::size_t>(std::countr_zero(marked));

    const TreeNode& node = tree[i];
    Verdict& verdict = verdicts_[i];
    if (verdict.result != Class::Partial) {
      i += static_cast<std::size_t>(node.subtree());
      continue;
    }
    const Verdict& parent = verdicts_[node.parent()];
    const std::uint32_t above = i == 0 ? 0 : parent.emitted;
    const bool inherited = i != 0 && parent.moved;
    const bool complemented = node.complemented() != inherited;
    if (!node.is_leaf() && verdict.partial == 1) {
      verdict.emitted = above;
      verdict.moved = complemented;
    } else {
      verdict.emitted = static_cast<std::uint32_t>(localized.size());
      localized.push_back(node);
      localized.back().set_parent(above);
      localized.back().set_complemented(complemented);
    }
    ++i;
  }
  finish(localized);
}

Class Localizer::localize(TreeView tree, std::span<const Remaining> remaining, std::vector<TreeNode>& localized) {
  localized.clear();
  if (remaining.empty()) return holds_outside(tree[0]) ? Class::Full : Class::Empty;
  marks_.assign(tree.size() / 64 + 1, 0);
  if (verdicts_.size() < tree.size()) verdicts_.resize(tree.size());
  for (const Remaining& leaf : remaining) {
    mark(leaf.node);
    verdicts_[leaf.node].result = leaf.kind;
    mark_ancestors(tree, leaf.node);
  }
  for (std::size_t word = marks_.size(); word-- > 0;)
    for (std::uint64_t marked = marks_[word]; marked != 0;) {
      const int bit = 63 - std::countl_zero(marked);
      marked ^= std::uint64_t{1} << bit;
      judge(tree, static_cast<std::uint32_t>(64 * word) + static_cast<std::uint32_t>(bit));
    }
  const Class root = verdicts_[0].result;
  if (root != Class::Partial) return (root == Class::Full) != tree[0].complemented() ? Class::Full : Class::Empty;
  copy(tree, localized);
  return Class::Partial;
}

Class CellClassifier::localize(TreeView tree, const Box& cell, std::vector<TreeNode>& localized, double margin) {
  remaining_.clear();
  for (std::uint32_t i = 0; i < tree.size(); ++i) {
    if (!tree[i].is_leaf()) continue;
    const Leaf& leaf = leaf_of(tree[i]);
    const Class kind = classify(leaf, cell.padded(leaf.pad + margin));
    if (kind != Class::Empty) remaining_.push_back({i, kind});
  }
  return localizer_.localize(tree, remaining_, localized);
}

void CellClassifier::localize_octants(TreeView tree, const Box& cell, const Vec3& planes, Class (&kinds)[8],
                                      std::vector<TreeNode> (&localized)[8], double margin) {
  for (std::vector<std::uint32_t>& nodes : in_octant_) nodes.clear();
  for (std::uint32_t i = 0; i < tree.size(); ++i) {
    if (!tree[i].is_leaf()) continue;
    const Leaf& leaf = leaf_of(tree[i]);
    bool low[3], high[3];
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = leaf.bounds.lo[axis] <= planes[axis] + leaf.pad + margin;
      high[axis] = leaf.bounds.hi[axis] >= planes[axis] - leaf.pad - margin;
    }
    for (int k = 0; k < 8; ++k)
      if ((k & 1 ? high : low)[0] && (k & 2 ? high : low)[1] && (k & 4 ? high : low)[2]) in_octant_[k].push_back(i);
  }
  for (int k = 0; k < 8; ++k) {
    const Box box = octant(cell, planes, k);
    remaining_.clear();
    for (const std::uint32_t i : in_octant_[k]) {
      const Leaf& leaf = leaf_of(tree[i]);
      const Class kind = classify(leaf, box.padded(leaf.pad + margin));
      if (kind != Class::Empty) remaining_.push_back({i, kind});
    }
    kinds[k] = localizer_.localize(tree, remaining_, localized[k]);
  }
}

}  // namespace csg
