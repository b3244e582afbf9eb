// Chuang–Hwang style, reconstructed: non-uniform cuts along the faces of S-bounds.
//
// Chuang and Hwang 1995 subdivide space along the face planes of the S-bounds of the CSG tree's
// nodes, from the primitives upwards, and keep a localized tree in each voxel. The abstract and the
// literature do not give the order of the planes nor the rule that ends the cutting, so this is a
// reconstruction: a binary space partition by axis-aligned planes, in which a region is cut along a
// face of an S-bound of its own localized tree until it has at most h halfspaces, is at level d, or no
// face passes through it.
//   order           bottom_up: faces of the primitives first, in the order of the source, then of their
//                   parents. top_down: of the root first, then of its children.
//                   median: the face that divides the primitives' S-bounds most evenly.
//   d, h            limits, as for the octree; a level is one cut.
//   build_threads   as for sdsm: the same regions, whatever their number.
//   budget_mb       where it is spent, regions stay uncut.
#include "../structures/subdivision.hpp"

namespace csg {
namespace {

enum class Order { BottomUp, TopDown, Median };

struct Plane {
  int axis = -1;  // −1: there is none
  double at = 0;
};

class ChuangHwang final : public Tracer {
 public:
  ChuangHwang(std::shared_ptr<const CsgTree> tree, int d, int h, Order order, const BuildLimits& limits)
      : Tracer(std::move(tree)), world_(tree_->world()), nodes_(1), trees_(*tree_) {
    Subdivision<Divider> subdivision({*this, d, h, order}, trees_, limits);
    subdivision.build(global_tree(*tree_), {world_, {}}, 0);
    deepest_level_ = subdivision.deepest_level();
    over_budget_ = subdivision.over_budget();
    nodes_.shrink_to_fit();
    trees_.shrink();
  }

  std::size_t bytes() const override { return nodes_.size() * sizeof(BspNode) + trees_.bytes(); }

  std::map<std::string, double> facts() const override {
    std::map<std::string, double> facts{{"cells", static_cast<double>(nodes_.size() / 2 + 1)},
                                        {"deepest_level", deepest_level_}};
    if (over_budget_ > 0) facts["cells_over_budget"] = static_cast<double>(over_budget_);
    trees_.describe(facts);
    return facts;
  }

  static constexpr int kDeepest = 60;

 private:
  struct BspNode {
    double at;          // of the plane
    std::int32_t link;  // index of the child below it, which the one above follows; of a leaf: the cell's code
    std::int32_t axis;  // −1: a leaf
  };

  /// As Subdivision asks for it. A slot is an index into `nodes_`.
  class Divider {
   public:
    struct Place {
      Box region;
      Plane cut;
    };
    using Parts = CellParts<Place, 2>;

    Divider(ChuangHwang& bsp, int d, int h, Order order)
        : bsp_(bsp), d_(d), h_(h), order_(order), classifier_(*bsp.tree_) {}

    static const Box& box(const Place& place) { return place.region; }

    Class localize(TreeView tree, const Place& place, std::vector<TreeNode>& localized) {
      return classifier_.localize(tree, place.region, localized);
    }
    void divide(TreeView tree, const Place& place, Parts& parts) {
      parts.places[0] = parts.places[1] = place;
      parts.places[0].region.hi[place.cut.axis] = parts.places[1].region.lo[place.cut.axis] = place.cut.at;
      for (int i = 0; i < 2; ++i) parts.kinds[i] = localize(tree, parts.places[i], parts.trees[i]);
    }
    bool divides(TreeView tree, Place& place, int level) {
      place.cut = level < d_ && leaf_count(tree) > h_ ? choose(tree, place.region) : Plane{};
      return place.cut.axis >= 0;
    }

    std::size_t open(std::size_t slot, const Place& place) {
      const std::size_t first = bsp_.nodes_.size();
      bsp_.nodes_[slot] = {place.cut.at, static_cast<std::int32_t>(first), place.cut.axis};
      bsp_.nodes_.resize(first + 2);
      return first;
    }
    void close(std::size_t slot, const Place&, Cell cell) { bsp_.nodes_[slot] = {0, cell.code(), -1}; }
    std::size_t bytes() const { return bsp_.bytes(); }

   private:
    /// A cut is worth making only if both parts are much thicker than the pad of classes.
    bool cuts(const Box& region, int axis, double at) const {
      const double margin = 16 * bsp_.tree_->pad();
      return region.lo[axis] + margin < at && at < region.hi[axis] - margin;
    }

    Plane choose(TreeView tree, const Box& region) {
      sbounds(*bsp_.tree_, tree, region, SBoundPasses::One, bounds_);
      if (order_ == Order::Median) return median(tree, region);
      const std::size_t count = tree.size();
      for (std::size_t i = 0; i < count; ++i) {
        const Box& bound = bounds_[order_ == Order::TopDown ? i : count - 1 - i];
        if (bound.empty()) continue;
        for (int axis = 0; axis < 3; ++axis) {
          if (cuts(region, axis, bound.lo[axis])) return {axis, bound.lo[axis]};
          if (cuts(region, axis, bound.hi[axis])) return {axis, bound.hi[axis]};
        }
      }
      return {};
    }

