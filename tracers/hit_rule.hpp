// The hit rule: what the first boundary along a ray is, whatever structure finds it.
//
//  1. A leaf's crossings are a pure function of leaf and whole ray: finite, sorted, an even number.
//  2. f(t) is the solid's membership after all crossings ≤ t, equal bits together. Only changes of f
//     matter, never mere crossings: those of pruned leaves must not change the answer.
//  3. band = 16·E/|d|, E = u·(|o| + size); at a surface met at an angle θ to its normal, bb = band / cos θ, at
//     most 2²⁰ bands (2⁵ for float32).
//  4. skip = t_min + band, s = f(skip). The first change of f at some T > skip sets skip = T + bb. If
//     f(skip) = s there was no boundary (surfaces that are one but for rounding): go on from skip.
//     Otherwise T is the hit.
//  5. It counts if T < t_max, which touches nothing else.
//  6. Its leaf is, among the crossings in [T, T + bb], the lowest that alone changes the solid, from the
//     state before T or after it. θ in bb is taken at the leaf so found among those exactly at T. The normal is
//     that leaf's gradient there, out of the solid; where it has none (an apex, a torus' axis), the ray's way back.
//  7. Of the intervals [t0, t1) into which cells cut a ray, one owns T: t0 ≤ T < t1, and t1 is the next
//     one's t0 to the bit. s and skip travel from cell to cell.
//  8. A cell looks at crossings a little beyond its interval, by two of the widest bands.
//  9. Classes of cells and S-bounds hold with a pad P = 2⁻²⁰·size (2⁻¹² for float32), more than four of
//     the widest bands and a kernel's error. Rays from so far that this fails are first moved to the world.
// 10. Trees are simplified by Full and Empty only; boxes that touch are not empty.
// 11. A ray that goes on behind a hit carries skip.
// 12. A shadow ray starts 16 bands off the surface, with t_min = 0.
#pragma once
#include <algorithm>
#include <vector>

#include "csg/localized_tree.hpp"
#include "error_unit.hpp"
#include "pool.hpp"
#include "primitives/primitive.hpp"
#include "slab.hpp"
#include "tracer.hpp"

namespace csg {

/// A leaf of a localized tree met by the ray.
struct Crossing {
  double t;
  std::int32_t leaf;
  std::uint32_t node;
  std::uint8_t face;
};

/// The unit normal of a leaf where a ray crosses it.
inline Vec3 unit_normal(const Leaf& leaf, std::uint8_t face, const Ray& ray, double t) {
  const Vec3 gradient = leaf_normal(leaf, face, ray.origin + t * ray.dir);
  const double norm = length(gradient);
  if (!(norm > 0 && norm < kInfinity)) return (-1 / length(ray.dir)) * ray.dir;  // an apex, a torus' axis
  return (1 / norm) * gradient;
}

/// Memory that a batch of rays shares.
struct SearchScratch {
  TreeState state;
  std::vector<Crossing> crossings;
  std::vector<std::uint32_t> started_inside;
};

template <class Work>
class BoundarySearch {
 public:
  BoundarySearch(const CsgTree& model, const Ray& ray, SearchScratch& scratch, Work& work)
      : model_(model), ray_(ray), scratch_(scratch), work_(work) {
    speed_ = length(ray.dir);
    band_ = tolerances().band(ray.origin, speed_);
    widest_band_ = tolerances().band_at(band_, 0);
    skip_ = ray.t_min + band_;
  }

  const Ray& ray() const { return ray_; }
  double skip() const { return skip_; }
  double widest_band() const { return widest_band_; }
  const Hit& hit() const { return hit_; }

  /// The ray is in a cell without surface, or outside the world.
  void pass_constant(bool inside) {
    if (!started_) inside_ = inside, started_ = true;
  }

  /// For a search of one cell alone, apart from those before it (embree_cells). Starts where the ray
  /// has been in the cell's box for longer than a tie band: if the tree was quiet until then, `skip`
  /// cannot reach in from outside. Where the ray itself starts later, that is the start.
  double start_in_quiet(double enter, double ray_start) {
    quiet_from_ = ray_start < enter ? enter : kInfinity;
    skip_ = ray_start < enter ? enter + 2 * widest_band_ : ray_start;
    return skip_;
  }
  /// Whether a crossing was met where there should be none.
  bool disturbed() const { return disturbed_; }
  bool inside() const { return inside_; }

  /// Searches [t0, t1) with a localized tree of which `select(visit)` calls `visit(node)` for each
  /// leaf to test. True if the search has ended, with or without a hit.
  template <class Select>
  bool search(TreeView tree, double t0, double t1, Select select) {
    collect(tree, t0, t1, select);
    std::vector<Crossing>& events = scratch_.crossings;
    if (events.empty() && started_) return false;
    TreeState& state = scratch_.state;
    state.reset(tree);
    for (const std::uint32_t node : scratch_.started_inside) state.toggle(node, work_);
    pass_constant(state.inside());
    std::sort(events.begin(), events.end(),
              [](const Crossing& a, const Crossing& b) { return a.t < b.t || (a.t == b.t && a.leaf < b.leaf); });

    const std::size_t count = events.size();
    for (std::size_t first = 0; first < count;) {
      const double t = events[first].t;
      if (t >= t1) return false;
      std::size_t after = first;
      while (after < count && events[after].t == t) state.toggle(events[after++].node, work_);
      if (state.inside() == inside_) {
        first = after;
        continue;
      }
      const double cosine = dot(normal(events[decisive(first, after, after)]), ray_.dir) / speed_;
      skip_ = t + tolerances().band_at(band_, cosine);
      std::size_t end = after;
      while (end < count && events[end].t <= skip_) state.toggle(events[end++].node, work_);
      if (state.inside() == inside_) {
        first = end;
        continue;
      }
      if (t < ray_.t_max) {
        for (std::size_t i = end; i-- > after;) state.toggle(events[i].node, work_);
        const Crossing& on = events[decisive(first, after, end)];
        hit_ = {t, oriented(normal(on)), on.leaf};
      }
      return true;
    }
    return false;
  }

