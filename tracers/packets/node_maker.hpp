// The nodes above the cells.
#pragma once
#include <algorithm>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "../large_pages.hpp"
#include "../structures/octree.hpp"
#include "cell_maker.hpp"

namespace csg::packets {

/// The boxes above the cells; a box with one octant is that octant's. Nodes stand behind those below them, but for the
/// first.
class NodeMaker {
 public:
  NodeMaker(const Octree& octree, std::span<const Boxed> cells, std::vector<Node, LargePages<Node>>& nodes)
      : octree_(octree), cells_(cells), nodes_(nodes) {
    nodes_.push_back(kNone);
    if (const std::optional<Boxed> root = make(octree.root()))
      put(*root, 0, nodes_[0]);
    else
      nodes_.clear();
  }

 private:
  static constexpr Node kNone = [] {
    Node none{};
    for (int axis = 0; axis < 3; ++axis) {
      std::ranges::fill(none.side[axis], std::numeric_limits<float>::infinity());
      std::ranges::fill(none.side[3 + axis], -std::numeric_limits<float>::infinity());
    }
    return none;
  }();

  static void put(const Boxed& boxed, int octant, Node& in) {
    for (int side = 0; side < 6; ++side) in.side[side][octant] = boxed.side[side];
    in.link[octant] = boxed.link;
    in.octants |= 1u << octant;
  }

  std::optional<Boxed> make(Octree::Link link) {
    if (octree_.is_cell(link)) {
      if (!octree_.cell(link).is_partial()) return std::nullopt;
      const Boxed& cell = cells_[octree_.cell(link).tree()];
      if (!(cell.side[0] <= cell.side[3])) return std::nullopt;
      return cell;
    }
    Node node = kNone;
    Boxed around{};
    for (int i = 0; i < 8; ++i) {
      const std::optional<Boxed> octant = make(octree_.child(link, i));
      if (!octant) continue;
      if (node.octants == 0) around = *octant;
      put(*octant, i, node);
      for (int axis = 0; axis < 3; ++axis) {
        around.side[axis] = std::min(around.side[axis], octant->side[axis]);
        around.side[3 + axis] = std::max(around.side[3 + axis], octant->side[3 + axis]);
      }
    }
    if (node.octants == 0) return std::nullopt;
    if ((node.octants & (node.octants - 1)) == 0) return around;
    around.link = static_cast<std::int32_t>(nodes_.size());
    nodes_.push_back(node);
    return around;
  }

  const Octree& octree_;
  std::span<const Boxed> cells_;
  std::vector<Node, LargePages<Node>>& nodes_;
};

}  // namespace csg::packets
