// SDSM: an octree of localized CSG trees (Wyvill and Kunii 1986; Wang et al. 1993; the paper, 3.1.3).
//
// The world is divided into octants until a cell holds no surface, at most h halfspaces, or is at
// level d. Each Partial cell has its own tree, the global one simplified by Figure 3 with Full, Empty
// and Partial proved per primitive. A ray visits the cells on its way and combines, in each, the
// spans of the few halfspaces that are left. This is the paper's "Bound: No".
//   d, h            limits of the octree.
//   build           eager, as in the paper; lazy: a cell is divided when the first ray enters it.
//   build_threads   of the eager build. One by default, as in the paper and as schemes are compared here.
//   budget_mb       where it is spent, cells stay undivided.
#include "../structures/octree_tracer.hpp"

namespace csg {
namespace {

std::vector<ParamSpec> sdsm_params() {
  std::vector<ParamSpec> params = octree_params();
  params.push_back(build_param());
  return params;
}

}  // namespace

extern const SchemeInfo scheme_sdsm;
const SchemeInfo scheme_sdsm{
    .name = "sdsm",
    .title = "SDSM octree",
    .params = sdsm_params(),
    .make = [](std::shared_ptr<const CsgTree> tree, const Params& params) -> std::unique_ptr<Tracer> {
      return make_octree_tracer(std::move(tree), params);
    }};

}  // namespace csg
