#include "lazy_octree.hpp"

namespace csg {

LazyOctree::LazyOctree(const CsgTree& model, OctreeLimits limits, Bounds bounds, SBoundPasses passes)
    : model_(model),
      limits_(limits),
      bounds_(bounds),
      passes_(passes),
      world_(octree_world(model)),
      root_(std::make_unique<LazyCell>()) {
  if (model.world().empty()) {
    root_->state = State::Constant;
    return;
  }
  const Class kind = CellClassifier(model).localize(global_tree(model), world_, root_->tree);
  if (kind != Class::Partial) root_->state = State::Constant;
  root_->is_full = kind == Class::Full;
  root_->tree.shrink_to_fit();
  committed_ = bytes_of(*root_);
}

/// The state of a cell that a ray has entered: Constant, Partial or Divided.
LazyCell::State LazyOctree::built(LazyCell& cell) const {
  State state = State::Pending;
  if (!cell.state.compare_exchange_strong(state, State::Building, std::memory_order_acquire)) {
    for (; state == State::Building; state = cell.state.load(std::memory_order_acquire))
      cell.state.wait(State::Building, std::memory_order_acquire);
    // Where it is Pending again, the thread that was building it ran out of memory.
    return state == State::Pending ? built(cell) : state;
  }
  try {
    std::unique_ptr<Workshop> workshop = workshops_.take([&] {
      return std::make_unique<Workshop>(
          Workshop{CellClassifier(model_), SBoundMaker(model_, bounds_, passes_), {}, {}, {}});
    });
    state = build(cell, *workshop);
    workshops_.give_back(std::move(workshop));
  } catch (...) {
    cell.state = State::Pending;
    cell.state.notify_all();
    throw;
  }
  cell.state.store(state, std::memory_order_release);
  cell.state.notify_all();
  return state;
}

LazyCell::State LazyOctree::build(LazyCell& cell, Workshop& workshop) const {
  const Box box = box_of(cell);
  if (limits_.divides(model_, cell.tree, box, cell.level)) {
    if (committed_ <= limits_.build.most_bytes) {
      divide(cell, box, workshop);
      return State::Divided;
    }
    ++over_budget_;
  }
  workshop.sbounds.clear();
  workshop.maker.add(cell.tree, box, workshop.sbounds);
  cell.sbounds.assign(workshop.sbounds.begin(), workshop.sbounds.end());  // no more than it needs
  committed_ += cell.sbounds.size() * sizeof(SBound);
  return State::Partial;
}

void LazyOctree::divide(LazyCell& cell, const Box& box, Workshop& workshop) const {
  workshop.classifier.localize_octants(cell.tree, box, box.center(), workshop.kinds, workshop.trees);
  auto octants = std::make_unique<LazyCell[]>(8);
  std::size_t bytes = 0;
  for (int i = 0; i < 8; ++i) {
    LazyCell& octant = octants[static_cast<std::size_t>(i)];
    octant.level = static_cast<std::uint8_t>(cell.level + 1);
    octant.path = cell.path << 3 | static_cast<std::uint64_t>(i);
    octant.is_full = workshop.kinds[i] == Class::Full;
    if (workshop.kinds[i] == Class::Partial)
      octant.tree.assign(workshop.trees[i].begin(), workshop.trees[i].end());
    else
      octant.state = State::Constant;
    bytes += bytes_of(octant);
  }
  committed_ += bytes;
  committed_ -= cell.tree.size() * sizeof(TreeNode);
  cell.octants = std::move(octants);
  cell.tree = {};
}

/// As the eager octree computes it.
Box LazyOctree::box_of(const LazyCell& cell) const {
  Box box = world_;
  for (int level = cell.level; level-- > 0;) box = octant(box, static_cast<int>(cell.path >> 3 * level & 7));
  return box;
}

std::size_t LazyOctree::bytes_of(const LazyCell& cell) const {
  return sizeof(cell) + cell.tree.size() * sizeof(TreeNode) + cell.sbounds.size() * sizeof(SBound);
}

template <class Visit>
void LazyOctree::for_each_cell(Visit visit) const {
  std::vector<const LazyCell*> todo{root_.get()};
  while (!todo.empty()) {
    const LazyCell& cell = *todo.back();
    todo.pop_back();
    visit(cell);
    if (cell.state == State::Divided)
      for (std::size_t i = 0; i < 8; ++i) todo.push_back(&cell.octants[i]);
  }
}

std::size_t LazyOctree::bytes() const {
  std::size_t bytes = 0;
  for_each_cell([&](const LazyCell& cell) { bytes += bytes_of(cell); });
  return bytes;
}

std::map<std::string, double> LazyOctree::facts() const {
  double divided = 0, partial = 0, pending = 0, leaves = 0, most = 0;
  int deepest = 0;
  for_each_cell([&](const LazyCell& cell) {
    const State state = cell.state;
    deepest = std::max<int>(deepest, cell.level);
    divided += state == State::Divided;
    pending += state == State::Pending;
    if (state != State::Partial) return;
    ++partial;
    leaves += leaf_count(cell.tree);
    most = std::max<double>(most, leaf_count(cell.tree));
  });
  std::map<std::string, double> facts{{"cells", 7 * divided + 1},
                                      {"divided_cells", divided},
                                      {"partial_cells", partial},
                                      {"pending_cells", pending},
                                      {"mean_halfspaces", partial > 0 ? leaves / partial : 0},
                                      {"max_halfspaces", most},
                                      {"deepest_level", deepest}};
  if (over_budget_ > 0) facts["cells_over_budget"] = static_cast<double>(over_budget_);
  return facts;
}

}  // namespace csg
