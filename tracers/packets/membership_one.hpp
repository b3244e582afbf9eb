// membership.hpp for one ray: eight atoms at a time, and then a bit an atom.
#pragma once
#include <bit>

#include "eight.hpp"
#include "spans.hpp"

namespace {

static_assert(kMostAtoms <= 64 && kMostAtoms % 8 == 0 && sizeof(F) == sizeof(float));

/// Whether the ray is in the solid at `s`, by the cell's operators.
inline Mask inside_at(const Cell& cell, const Atom*, const Operator* operators, const Spans& spans, F s) {
  const Eight at = eight_of(s.only);
  std::uint64_t set = 0;  // bits behind the last atom mean nothing
  for (int i = 0; i < cell.atoms; i += 8)
    set |= std::uint64_t{signs((load_eight(spans.lo + i) <= at) & (at < load_eight(spans.hi + i)))} << i;
  set ^= cell.flipped;
  const int last = cell.operators - 1;
  if (last == 0) return ((set & operators[0].atoms) != 0) ^ (operators[0].flip & 1u);
  std::uint8_t fed[kMostOperators];
  for (int i = 0; i <= last; ++i) fed[i] = 0;
  for (int i = 0; i < last; ++i)
    fed[operators[i].parent] |= static_cast<std::uint8_t>((fed[i] | ((set & operators[i].atoms) != 0)) ^ (operators[i].flip & 1));
  return (fed[last] | ((set & operators[last].atoms) != 0)) ^ (operators[last].flip & 1u);
}

/// The next crossing behind `s` by which the solid may grow.
inline F next_growth(const Cell& cell, const Atom*, const Spans& spans, F s) {
  const Eight never = eight_of(kNever), at = eight_of(s.only);
  Eight next = never;
  for (int i = 0; i < cell.atoms; i += 8) {
    const auto there = spread(static_cast<unsigned>(((std::uint64_t{1} << 1 << (cell.atoms - 1)) - 1) >> i));
    const Eight event = spread(static_cast<unsigned>(cell.negative >> i)) ? load_eight(spans.hi + i) : load_eight(spans.lo + i);
    const Eight behind = (at < event) & there ? event : never;
    next = behind < next ? behind : next;
  }
  const auto least = [](auto a, auto b) { return a < b ? a : b; };
  const Eight four = least(next, __builtin_shufflevector(next, next, 4, 5, 6, 7, 0, 1, 2, 3));
  const Eight two = least(four, __builtin_shufflevector(four, four, 2, 3, 0, 1, 6, 7, 4, 5));
  return {least(two[0], two[1])};
}

}  // namespace
