// A tracer whose rays go from cell to cell of an octree, built whole or as rays need it.
#pragma once
#include "lazy_octree.hpp"

namespace csg {

/// The declaration of `build`, for the schemes that can be lazy.
inline ParamSpec build_param() {
  return {.name = "build",
          .meaning = "eager: the whole octree before the first ray; lazy: a cell when the first ray enters it",
          .default_value = std::string("eager"),
          .choices = {"eager", "lazy"},
          .trial_values = {std::string("eager"), std::string("lazy")},
          .implied_by_default = true};
}

template <class Cells>
class OctreeTracer final : public Tracer {
 public:
  OctreeTracer(std::shared_ptr<const CsgTree> tree, OctreeLimits limits, Bounds bounds, SBoundPasses passes)
      : Tracer(std::move(tree)), octree_(*tree_, limits, bounds, passes) {}

  std::size_t bytes() const override { return octree_.bytes(); }
  std::map<std::string, double> facts() const override { return octree_.facts(); }

 private:
  void trace_batch(std::span<const Ray> rays, std::span<Hit> hits, Counters* counters) const override {
    trace_cells(*tree_, octree_.world(), octree_, rays, hits, counters,
                [&](auto&&... along) { octree_.walk(along...); });
  }

  Cells octree_;
};

inline std::unique_ptr<Tracer> make_octree_tracer(std::shared_ptr<const CsgTree> tree, const Params& params,
                                                  Bounds bounds = Bounds::None,
                                                  SBoundPasses passes = SBoundPasses::One) {
  const OctreeLimits limits = OctreeLimits::of(params);
  if (params.choice("build") == "lazy")
    return std::make_unique<OctreeTracer<LazyOctree>>(std::move(tree), limits, bounds, passes);
  return std::make_unique<OctreeTracer<Octree>>(std::move(tree), limits, bounds, passes);
}

}  // namespace csg
