// Uniform grid: a localized CSG tree in each voxel of a regular grid (Bouatouch et al. 1987).
//
// The solid's bounding box is cut into n voxels along its longest side and as many of about the same
// size along the others. Rays go from voxel to voxel by 3D-DDA (Amanatides and Woo 1987), with t
// computed from the plane's index and never summed up, so that no voxel is skipped.
//   n               voxels along the longest side.
//   build_threads   as for sdsm: the same grid, whatever their number.
//   budget_mb       where it is spent, voxels side by side share a tree.
#include "../structures/subdivision.hpp"

namespace csg {
namespace {

class UniformGrid final : public Tracer {
 public:
  UniformGrid(std::shared_ptr<const CsgTree> tree, int resolution, const BuildLimits& limits)
      : Tracer(std::move(tree)), world_(tree_->world()), trees_(*tree_) {
    const Vec3 extent = world_.hi - world_.lo;
    const double voxel = std::max({extent.x, extent.y, extent.z}) / resolution;
    for (int axis = 0; axis < 3; ++axis) {
      size_[axis] = std::clamp(static_cast<int>(std::lround(extent[axis] / voxel)), 1, resolution);
      step_[axis] = extent[axis] / size_[axis];
    }
    cells_.resize(static_cast<std::size_t>(size_[0]) * static_cast<std::size_t>(size_[1]) *
                  static_cast<std::size_t>(size_[2]));
    Subdivision<Divider> subdivision(Divider(*this), trees_, limits);
    subdivision.build(global_tree(*tree_), {{0, 0, 0}, {size_[0], size_[1], size_[2]}}, 0);
    over_budget_ = subdivision.over_budget();
    trees_.shrink();
  }

  std::size_t bytes() const override { return cells_.size() * sizeof(cells_[0]) + trees_.bytes(); }

  std::map<std::string, double> facts() const override {
    std::map<std::string, double> facts{{"cells", static_cast<double>(cells_.size())}};
    if (over_budget_ > 0) facts["cells_over_budget"] = static_cast<double>(over_budget_);
    trees_.describe(facts);
    return facts;
  }

 private:
  double plane(int axis, int index) const { return world_.lo[axis] + index * step_[axis]; }
  std::size_t index(const int at[3]) const {
    return static_cast<std::size_t>(at[0]) +
           static_cast<std::size_t>(size_[0]) *
               (static_cast<std::size_t>(at[1]) + static_cast<std::size_t>(size_[1]) * static_cast<std::size_t>(at[2]));
  }

  /// As Subdivision asks for it: a range of voxels is divided until it is constant or one voxel.
  class Divider {
   public:
    struct Place {
      int lo[3], hi[3];
    };
    using Parts = CellParts<Place, 8>;

    explicit Divider(UniformGrid& grid) : grid_(grid), classifier_(*grid.tree_) {}

    Box box(const Place& range) const {
      Box box;
      for (int axis = 0; axis < 3; ++axis) {
        box.lo[axis] = grid_.plane(axis, range.lo[axis]);
        box.hi[axis] = grid_.plane(axis, range.hi[axis]);
      }
      return box;
    }

    Class localize(TreeView tree, const Place& range, std::vector<TreeNode>& localized) {
      return classifier_.localize(tree, box(range), localized);
    }
    /// At the middle of each side that is more than half as long as the longest.
    void divide(TreeView tree, const Place& range, Parts& parts) {
      std::fill_n(parts.places, Parts::kCount, range);
      Vec3 planes{kInfinity, kInfinity, kInfinity};
      for (int axis = 0; axis < 3; ++axis) {
        const bool halved = 2 * side(range, axis) > std::max(longest(range), 2);
        const int middle = halved ? (range.lo[axis] + range.hi[axis]) / 2 : range.hi[axis];
        if (halved) planes[axis] = grid_.plane(axis, middle);
        for (int i = 0; i < 8; ++i) (i >> axis & 1 ? parts.places[i].lo : parts.places[i].hi)[axis] = middle;
      }
      classifier_.localize_octants(tree, box(range), planes, parts.kinds, parts.trees);
    }
    static bool divides(TreeView, const Place& range, int) { return longest(range) > 1; }

