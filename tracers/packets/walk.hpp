// Packets of sixteen rays through the boxes and cells of a PacketModel. Compiled for each instruction set;
// nothing here but the entry has external linkage.
//
// Floats find where a ray first passes into the solid, and say what they are sure of. They bound the
// solid from outside: atoms that add to it are grown by their rounding, those that it is cut by are
// shrunk, so that a ray that misses the bound surely misses. Where it enters the bound, the true
// boundary lies within the window W behind, if no other atom is crossed near there and the surface is not
// grazed. Else the ray is `unsure`, and is traced again by the scalar search.
#pragma once
#include "lanes.hpp"
#include "packet_model.hpp"

namespace {

using namespace csg::packets;

constexpr float kNever = __builtin_inff();

struct Packet {
  D o[3], d[3];                    // start and unit direction, units
  F of[3], inverse[3], scaled[3];  // scaled = o·inverse
  F end;
  Mask in_world;  // not moved to where they enter the world
  Mask far;       // origins beyond Model::near
};

/// One atom's interval along each ray of the packet, within a cell.
struct Spans {
  F lo[kMostAtoms], hi[kMostAtoms];
};

/// A packet's part in a cell, from its point nearest the cell's centre.
struct Passage {
  F p[3], d[3];
  F enter, exit, start;
  Mask lanes, near_start;
};

inline F dot3(const F a[3], const F b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline F apply(const float row[3], const F v[3]) { return row[0] * v[0] + row[1] * v[1] + row[2] * v[2]; }

/// What the square of a round atom's half chord may be wrong by: below it, floats cannot tell whether it is met.
inline float touch(const Atom& atom) { return 8 * __builtin_fabsf(atom.size - 1); }

/// A quadric that is the unit circle or sphere in `axes` axes of the frame.
template <int axes>
inline Mask round_span(const Atom& atom, const float (*rows)[3], const Passage& in, F& lo, F& hi) {
  F x[axes], v[axes];
  F along = F{}, vv = F{};
  for (int i = 0; i < axes; ++i) {
    x[i] = apply(rows[i], in.p) + atom.centre[i];
    v[i] = apply(rows[i], in.d);
    along += x[i] * v[i];
    vv += v[i] * v[i];
  }
  // A ray along the axis is as far from it everywhere.
  const Mask parallel = less(vv, all(1e-15f));
  vv = max(vv, all(1e-15f));
  const F inverse = 1.0f / vv, middle = select(parallel, F{}, -along * inverse);
  F distance = F{};
  for (int i = 0; i < axes; ++i) {
    const F across = x[i] + middle * v[i];
    distance += across * across;
  }
  const F inside = atom.size * atom.size - distance;
  // Along the axis the middle may be far away, and rounded as coarsely.
  const float outwards = atom.negative ? -0x1p-21f : 0x1p-21f;
  const F half = root(max(inside, F{}) * inverse) + outwards * magnitude(middle);
  const Mask met = less(F{}, inside);
  lo = select(met, middle - half, all(kNever));
  hi = select(met, middle + half, all(-kNever));
  return less(magnitude(inside), max(atom.graze * atom.graze * inverse, all(touch(atom))));
}

inline Mask ball_span(const Atom& atom, float per_radius, const Passage& in, F& lo, F& hi) {
  F x[3];
  for (int i = 0; i < 3; ++i) x[i] = per_radius * in.p[i] + atom.centre[i];
  const float radius = 1 / per_radius;
  const F along = dot3(x, in.d);
  F distance = F{};
  for (int i = 0; i < 3; ++i) {
    const F across = x[i] - along * in.d[i];
    distance += across * across;
  }
  const F inside = atom.size * atom.size - distance;
  const F half = radius * root(max(inside, F{})), middle = -radius * along;
  const Mask met = less(F{}, inside);
  lo = select(met, middle - half, all(kNever));
  hi = select(met, middle + half, all(-kNever));
  return less(magnitude(inside), all(__builtin_fmaxf(atom.graze * atom.graze * radius * radius, touch(atom))));
}

/// |z| ≤ 1 along z + s·v. Grazed where the ray is nearly parallel to the faces and, in the cell, neither
/// certainly between them nor certainly not.
inline Mask slab(const Atom& atom, F z, F v, const Passage& in, F& lo, F& hi) {
  v = away_from_zero(v);
  const F inverse = 1.0f / v;
  const auto between = [&](float size, F& first, F& last) {
    const F low = (-size - z) * inverse, high = (size - z) * inverse;
    first = min(low, high);
    last = max(low, high);
  };
  between(atom.size, lo, hi);
  Mask grazed = in.lanes & less(magnitude(v), all(atom.graze));
  if (grazed) [[unlikely]] {
    const F spare = in.exit - in.enter, from = in.enter - spare, to = in.exit + spare;
    const float rounding = __builtin_fabsf(atom.size - 1) + 0x1p-21f;
    F outer_lo, outer_hi, inner_lo, inner_hi;
    between(1 + rounding, outer_lo, outer_hi);
    between(1 - rounding, inner_lo, inner_hi);
    grazed &= at_most(outer_lo, to) & at_most(from, outer_hi) & ~(at_most(inner_lo, from) & at_most(to, inner_hi));
  }
  return grazed;
}

inline Mask slab_span(const Atom& atom, const float row[3], float centre, const Passage& in, F& lo, F& hi) {
  return slab(atom, apply(row, in.p) + centre, apply(row, in.d), in, lo, hi);
}

/// ρ ≤ w where w ≥ 0, from the roots of ρ² − w². A line flatter than the wall is inside between them, if that
/// is on the side of the apex where w ≥ 0; a steeper one outside of them, and one root is on that side.
inline Mask wall_span(const Atom& atom, const Frame& frame, const Passage& in, F& lo, F& hi) {
  F x[3], v[3];
  for (int i = 0; i < 3; ++i) {
    x[i] = apply(frame.narrow[i], in.p) + atom.centre[i];
    v[i] = apply(frame.narrow[i], in.d);
  }
  const F vv = max(dot3(v, v), all(1e-16f)), middle = -dot3(x, v) / vv;
  for (int i = 0; i < 3; ++i) x[i] += middle * v[i];
  const float slope = frame.narrow_shape[1];
  const F w = x[2] * slope + (frame.narrow_shape[0] + (atom.size - 1)), dw = v[2] * slope;
  const F a = v[0] * v[0] + v[1] * v[1] - dw * dw;
  const F b = x[0] * v[0] + x[1] * v[1] - w * dw;
  const F c = x[0] * x[0] + x[1] * x[1] - w * w;
  // Rounding as a longer way inside for an atom that adds to the solid: between the roots, or outside of them.
  const Mask steep = less(a, F{}), opens = less(F{}, dw);
  const F longer = 0x1p-21f * (b * b + magnitude(a * c));
  const F inside = b * b - a * c + select(atom.negative ? ~steep : steep, -longer, longer);
  const F square = root(max(inside, F{}));
  const F q = away_from_zero(-(b + select(less(b, F{}), -square, square)));
  const F s = q / away_from_zero(a), t = c / q;
  const F first = min(s, t), second = max(s, t);
  const Mask met = less(F{}, inside) & less(F{}, 2.0f * w + dw * (first + second));
  lo = middle + select(steep, select(opens, second, all(-kNever)), select(met, first, all(kNever)));
  hi = middle + select(steep, select(opens, all(kNever), first), select(met, second, all(-kNever)));
  return less(magnitude(inside), max(all(atom.graze * atom.graze), touch(atom) * vv)) | less(magnitude(a), 1e-4f * vv);
}

/// Crossings of a torus: where its quartic along the ray changes sign between the ends of the cell.
struct Quartic {
  F c[5];

  F at(F s) const { return c[0] + s * (c[1] + s * (c[2] + s * (c[3] + s * c[4]))); }
  F slope(F s) const { return c[1] + s * (2.0f * c[2] + s * (3.0f * c[3] + s * (4.0f * c[4]))); }
  F bend(F s) const { return 2.0f * c[2] + s * (6.0f * c[3] + s * (12.0f * c[4])); }

  /// Signs of the Bernstein coefficients over [m − w, m + w]: which lanes are certainly above 0, and
  /// certainly below; and which change sign once.
  void signs(F m, F w, F slack, Mask& above, Mask& below, Mask& once) const {
    const F c4 = c[4], c3 = c[3] + 4.0f * m * c4, c2 = c[2] + m * (3.0f * c[3] + 6.0f * m * c4);
    const F c1 = slope(m), c0 = at(m);
    const F w2 = w * w, a1 = c1 * w, a2 = c2 * w2, a3 = c3 * w2 * w, a4 = c4 * w2 * w2;
    const F even = c0 + a2 + a4, odd = a1 + a3, even1 = c0 - a4, odd1 = 0.5f * (a1 - a3);
    const F b[5] = {even - odd, even1 - odd1, c0 - (1.0f / 3) * a2 + a4, even1 + odd1, even + odd};
    Mask positive[5], negative[5];
    above = below = 0xffff;
    for (int i = 0; i < 5; ++i) {
      positive[i] = less(slack, b[i]);
      negative[i] = less(b[i], -slack);
      above &= positive[i];
      below &= negative[i];
    }
    // The sign changes once whatever an uncertain coefficient stands for: it may only stand at the turn.
    Mask down = positive[0] & negative[4], up = negative[0] & positive[4];
    for (int i = 0; i < 4; ++i) {
      down &= positive[i] | negative[i + 1];
      up &= negative[i] | positive[i + 1];
    }
    once = down | up;
  }

  /// The root in [lo, hi], where the sign changes once, from the chord: Newton, halving where it leaves the bracket,
  /// until the rays `of` are near enough.
  F root_in(F lo, F hi, F enough, Mask of) const {
    const F at_lo = at(lo), at_hi = at(hi);
    const Mask falls = less(F{}, at_lo);
    F s = lo + (hi - lo) * (at_lo / away_from_zero(at_lo - at_hi));
    for (int step = 0; step < 12; ++step) {
      const F value = at(s);
      if (!(of & less(enough, magnitude(value)))) break;
      const Mask behind = ~(less(F{}, value) ^ falls);  // the root lies behind s
      lo = select(behind, s, lo);
      hi = select(behind, hi, s);
      const F next = s - value / away_from_zero(slope(s));
      s = select(at_most(lo, next) & at_most(next, hi), next, 0.5f * (lo + hi));
    }
    return s;
  }
};

/// Lanes of which the torus' interval could not be told are returned as grazed.
inline Mask torus_span(const Atom& atom, const Frame& frame, const Passage& in, float window, F& lo, F& hi) {
  const F middle = 0.5f * (in.enter + in.exit);
  const F wide = 0.5f * (in.exit - in.enter) + all(4 * window);
  F x[3], v[3];
  for (int i = 0; i < 3; ++i) {
    v[i] = apply(frame.narrow[i], in.d);
    x[i] = apply(frame.narrow[i], in.p) + atom.centre[i] + middle * v[i];
  }
  const float minor = frame.narrow_shape[0];
  const F xx = dot3(x, x), alpha = xx + (1 - minor * minor), beta = 2.0f * dot3(x, v), gamma = dot3(v, v);
  const F q0 = x[0] * x[0] + x[1] * x[1], q1 = 2.0f * (x[0] * v[0] + x[1] * v[1]), q2 = v[0] * v[0] + v[1] * v[1];
  Quartic g;
  // The two factors of alpha² − 4·rho²: what is small near the tube is computed from what is small.
  const F rho = root(q0), off = rho - 1.0f;
  g.c[0] = (off * off + x[2] * x[2] - minor * minor) * (alpha + 2.0f * rho);
  g.c[1] = 2.0f * alpha * beta - 4.0f * q1;
  g.c[2] = beta * beta + 2.0f * alpha * gamma - 4.0f * q2;
  g.c[3] = 2.0f * beta * gamma;
  g.c[4] = gamma * gamma;
  const F slack = all(atom.size);
  Mask above, below, once;
  g.signs(F{}, wide, slack, above, below, once);
  lo = select(below, all(-kNever), all(kNever));
  hi = select(below, all(kNever), all(-kNever));
  Mask todo = in.lanes & ~(above | below);
  if (!todo) return 0;
  F left = -wide, right = wide;
  Mask told = once & todo, two = 0;
  const Mask rises = less(g.at(-wide), F{});  // starts inside
  Mask rest = todo & ~once;
  F lowest = F{};
  if (rest) {
    // Look for a place inside, or for proof that there is none, on either side of the lowest point.
    for (int step = 0; step < 3; ++step) {
      const F by = g.slope(lowest) / max(magnitude(g.bend(lowest)), all(1e-12f));
      lowest = min(max(lowest - by, left), right);
    }
    const F m1 = 0.5f * (left + lowest), w1 = 0.5f * (lowest - left), m2 = 0.5f * (lowest + right),
            w2 = 0.5f * (right - lowest);
    Mask above1, below1, once1, above2, below2, once2;
    g.signs(m1, w1, slack, above1, below1, once1);
    g.signs(m2, w2, slack, above2, below2, once2);
    rest &= ~(above1 & above2);
    two = rest & once1 & once2 & less(g.at(lowest), -slack) & ~rises;
    rest &= ~two;
  }
  Mask grazed = 0;
  // Where it is entered or left, outwards or inwards by what rounding may cost, as long as the slope says so.
  const F outwards = all<float>(atom.negative ? -1 : 1);
  const auto crossing = [&](Mask of, F from, F to, F side) {
    const F s = g.root_in(from, to, 0.25f * slack, of), value = magnitude(g.at(s)),
            speed = max(magnitude(g.slope(s)), all(1e-20f));
    const F by = (slack + value) / speed;
    rest |= of & (less(slack, value) | less(0.25f * speed, by * magnitude(g.bend(s))));
    grazed |= of & less(all(0.25f * window), by);
    return s + side * by;
  };
  if (const Mask entered = (told & ~rises) | two, left_only = told & rises; entered | left_only) {
    const F s = crossing(entered | left_only, left, select(two, lowest, right), select(left_only, outwards, -outwards));
    lo = select(entered, s, select(left_only, all(-kNever), lo));
    hi = select(left_only, s, select(entered, all(kNever), hi));
  }
  if (two) hi = select(two, crossing(two, lowest, right, outwards), hi);
  // A ray of which it could not be told is taken to be inside if the torus adds to the solid, else outside.
  lo = select(rest, all<float>(atom.negative ? kNever : -kNever), lo);
  hi = select(rest, all<float>(atom.negative ? -kNever : kNever), hi);
  lo += middle;
  hi += middle;
  return grazed | rest;
}

/// Where an atom lies whose surface is nearer to a ray's start than floats can tell: by its value
/// there, in double. A convex atom that is left behind is never met again.
inline void settle_start(const Atom& atom, const Frame& frame, const Packet& packet, double band, Mask near, F& lo,
                         F& hi, Mask& unsure) {
  D x[3], v[3];
  const int first = atom.kind == AtomKind::SlabY ? 1 : atom.kind == AtomKind::SlabZ ? 2 : 0;
  const int last = atom.kind == AtomKind::SlabX                                  ? 1
                   : atom.kind == AtomKind::SlabY || atom.kind == AtomKind::Tube ? 2
                                                                                 : 3;
  D rel[3];
  for (int j = 0; j < 3; ++j) rel[j] = packet.o[j] - all<double>(frame.offset[j]);
  double steepest = 0;
  for (int i = first; i < last; ++i) {
    const double* row = frame.row[i];
    x[i] = all<double>(row[0]) * rel[0] + all<double>(row[1]) * rel[1] + all<double>(row[2]) * rel[2];
    v[i] = all<double>(row[0]) * packet.d[0] + all<double>(row[1]) * packet.d[1] + all<double>(row[2]) * packet.d[2];
    steepest += row[0] * row[0] + row[1] * row[1] + row[2] * row[2];
  }
  // g, its slope along the ray, and what one band changes of it.
  D g = all<double>(0), slope = all<double>(0), slack = all<double>(0);
  const D two = all<double>(2);
  const double per_band = band * __builtin_sqrt(steepest);
  switch (atom.kind) {
    case AtomKind::Ball:
    case AtomKind::Ellipsoid:
    case AtomKind::Tube:
      g = all<double>(-1);
      for (int i = 0; i < last; ++i) g = g + x[i] * x[i], slope = slope + two * x[i] * v[i];
      slack = all<double>(2 * per_band);
      break;
    case AtomKind::SlabX:
    case AtomKind::SlabY:
    case AtomKind::SlabZ:
      g = x[first] * x[first] - all<double>(1);
      slope = two * x[first] * v[first];
      slack = all<double>(2 * per_band);
      break;
    case AtomKind::Torus: {
      const double minor = frame.shape[0];
      const D alpha = x[0] * x[0] + x[1] * x[1] + x[2] * x[2] + all<double>(1 - minor * minor);
      g = alpha * alpha - all<double>(4) * (x[0] * x[0] + x[1] * x[1]);
      slope = all<double>(4) * (alpha * (x[0] * v[0] + x[1] * v[1] + x[2] * v[2]) - two * (x[0] * v[0] + x[1] * v[1]));
      slack = all<double>(16 * minor * per_band + 0x1p-46);
      break;
    }
    case AtomKind::Wall: {
      const D rho = root(x[0] * x[0] + x[1] * x[1]);
      g = rho - all<double>(frame.shape[0]) - all<double>(frame.shape[1]) * x[2];
      slope = (x[0] * v[0] + x[1] * v[1]) / rho - all<double>(frame.shape[1]) * v[2];
      slack = all<double>(2 * per_band);
      break;
    }
  }
  Mask outside = 0, inside = 0, away = 0;
  for (int i = 0; i < kLanes; ++i) {
    outside |= static_cast<Mask>(g[i] > slack[i]) << i;
    inside |= static_cast<Mask>(g[i] < -slack[i]) << i;
    away |= static_cast<Mask>(slope[i] >= 0) << i;
  }
  // A torus may be met again, but not in this cell if its one crossing here is the one behind.
  const Mask once = atom.kind == AtomKind::Torus ? less(lo, all(-1e30f)) : 0xffff;
  const Mask left = near & outside & away & once, still_in = near & inside;
  lo = select(left, all(kNever), lo);
  hi = select(left, all(-kNever), hi);
  lo = select(still_in, all(-kNever), lo);
  unsure |= near & (~(left | still_in) | packet.far);
}

/// The membership of each ray at `s`, by the cell's operators.
inline Mask inside_at(const Atom* atoms, int count, const Operator* operators, int operator_count, const Spans& spans,
                      F s) {
  std::uint32_t value[kMostOperators];
  for (int i = 0; i < operator_count; ++i) value[i] = 0;
  for (int i = 0; i < count; ++i)
    value[atoms[i].parent] |= (at_most(spans.lo[i], s) & less(s, spans.hi[i])) ^ atoms[i].flip;
  for (int i = 0; i + 1 < operator_count; ++i) value[operators[i].parent] |= value[i] ^ operators[i].flip;
  return value[operator_count - 1] ^ operators[operator_count - 1].flip;
}

template <bool any, bool counting>
class Walker {
 public:
  Walker(const Model& model, const Packet& packet, Answer& answer, Counts* counts)
      : model_(model), packet_(packet), answer_(answer), counts_(counts) {}

  /// Rays whose directions have the signs of `octant`, front to back.
  void walk(Mask lanes, int octant) {
    struct Task {
      std::int32_t node;
      Mask lanes;
    } stack[8 * 24];
    int top = 0;
    active_ = lanes;
    limit_ = packet_.end;
    for (int axis = 0; axis < 3; ++axis) nearer_[axis] = axis + (octant >> axis & 1 ? 3 : 0);
    F enter, exit;
    stack[top++] = {0, meets(model_.nodes[0], lanes, enter, exit)};
    while (top > 0) {
      const Task task = stack[--top];
      const Mask met = task.lanes & active_;
      if (!met) continue;
      const Node& node = model_.nodes[task.node];
      if (node.octants == 0) {
        const Mask still = meets(node, met, enter, exit);
        if (still) pass(model_.cells[node.link], still, enter, exit);
        if (!active_) return;
        continue;
      }
      // The last of the children first, so that the first is on top. Each is pushed, and kept if it is met: no
      // branch hangs on the answer.
      for (unsigned order = turned(node.octants, octant); order;) {
        const int last = 31 - __builtin_clz(order);
        order ^= 1u << last;
        const unsigned bit = 1u << (last ^ octant);
        const std::int32_t child = node.link + count_of(node.octants & (bit - 1));
        const Mask lanes_met = meets(model_.nodes[child], met, enter, exit);
        stack[top] = {child, lanes_met};
        top += lanes_met != 0;
      }
    }
  }

 private:
  /// Bit i of a mask of octants to bit i ^ octant.
  static unsigned turned(unsigned octants, int octant) {
    if (octant & 1) octants = (octants & 0x55) << 1 | (octants & 0xaa) >> 1;
    if (octant & 2) octants = (octants & 0x33) << 2 | (octants & 0xcc) >> 2;
    if (octant & 4) octants = (octants & 0x0f) << 4 | (octants & 0xf0) >> 4;
    return octants;
  }

  /// The rays' interval in a box, and which of `lanes` have one.
  Mask meets(const Node& node, Mask lanes, F& enter, F& exit) const {
    if (counting) counts_->boxes += static_cast<std::uint64_t>(count_of(lanes));
    enter = F{}, exit = limit_;
    for (int axis = 0; axis < 3; ++axis) {
      enter = max(enter, node.side[nearer_[axis]] * packet_.inverse[axis] - packet_.scaled[axis]);
      exit = min(exit, node.side[3 - nearer_[axis] + 2 * axis] * packet_.inverse[axis] - packet_.scaled[axis]);
    }
    return lanes & at_most(enter, exit);
  }

  void pass(const Cell& cell, Mask lanes, F enter, F exit) {
    if (counting) counts_->cells += static_cast<std::uint64_t>(count_of(lanes));
    if (!cell.trusted) {
      answer_.unsure |= lanes;
      active_ &= ~lanes;
      return;
    }
    Passage in;
    in.lanes = lanes;
    D to[3], at = all<double>(0);
    for (int i = 0; i < 3; ++i) to[i] = all<double>(cell.centre[i]) - packet_.o[i], at = at + to[i] * packet_.d[i];
    for (int i = 0; i < 3; ++i) in.p[i] = narrow(at * packet_.d[i] - to[i]), in.d[i] = narrow(packet_.d[i]);
    const F nearest = narrow(at);
    in.enter = enter - nearest;
    in.exit = exit - nearest;
    in.start = -nearest;
    const F window = all(cell.window);
    in.near_start = lanes & packet_.in_world & less(enter, window);

    const Atom* atoms = model_.atoms + cell.first_atom;
    const int count = cell.atoms;
    Spans spans;
    Mask unsure = 0, grazed = 0;
    for (int i = 0; i < count; ++i) {
      const Atom& atom = atoms[i];
      const Frame& frame = model_.frames[atom.leaf];
      F &lo = spans.lo[i], &hi = spans.hi[i];
      Mask graze = 0;
      switch (atom.kind) {
        case AtomKind::Ball:
          graze = ball_span(atom, frame.narrow_shape[0], in, lo, hi);
          break;
        case AtomKind::Ellipsoid:
          graze = round_span<3>(atom, frame.narrow, in, lo, hi);
          break;
        case AtomKind::Tube:
          graze = round_span<2>(atom, frame.narrow, in, lo, hi);
          break;
        case AtomKind::SlabX:
          graze = slab_span(atom, frame.narrow[0], atom.centre[0], in, lo, hi);
          break;
        case AtomKind::SlabY:
          graze = slab_span(atom, frame.narrow[1], atom.centre[1], in, lo, hi);
          break;
        case AtomKind::SlabZ:
          graze = slab_span(atom, frame.narrow[2], atom.centre[2], in, lo, hi);
          break;
        case AtomKind::Wall:
          graze = wall_span(atom, frame, in, lo, hi);
          break;
        case AtomKind::Torus:
          graze = torus_span(atom, frame, in, cell.window, lo, hi);
          break;
      }
      if (in.near_start) {
        const Mask near = in.near_start & (less(magnitude(lo - in.start), 4.0f * window) |
                                           less(magnitude(hi - in.start), 4.0f * window));
        if (near) settle_start(atom, frame, packet_, model_.band, near, lo, hi, unsure);
      }
      grazed |= graze;
    }
    if (counting) counts_->atoms += static_cast<std::uint64_t>(count) * static_cast<std::uint64_t>(count_of(lanes));

    const Operator* operators = model_.operators + cell.first_operator;
    const auto inside = [&](F s, Mask of) {
      if (counting)
        counts_->operators += static_cast<std::uint64_t>(cell.operators) * static_cast<std::uint64_t>(count_of(of));
      return inside_at(atoms, count, operators, cell.operators, spans, s);
    };
    F s = in.enter;
    unsure |= inside(s, lanes);
    Mask todo = lanes & ~unsure, found = 0;
    const F last = in.exit + window;
    F at_boundary = s;
    while (todo) {
      // The next crossing by which the solid may grow.
      F next = all(kNever);
      for (int i = 0; i < count; ++i) {
        const F event = atoms[i].negative ? spans.hi[i] : spans.lo[i];
        next = select(less(s, event), min(next, event), next);
      }
      todo &= at_most(next, last);
      if (!todo) break;
      s = select(todo, next, s);
      const Mask now = inside(s, todo) & todo;
      found |= now;
      at_boundary = select(now, s, at_boundary);
      todo &= ~now;
    }
    unsure &= lanes;
    Mask settled = 0;
    if (found) {
      // Only one crossing may lie where the boundary may be.
      const F from = at_boundary - 2.0f * window, to_end = at_boundary + 3.0f * window;
      Mask once = 0, twice = 0;
      I which = all<std::int32_t>(0);
      for (int i = 0; i < count; ++i) {
        const Mask low = at_most(from, spans.lo[i]) & at_most(spans.lo[i], to_end);
        const Mask high = at_most(from, spans.hi[i]) & at_most(spans.hi[i], to_end);
        twice |= (once & (low | high)) | (low & high);
        once |= low | high;
        which = select(low | high, all<std::int32_t>(atoms[i].leaf), which);
      }
      unsure |= found & (twice | ~once | grazed);
      const F left = packet_.end - nearest - at_boundary;
      unsure |= found & less(left, 4.0f * window);
      const Mask sure = found & ~unsure;
      answer_.hit |= sure;
      limit_ = select(sure, at_boundary + nearest, limit_);
      settled = any ? sure : sure & well_inside(cell, in, at_boundary);
      const D t = widen(at_boundary) + at;
      for (Mask m = sure; m; m &= m - 1) {
        const int i = first_of(m);
        answer_.t[i] = t[i];
        answer_.t_error[i] = 4 * static_cast<double>(cell.window);
        answer_.leaf[i] = which[i];
      }
    }
    answer_.unsure |= unsure;
    active_ &= ~(unsure | settled);
  }

  /// Cells come in the order of the ray, but not their margins: where a ray runs along a wall, the margin of one
  /// cell may come before the cell itself. A boundary in there is the first as far as is known.
  static Mask well_inside(const Cell& cell, const Passage& in, F s) {
    Mask inside = 0xffff;
    for (int axis = 0; axis < 3; ++axis) {
      const F x = in.p[axis] + s * in.d[axis];
      inside &= less(all(cell.lo[axis] + cell.window), x) & less(x, all(cell.hi[axis] - cell.window));
    }
    return inside;
  }

  const Model& model_;
  const Packet& packet_;
  Answer& answer_;
  Counts* counts_;
  Mask active_ = 0;
  int nearer_[3];  // which sides of a box are met first
  F limit_;        // of each ray's way: its end, or a boundary
};

/// Sixteen rays from as many lines of eight doubles.
inline void load(const Rays& rays, D columns[8]) {
  alignas(64) double transposed[8][kLanes];
  for (int i = 0; i < kLanes; ++i) {
    const double* ray = rays.first + 8 * (i < rays.count ? i : 0);
    for (int j = 0; j < 8; ++j) transposed[j][i] = ray[j];
  }
  std::memcpy(columns, transposed, sizeof transposed);
}

template <bool any, bool counting>
void walk_packet(const Model& model, const Rays& rays, Answer& answer, Counts* counts) {
  D column[8];
  load(rays, column);
  Packet packet;
  const D dd = column[3] * column[3] + column[4] * column[4] + column[5] * column[5];
  const D speed = root(dd), per_speed = all<double>(1) / speed;
  D along = all<double>(0);
  D distance = all<double>(0);
  for (int axis = 0; axis < 3; ++axis) {
    distance = distance + column[axis] * column[axis];
    packet.d[axis] = column[3 + axis] * per_speed;
    packet.o[axis] = (column[axis] - all<double>(model.centre[axis])) * all<double>(model.per_unit);
    along = along + packet.o[axis] * packet.d[axis];
  }
  // From where it enters the ball around the world, or where it starts.
  const D units = speed * all<double>(model.per_unit);
  const D from = column[6] * units, enter = all<double>(-model.radius) - along;
  const D start = max(from, enter), end = column[7] * units - start;
  const double near = model.near / model.per_unit;
  const Mask valid = less(column[6], column[7]) & ((1u << rays.count) - 1);
  for (int axis = 0; axis < 3; ++axis) {
    packet.o[axis] = packet.o[axis] + start * packet.d[axis];
    packet.of[axis] = narrow(packet.o[axis]);
    packet.inverse[axis] = 1.0f / away_from_zero(narrow(packet.d[axis]));
    packet.scaled[axis] = packet.of[axis] * packet.inverse[axis];
  }
  packet.end = narrow(end);
  packet.in_world = ~less(from, enter);
  packet.far = less(all<double>(near * near), distance);

  answer.hit = answer.unsure = 0;
  Walker<any, counting> walker(model, packet, answer, counts);
  Mask down[3];
  for (int axis = 0; axis < 3; ++axis) down[axis] = less(packet.inverse[axis], F{});
  for (Mask todo = valid; todo;) {
    const int i = first_of(todo);
    int octant = 0;
    Mask alike = todo;
    for (int axis = 0; axis < 3; ++axis) {
      const bool is_down = down[axis] >> i & 1;
      octant |= is_down << axis;
      alike &= is_down ? down[axis] : ~down[axis];
    }
    walker.walk(alike, octant);
    todo &= ~alike;
  }
  answer.hit &= ~answer.unsure;
  for (Mask m = answer.hit; m; m &= m - 1) {
    const int i = first_of(m);
    answer.t[i] = (answer.t[i] + start[i]) / units[i];
    answer.t_error[i] /= units[i];
  }
}

inline void walk(const Model& model, const Rays& rays, bool any, Answer& answer, Counts* counts) {
  const auto run = any      ? counts ? walk_packet<true, true> : walk_packet<true, false>
                   : counts ? walk_packet<false, true>
                            : walk_packet<false, false>;
  run(model, rays, answer, counts);
}

}  // namespace