  /// All leaves of the tree.
  bool search(TreeView tree, double t0, double t1) {
    return search(tree, t0, t1, [&](auto visit) {
      for (std::uint32_t i = 0; i < tree.size(); ++i)
        if (tree[i].is_leaf()) visit(i);
    });
  }

 private:
  const Tolerances& tolerances() const { return model_.tolerances(); }

  /// Crossings before the interval, or before `skip`, only tell where the ray starts inside.
  template <class Select>
  void collect(TreeView tree, double t0, double t1, Select select) {
    scratch_.crossings.clear();
    scratch_.started_inside.clear();
    const double last = t1 + 2 * widest_band_;
    select([&](std::uint32_t node) {
      work_.primitive();
      const std::int32_t leaf = tree[node].leaf();
      const Crossings found = crossings(model_.leaves()[static_cast<std::size_t>(leaf)], ray_);
      bool inside = false;
      for (int i = 0; i < found.count; ++i) {
        const double t = found.t[i];
        if (t <= skip_ || t < t0) {
          inside = !inside;
          disturbed_ |= t > quiet_from_;
        } else if (t <= last) {
          scratch_.crossings.push_back({t, leaf, node, found.face[i]});
        }
      }
      if (inside) scratch_.started_inside.push_back(node);
    });
  }

  /// Rule 6: among the crossings [first, end), of which [first, after) lie at T, the one of the lowest
  /// leaf that alone changes the root from the state before T or after it; if there is none, the one
  /// that does when those at T are toggled in the order of leaves. The state is, and stays, after T.
  std::size_t decisive(std::size_t first, std::size_t after, std::size_t end) {
    if (end == first + 1) return first;
    std::vector<Crossing>& events = scratch_.crossings;
    TreeState& state = scratch_.state;
    std::size_t best = end;
    const auto try_alone = [&] {
      const bool before = state.inside();
      for (std::size_t i = first; i < end; ++i) {
        if (best < end && events[i].leaf >= events[best].leaf) continue;
        state.toggle(events[i].node, work_);
        const bool changes = state.inside() != before;
        state.toggle(events[i].node, work_);
        if (changes) best = i;
      }
    };
    try_alone();
    for (std::size_t i = first; i < after; ++i) state.toggle(events[i].node, work_);
    try_alone();
    const bool before = state.inside();
    for (std::size_t i = first; i < after; ++i) {
      state.toggle(events[i].node, work_);
      if (best == end && state.inside() != before) best = i;
    }
    return best;
  }

  Vec3 normal(const Crossing& on) const {
    return unit_normal(model_.leaves()[static_cast<std::size_t>(on.leaf)], on.face, ray_, on.t);
  }

  /// Out of the solid: against the ray if it enters, with it if it leaves.
  Vec3 oriented(const Vec3& normal) const {
    const bool along = dot(normal, ray_.dir) > 0;
    return along == inside_ ? normal : -normal;
  }

  const CsgTree& model_;
  const Ray& ray_;
  SearchScratch& scratch_;
  Work& work_;
  double speed_, band_, widest_band_, skip_;
  double quiet_from_ = kInfinity;
  bool disturbed_ = false;
  bool started_ = false;
  bool inside_ = false;  // s
  Hit hit_;
};

/// Runs `one(ray, scratch, work)`, which returns a Hit, over a batch, counting if asked to.
template <class One>
void for_each_ray(std::span<const Ray> rays, std::span<Hit> hits, Counters* counters, SearchScratch& scratch, One one) {
  const auto run = [&](auto work) {
    for (std::size_t i = 0; i < rays.size(); ++i) hits[i] = one(rays[i], scratch, work);
  };
  if (counters)
    run(CountWork{*counters});
  else
    run(CountNothing{});
}
template <class One>
void for_each_ray(std::span<const Ray> rays, std::span<Hit> hits, Counters* counters, One one) {
  SearchScratch scratch;
  for_each_ray(rays, hits, counters, scratch, one);
}

/// The same for rays that are all searched with one tree, however many batches of them there are: a state that
/// stays is filled once. The tree lives as long as the pool, so that no other one ever has its address.
template <class One>
void for_each_ray(std::span<const Ray> rays, std::span<Hit> hits, Counters* counters, Pool<SearchScratch>& scratches,
                  One one) {
  std::unique_ptr<SearchScratch> scratch = scratches.take([] { return std::make_unique<SearchScratch>(); });
  for_each_ray(rays, hits, counters, *scratch, one);
  scratches.give_back(std::move(scratch));
}

}  // namespace csg
