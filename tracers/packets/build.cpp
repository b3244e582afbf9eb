#include "build.hpp"

#include <algorithm>
#include <cmath>

#include "../structures/parallel.hpp"
#include "node_maker.hpp"

namespace csg::packets {

Structure::Structure(const CsgTree& tree, const Octree& octree, double margin, bool tight, bool packets,
                     std::size_t threads) {
  if (tree.world().empty()) return;
  build(tree, octree, margin, tight, threads);
  nodes_.shrink_to_fit(), cells_.shrink_to_fit();
  model_.nodes = nodes_.data(), model_.cells = cells_.data(), model_.frames = frames_.data();
  // What rays that go alone wait for is asked for ahead: that pays once it is in no cache.
  constexpr std::size_t kCached = std::size_t{32} << 20;
  model_.few = !packets ? 16 : bytes() > kCached ? 3 : 1;
}

void Structure::build(const CsgTree& tree, const Octree& octree, double margin, bool tight, std::size_t threads) {
  // The widest band of any ray, and at least what double loses.
  Scale scale{std::ldexp(1.0, std::ilogb(tree.size())), octree.world().center(), 0, margin};
  const auto band = [&](double distance) {
    const Vec3 origin{distance, 0, 0};
    return std::max(tree.tolerances().band(origin, 1), Tolerances({}, tree.size()).band(origin, 1)) / scale.unit;
  };
  scale.band = band(tree.tolerances().farthest_origin());
  for (int axis = 0; axis < 3; ++axis) model_.centre[axis] = scale.middle[axis];
  model_.per_unit = 1 / scale.unit;
  model_.radius = length(octree.world().half()) / scale.unit * (1 + margin);
  model_.near = 2 * tree.size() / scale.unit;
  model_.band = band(2 * tree.size());
  for (const Leaf& leaf : tree.leaves()) frames_.push_back(frame_of(leaf, scale.middle, scale.unit));

  std::vector<Box> boxes(octree.trees().count());
  octree.for_each_partial([&](csg::Cell cell, const Box& box) { boxes[cell.tree()] = box; });
  constexpr std::size_t kBatch = 64;
  std::vector<CellMaker::Batch> batches((boxes.size() + kBatch - 1) / kBatch);
  std::vector<CellMaker> makers(threads, CellMaker(tree, frames_, scale, tight));
  in_parallel(threads, batches.size(), [&](std::size_t i, std::size_t thread) {
    for (std::size_t k = i * kBatch; k < std::min((i + 1) * kBatch, boxes.size()); ++k)
      makers[thread].add(octree.trees().tree(k), boxes[k], batches[i]);
  });

  std::vector<Boxed> boxed;
  for (const CellMaker::Batch& batch : batches) {
    const auto first = static_cast<std::int32_t>(cells_.size());
    for (Boxed box : batch.boxes) {
      box.link = ~(first + box.link);
      boxed.push_back(box);
    }
    cells_.insert(cells_.end(), batch.cells.begin(), batch.cells.end());
    made_.cells += batch.made.cells, made_.untrusted += batch.made.untrusted, made_.atoms += batch.made.atoms;
  }
  cells_.resize(cells_.size() + 1);
  NodeMaker(octree, boxed, nodes_);
}

std::size_t Structure::bytes() const {
  return nodes_.size() * sizeof(Node) + cells_.size() * sizeof(Line) + frames_.size() * sizeof(Frame);
}

void Structure::describe(std::map<std::string, double>& facts) const {
  facts["packet_cells"] = static_cast<double>(made_.cells);
  facts["untrusted_cells"] = static_cast<double>(made_.untrusted);
  facts["mean_atoms"] = made_.cells == 0 ? 0 : static_cast<double>(made_.atoms) / static_cast<double>(made_.cells);
}

}  // namespace csg::packets
