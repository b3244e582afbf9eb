// S-bounds (Cameron 1991; the paper's section 3.1.4 and Figure 5): a box for every node of a
// localized tree, outside of which the node cannot matter to the cell.
//
// Upwards, boxes combine by Figure 5 (a complemented child is bounded by the cell alone); the root
// is clipped to the cell; downwards, a child is clipped to its parent. Repeating both, with
// B ← B_old ∩ combine(children), reaches a fixed point that one pass misses on some trees.
//
// How a tracer may use them: a subtree whose box the ray misses is taken as "all leaves outside",
// without testing them. That never changes the root inside the cell, because (1) a node so
// evaluated is false outside its upward box, whatever is skipped below it, and (2) inside its final
// box it is right: a child missed there is false in truth as well. Nothing needs to be clipped.
#pragma once
#include <cmath>
#include <vector>

#include "localized_tree.hpp"

namespace csg {

/// A box in float, rounded outwards: 24 bytes.
struct SBound {
  float lo[3], hi[3];

  SBound() = default;
  explicit SBound(const Box& box) {
    constexpr float kMax = std::numeric_limits<float>::infinity();
    for (int axis = 0; axis < 3; ++axis) {
      lo[axis] = static_cast<float>(box.lo[axis]);
      hi[axis] = static_cast<float>(box.hi[axis]);
      if (lo[axis] > box.lo[axis]) lo[axis] = std::nextafter(lo[axis], -kMax);
      if (hi[axis] < box.hi[axis]) hi[axis] = std::nextafter(hi[axis], kMax);
    }
  }
  Box box() const { return {{lo[0], lo[1], lo[2]}, {hi[0], hi[1], hi[2]}}; }
};

/// How often the up-clip-down pass is made.
enum class SBoundPasses { One, FixedPoint };

/// Box of every node of `tree`, in its order, within `cell`; leaves' boxes are grown by P first.
void sbounds(const CsgTree& model, TreeView tree, const Box& cell, SBoundPasses passes, std::vector<Box>& out);

}  // namespace csg
