// Naive: every ray against every halfspace (Roth 1982, without enclosures).
//
// All primitives are intersected with the whole ray, their spans are merged along it and combined by
// the whole Boolean tree. The first boundary of the result is the hit. No structure, no parameters,
// O(n) a ray: the reference for every other scheme's answers.
#include "../hit_rule.hpp"
#include "../params.hpp"

namespace csg {
namespace {

class Naive final : public Tracer {
 public:
  explicit Naive(std::shared_ptr<const CsgTree> tree) : Tracer(std::move(tree)), nodes_(global_tree(*tree_)) {}

  std::size_t bytes() const override { return nodes_.size() * sizeof(TreeNode); }

 private:
  void trace_batch(std::span<const Ray> rays, std::span<Hit> hits, Counters* counters) const override {
    for_each_ray(rays, hits, counters, scratches_, [&](const Ray& ray, SearchScratch& scratch, auto& work) {
      BoundarySearch search(*tree_, ray, scratch, work);
      search.search(nodes_, -kInfinity, kInfinity);
      return search.hit();
    });
  }

  std::vector<TreeNode> nodes_;
  mutable Pool<SearchScratch> scratches_;
};

}  // namespace

extern const SchemeInfo scheme_naive;
const SchemeInfo scheme_naive{
    .name = "naive",
    .title = "Naive CSG (Roth)",
    .make = [](std::shared_ptr<const CsgTree> tree, const Params&) -> std::unique_ptr<Tracer> {
      return std::make_unique<Naive>(std::move(tree));
    }};

}  // namespace csg
