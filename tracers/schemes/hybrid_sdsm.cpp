// Hybrid SDSM: the SDSM octree with an S-bound in each localized tree (the paper, 3.1.4 and 3.2).
//
// The cells are those of sdsm for the same parameters. When a cell's tree is made, its S-bounds are made
// too: upwards by Figure 5, clipped to the cell, downwards. A ray that misses the bound of a tree, or
// of a subtree, tests none of its halfspaces.
//   bound   root: one box a cell, tested before its tree (Figure 6). all: a box for every node.
//   passes  one: the paper's up, clip, down. fixed: repeated until nothing shrinks.
//   and those of sdsm.
#include "../structures/octree_tracer.hpp"

namespace csg {
namespace {

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
  params.push_back(build_param());
  return params;
}

}  // namespace

extern const SchemeInfo scheme_hybrid_sdsm;
const SchemeInfo scheme_hybrid_sdsm{
    .name = "hybrid_sdsm",
    .title = "Hybrid SDSM (octree and S-bounds)",
    .params = hybrid_params(),
    .make = [](std::shared_ptr<const CsgTree> tree, const Params& params) -> std::unique_ptr<Tracer> {
      return make_octree_tracer(std::move(tree), params, params.choice("bound") == "root" ? Bounds::Root : Bounds::All,
                                params.choice("passes") == "one" ? SBoundPasses::One : SBoundPasses::FixedPoint);
    }};

}  // namespace csg