    /// Minimizes the larger number of primitives' S-bounds on one side, straddlers counted twice.
    Plane median(TreeView tree, const Box& region) {
      Plane best;
      std::size_t fewest = leaf_count(tree) + std::size_t{1};
      for (int axis = 0; axis < 3; ++axis) {
        lows_.clear();
        highs_.clear();
        for (std::size_t i = 0; i < tree.size(); ++i)
          if (tree[i].is_leaf() && !bounds_[i].empty())
            lows_.push_back(bounds_[i].lo[axis]), highs_.push_back(bounds_[i].hi[axis]);
        std::sort(lows_.begin(), lows_.end());
        std::sort(highs_.begin(), highs_.end());
        for (const std::vector<double>* faces : {&lows_, &highs_}) {
          std::size_t below = 0, left = 0;  // S-bounds that begin below the face, that end there or below
          for (const double at : *faces) {
            while (below < lows_.size() && lows_[below] < at) ++below;
            while (left < highs_.size() && highs_[left] <= at) ++left;
            const std::size_t more = std::max(below, highs_.size() - left);
            if (more < fewest && cuts(region, axis, at)) fewest = more, best = {axis, at};
          }
        }
      }
      return best;
    }

    ChuangHwang& bsp_;
    int d_, h_;
    Order order_;
    CellClassifier classifier_;
    std::vector<Box> bounds_;
    std::vector<double> lows_, highs_;
  };

  template <class Visit>
  void walk(const Ray& ray, const Reciprocal& reciprocal, double t0, double t1, Visit visit) const {
    struct Task {
      std::int32_t node;
      double t0, t1;
    };
    Task stack[kDeepest + 2];
    int top = 0;
    stack[top++] = {0, t0, t1};
    while (top > 0) {
      Task task = stack[--top];
      for (;;) {
        const BspNode& node = nodes_[static_cast<std::size_t>(task.node)];
        if (node.axis < 0) {
          if (visit(Cell::decode(node.link), task.t0, task.t1)) return;
          break;
        }
        const std::int32_t below = node.link, above = node.link + 1;
        if (reciprocal.parallel[node.axis]) {
          task.node = ray.origin[node.axis] < node.at ? below : above;
          continue;
        }
        const bool forward = reciprocal.forward[node.axis];
        const std::int32_t near = forward ? below : above, far = forward ? above : below;
        const double t = reciprocal.plane(node.axis, node.at, ray.origin);
        if (t <= task.t0) {
          task.node = far;
        } else {
          if (t < task.t1) {
            stack[top++] = {far, t, task.t1};
            task.t1 = t;
          }
          task.node = near;
        }
      }
    }
  }

  void trace_batch(std::span<const Ray> rays, std::span<Hit> hits, Counters* counters) const override {
    trace_cells(*tree_, world_, trees_, rays, hits, counters, [&](auto&&... along) { walk(along...); });
  }

  Box world_;
  std::vector<BspNode> nodes_;
  CellTrees trees_;
  int deepest_level_ = 0;
  std::size_t over_budget_ = 0;  // regions not cut for want of memory
};

}  // namespace

extern const SchemeInfo scheme_chuang_hwang;
const SchemeInfo scheme_chuang_hwang{
    .name = "chuang_hwang",
    .title = "Chuang–Hwang style (reconstructed)",
    .params = {{.name = "d",
                .meaning = "maximum number of cuts above a cell",
                .default_value = 20L,
                .minimum = 0,
                .maximum = ChuangHwang::kDeepest,
                .trial_values = {0L, 6L, 12L}},
               {.name = "h",
                .meaning = "a region of at most this many halfspaces is not cut",
                .default_value = 7L,
                .minimum = 1,
                .maximum = 1000000,
                .trial_values = {1L, 6L}},
               {.name = "order",
                .meaning = "which face of which S-bound cuts first",
                .default_value = std::string("median"),
                .choices = {"bottom_up", "top_down", "median"},
                .trial_values = {std::string("bottom_up"), std::string("top_down"), std::string("median")}},
               build_threads_param(),
               budget_param()},
    .make = [](std::shared_ptr<const CsgTree> tree, const Params& params) -> std::unique_ptr<Tracer> {
      const std::string& order = params.choice("order");
      return std::make_unique<ChuangHwang>(std::move(tree), params.integer("d"), params.integer("h"),
                                           order == "bottom_up"  ? Order::BottomUp
                                           : order == "top_down" ? Order::TopDown
                                                                 : Order::Median,
                                           BuildLimits::of(params));
    }};

}  // namespace csg
