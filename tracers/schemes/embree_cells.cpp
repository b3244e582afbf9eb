// Embree over cells: the hybrid's Partial cells as user geometry of a BVH; the first hit ends a ray.
//
// The octree is that of hybrid_sdsm, but rays find its Partial cells through Embree's BVH over their
// root S-bounds, which skips empty space at once. Cells come roughly, not strictly, in order, so each
// is searched on its own: a little way in from the wall, a cell whose localized tree is quiet there
// tells by itself whether the ray has passed a boundary before. The nearest hit of all cells is the
// hit. Where a surface lies so close to a cell's wall that its tie band reaches across it, the ray is
// traced again through the octree, in order (hit_rule.hpp): rare, and the same answer by definition.
//   d, h, budget_mb   limits of the octree, as for sdsm.
//   build_threads     of the octree and of Embree.
#include "../structures/embree.hpp"
#include "../structures/octree.hpp"
#include "../structures/parallel.hpp"

namespace csg {
namespace {

class EmbreeCells final : public Tracer {
 public:
  EmbreeCells(std::shared_ptr<const CsgTree> tree, OctreeLimits limits)
      : Tracer(std::move(tree)),
        octree_(*tree_, limits, Bounds::Root),
        boxes_(root_bounds(), size_with_pads(octree_.world(), tree_->size()), thread_count(limits.build.threads)) {}

  std::size_t bytes() const override { return octree_.bytes() + boxes_.bytes(); }
  std::map<std::string, double> facts() const override { return octree_.facts(); }

 private:
  /// S-bounds within cells that are padded by half of P, in double: a tree is right in the whole of its
  /// box, and rounding takes no ray that is in the box out of where it is right.
  std::vector<Box> root_bounds() const {
    std::vector<Box> boxes(octree_.trees().count()), of_nodes;
    octree_.for_each_partial([&](Cell cell, const Box& box) {
      sbounds(*tree_, octree_.trees().tree(cell.tree()), box, SBoundPasses::One, of_nodes);
      boxes[cell.tree()] = intersection(of_nodes[0], box.padded(0.5 * tree_->pad()));
    });
    return boxes;
  }

  template <class Work>
  Hit in_order(const Ray& ray, const Reciprocal& reciprocal, double t0, double t1, BoundarySearch<Work>& search,
               Work& work) const {
    octree_.walk(ray, reciprocal, t0, t1, [&](Cell cell, double from, double to) {
      return octree_.trees().pass(cell, search, work, reciprocal, from, to) || !(to < ray.t_max);
    });
    return search.hit();
  }

  void trace_batch(std::span<const Ray> rays, std::span<Hit> hits, Counters* counters) const override {
    for_each_ray(rays, hits, counters, [&](const Ray& ray, SearchScratch& scratch, auto& work) {
      BoundarySearch start(*tree_, ray, scratch, work);
      const Reciprocal reciprocal(ray.dir);
      const Interval in = slab(octree_.world(), ray.origin, reciprocal);
      if (!(in.lo < in.hi) || !(start.skip() < in.hi) || !(in.lo < ray.t_max)) return start.hit();
      const double t0 = std::max(in.lo, start.skip());
      // Whether the ray starts inside: known outside the world, else told by its first cell.
      if (start.skip() < in.lo) {
        start.pass_constant(false);
      } else {
        bool ended = false;
        octree_.walk(ray, reciprocal, t0, in.hi, [&](Cell cell, double from, double to) {
          ended = octree_.trees().pass(cell, start, work, reciprocal, from, to);
          return true;
        });
        if (ended) return start.hit();
      }

      Hit nearest;
      bool unsure = false;
      boxes_.query(ray, t0, std::min(in.hi, ray.t_max), [&](unsigned number) {
        if (unsure) return -kInfinity;
        work.cell();
        const Interval own = slab(boxes_.box(number), ray.origin, reciprocal);
        if (own.empty() || !(start.skip() < own.hi) || !(own.lo < nearest.t)) return kInfinity;
        BoundarySearch here(*tree_, ray, scratch, work);
        const double from = here.start_in_quiet(own.lo, start.skip());
        // T + bb must lie in the box too; what is nearer to its end is another cell's.
        here.search(octree_.trees().tree(number), from, own.hi - 2 * here.widest_band());
        if (here.disturbed()) {
          unsure = true;
          return -kInfinity;
        }
        if (here.inside() != start.inside() || !(here.hit().t < nearest.t)) return kInfinity;
        nearest = here.hit();
        return nearest.t;
      });
      if (!unsure) return nearest;
      BoundarySearch again(*tree_, ray, scratch, work);
      if (again.skip() < in.lo) again.pass_constant(false);
      return in_order(ray, reciprocal, t0, in.hi, again, work);
    });
  }

  Octree octree_;
  EmbreeBoxes boxes_;
};

}  // namespace

extern const SchemeInfo scheme_embree_cells;
const SchemeInfo scheme_embree_cells{
    .name = "embree_cells",
    .title = "Embree BVH over the hybrid's cells",
    .params = octree_params(),
    .make = [](std::shared_ptr<const CsgTree> tree, const Params& params) -> std::unique_ptr<Tracer> {
      return std::make_unique<EmbreeCells>(std::move(tree), OctreeLimits::of(params));
    }};

}  // namespace csg
