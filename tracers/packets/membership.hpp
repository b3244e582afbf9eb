// Of rays in a cell: which are in the solid, and where next they may pass into it. For a packet, atom by atom; for one
// ray, by a bit an atom.
#pragma once
#include "spans.hpp"

namespace {

/// One atom's interval along each ray of a packet, within a cell.
struct Spans {
  F lo[kMostAtoms], hi[kMostAtoms];
};

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

static_assert(kMostAtoms <= 64 && kMostOperators % 64 == 0 && kLanes == kLanesRead);

/// The atoms' intervals along one ray. Those behind the last atom mean nothing.
class LoneSpans {
 public:
  explicit LoneSpans(const Cell& cell) : cell_(cell), there_(~std::uint64_t{0} >> (64 - cell.atoms)) {}

  void put(int first, const F& lo, const F& hi) { store(lo, lo_ + first), store(hi, hi_ + first); }
  float& lo(int i) { return lo_[i]; }
  float& hi(int i) { return hi_[i]; }

  /// Whether the ray is in the solid at `s`, by the cell's operators.
  bool inside_at(const Operator* operators, float s) const {
    const std::uint64_t set =
        each([&](int i) { return at_most(load(lo_ + i), all(s)) & less(all(s), load(hi_ + i)); }) ^ cell_.flipped;
    std::uint64_t fed[kMostOperators / 64] = {};  // operators of which another is an operand, and holds
    const auto value = [&](int i) -> std::uint64_t {
      return (((set & operators[i].atoms) != 0) | (fed[i / 64] >> i % 64 & 1)) ^ (operators[i].flip & 1u);
    };
    const int last = cell_.operators - 1;
    for (int i = 0; i < last; ++i) fed[operators[i].parent / 64] |= value(i) << operators[i].parent % 64;
    return value(last) != 0;
  }

  /// The next crossing behind `s` by which the solid may grow.
  float next_growth(float s) const {
    F next = all(kNever);
    for (int i = 0; i < cell_.atoms; i += kLanes) {
      const F event = select(static_cast<Mask>(cell_.negative >> i & 0xffff), load(hi_ + i), load(lo_ + i));
      next = select(less(all(s), event) & static_cast<Mask>(there_ >> i & 0xffff), min(next, event), next);
    }
    return least(next);
  }

  /// The one atom that is crossed between, if there is one and it is crossed once; else none, which is −1.
  int crossed_once(float from, float to) const {
    const auto between = [&](const float* s) {
      return each([&](int i) { return at_most(all(from), load(s + i)) & at_most(load(s + i), all(to)); }) & there_;
    };
    const std::uint64_t low = between(lo_), high = between(hi_), crossed = low | high;
    const bool once = crossed != 0 && (crossed & (crossed - 1)) == 0 && (low & high) == 0;
    return once ? __builtin_ctzll(crossed) : -1;
  }

 private:
  /// One bit an atom, from the masks of so many atoms at a time as there are lanes.
  template <class Masks>
  std::uint64_t each(Masks masks) const {
    std::uint64_t out = 0;
    for (int i = 0; i < cell_.atoms; i += kLanes) out |= std::uint64_t{masks(i)} << i;
    return out;
  }

  const Cell& cell_;
  std::uint64_t there_;
  float lo_[kMostAtoms + kLanes], hi_[kMostAtoms + kLanes];
};

}  // namespace
