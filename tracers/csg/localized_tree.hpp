// Localized CSG trees: what is left of the tree inside one cell (the paper's section 3.1.2).
//
// Figure 3 in three lines: a node is a union (true where at least 1 child is) or an intersection
// (where 2 are), and each edge to a parent may complement: A − B is A ∩ ¬B. With that, all 27 rows,
// the 5 missing ones included, are one rule: a child that decides its parent absorbs it, a child
// that is neutral leaves the other in the parent's place. `Full − Partial` thereby becomes the
// complemented right tree, and no Full literal is needed.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "../error_unit.hpp"
#include "../primitives/primitive.hpp"
#include "csg_tree.hpp"

namespace csg {

/// Eight bytes a node, in pre-order: a subtree is the run of `subtree()` nodes from its root.
class TreeNode {
 public:
  static TreeNode make_leaf(std::int32_t leaf) { return {leaf, 0}; }
  static TreeNode make_operator(bool is_union) { return {-1, is_union ? 0 : kTwo}; }

  bool is_leaf() const { return link_ >= 0; }
  std::int32_t leaf() const { return link_; }
  int subtree() const { return is_leaf() ? 1 : -link_; }
  std::uint32_t parent() const { return packed_ >> 4; }
  bool complemented() const { return packed_ & kComplement; }
  bool is_union() const { return !(packed_ & kTwo); }
  /// How many children must hold for the node to hold.
  int threshold() const { return is_union() ? 1 : 2; }
  /// How many children hold where every leaf is outside.
  int base() const { return static_cast<int>(packed_ & kBase); }

  void set_subtree(int nodes) { link_ = -nodes; }
  void set_parent(std::uint32_t node) { packed_ = (packed_ & 15u) | node << 4; }
  void set_complemented(bool on) { packed_ = on ? packed_ | kComplement : packed_ & ~kComplement; }
  void add_to_base() { ++packed_; }
  void clear_base() { packed_ &= ~kBase; }

 private:
  static constexpr std::uint32_t kBase = 3, kTwo = 4, kComplement = 8;
  TreeNode(std::int32_t link, std::uint32_t packed) : link_(link), packed_(packed) {}
  std::int32_t link_;     // leaf index, or −(nodes of the subtree)
  std::uint32_t packed_;  // parent << 4 | complemented | needs two | base
};

using TreeView = std::span<const TreeNode>;

/// The whole tree in this form. Throws ModelError past 2²⁸ nodes.
std::vector<TreeNode> global_tree(const CsgTree& tree);

/// The same solid, with each chain of one operator as a balanced tree over the chain's operands, in their order.
std::vector<TreeNode> balanced(TreeView tree);

/// A leaf node that is not Empty, and its class.
struct Remaining {
  std::uint32_t node;
  Class kind;
};

/// Simplifies a tree, knowing of its leaves which are Partial or Full. Only these and the operators
/// above them are visited, the others by what they are worth where all is outside (`TreeNode::base`):
/// a cell costs what is in it, not what is in its parent.
class Localizer {
 public:
  /// `remaining`: in the order of the nodes. Returns the class of the solid in the cell; if Partial,
  /// `localized` holds what is left. No recursion.
  Class localize(TreeView tree, std::span<const Remaining> remaining, std::vector<TreeNode>& localized);

 private:
  struct Verdict {
    std::uint8_t visited = 0, visited_base = 0;  // children visited; of these, how many add to the node's base
    std::uint8_t partial = 0;                    // children that stay
    bool decided = false;                        // a child decides the node
    bool moved = false;                          // it stands for its one child, whose edge it complements
    Class result = Class::Partial;
    std::uint32_t emitted = 0;  // its place, or that of the nearest ancestor that has one
  };

  bool is_marked(std::uint32_t node) const { return marks_[node / 64] >> node % 64 & 1; }
  bool mark(std::uint32_t node);
  void mark_ancestors(TreeView tree, std::uint32_t node);
  void judge(TreeView tree, std::uint32_t node);
  void copy(TreeView tree, std::vector<TreeNode>& localized);

  std::vector<std::uint64_t> marks_;  // a bit a node: visited
  std::vector<Verdict> verdicts_;     // of the nodes visited
};

/// Localizes a tree to a cell, classifying its leaves by their own geometry.
class CellClassifier {
 public:
  explicit CellClassifier(const CsgTree& tree) : tree_(tree) {}

  /// `cell` without pad; the classes hold for the cell grown by P (rule 9) and by `margin`.
  Class localize(TreeView tree, const Box& cell, std::vector<TreeNode>& localized, double margin = 0);

  /// The same for the octants of a cell: bounds are compared with the three planes that divide it once for
  /// all eight. Octant i lies above the planes on the axes whose bits are set; a plane at infinity leaves
  /// nothing above it.
  void localize_octants(TreeView tree, const Box& cell, const Vec3& planes, Class (&kinds)[8],
                        std::vector<TreeNode> (&localized)[8], double margin = 0);

 private:
  const Leaf& leaf_of(const TreeNode& node) const { return tree_.leaves()[static_cast<std::size_t>(node.leaf())]; }

  const CsgTree& tree_;
  Localizer localizer_;
  std::vector<Remaining> remaining_;
  std::vector<std::uint32_t> in_octant_[8];
};

/// Octant i of a box that is divided by three planes.
inline Box octant(const Box& box, const Vec3& planes, int i) {
  Box out = box;
  for (int axis = 0; axis < 3; ++axis)
    if (i >> axis & 1)
      out.lo[axis] = planes[axis];
    else
      out.hi[axis] = std::min(out.hi[axis], planes[axis]);
  return out;
}
/// By those through its middle.
inline Box octant(const Box& box, int i) { return octant(box, box.center(), i); }

inline int leaf_count(TreeView tree) { return (static_cast<int>(tree.size()) + 1) / 2; }

/// The tree's value while a ray crosses its leaves one by one. A toggle climbs only as far as values
/// change. `Work` counts the operators that it evaluates.
class TreeState {
 public:
  /// All leaves outside. Where the tree is the one before, only what was touched is put back.
  void reset(TreeView tree) {
    if (tree.data() == tree_.data() && tree.size() == tree_.size()) {
      for (const std::uint32_t node : touched_) holding_[node] = static_cast<std::uint8_t>(tree[node].base());
    } else {
      tree_ = tree;
      holding_.resize(tree.size());
      for (std::size_t i = 0; i < tree.size(); ++i) holding_[i] = static_cast<std::uint8_t>(tree[i].base());
    }
    touched_.clear();
    inside_ = (!tree[0].is_leaf() && holding_[0] >= tree[0].threshold()) != tree[0].complemented();
  }

  bool inside() const { return inside_; }

  /// Crosses the surface of the leaf at `node`.
  template <class Work>
  void toggle(std::uint32_t node, Work& work) {
    bool holds = holding_[node] ^= 1;
    touched_.push_back(node);
    while (node != 0) {
      const TreeNode& child = tree_[node];
      node = child.parent();
      const int threshold = tree_[node].threshold();
      const bool before = holding_[node] >= threshold;
      touched_.push_back(node);
      holding_[node] = static_cast<std::uint8_t>(holding_[node] + (holds != child.complemented() ? 1 : -1));
      holds = holding_[node] >= threshold;
      work.boolean();
      if (holds == before) return;
    }
    inside_ = holds != tree_[0].complemented();
  }

 private:
  TreeView tree_;
  std::vector<std::uint32_t> touched_;
  std::vector<std::uint8_t> holding_;  // of a leaf: 1 inside; of an operator: children that hold
  bool inside_ = false;
};

}  // namespace csg
