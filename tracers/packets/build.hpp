// From an octree of localized trees to what packets walk through: tight boxes, and atoms.
#pragma once
#include <map>
#include <string>
#include <vector>

#include "../error_unit.hpp"
#include "../large_pages.hpp"
#include "../structures/octree.hpp"
#include "packet_model.hpp"

namespace csg::packets {

/// Around a cell, its tree holds for this many halves of its side: half of it is given to the boxes that rays
/// enter by, and a 64th to an 8th to what floats may be wrong by.
constexpr double margin_for(Precision precision) { return precision == Precision::Float64 ? 0x1p-4 : 0x1p-3; }

/// How many were made: cells, those that floats are not trusted in, and atoms of the others.
struct CellTally {
  std::size_t cells, untrusted, atoms;
};

/// The model of a CsgTree for packets. Owns what Model points to.
class Structure {
 public:
  /// `tight`: shrink the cells' boxes to where their trees are not constant. The same for any number of threads.
  /// `margin` is that of the octree's trees. Without `packets`, every ray goes alone.
  Structure(const CsgTree& tree, const Octree& octree, double margin, bool tight, bool packets, std::size_t threads);

  const Model& model() const { return model_; }
  bool empty() const { return nodes_.empty(); }
  std::size_t bytes() const;
  void describe(std::map<std::string, double>& facts) const;

 private:
  void build(const CsgTree& tree, const Octree& octree, double margin, bool tight, std::size_t threads);

  std::vector<Node, LargePages<Node>> nodes_;
  std::vector<Line, LargePages<Line>> cells_;
  std::vector<Frame> frames_;
  Model model_{};
  CellTally made_{};
};

}  // namespace csg::packets
