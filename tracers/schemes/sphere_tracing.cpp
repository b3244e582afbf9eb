// Sphere tracing: marching by signed distance bounds (Hart 1996), the common way to draw CSG that is
// never intersected. Inexact: it stops at a tolerance, a stated part of the model's size.
// A leaf's bound is its local signed distance times the smallest stretch of its transform; a union
// takes the least of its children's, an intersection the greatest, a complement changes the sign. No
// surface is nearer than the result says, so a ray may go that far. Over the whole tree this is O(n) a
// step, so the march is made inside the cells of sdsm's octree with their localized trees. There the
// bound holds for the surfaces in the cell alone: no step leads out of it, the next cell goes on.
//   d, h       as for sdsm; small cells pay, since each step evaluates a whole localized tree.
//   tolerance  k: where the bound is below 10⁻ᵏ of the model's size, the ray has hit.
//   steps      the most a ray takes. One that runs out of them has hit where it is if its last step
//              drew it nearer to the surface, and misses if not.
// What decides a hit:
//   - The ray starts as the hit rule says, a tie band on; the sign there, or of its cell, is the side
//     that it is on. It marches by the absolute value, so it may start inside.
//   - One that starts within the tolerance of a surface, as shadow rays do, must first leave it: until
//     it has been seen beyond the tolerance, it goes in steps of at least the tolerance and hits only
//     where its side changes. It passes through what is thinner than a step.
//   - Where its side changes, be it between cells, a boundary was missed: the hit is there, on the leaf
//     that decided last.
// Limits: depth is short by up to the tolerance over the cosine, and outlines are fatter by it (more
// under a transform that is no similarity, where the bound is below the distance). Surfaces that
// cancel, as of A − A and inside flush unions, are still zeros of the bound: they are hit.
#include <cmath>

#include "../primitives/distance.hpp"
#include "../structures/octree.hpp"

namespace csg {
namespace {

/// The bound of a subtree at a point: of the leaf that decides, with the sign of the complements above.
struct Bound {
  double distance = 0;
  std::int32_t leaf = -1;
  bool complemented = false;
};

/// What all rays share.
struct MarchLimits {
  double tolerance;  ///< model units
  int steps;
};

/// One ray on its way through the cells.
template <class Work>
class March {
 public:
  March(const CsgTree& model, const std::vector<double>& stretch, MarchLimits limits, const Ray& ray,
        std::vector<Bound>& bounds, Work& work)
      : model_(model), stretch_(stretch), limits_(limits), ray_(ray), bounds_(bounds), work_(work) {
    speed_ = length(ray.dir);
    start_ = ray.t_min + model.tolerances().band(ray.origin, speed_);
  }

  double start() const { return start_; }
  const Hit& hit() const { return hit_; }

  /// The ray comes from outside the world, where it is near nothing.
  void come_from_outside() { side_known_ = true, in_shell_ = false; }

  /// Through a cell without surface; true if the march has ended.
  bool pass_constant(bool full, double t0) {
    if (changes_side(full) && last_.leaf >= 0) return report(last_, t0);
    inside_ = full;
    return false;
  }

  /// Through [t0, t1) by a localized tree; true if the march has ended.
  bool pass(TreeView tree, double t0, double t1) {
    for (double t = t0; t < t1;) {
      const double before = std::fabs(last_.distance);
      last_ = bound(tree, ray_.origin + t * ray_.dir);
      const double distance = std::fabs(last_.distance);
      const bool near = distance < limits_.tolerance;
      if (changes_side(last_.distance < 0) || (near && !in_shell_)) return report(last_, t);
      if (++steps_ == limits_.steps) return distance < before ? report(last_, t) : true;
      in_shell_ = in_shell_ && near;
      t += std::max(distance, limits_.tolerance) / speed_;
    }
    return false;
  }

 private:
  /// True if it is not the side that the ray was on; the first side that is seen is where it starts.
  bool changes_side(bool inside) {
    if (!side_known_) inside_ = inside, side_known_ = true;
    return inside != inside_;
  }

  /// Children stand behind their parents, the left one next to them: backwards, no recursion.
  Bound bound(TreeView tree, const Vec3& p) {
    bounds_.resize(std::max(bounds_.size(), tree.size()));
    for (std::size_t i = tree.size(); i-- > 0;) {
      const TreeNode& node = tree[i];
      Bound& here = bounds_[i];
      if (node.is_leaf()) {
        const auto leaf = static_cast<std::size_t>(node.leaf());
        here = {stretch_[leaf] * local_distance(model_.leaves()[leaf], p).value, node.leaf(), false};
        work_.primitive();
      } else {
        const Bound& left = bounds_[i + 1];
        const Bound& right = bounds_[i + 1 + static_cast<std::size_t>(tree[i + 1].subtree())];
        const bool take_left = node.is_union() ? left.distance <= right.distance : left.distance >= right.distance;
        here = take_left ? left : right;
        work_.boolean();
      }
      if (node.complemented()) here.distance = -here.distance, here.complemented = !here.complemented;
    }
    return bounds_[0];
  }

