// Embree over primitives: what a BVH library gives when it is used as it is meant to be.
//
// Embree's BVH is built over the bounds of all halfspaces (user geometry, rounded outwards). A ray
// gathers the primitives whose boxes it meets, their spans are merged, and the whole tree is combined
// over just these: all others are outside. The first hit of a primitive cannot end the ray, since a
// subtraction found later may remove it. But where the nearest boxes are known, up to where the next
// one begins, all is known: so a ray goes from piece to piece, each as long as a few boxes last
// (multi-hit traversal with node culling, Gribble 2016). Chains of one operator are balanced: from a
// crossing up to the root it is a few steps, not as many as the chain is long.
//   nearest         boxes that begin in a piece; 0: the ray is one piece, and gathers all.
//   build_threads   of Embree's build.
#include <algorithm>

#include "../hit_rule.hpp"
#include "../params.hpp"
#include "../structures/embree.hpp"
#include "../structures/parallel.hpp"

namespace csg {
namespace {

class EmbreePrimitives final : public Tracer {
 public:
  EmbreePrimitives(std::shared_ptr<const CsgTree> tree, int nearest, std::size_t threads)
      : Tracer(std::move(tree)),
        nearest_(static_cast<std::size_t>(nearest)),
        nodes_(balanced(global_tree(*tree_))),
        world_(tree_->world()),
        boxes_(leaf_boxes(*tree_), size_with_pads(world_, tree_->size()), threads) {
    node_of_leaf_.resize(tree_->leaves().size());
    for (std::uint32_t i = 0; i < nodes_.size(); ++i)
      if (nodes_[i].is_leaf()) node_of_leaf_[static_cast<std::size_t>(nodes_[i].leaf())] = i;
  }

  std::size_t bytes() const override {
    return nodes_.size() * sizeof(TreeNode) + node_of_leaf_.size() * sizeof(node_of_leaf_[0]) + boxes_.bytes();
  }

 private:
  static std::vector<Box> leaf_boxes(const CsgTree& tree) {
    std::vector<Box> boxes;
    for (const Leaf& leaf : tree.leaves()) boxes.push_back(leaf.bounds.padded(leaf.pad));
    return boxes;
  }

  /// A box that a ray meets, and where it begins.
  struct Met {
    double enter;
    unsigned leaf;
  };
  struct Gathered {
    std::vector<Met> met;
    std::vector<double> ahead;  // a heap: where the nearest boxes that begin ahead do so, the last of them first
  };

  /// What the search will read of a leaf comes from afar while Embree looks for the next box.
  void fetch(unsigned leaf) const {
    const auto* first = reinterpret_cast<const char*>(&tree_->leaves()[leaf]);
    for (std::size_t line = 0; line < sizeof(Leaf); line += 64) __builtin_prefetch(first + line);
    __builtin_prefetch(&node_of_leaf_[leaf]);
  }

  /// Gathers the boxes on [t0, t1) and returns where the piece of the ray ends of which all are there: before
  /// one more than `nearest_` begin, by more than `margin`.
  template <class Work>
  double gather(const Ray& ray, const Reciprocal& reciprocal, double t0, double t1, double margin, Work& work,
                Gathered& out) const {
    out.met.clear();
    out.ahead.clear();
    boxes_.query(ray, t0, t1, [&](unsigned leaf) {
      work.cell();
      const Interval in = slab(boxes_.box(leaf), ray.origin, reciprocal);
      if (in.empty()) return kInfinity;
      fetch(leaf);
      out.met.push_back({in.lo, leaf});
      if (nearest_ == 0 || !(t0 + 2 * margin < in.lo)) return kInfinity;
      out.ahead.push_back(in.lo);
      std::push_heap(out.ahead.begin(), out.ahead.end());
      if (out.ahead.size() <= nearest_) return kInfinity;
      if (out.ahead.size() > nearest_ + 1) {
        std::pop_heap(out.ahead.begin(), out.ahead.end());
        out.ahead.pop_back();
      }
      return out.ahead.front();
    });
    return nearest_ == 0 || out.ahead.size() <= nearest_ ? t1 : out.ahead.front() - margin;
  }

  void trace_batch(std::span<const Ray> rays, std::span<Hit> hits, Counters* counters) const override {
    Gathered gathered;
    for_each_ray(rays, hits, counters, scratches_, [&](const Ray& ray, SearchScratch& scratch, auto& work) {
      BoundarySearch search(*tree_, ray, scratch, work);
      const Reciprocal reciprocal(ray.dir);
      const Interval in = slab(world_, ray.origin, reciprocal);
      if (!(in.lo < in.hi) || !(search.skip() < in.hi) || !(in.lo < ray.t_max)) return search.hit();
      if (search.skip() < in.lo) search.pass_constant(false);
      const double margin = 4 * search.widest_band();
      for (double t0 = std::max(in.lo, search.skip()), t1; t0 < in.hi && t0 < ray.t_max; t0 = t1) {
        t1 = gather(ray, reciprocal, t0, in.hi, margin, work, gathered);
        const bool ended = search.search(nodes_, t0, t1, [&](auto visit) {
          for (const Met& met : gathered.met)
            if (met.enter < t1 + margin) visit(node_of_leaf_[met.leaf]);
        });
        if (ended) break;
      }
      return search.hit();
    });
  }

  std::size_t nearest_;
  std::vector<TreeNode> nodes_;
  mutable Pool<SearchScratch> scratches_;
  std::vector<std::uint32_t> node_of_leaf_;
  Box world_;
  EmbreeBoxes boxes_;
};

}  // namespace

extern const SchemeInfo scheme_embree_primitives;
const SchemeInfo scheme_embree_primitives{
    .name = "embree_primitives",
    .title = "Embree BVH over primitives",
    .params = {{.name = "nearest",
                .meaning = "boxes that begin in a piece of a ray, which is searched before the next; 0: all at once",
                .default_value = 8L,
                .minimum = 0,
                .maximum = 1000,
                .trial_values = {0L, 1L, 8L}},
               build_threads_param()},
    .make = [](std::shared_ptr<const CsgTree> tree, const Params& params) -> std::unique_ptr<Tracer> {
      return std::make_unique<EmbreePrimitives>(std::move(tree), params.integer("nearest"),
                                                thread_count(params.integer("build_threads")));
    }};

}  // namespace csg
