// Operators with any number of operands, as OpenSCAD writes them, made binary.
#pragma once
#include <cstdint>
#include <vector>

#include "csg_tree.hpp"
#include "loader.hpp"

namespace csg {

/// In pre-order: an operator's operands start at the next item, and each ends where the next one
/// begins. No operator is without operands; one with a single operand is that operand.
struct NaryItem {
  Op op = Op::Leaf;
  std::uint32_t leaf = 0;
  std::uint32_t end = 0;  ///< index past the item's descendants
};

/// The nodes of a CsgTree, in post-order. `items` is one expression, not empty.
std::vector<Node> to_binary(const std::vector<NaryItem>& items, Shape shape);

}  // namespace csg
