// Of a packet in a cell: which rays are in the solid, and where next they may pass into it.
#pragma once
#include "spans.hpp"

namespace {

/// The membership of each ray at `s`, by the cell's operators.
inline Mask inside_at(const Cell& cell, const Atom* atoms, const Operator* operators, const Spans& spans, F s) {
  if (cell.operators == 1) {
    Mask value = 0;
    for (int i = 0; i < cell.atoms; ++i) value |= (at_most(spans.lo[i], s) & less(s, spans.hi[i])) ^ atoms[i].flip;
    return value ^ operators[0].flip;
  }
  std::uint32_t value[kMostOperators];
  for (int i = 0; i < cell.operators; ++i) value[i] = 0;
  for (int i = 0; i < cell.atoms; ++i)
    value[atoms[i].parent] |= (at_most(spans.lo[i], s) & less(s, spans.hi[i])) ^ atoms[i].flip;
  for (int i = 0; i + 1 < cell.operators; ++i) value[operators[i].parent] |= value[i] ^ operators[i].flip;
  return value[cell.operators - 1] ^ operators[cell.operators - 1].flip;
}

/// The next crossing behind `s` by which the solid may grow.
inline F next_growth(const Cell& cell, const Atom* atoms, const Spans& spans, F s) {
  F next = all(kNever);
  for (int i = 0; i < cell.atoms; ++i) {
    const F event = atoms[i].negative ? spans.hi[i] : spans.lo[i];
    next = select(less(s, event), min(next, event), next);
  }
  return next;
}

}  // namespace