    std::size_t open(std::size_t, const Place&) { return 0; }  // ranges name themselves
    void close(std::size_t, const Place& range, Cell cell) {
      int at[3];
      for (at[2] = range.lo[2]; at[2] < range.hi[2]; ++at[2])
        for (at[1] = range.lo[1]; at[1] < range.hi[1]; ++at[1])
          for (at[0] = range.lo[0]; at[0] < range.hi[0]; ++at[0]) grid_.cells_[grid_.index(at)] = cell.code();
    }
    std::size_t bytes() const { return grid_.bytes(); }

   private:
    static int side(const Place& range, int axis) { return range.hi[axis] - range.lo[axis]; }
    static int longest(const Place& range) { return std::max({side(range, 0), side(range, 1), side(range, 2)}); }

    UniformGrid& grid_;
    CellClassifier classifier_;
  };

  template <class Visit>
  void walk(const Ray& ray, const Reciprocal& reciprocal, double t0, double t_end, Visit visit) const {
    int at[3], ahead[3], step[3];
    double next[3];
    const auto t_of = [&](int axis, int plane_index) {
      return reciprocal.plane(axis, plane(axis, plane_index), ray.origin);
    };
    for (int axis = 0; axis < 3; ++axis) {
      const bool forward = reciprocal.forward[axis];
      const double p = ray.origin[axis] + (reciprocal.parallel[axis] ? 0 : t0 * ray.dir[axis]);
      at[axis] = std::clamp(static_cast<int>(std::floor((p - world_.lo[axis]) / step_[axis])), 0, size_[axis] - 1);
      step[axis] = forward ? 1 : -1;
      ahead[axis] = forward ? 1 : 0;
      next[axis] = kInfinity;
      if (reciprocal.parallel[axis]) continue;
      // The voxel is the one whose planes, by t, enclose t0.
      while (0 <= at[axis] + step[axis] && at[axis] + step[axis] < size_[axis] &&
             t_of(axis, at[axis] + ahead[axis]) <= t0)
        at[axis] += step[axis];
      while (0 <= at[axis] - step[axis] && at[axis] - step[axis] < size_[axis] &&
             t0 < t_of(axis, at[axis] + 1 - ahead[axis]))
        at[axis] -= step[axis];
      next[axis] = t_of(axis, at[axis] + ahead[axis]);
    }
    for (;;) {
      const int axis = next[0] < next[1] ? (next[0] < next[2] ? 0 : 2) : (next[1] < next[2] ? 1 : 2);
      const double t1 = std::min(next[axis], t_end);
      if (t0 < t1) {
        if (visit(Cell::decode(cells_[index(at)]), t0, t1)) return;
        t0 = t1;
      }
      at[axis] += step[axis];
      if (!(t1 < t_end) || at[axis] < 0 || at[axis] >= size_[axis]) return;
      next[axis] = t_of(axis, at[axis] + ahead[axis]);
    }
  }

  void trace_batch(std::span<const Ray> rays, std::span<Hit> hits, Counters* counters) const override {
    trace_cells(*tree_, world_, trees_, rays, hits, counters, [&](auto&&... along) { walk(along...); });
  }

  Box world_;
  int size_[3];
  Vec3 step_;
  std::vector<std::int32_t> cells_;
  std::size_t over_budget_ = 0;  // ranges of voxels that share a tree for want of memory
  CellTrees trees_;
};

}  // namespace

extern const SchemeInfo scheme_uniform_grid;
const SchemeInfo scheme_uniform_grid{
    .name = "uniform_grid",
    .title = "Uniform grid (Bouatouch)",
    .params = {{.name = "n",
                .meaning = "voxels along the longest side of the solid's bounding box",
                .default_value = 48L,
                .minimum = 1,
                .maximum = 400,
                .trial_values = {1L, 7L, 32L}},
               build_threads_param(),
               budget_param()},
    .make = [](std::shared_ptr<const CsgTree> tree, const Params& params) -> std::unique_ptr<Tracer> {
      return std::make_unique<UniformGrid>(std::move(tree), params.integer("n"), BuildLimits::of(params));
    }};

}  // namespace csg
