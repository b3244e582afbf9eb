// Where rays meet a torus in a cell: an interval along each, in floats.
#pragma once
#include "passage.hpp"

namespace {

/// Crossings of a torus: where its quartic along the ray changes sign between the ends of the cell.
struct Quartic {
  F c[5];

  F at(F s) const { return c[0] + s * (c[1] + s * (c[2] + s * (c[3] + s * c[4]))); }
  F slope(F s) const { return c[1] + s * (2.0f * c[2] + s * (3.0f * c[3] + s * (4.0f * c[4]))); }
  F bend(F s) const { return 2.0f * c[2] + s * (6.0f * c[3] + s * (12.0f * c[4])); }

  /// The same about `m`: g(m + s).
  Quartic about(F m) const {
    return {{at(m), slope(m), c[2] + m * (3.0f * c[3] + 6.0f * (m * c[4])), c[3] + 4.0f * (m * c[4]), c[4]}};
  }

  /// Bernstein coefficients: they enclose the values over an interval.
  struct Bernstein {
    F b[5];

    /// Where all values are certainly above 0, or below, if each coefficient may be wrong by `slack`.
    Mask above(F slack) const { return less(slack, min(min(min(b[0], b[1]), min(b[2], b[3])), b[4])); }
    Mask below(F slack) const { return less(max(max(max(b[0], b[1]), max(b[2], b[3])), b[4]), -slack); }

    /// Which change sign once, whatever an uncertain coefficient stands for: it may only stand at the turn.
    Mask once(F slack) const {
      Mask positive[5], negative[5];
      for (int i = 0; i < 5; ++i) positive[i] = less(slack, b[i]), negative[i] = less(b[i], -slack);
      Mask down = positive[0] & negative[4], up = negative[0] & positive[4];
      for (int i = 0; i < 4; ++i) {
        down &= positive[i] | negative[i + 1];
        up &= negative[i] | positive[i + 1];
      }
      return down | up;
    }
  };
  /// Those over [−w, w].
  Bernstein over(F w) const {
    const F w2 = w * w, a1 = c[1] * w, a2 = c[2] * w2, a3 = c[3] * w2 * w, a4 = c[4] * w2 * w2;
    const F even = c[0] + a2 + a4, odd = a1 + a3, even1 = c[0] - a4, odd1 = 0.5f * (a1 - a3);
    return {{even - odd, even1 - odd1, c[0] - (1.0f / 3) * a2 + a4, even1 + odd1, even + odd}};
  }

