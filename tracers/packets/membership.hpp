// Of rays in a cell: which are in the solid, and where next they may pass into it. For a packet, atom by atom; for one
// ray, by a bit an atom.
#pragma once
#include "passage.hpp"

namespace {

/// One atom's interval along each ray of a packet, within a cell.
struct Spans {
  F lo[kMostAtoms], hi[kMostAtoms];
};

inline int atoms_in(const Cell& cell) { return cell.end[kAtomKinds - 1]; }

inline AtomKind kind_of(const Cell& cell, int atom) {
  int kind = 0;
  while (atom >= cell.end[kind]) ++kind;
  return AtomKind{static_cast<std::uint8_t>(kind)};
}

/// What stands behind a cell.
struct Parts {
  const std::uint64_t* operands;       // of each operator
  const std::uint32_t* leaf_and_axis;  // of each atom
  const std::uint8_t* atom_feeds;
  const std::uint8_t* operator_feeds;
  const float* floats;

  explicit Parts(const Cell& cell)
      : operands(reinterpret_cast<const std::uint64_t*>(&cell + 1)),
        leaf_and_axis(reinterpret_cast<const std::uint32_t*>(operands + cell.operators)),
        atom_feeds(reinterpret_cast<const std::uint8_t*>(leaf_and_axis + atoms_in(cell))),
        operator_feeds(atom_feeds + atoms_in(cell)),
        floats(reinterpret_cast<const float*>(leaf_and_axis + atoms_in(cell)) +
               (atoms_in(cell) + cell.operators + 3) / 4) {}

  std::int32_t leaf(int atom) const {
    return static_cast<std::int32_t>(leaf_and_axis[atom] & ((std::uint32_t{1} << kLeafBits) - 1));
  }
  int axis(int atom) const { return static_cast<int>(leaf_and_axis[atom] >> kLeafBits); }
};

/// The membership of each ray at `s`, by the cell's operators; more bits than there are rays.
inline Mask inside_at(const Cell& cell, const Parts& parts, const Spans& spans, F s) {
  const int atoms = atoms_in(cell);
  const auto atom_at = [&](int i) { return in_half_open(spans.lo[i], s, spans.hi[i]); };
  const auto flip_of = [](std::uint8_t feed) { return Mask{0} - (feed & 1u); };
  if (cell.operators == 1) {
    Mask value = 0;
    for (int i = 0; i < atoms; ++i) value |= atom_at(i) ^ flip_of(parts.atom_feeds[i]);
    return value ^ flip_of(parts.operator_feeds[0]);
  }
  Mask value[kMostOperators];
  for (int i = 0; i < cell.operators; ++i) value[i] = 0;
  for (int i = 0; i < atoms; ++i) {
    const std::uint8_t feed = parts.atom_feeds[i];
    value[feed >> 1] |= atom_at(i) ^ flip_of(feed);
  }
  const int root = cell.operators - 1;
  for (int i = 0; i < root; ++i) {
    const std::uint8_t feed = parts.operator_feeds[i];
    value[feed >> 1] |= value[i] ^ flip_of(feed);
  }
  return value[root] ^ flip_of(parts.operator_feeds[root]);
}

/// The next crossing behind `s` by which the solid may grow.
inline F next_growth(const Cell& cell, const Spans& spans, F s) {
  F next = all(kNever);
  for (int i = 0; i < atoms_in(cell); ++i) {
    const F event = cell.negative >> i & 1 ? spans.hi[i] : spans.lo[i];
    next = select_less(s, event, min(next, event), next);
  }
  return next;
}

static_assert(kMostAtoms <= 64 && kMostOperators % 64 == 0 && kLanes == kLanesRead);

/// The atoms' intervals along one ray. Those behind the last atom mean nothing.
class LoneSpans {
 public:
  explicit LoneSpans(const Cell& cell)
      : cell_(cell), atoms_(atoms_in(cell)), there_(~std::uint64_t{0} >> (64 - atoms_)) {}

  void put(int first, const F& lo, const F& hi) { store(lo, lo_ + first), store(hi, hi_ + first); }
  float& lo(int i) { return lo_[i]; }
  float& hi(int i) { return hi_[i]; }

  /// Whether the ray is in the solid at `s`, by the cell's operators.
  bool inside_at(const Parts& parts, float s) const {
    const std::uint64_t set =
        each([&](int i) { return in_half_open(load(lo_ + i), all(s), load(hi_ + i)); }) ^ cell_.flipped;
    std::uint64_t fed[kMostOperators / 64] = {};  // operators of which another is an operand, and holds
    const auto value = [&](int i) -> std::uint64_t {
      return (((set & parts.operands[i]) != 0) | (fed[i / 64] >> i % 64 & 1)) ^ (parts.operator_feeds[i] & 1u);
    };
    const int root = cell_.operators - 1;
    for (int i = 0; i < root; ++i) {
      const int above = parts.operator_feeds[i] >> 1;
      fed[above / 64] |= value(i) << above % 64;
    }
    return value(root) != 0;
  }

  /// The next crossing behind `s` by which the solid may grow.
  float next_growth(float s) const {
    F next = all(kNever);
    for (int i = 0; i < atoms_; i += kLanes) {
      const F event = select(static_cast<Mask>(cell_.negative >> i & 0xffff), load(hi_ + i), load(lo_ + i));
      next = select(less(all(s), event) & static_cast<Mask>(there_ >> i & 0xffff), min(next, event), next);
    }
    return least(next);
  }

  /// The one atom that is crossed between, if there is one and it is crossed once; else none, which is −1.
  int crossed_once(float from, float to) const {
    const auto among = [&](const float* s) {
      return each([&](int i) { return in_closed(all(from), load(s + i), all(to)); }) & there_;
    };
    const std::uint64_t low = among(lo_), high = among(hi_), crossed = low | high;
    const bool once = crossed != 0 && (crossed & (crossed - 1)) == 0 && (low & high) == 0;
    return once ? __builtin_ctzll(crossed) : -1;
  }

 private:
  /// One bit an atom, from the masks of so many atoms at a time as there are lanes.
  template <class Masks>
  std::uint64_t each(Masks masks) const {
    std::uint64_t out = 0;
    for (int i = 0; i < atoms_; i += kLanes) out |= std::uint64_t{masks(i)} << i;
    return out;
  }

  const Cell& cell_;
  int atoms_;
  std::uint64_t there_;
  float lo_[kMostAtoms + kLanes], hi_[kMostAtoms + kLanes];
};

}  // namespace
