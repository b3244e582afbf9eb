// Hybrid SDSM: the SDSM octree with an S-bound in each localized tree (the paper, 3.1.4 and 3.2).
//
// The cells are those of sdsm for the same d and h. When a cell's tree is made, its S-bounds are made
// too: upwards by Figure 5, clipped to the cell, downwards. A ray that misses the bound of a tree, or
// of a subtree, tests none of its halfspaces.
//   bound   root: one box a cell, tested before its tree (Figure 6). all: a box for every node.
//   passes  one: the paper's up, clip, down. fixed: repeated until nothing shrinks.
#include "../structures/octree.hpp"

namespace csg {
namespace {

class HybridSdsm final : public Tracer {
 public:
  HybridSdsm(std::shared_ptr<const CsgTree> tree, OctreeLimits limits, Bounds bounds, SBoundPasses passes)
      : Tracer(std::move(tree)), octree_(*tree_, limits, bounds, passes) {}

  std::size_t bytes() const override { return octree_.bytes(); }
  std::map<std::string, double> facts() const override { return octree_.facts(); }

 private:
  void trace_batch(std::span<const Ray> rays, std::span<Hit> hits, Counters* counters) const override {
    trace_cells(*tree_, octree_.world(), octree_.trees(), rays, hits, counters,
                [&](auto&&... along) { octree_.walk(along...); });
  }

  Octree octree_;
};

std::vector<ParamSpec> hybrid_params() {
  std::vector<ParamSpec> params = octree_params();
  params.push_back({.name = "bound",
                    .meaning = "which S-bounds a ray tests: the root's, or every node's",
                    .default_value = std::string("all"),
                    .choices = {"root", "all"},
                    .trial_values = {std::string("root"), std::string("all")}});
  params.push_back({.name = "passes",
                    .meaning = "how S-bounds are made: in one pass, or to the fixed point",
                    .default_value = std::string("one"),
                    .choices = {"one", "fixed"},
                    .trial_values = {std::string("one"), std::string("fixed")}});
  return params;
}

}  // namespace

extern const SchemeInfo scheme_hybrid_sdsm;
const SchemeInfo scheme_hybrid_sdsm{
    .name = "hybrid_sdsm",
    .title = "Hybrid SDSM (octree and S-bounds)",
    .params = hybrid_params(),
    .make = [](std::shared_ptr<const CsgTree> tree, const Params& params) -> std::unique_ptr<Tracer> {
      return std::make_unique<HybridSdsm>(
          std::move(tree), OctreeLimits{params.integer("d"), params.integer("h")},
          params.choice("bound") == "root" ? Bounds::Root : Bounds::All,
          params.choice("passes") == "one" ? SBoundPasses::One : SBoundPasses::FixedPoint);
    }};

}  // namespace csg