  /// The root in [lo, hi], where the sign changes once, from the chord: Newton, halving where it leaves the bracket,
  /// until the rays `of` are near enough.
  F root_in(F lo, F hi, F enough, Mask of) const {
    const F at_lo = at(lo), at_hi = at(hi), falls = sign_of(at_lo);
    F s = lo + (hi - lo) * (at_lo / away_from_zero(at_lo - at_hi));
    for (int step = 0; step < 12; ++step) {
      const F value = at(s);
      if (!(of & less(enough, magnitude(value)))) break;
      const F behind = value * falls;  // above 0 if the root lies behind s
      const F next = s - value / away_from_zero(slope(s));
      lo = select_less(F{}, behind, s, lo);
      hi = select_less(F{}, behind, hi, s);
      s = select(in_closed(lo, next, hi), next, 0.5f * (lo + hi));
    }
    return s;
  }
};

/// Where a ray's nearest point to the cell's centre, and its direction, stand to a torus: across its axis and along.
struct Across {
  F x[3], v[3];  // across
  F z, vz;
};
/// Of a torus that is as round in the world as in its frame: by its axis alone.
template <class Read>
inline Across across_round(Read& read, const Passage& in, const F& middle) {
  using Number = decltype(read());
  const Number centre[3] = {read(), read(), read()}, per_major = read(), axis[3] = {read(), read(), read()};
  Across out;
  for (int i = 0; i < 3; ++i) {
    out.v[i] = per_major * in.d[i];
    out.x[i] = per_major * in.p[i] + centre[i] + middle * out.v[i];
  }
  out.z = apply(axis, out.x), out.vz = apply(axis, out.v);
  for (int i = 0; i < 3; ++i) {
    out.x[i] = out.x[i] - axis[i] * out.z;
    out.v[i] = out.v[i] - axis[i] * out.vz;
  }
  return out;
}
template <class Read>
inline Across across_skew(Read& read, const Passage& in, const F& middle) {
  const Framed<decltype(read()), 3> atom(read);
  F x[3], v[3];
  for (int i = 0; i < 3; ++i) {
    v[i] = apply(atom.row[i], in.d);
    x[i] = apply(atom.row[i], in.p) + atom.centre[i] + middle * v[i];
  }
  return {{x[0], x[1], F{}}, {v[0], v[1], F{}}, x[2], v[2]};
}

template <AtomKind kind, class Read>
inline void torus_span(Read read, const Passage& in, Doubts& doubts, F& lo, F& hi) {
  const float window = in.window;
  const F middle = 0.5f * (in.enter + in.exit);
  const F wide = 0.5f * (in.exit - in.enter) + all(4 * window);
  const Across on = kind == AtomKind::Torus ? across_round(read, in, middle) : across_skew(read, in, middle);
  // What the quartic's value may be wrong by, and the minor radius.
  const auto error = read(), minor = read();
  const F outwards = in_lanes(sign_of(error));
  const F q0 = dot3(on.x, on.x), q1 = 2.0f * dot3(on.x, on.v), q2 = dot3(on.v, on.v);
  const F alpha = q0 + on.z * on.z + (1.0f - minor * minor);
  const F beta = q1 + 2.0f * (on.z * on.vz), gamma = q2 + on.vz * on.vz;
  Quartic g;
  // The two factors of alpha² − 4·rho²: what is small near the tube is computed from what is small.
  const F rho = root(q0), off = rho - 1.0f;
  g.c[0] = (off * off + on.z * on.z - minor * minor) * (alpha + 2.0f * rho);
  g.c[1] = 2.0f * alpha * beta - 4.0f * q1;
  g.c[2] = beta * beta + 2.0f * alpha * gamma - 4.0f * q2;
  g.c[3] = 2.0f * beta * gamma;
  g.c[4] = gamma * gamma;
  const F slack = in_lanes(magnitude(error));
  const Quartic::Bernstein whole = g.over(wide);
  const Mask below = whole.below(slack);
  lo = select(below, all(-kNever), all(kNever));
  hi = -lo;
  const Mask todo = in.lanes & ~(whole.above(slack) | below);
  if (!todo) return;
  F left = -wide, right = wide;
  const Mask told = whole.once(slack) & todo;
  Mask two = 0;
  const Mask rises = less(whole.b[0], F{});  // starts inside
  Mask rest = todo & ~told;
  F lowest = F{};
  if (rest) {
    // Look for a place inside, or for proof that there is none, on either side of the lowest point.
    for (int step = 0; step < 3; ++step) {
      const F by = g.slope(lowest) / max(magnitude(g.bend(lowest)), all(1e-12f));
      lowest = min(max(lowest - by, left), right);
    }
    const auto part = [&](F from, F to) { return g.about(0.5f * (from + to)).over(0.5f * (to - from)); };
    const Quartic::Bernstein before = part(left, lowest), behind = part(lowest, right);
    rest &= ~(before.above(slack) & behind.above(slack));
    if (rest) two = rest & before.once(slack) & behind.once(slack) & less(g.at(lowest), -slack) & ~rises;
    rest &= ~two;
  }
  // Where it is entered or left, outwards or inwards by what rounding may cost, as long as the slope says so.
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
  lo = select(rest, -kNever * outwards, lo);
  hi = select(rest, kNever * outwards, hi);
  lo += middle;
  hi += middle;
  if (rest) doubts.add(rest, all(-kNever), all(kNever));
}

}  // namespace
