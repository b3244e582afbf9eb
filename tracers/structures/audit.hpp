// The premise on which all pruning rests, checked directly: where a leaf is called Empty or Full for
// a cell, the crossings that its kernel reports leave it so all along the ray's way through the cell,
// tie bands included (rules 8 and 9 of the hit rule).
#pragma once
#include <span>

#include "../hit_rule.hpp"

namespace csg {

struct AuditResult {
  std::uint64_t constants = 0;   ///< leaves called Empty or Full, over all pairs
  std::uint64_t violations = 0;  ///< of these, not constant along the ray
};

/// Checks all leaves for each pair of a cell and a ray through it. Precondition: as many cells as rays.
inline AuditResult audit_classes(const CsgTree& tree, std::span<const Box> cells, std::span<const Ray> rays) {
  AuditResult result;
  SearchScratch scratch;
  CountNothing work;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const BoundarySearch search(tree, rays[i], scratch, work);
    const Interval in = slab(cells[i], rays[i].origin, Reciprocal(rays[i].dir));
    if (in.empty()) continue;
    const double from = in.lo - 2 * search.widest_band(), to = in.hi + 2 * search.widest_band();
    for (const Leaf& leaf : tree.leaves()) {
      const Class kind = classify(leaf, cells[i].padded(leaf.pad));
      if (kind == Class::Partial) continue;
      ++result.constants;
      const Crossings found = crossings(leaf, rays[i]);
      bool inside = false, constant = true;
      for (int k = 0; k < found.count; ++k) {
        if (found.t[k] <= from)
          inside = !inside;
        else if (found.t[k] <= to)
          constant = false;
      }
      result.violations += !constant || inside != (kind == Class::Full);
    }
  }
  return result;
}

}  // namespace csg
