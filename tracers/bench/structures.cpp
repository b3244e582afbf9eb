// The parts of a scheme: localized trees, the octree, classes of boxes, S-bounds, and the loader.
#include <functional>
#include <optional>

#include "../csg/loader.hpp"
#include "../structures/octree.hpp"
#include "bench.hpp"

namespace csg::bench {
namespace {

constexpr OctreeLimits kLimits{6, 7};   // the defaults of sdsm
constexpr std::size_t kEveryCell = 16;  // of which boxes are classified and S-bounds made

/// A cell that a primary ray passes through.
struct Visit {
  const Ray* ray;
  TreeView tree;
  double t0, t1;
};

/// A leaf, and an octant of a cell in whose tree it is.
struct Pair {
  const Leaf* leaf;
  Box box;
};

/// What the benchmarks of a model work on, made when the first of them runs.
struct Material {
  explicit Material(const Model& of) : model(*of.tree), octree(model, kLimits) {
    for (const auto& batch : of.primary)
      for (const Ray& ray : batch) {
        walk(ray, [&](Cell cell, double t0, double t1) {
          if (cell.is_partial()) visits.push_back({&ray, octree.trees().tree(cell.tree()), t0, t1});
          ++cells_on_rays;
          return false;
        });
        rays.push_back(&ray);
      }
    std::size_t number = 0;
    octree.for_each_partial([&](Cell cell, const Box& box) {
      const TreeView tree = octree.trees().tree(cell.tree());
      leaves += static_cast<std::size_t>(leaf_count(tree));
      if (number++ % kEveryCell != 0) return;
      sample.emplace_back(tree, box);
      nodes += tree.size();
      for (const TreeNode& node : tree)
        if (node.is_leaf()) {
          const Leaf& leaf = model.leaves()[static_cast<std::size_t>(node.leaf())];
          for (int i = 0; i < 8; ++i) pairs[static_cast<std::size_t>(leaf.kind)].push_back({&leaf, octant(box, i)});
        }
    });
  }

  template <class Visitor>
  void walk(const Ray& ray, Visitor visit) const {
    const Reciprocal reciprocal(ray.dir);
    const Interval in = slab(octree.world(), ray.origin, reciprocal);
    const double t0 = std::max(in.lo, ray.t_min);
    if (t0 < in.hi) octree.walk(ray, reciprocal, t0, in.hi, visit);
  }

  const CsgTree& model;
  Octree octree;
  std::vector<const Ray*> rays;
  std::vector<Visit> visits;
  std::vector<std::pair<TreeView, Box>> sample;  // of Partial cells
  std::array<std::vector<Pair>, 5> pairs;        // of the sample, by kind
  std::size_t cells_on_rays = 0, leaves = 0, nodes = 0;
};

void toggle(benchmark::State& state, const Material& on) {
  TreeState tree_state;
  CountNothing work;
  measure(state, "s_per_toggle", on.leaves, [&] {
    for (std::size_t i = 0; i < on.octree.trees().count(); ++i) {
      const TreeView tree = on.octree.trees().tree(i);
      tree_state.reset(tree);
      for (std::uint32_t node = 0; node < tree.size(); ++node)
        if (tree[node].is_leaf()) tree_state.toggle(node, work);
      benchmark::DoNotOptimize(tree_state.inside());
    }
  });
}

void search(benchmark::State& state, const Material& on) {
  SearchScratch scratch;
  CountNothing work;
  measure(state, "s_per_cell", on.visits.size(), [&] {
    for (const Visit& visit : on.visits) {
      BoundarySearch boundary(on.model, *visit.ray, scratch, work);
      benchmark::DoNotOptimize(boundary.search(visit.tree, visit.t0, visit.t1));
    }
  });
}

void walk(benchmark::State& state, const Material& on) {
  measure(state, "s_per_cell", on.cells_on_rays, [&] {
    for (const Ray* ray : on.rays)
      on.walk(*ray, [](Cell cell, double, double) {
        benchmark::DoNotOptimize(cell);
        return false;
      });
  });
}

void classes(benchmark::State& state, const Material& on, Kind kind) {
  const std::vector<Pair>& pairs = on.pairs[static_cast<std::size_t>(kind)];
  measure(state, "s_per_box", pairs.size(), [&] {
    for (const Pair& pair : pairs) benchmark::DoNotOptimize(classify(*pair.leaf, pair.box.padded(pair.leaf->pad)));
  });
}

void sbound(benchmark::State& state, const Material& on, SBoundPasses passes) {
  std::vector<Box> bounds;
  measure(state, "s_per_node", on.nodes, [&] {
    for (const auto& [tree, cell] : on.sample) {
      sbounds(on.model, tree, cell, passes, bounds);
      benchmark::DoNotOptimize(bounds.data());
    }
  });
}

struct Part {
  const char* name;
  std::function<void(benchmark::State&, const Material&)> run;
  std::optional<Kind> of{};  // only where the model has such leaves
};

Part class_of(const char* name, Kind kind) {
  return {name, [kind](benchmark::State& state, const Material& on) { classes(state, on, kind); }, kind};
}

Part sbound_by(const char* name, SBoundPasses passes) {
  return {name, [passes](benchmark::State& state, const Material& on) { sbound(state, on, passes); }};
}

const Part kParts[] = {
    {"localized tree: toggle", toggle},
    {"localized tree: search", search},
    {"octree: walk", walk},
    class_of("class of a box: sphere", Kind::Sphere),
    class_of("class of a box: block", Kind::Block),
    class_of("class of a box: cylinder", Kind::Cylinder),
    class_of("class of a box: cone", Kind::Cone),
    class_of("class of a box: torus", Kind::Torus),
    sbound_by("S-bounds: one pass", SBoundPasses::One),
    sbound_by("S-bounds: fixed point", SBoundPasses::FixedPoint),
};

}  // namespace

void add_structures(const Model& model) {
  const auto has = [&](Kind kind) {
    return std::ranges::any_of(model.tree->leaves(), [&](const Leaf& leaf) { return leaf.kind == kind; });
  };
  const auto add = [&](const std::string& part, auto run) {
    benchmark::RegisterBenchmark(("structure/" + part + "/" + model.name).c_str(), run);
  };
  const auto material = std::make_shared<std::unique_ptr<const Material>>();
  for (const Part& part : kParts)
    if (!part.of || has(*part.of))
      add(part.name, [&model, &part, material](benchmark::State& state) {
        if (!*material) *material = std::make_unique<const Material>(model);
        part.run(state, **material);
      });
  add("loader", [&model](benchmark::State& state) {
    measure(state, "s_per_byte", model.text.size(),
            [&] { benchmark::DoNotOptimize(parse_csg(model.text, model.name)); });
  });
}

}  // namespace csg::bench
