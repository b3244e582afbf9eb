// SDSM: an octree of localized CSG trees (Wyvill and Kunii 1986; Wang et al. 1993; the paper, 3.1.3).
//
// The world is divided into octants until a cell holds no surface, at most h halfspaces, or is at
// level d. Each Partial cell has its own tree, the global one simplified by Figure 3 with Full, Empty
// and Partial proved per primitive. A ray visits the cells on its way and combines, in each, the
// spans of the few halfspaces that are left. Parameters: d, h. This is the paper's "Bound: No".
#include "../structures/octree.hpp"

namespace csg {
namespace {

class Sdsm final : public Tracer {
 public:
  Sdsm(std::shared_ptr<const CsgTree> tree, OctreeLimits limits) : Tracer(std::move(tree)), octree_(*tree_, limits) {}

  std::size_t bytes() const override { return octree_.bytes(); }
  std::map<std::string, double> facts() const override { return octree_.facts(); }

 private:
  void trace_batch(std::span<const Ray> rays, std::span<Hit> hits, Counters* counters) const override {
    trace_cells(*tree_, octree_.world(), octree_.trees(), rays, hits, counters,
                [&](auto&&... along) { octree_.walk(along...); });
  }

  Octree octree_;
};

}  // namespace

extern const SchemeInfo scheme_sdsm;
const SchemeInfo scheme_sdsm{
    .name = "sdsm",
    .title = "SDSM octree",
    .params = octree_params(),
    .make = [](std::shared_ptr<const CsgTree> tree, const Params& params) -> std::unique_ptr<Tracer> {
      return std::make_unique<Sdsm>(std::move(tree), OctreeLimits{params.integer("d"), params.integer("h")});
    }};

}  // namespace csg