  bool report(const Bound& on, double t) {
    if (!(t < ray_.t_max)) return true;
    const Leaf& leaf = model_.leaves()[static_cast<std::size_t>(on.leaf)];
    const Vec3 p = ray_.origin + t * ray_.dir;
    const Vec3 gradient = leaf_normal(leaf, local_distance(leaf, p).face, p);
    const double norm = length(gradient);
    if (norm > 0 && norm < kInfinity)
      hit_ = {t, ((on.complemented ? -1 : 1) / norm) * gradient, on.leaf};
    else  // an apex, a torus' axis
      hit_ = {t, ((inside_ ? 1 : -1) / speed_) * ray_.dir, on.leaf};
    return true;
  }

  const CsgTree& model_;
  const std::vector<double>& stretch_;
  const MarchLimits limits_;
  const Ray& ray_;
  std::vector<Bound>& bounds_;  // one a node
  Work& work_;
  double speed_, start_;
  Bound last_;
  int steps_ = 0;
  bool side_known_ = false, inside_ = false;
  bool in_shell_ = true;  // not yet seen beyond the tolerance
  Hit hit_;
};

class SphereTracing final : public Tracer {
 public:
  SphereTracing(std::shared_ptr<const CsgTree> tree, OctreeLimits cells, MarchLimits limits)
      : Tracer(std::move(tree)), octree_(*tree_, cells), limits_(limits) {
    stretch_.reserve(tree_->leaves().size());
    for (const Leaf& leaf : tree_->leaves()) stretch_.push_back(smallest_stretch(leaf));
  }

  std::size_t bytes() const override { return octree_.bytes() + stretch_.size() * sizeof(stretch_[0]); }
  std::map<std::string, double> facts() const override { return octree_.facts(); }

 private:
  void trace_batch(std::span<const Ray> rays, std::span<Hit> hits, Counters* counters) const override {
    std::vector<Bound> bounds;
    for_each_ray(rays, hits, counters, [&](const Ray& ray, SearchScratch&, auto& work) {
      March march(*tree_, stretch_, limits_, ray, bounds, work);
      const Reciprocal reciprocal(ray.dir);
      const Interval in = slab(octree_.world(), ray.origin, reciprocal);
      if (!(in.lo < in.hi) || !(march.start() < in.hi) || !(in.lo < ray.t_max)) return march.hit();
      if (march.start() < in.lo) march.come_from_outside();
      bool ended = false;
      octree_.walk(ray, reciprocal, std::max(in.lo, march.start()), in.hi, [&](Cell cell, double t0, double t1) {
        work.cell();
        ended = cell.is_partial() ? march.pass(octree_.trees().tree(cell.tree()), t0, t1)
                                  : march.pass_constant(cell.is_full(), t0);
        return ended || !(t1 < ray.t_max);
      });
      if (!ended) march.pass_constant(false, in.hi);  // out of the world
      return march.hit();
    });
  }

  Octree octree_;
  MarchLimits limits_;
  std::vector<double> stretch_;  // of each leaf, at least
};

std::vector<ParamSpec> sphere_tracing_params() {
  std::vector<ParamSpec> params = octree_params();
  for (ParamSpec& param : params)
    if (param.name == "h") param.default_value = 2L;  // a step costs all that a cell holds, not the few hit
  params.push_back({.name = "tolerance",
                    .meaning = "a point within 10^-tolerance of the model's size is on the surface",
                    .default_value = 6L,
                    .minimum = 2,
                    .maximum = 8,
                    .trial_values = {3L, 6L}});
  params.push_back({.name = "steps",
                    .meaning = "the most steps that a ray takes",
                    .default_value = 1024L,
                    .minimum = 1,
                    .maximum = 1000000,
                    .trial_values = {64L, 1024L}});
  return params;
}

}  // namespace

extern const SchemeInfo scheme_sphere_tracing;
const SchemeInfo scheme_sphere_tracing{
    .name = "sphere_tracing",
    .title = "Sphere tracing (Hart)",
    .exact = false,
    .own_numerics = true,
    .params = sphere_tracing_params(),
    .make = [](std::shared_ptr<const CsgTree> tree, const Params& params) -> std::unique_ptr<Tracer> {
      const double tolerance = std::pow(10.0, -params.integer("tolerance")) * tree->size();
      return std::make_unique<SphereTracing>(std::move(tree), OctreeLimits::of(params),
                                             MarchLimits{tolerance, params.integer("steps")});
    }};

}  // namespace csg
