// Where rays meet an atom: its interval along each ray of a packet, in floats from the point of the ray nearest
// the cell's centre. After lanes.hpp, or lane.hpp for rays one at a time.
#pragma once
#include "packet_model.hpp"

namespace {

using namespace csg::packets;

constexpr float kNever = __builtin_inff();

struct Packet {
  D o[3], d[3];                           // start and unit direction, units
  F of[3], df[3], inverse[3], scaled[3];  // the same in floats; scaled = o·inverse
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

/// Where crossings of a cell's atoms may be, if there are any, of which floats cannot tell more: the ray grazes a
/// surface there. Outside of these an atom is as its interval says.
struct Doubts {
  struct {
    Mask lanes;
    F from, to;
  } of[3 * kMostAtoms];
  int count = 0;

  void add(Mask lanes, const F& from, const F& to) { of[count++] = {lanes, from, to}; }

  /// The rays of which one lies between.
  Mask between(const F& from, const F& to) const {
    Mask out = 0;
    for (int i = 0; i < count; ++i) out |= of[i].lanes & at_most(of[i].from, to) & at_most(from, of[i].to);
    return out;
  }
};

inline F dot3(const F a[3], const F b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline F apply(const float row[3], const F v[3]) { return row[0] * v[0] + row[1] * v[1] + row[2] * v[2]; }

/// What the square of a round atom's half chord may be wrong by: below it, floats cannot tell whether it is met.
inline float touch(const Atom& atom) { return 8 * __builtin_fabsf(atom.size - 1); }

/// The interval of a round atom around the middle of its chord. `inside` times `inverse` is the square of half the
/// chord, which is off by no more than `rounding` besides.
inline void chord(const Atom& atom, const F& middle, const F& inside, const F& inverse, const F& rounding,
                  const Passage& in, Doubts& doubts, F& lo, F& hi) {
  const F half = root(max(inside, F{}) * inverse) + rounding;
  const Mask met = less(F{}, inside);
  lo = select(met, middle - half, all(kNever));
  hi = select(met, middle + half, all(-kNever));
  const Mask grazed = in.lanes & less(magnitude(inside), max(atom.graze * atom.graze * inverse, all(touch(atom))));
  if (grazed) [[unlikely]] {
    const F most = root((max(inside, F{}) + 2 * touch(atom)) * inverse) + magnitude(rounding);
    doubts.add(grazed, middle - most, middle + most);
  }
}

/// A quadric that is the unit circle or sphere in `axes` axes of the frame.
template <int axes>
inline void round_span(const Atom& atom, const float (*rows)[3], const Passage& in, Doubts& doubts, F& lo, F& hi) {
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
  // Along the axis the middle may be far away, and rounded as coarsely.
  const float outwards = atom.negative ? -0x1p-21f : 0x1p-21f;
  chord(atom, middle, atom.size * atom.size - distance, inverse, outwards * magnitude(middle), in, doubts, lo, hi);
}

inline void ball_span(const Atom& atom, float per_radius, const Passage& in, Doubts& doubts, F& lo, F& hi) {
  F x[3];
  for (int i = 0; i < 3; ++i) x[i] = per_radius * in.p[i] + atom.centre[i];
  const float radius = 1 / per_radius;
  const F along = dot3(x, in.d);
  F distance = F{};
  for (int i = 0; i < 3; ++i) {
    const F across = x[i] - along * in.d[i];
    distance += across * across;
  }
  chord(atom, -radius * along, atom.size * atom.size - distance, all(radius * radius), F{}, in, doubts, lo, hi);
}

/// |z| ≤ 1 along z + s·v.
inline void slab_span(const Atom& atom, const float row[3], float centre, const Passage& in, Doubts& doubts, F& lo,
                      F& hi) {
  const F z = apply(row, in.p) + centre, v = away_from_zero(apply(row, in.d)), inverse = 1.0f / v;
  const auto between = [&](float size, F& first, F& last) {
    const F low = (-size - z) * inverse, high = (size - z) * inverse;
    first = min(low, high);
    last = max(low, high);
  };
  between(atom.size, lo, hi);
  const Mask grazed = in.lanes & less(magnitude(v), all(atom.graze));
  if (grazed) [[unlikely]] {
    const float rounding = __builtin_fabsf(atom.size - 1) + 0x1p-21f;
    F outer_lo, outer_hi, inner_lo, inner_hi;
    between(1 + rounding, outer_lo, outer_hi);
    between(1 - rounding, inner_lo, inner_hi);
    doubts.add(grazed, outer_lo, inner_lo);
    doubts.add(grazed, inner_hi, outer_hi);
  }
}

/// ρ ≤ w where w ≥ 0, from the roots of ρ² − w². A line flatter than the wall is inside between them, if that
/// is on the side of the apex where w ≥ 0; a steeper one outside of them, and one root is on that side.
inline void wall_span(const Atom& atom, const Frame& frame, const Passage& in, Doubts& doubts, F& lo, F& hi) {
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
  const Mask grazed = in.lanes & (less(magnitude(inside), max(all(atom.graze * atom.graze), touch(atom) * vv)) |
                                  less(magnitude(a), 1e-4f * vv));
  if (grazed) [[unlikely]]
    doubts.add(grazed, all(-kNever), all(kNever));
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

inline void torus_span(const Atom& atom, const Frame& frame, const Passage& in, float window, Doubts& doubts, F& lo,
                       F& hi) {
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
  if (!todo) return;
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
  // Where it is entered or left, outwards or inwards by what rounding may cost, as long as the slope says so.
  const F outwards = all<float>(atom.negative ? -1 : 1);
  const auto crossing = [&](Mask of, F from, F to, F side) {
    const F s = g.root_in(from, to, 0.25f * slack, of), value = magnitude(g.at(s)),
            speed = max(magnitude(g.slope(s)), all(1e-20f));
    const F by = (slack + value) / speed;
    rest |= of & (less(slack, value) | less(0.25f * speed, by * magnitude(g.bend(s))));
    if (const Mask grazed = of & less(all(0.5f * window), by))
      doubts.add(grazed, middle + s - 2.0f * by, middle + s + 2.0f * by);
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
  if (rest) doubts.add(rest, all(-kNever), all(kNever));
}

/// Where an atom lies whose surface is nearer to a ray's start than floats can tell: by its value
/// there, in double. A convex atom that is left behind is never met again.
inline void settle_start(const Atom& atom, const Frame& frame, const Packet& packet, double band, Mask near, F& lo,
                         F& hi, Mask& unsure) {
  D x[3], v[3];
  const auto [first, end] = kAxes[static_cast<int>(atom.kind)];
  D rel[3];
  for (int j = 0; j < 3; ++j) rel[j] = packet.o[j] - all<double>(frame.offset[j]);
  double steepest = 0;
  for (int i = first; i < end; ++i) {
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
      for (int i = 0; i < end; ++i) g = g + x[i] * x[i], slope = slope + two * x[i] * v[i];
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
  const Mask outside = less(slack, g), inside = less(g, -slack), away = ~less(slope, all<double>(0));
  // A torus may be met again, but not in this cell if its one crossing here is the one behind.
  const Mask once = atom.kind == AtomKind::Torus ? less(lo, all(-1e30f)) : 0xffff;
  const Mask left = near & outside & away & once, still_in = near & inside;
  lo = select(left, all(kNever), lo);
  hi = select(left, all(-kNever), hi);
  lo = select(still_in, all(-kNever), lo);
  unsure |= near & (~(left | still_in) | packet.far);
}

}  // namespace
