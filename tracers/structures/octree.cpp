#include "octree.hpp"

#include "parallel.hpp"

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
           .trial_values = {1L, 4L, 10L}},
          {.name = "build_threads",
           .meaning = "that build the octree, the same whatever their number; 0: one a core",
           .default_value = 1L,
           .minimum = 0,
           .maximum = 256,
           .trial_values = {2L},
           .implied_by_default = true},
          budget_param()};
}

OctreeLimits OctreeLimits::of(const Params& params) {
  return {params.integer("d"), params.integer("h"), params.integer("build_threads"), budget_of(params)};
}

Box octree_world(const CsgTree& model) {
  const Vec3 centre = model.world().center(), half = model.world().half();
  const double side = std::max({half.x, half.y, half.z});
  return {centre - Vec3{side, side, side}, centre + Vec3{side, side, side}};
}

/// Divides cells level by level. Those of a level are divided by all threads, in batches whose results
/// are put together in the order of the cells; whether there is memory left is asked between rounds of
/// batches. So the octree does not depend on the number of threads.
class Octree::Builder {
 public:
  Builder(Octree& octree, const CsgTree& model, OctreeLimits limits)
      : octree_(octree),
        model_(model),
        limits_(limits),
        threads_(thread_count(limits.threads)),
        classifiers_(threads_, CellClassifier(model)) {}

  void build() {
    std::vector<TreeNode> tree;
    const Class kind = classifiers_[0].localize(global_tree(model_), octree_.world_, tree, margin_of(octree_.world_));
    if (kind != Class::Partial) {
      octree_.root_ = link(Cell::constant(kind == Class::Full));
      return;
    }
    committed_ = octree_.trees_.bytes_of(tree);
    std::vector<Open> open{{octree_.world_, tree, kRoot}};
    if (!limits_.divides(model_, tree, octree_.world_, 0)) close(open[0]), open.clear();
    std::vector<Batch> held;  // where the trees of `open` are
    for (int level = 0; !open.empty(); ++level) {
      std::vector<Batch> made;
      std::vector<Open> next;
      const std::size_t batch = std::clamp<std::size_t>(open.size() / 8, 1, kMostInBatch);
      for (std::size_t begin = 0; begin < open.size(); begin += kRound) {
        const auto round = std::span(open).subspan(begin, std::min(kRound, open.size() - begin));
        if (committed_ > limits_.most_bytes) {
          octree_.over_budget_ += round.size();
          for (const Open& cell : round) close(cell);
          continue;
        }
        const std::size_t first = made.size();
        made.resize(first + (round.size() + batch - 1) / batch);
        in_parallel(threads_, made.size() - first, [&](std::size_t i, std::size_t thread) {
          divide(round.subspan(i * batch, std::min(batch, round.size() - i * batch)), level, classifiers_[thread],
                 made[first + i]);
        });
        for (std::size_t i = first; i < made.size(); ++i) add(made[i], round.subspan((i - first) * batch), next);
      }
      if (!made.empty()) octree_.deepest_level_ = level + 1;
      held = std::move(made);
      open = std::move(next);
    }
  }

 private:
  /// A cell that is to be divided, and where its link stands.
  struct Open {
    Box box;
    TreeView tree;
    std::size_t slot;
  };
  /// What became of some cells: their octants in order, trees and S-bounds back to back.
  struct Batch {
    struct Octant {
      Class kind;
      bool divides;
      std::size_t nodes;
    };
    std::vector<Octant> octants;
    std::vector<TreeNode> nodes;
    std::vector<SBound> sbounds;
  };

  double margin_of(const Box& cell) const { return limits_.margin * cell.half().x; }

  void divide(std::span<const Open> cells, int level, CellClassifier& classifier, Batch& batch) const {
    Class kinds[8];
    std::vector<TreeNode> trees[8];
    SBoundMaker bounds = octree_.trees_.maker();
    for (const Open& cell : cells) {
      classifier.localize_octants(cell.tree, cell.box, kinds, trees, margin_of(cell.box) / 2);
      for (int i = 0; i < 8; ++i) {
        const Box box = octant(cell.box, i);
        const bool divides = kinds[i] == Class::Partial && limits_.divides(model_, trees[i], box, level + 1);
        batch.octants.push_back({kinds[i], divides, trees[i].size()});
        batch.nodes.insert(batch.nodes.end(), trees[i].begin(), trees[i].end());
        if (kinds[i] == Class::Partial && !divides) bounds.add(trees[i], box, batch.sbounds);
      }
    }
  }

  void add(const Batch& batch, std::span<const Open> cells, std::vector<Open>& next) {
    const TreeNode* nodes = batch.nodes.data();
    const SBound* sbounds = batch.sbounds.data();
    for (std::size_t i = 0; i < batch.octants.size(); ++i) {
      const Open& parent = cells[i / 8];
      if (i % 8 == 0) {
        set_link(parent.slot, static_cast<std::int32_t>(octree_.children_.size()));
        octree_.children_.resize(octree_.children_.size() + 8);
        committed_ += 8 * sizeof(octree_.children_[0]);
        committed_ -= octree_.trees_.bytes_of(parent.tree);
      }
      const Batch::Octant& made = batch.octants[i];
      const std::size_t slot = octree_.children_.size() - 8 + i % 8;
      const TreeView tree(nodes, made.nodes);
      nodes += made.nodes;
      if (made.kind != Class::Partial) {
        set_link(slot, link(Cell::constant(made.kind == Class::Full)));
        continue;
      }
      committed_ += octree_.trees_.bytes_of(tree);
      if (made.divides)
        next.push_back({octant(parent.box, static_cast<int>(i % 8)), tree, slot});
      else
        set_link(slot, link(octree_.trees_.add(tree, sbounds)));
    }
  }

  void close(const Open& cell) { set_link(cell.slot, link(octree_.trees_.add(cell.tree, cell.box))); }

  void set_link(std::size_t slot, std::int32_t link) {
    (slot == kRoot ? octree_.root_ : octree_.children_[slot]) = link;
  }

  static constexpr std::size_t kRoot = ~std::size_t{0};
  static constexpr std::size_t kMostInBatch = 16, kRound = 1024;

  Octree& octree_;
  const CsgTree& model_;
  OctreeLimits limits_;
  std::size_t threads_;
  std::vector<CellClassifier> classifiers_;  // one a thread
  std::size_t committed_ = 0;                // bytes, as if no cell were divided further
};

Octree::Octree(const CsgTree& model, OctreeLimits limits, Bounds bounds, SBoundPasses passes)
    : world_(octree_world(model)), trees_(model, bounds, passes) {
  if (model.world().empty()) return;
  Builder(*this, model, limits).build();
  children_.shrink_to_fit();
  trees_.shrink();
}

std::map<std::string, double> Octree::facts() const {
  std::map<std::string, double> facts{{"cells", static_cast<double>(children_.size() / 8 * 7 + 1)},
                                      {"divided_cells", static_cast<double>(children_.size() / 8)},
                                      {"deepest_level", deepest_level_}};
  if (over_budget_ > 0) facts["cells_over_budget"] = static_cast<double>(over_budget_);
  trees_.describe(facts);
  return facts;
}

}  // namespace csg
