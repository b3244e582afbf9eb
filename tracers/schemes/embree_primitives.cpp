// Embree over primitives: what a BVH library gives when it is used as it is meant to be.
//
// Embree's BVH is built over the bounds of all halfspaces (user geometry, rounded outwards). A ray
// gathers every primitive whose box it meets, their spans are merged, and the whole tree is combined
// over just these: all others are outside. Nothing can end the ray early, since a subtraction found
// later may remove what was found before. No parameters.
#include "../hit_rule.hpp"
#include "../params.hpp"
#include "../structures/embree.hpp"

namespace csg {
namespace {

class EmbreePrimitives final : public Tracer {
 public:
  explicit EmbreePrimitives(std::shared_ptr<const CsgTree> tree)
      : Tracer(std::move(tree)),
        nodes_(global_tree(*tree_)),
        world_(tree_->world()),
        boxes_(leaf_boxes(*tree_), size_with_pads(world_, tree_->size())) {
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

  void trace_batch(std::span<const Ray> rays, std::span<Hit> hits, Counters* counters) const override {
    for_each_ray(rays, hits, counters, [&](const Ray& ray, SearchScratch& scratch, auto& work) {
      BoundarySearch search(*tree_, ray, scratch, work);
      const Interval in = slab(world_, ray.origin, Reciprocal(ray.dir));
      if (!(in.lo < in.hi) || !(search.skip() < in.hi) || !(in.lo < ray.t_max)) return search.hit();
      if (search.skip() < in.lo) search.pass_constant(false);
      const double t0 = std::max(in.lo, search.skip());
      search.search(nodes_, t0, in.hi, [&](auto visit) {
        boxes_.query(ray, t0, in.hi, [&](unsigned leaf) {
          work.cell();
          visit(node_of_leaf_[leaf]);
          return kInfinity;
        });
      });
      return search.hit();
    });
  }

  std::vector<TreeNode> nodes_;
  std::vector<std::uint32_t> node_of_leaf_;
  Box world_;
  EmbreeBoxes boxes_;
};

}  // namespace

extern const SchemeInfo scheme_embree_primitives;
const SchemeInfo scheme_embree_primitives{
    .name = "embree_primitives",
    .title = "Embree BVH over primitives",
    .make = [](std::shared_ptr<const CsgTree> tree, const Params&) -> std::unique_ptr<Tracer> {
      return std::make_unique<EmbreePrimitives>(std::move(tree));
    }};

}  // namespace csg
