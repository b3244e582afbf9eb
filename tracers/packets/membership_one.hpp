// membership.hpp for one ray: eight atoms at a time, and then a bit an atom.
#pragma once
#include "eight.hpp"
#include "spans.hpp"

namespace {

static_assert(kMostAtoms <= 64 && kMostOperators % 64 == 0 && kMostAtoms % 8 == 0 && sizeof(F) == sizeof(float));

/// Whether the ray is in the solid at `s`, by the cell's operators.
inline Mask inside_at(const Cell& cell, const Atom*, const Operator* operators, const Spans& spans, F s) {
  const Eight at = eight_of(s.only);
  std::uint64_t set = 0;  // bits behind the last atom mean nothing
  for (int i = 0; i < cell.atoms; i += 8)
    set |= std::uint64_t{at_most(load_eight(spans.lo + i), at) & less(at, load_eight(spans.hi + i))} << i;
  set ^= cell.flipped;
  std::uint64_t fed[kMostOperators / 64] = {};  // operators of which another is an operand, and holds
  const auto value = [&](int i) -> std::uint64_t {
    return (((set & operators[i].atoms) != 0) | (fed[i / 64] >> i % 64 & 1)) ^ (operators[i].flip & 1u);
  };
  const int last = cell.operators - 1;
  for (int i = 0; i < last; ++i) fed[operators[i].parent / 64] |= value(i) << operators[i].parent % 64;
  return static_cast<Mask>(value(last));
}

/// The next crossing behind `s` by which the solid may grow.
inline F next_growth(const Cell& cell, const Atom*, const Spans& spans, F s) {
  const Eight never = eight_of(kNever), at = eight_of(s.only);
  const std::uint64_t all_atoms = ~std::uint64_t{0} >> (64 - cell.atoms);
  Eight next = never;
  for (int i = 0; i < cell.atoms; i += 8) {
    const auto negative = static_cast<unsigned>(cell.negative >> i), there = static_cast<unsigned>(all_atoms >> i);
    const Eight event = select(negative, load_eight(spans.hi + i), load_eight(spans.lo + i));
    next = lesser_of(select(less(at, event) & there, event, never), next);
  }
  return {least(next)};
}

}  // namespace
