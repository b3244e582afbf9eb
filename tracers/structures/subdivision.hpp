// Dividing space by several threads, whatever cells are: octants, boxes of voxels, regions between planes.
#pragma once
#include "cells.hpp"
#include "parallel.hpp"

namespace csg {

/// What a cell is divided into. `Place`: where a cell lies, and how it is to be divided if there is a choice.
template <class Place, std::size_t n>
struct CellParts {
  static constexpr std::size_t kCount = n;
  Place places[n];
  Class kinds[n];
  std::vector<TreeNode> trees[n];
};

/// Divides cells level by level. Those of a level are divided by all threads, in batches whose results
/// are put together in the order of the cells; whether there is memory left is asked between rounds of
/// batches. So what is built does not depend on the number of threads.
///
/// `Divider` knows what cells are. Each thread has a copy, which is asked for
///   localize(tree, place, out)    the class of the first cell, and its tree;
///   divide(tree, place, parts)    the parts of a cell;
///   divides(tree, place, level)   whether a Partial cell is to be divided; `place` may take up how;
///   box(place)                    what S-bounds are clipped to.
/// In the order of the cells, the first copy alone is told what to build:
///   open(slot, place)             a cell is divided; returns the slot of its first part, others follow;
///   close(slot, place, cell)      a cell is not;
///   bytes()                       what has been built takes so many.
template <class Divider>
class Subdivision {
 public:
  using Place = typename Divider::Place;
  using Parts = typename Divider::Parts;

  Subdivision(const Divider& divider, CellTrees& trees, const BuildLimits& limits)
      : trees_(trees), most_bytes_(limits.most_bytes), dividers_(thread_count(limits.threads), divider) {}

  void build(TreeView whole, Place place, std::size_t slot) {
    Divider& divider = dividers_[0];
    std::vector<TreeNode> tree;
    const Class kind = divider.localize(whole, place, tree);
    if (kind != Class::Partial) return divider.close(slot, place, Cell::constant(kind == Class::Full));
    std::vector<Open> open;
    if (divider.divides(tree, place, 0))
      push({place, tree, slot}, open);
    else
      divider.close(slot, place, trees_.add(tree, divider.box(place)));
    std::vector<std::vector<TreeNode>> held;  // the trees of `open`
    std::vector<Batch> batches;
    for (int level = 1; !open.empty(); ++level) {
      std::vector<std::vector<TreeNode>> made;
      std::vector<Open> next;
      const std::size_t batch = std::clamp<std::size_t>(open.size() / 8, 1, kMostInBatch);
      for (std::size_t begin = 0; begin < open.size(); begin += kRound) {
        const auto round = std::span(open).subspan(begin, std::min(kRound, open.size() - begin));
        if (divider.bytes() + open_bytes_ > most_bytes_) {
          over_budget_ += round.size();
          for (const Open& cell : round)
            divider.close(cell.slot, cell.place, trees_.add(pop(cell), divider.box(cell.place)));
          continue;
        }
        batches.resize((round.size() + batch - 1) / batch);
        in_parallel(dividers_.size(), batches.size(), [&](std::size_t i, std::size_t thread) {
          divide(round.subspan(i * batch, std::min(batch, round.size() - i * batch)), level, dividers_[thread],
                 batches[i]);
        });
        for (std::size_t i = 0; i < batches.size(); ++i) {
          add(batches[i], &round[i * batch], next);
          made.push_back(std::move(batches[i].open));
        }
        deepest_level_ = level;
      }
      held = std::move(made);
      open = std::move(next);
    }
  }

  int deepest_level() const { return deepest_level_; }
  /// Cells not divided for want of memory.
  std::size_t over_budget() const { return over_budget_; }

 private:
  /// A cell that is to be divided.
  struct Open {
    Place place;
    TreeView tree;
    std::size_t slot;
  };
  /// What became of some cells: their parts in order, trees and S-bounds back to back.
  struct Batch {
    struct Part {
      Place place;
      Class kind;
      bool divides;
      std::uint32_t nodes;
    };
    std::vector<Part> parts;
    std::vector<TreeNode> open, closed;  // trees of those that are divided, and of the others
    std::vector<SBound> sbounds;         // of the others
  };

  void divide(std::span<const Open> cells, int level, Divider& divider, Batch& batch) const {
    Parts parts;
    SBoundMaker bounds = trees_.maker();
    for (const Open& cell : cells) {
      divider.divide(cell.tree, cell.place, parts);
      for (std::size_t i = 0; i < Parts::kCount; ++i) {
        Place& place = parts.places[i];
        const std::vector<TreeNode>& tree = parts.trees[i];
        const bool partial = parts.kinds[i] == Class::Partial;
        const bool divides = partial && divider.divides(tree, place, level);
        std::vector<TreeNode>& nodes = divides ? batch.open : batch.closed;
        nodes.insert(nodes.end(), tree.begin(), tree.end());
        batch.parts.push_back({place, parts.kinds[i], divides, static_cast<std::uint32_t>(tree.size())});
        if (partial && !divides) bounds.add(tree, divider.box(place), batch.sbounds);
      }
    }
  }

  /// Empties the batch but for the trees of `next`.
  void add(Batch& batch, const Open* cells, std::vector<Open>& next) {
    Divider& divider = dividers_[0];
    const TreeNode *open = batch.open.data(), *closed = batch.closed.data();
    const SBound* sbounds = batch.sbounds.data();
    std::size_t slot = 0;
    for (std::size_t i = 0; i < batch.parts.size(); ++i, ++slot) {
      if (i % Parts::kCount == 0) {
        const Open& parent = cells[i / Parts::kCount];
        slot = divider.open(parent.slot, parent.place);
        pop(parent);
      }
      const auto& part = batch.parts[i];
      const TreeView tree(part.divides ? open : closed, part.nodes);
      (part.divides ? open : closed) += part.nodes;
      if (part.divides)
        push({part.place, tree, slot}, next);
      else if (part.kind == Class::Partial)
        divider.close(slot, part.place, trees_.add(tree, sbounds));
      else
        divider.close(slot, part.place, Cell::constant(part.kind == Class::Full));
    }
    batch.parts.clear(), batch.closed.clear(), batch.sbounds.clear();
  }

  void push(const Open& cell, std::vector<Open>& open) {
    open_bytes_ += trees_.bytes_of(cell.tree);
    open.push_back(cell);
  }
  TreeView pop(const Open& cell) {
    open_bytes_ -= trees_.bytes_of(cell.tree);
    return cell.tree;
  }

  static constexpr std::size_t kMostInBatch = 128 / Parts::kCount, kRound = 8192 / Parts::kCount;

  CellTrees& trees_;
  std::size_t most_bytes_;
  std::vector<Divider> dividers_;  // one a thread
  std::size_t open_bytes_ = 0;     // that open cells would take if none were divided
  int deepest_level_ = 0;
  std::size_t over_budget_ = 0;
};

}  // namespace csg
