// Where rays meet atoms: intervals along rays, in floats from the point of a ray nearest the cell's centre. A lane is a
// ray of a packet that meets one atom, or an atom that one ray meets: the same code is for either, and an atom's
// numbers are floats in the first case, lanes in the second.
#pragma once
#include "lanes.hpp"
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

/// Rays' part in a cell, from their points nearest the cell's centre.
struct Passage {
  F p[3], d[3];
  F enter, exit, start;
  float window;
  Mask lanes;
};

/// An atom's numbers one after the other, for the rays of a packet.
struct OneAtom {
  const float* next;
  int atoms;  ///< of its kind in the cell

  float operator()() {
    const float number = *next;
    next += atoms;
    return number;
  }
};
/// Those of so many atoms as there are lanes, for one ray.
struct AtomEachLane {
  const float* next;
  int atoms;

  F operator()() {
    const F numbers = load(next);
    next += atoms;
    return numbers;
  }
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
template <class Number>
inline F apply(const Number row[3], const F v[3]) {
  return row[0] * v[0] + row[1] * v[1] + row[2] * v[2];
}
inline float magnitude(float x) { return __builtin_fabsf(x); }
inline F in_lanes(float x) { return all(x); }
inline F in_lanes(const F& x) { return x; }

/// 1 with the sign of x.
inline float sign_of(float x) { return __builtin_copysignf(1, x); }
inline F sign_of(const F& x) {
  return each<float>([](auto one) { return (FloatRegister)(((IntRegister)one & kSignBit) | 0x3f800000); }, x);
}

/// Where an atom ends because of rounding: as a larger atom if it adds to the solid, else as a smaller. An atom's
/// error is below 0 if it is `negative`.
template <class Number>
inline Number rounded_size(const Number& error) {
  return 1.0f + error;
}
/// Below this speed towards the surface, rounding may move a crossing by W/2.
template <class Number>
inline Number grazing_speed(const Number& error, float window) {
  return magnitude(error) * (2 / window);
}
/// What the square of a round atom's half chord may be wrong by: below it, floats cannot tell whether it is met.
template <class Number>
inline Number touch(const Number& error) {
  return 8.0f * magnitude(error);
}

/// Rows of an atom's frame, and the cell's centre there.
template <class Number, int axes>
struct Framed {
  Number row[axes][3], centre[axes];

  template <class Read>
  explicit Framed(Read& read) {
    for (auto& of_axis : row)
      for (Number& number : of_axis) number = read();
    for (Number& number : centre) number = read();
  }
};

/// The interval of a round atom around the middle of its chord, of which half is the root of `square`: off by no more
/// than `rounding` besides. Where `square` is below `graze` or `touch`, more cannot be told.
template <class Number>
[[gnu::always_inline]] inline void chord(const F& middle, const F& square, const F& rounding, const Number& graze,
                                         const Number& touch, const Passage& in, Doubts& doubts, F& lo, F& hi) {
  const F half = root(max(square, F{})) + rounding;
  lo = select_less(F{}, square, middle - half, all(kNever));
  hi = select_less(F{}, square, middle + half, all(-kNever));
  const Mask grazed = in.lanes & less(magnitude(square), max(in_lanes(graze), in_lanes(touch)));
  if (grazed) [[unlikely]] {
    const F most = root(max(square, F{}) + 2.0f * touch) + magnitude(rounding);
    doubts.add(grazed, middle - most, middle + most);
  }
}

/// A quadric that is the unit circle or sphere in `axes` axes of the frame.
template <int axes, class Read>
[[gnu::always_inline]] inline void round_span(Read read, const Passage& in, Doubts& doubts, F& lo, F& hi) {
  using Number = decltype(read());
  const Framed<Number, axes> atom(read);
  const Number error = read(), size = rounded_size(error), graze = grazing_speed(error, in.window);
  F x[axes], v[axes];
  F along = F{}, vv = F{};
  for (int i = 0; i < axes; ++i) {
    x[i] = apply(atom.row[i], in.p) + atom.centre[i];
    v[i] = apply(atom.row[i], in.d);
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
  const F outwards = magnitude(middle) * (0x1p-21f * sign_of(error));
  chord(middle, (size * size - distance) * inverse, outwards,
        inverse * inverse * (graze * graze), inverse * touch(error), in, doubts, lo, hi);
}

/// A ball needs no frame: a centre and a radius.
template <class Read>
[[gnu::always_inline]] inline void ball_span(Read read, const Passage& in, Doubts& doubts, F& lo, F& hi) {
  using Number = decltype(read());
  const Number x0 = read(), x1 = read(), x2 = read(), radius = read(), error = read();
  const Number size = radius * rounded_size(error), square = radius * radius;
  const Number graze = square * grazing_speed(error, in.window);
  const F x[3] = {in.p[0] + x0, in.p[1] + x1, in.p[2] + x2};
  const F along = dot3(x, in.d);
  F distance = F{};
  for (int i = 0; i < 3; ++i) {
    const F across = x[i] - along * in.d[i];
    distance += across * across;
  }
  chord(-along, size * size - distance, F{}, graze * graze, square * touch(error), in, doubts, lo, hi);
}

/// |z| ≤ 1 along z + s·v.
template <class Read>
[[gnu::always_inline]] inline void slab_span(Read read, const Passage& in, Doubts& doubts, F& lo, F& hi) {
  const Framed<decltype(read()), 1> atom(read);
  const auto error = read();
  const F z = apply(atom.row[0], in.p) + atom.centre[0], v = away_from_zero(apply(atom.row[0], in.d));
  const F inverse = 1.0f / v;
  const auto between = [&](const auto& size, F& first, F& last) {
    const F low = (-size - z) * inverse, high = (size - z) * inverse;
    first = min(low, high);
    last = max(low, high);
  };
  between(rounded_size(error), lo, hi);
  const Mask grazed = in.lanes & less(magnitude(v), in_lanes(grazing_speed(error, in.window)));
  if (grazed) [[unlikely]] {
    const auto rounding = magnitude(error) + 0x1p-21f;
    F outer_lo, outer_hi, inner_lo, inner_hi;
    between(1.0f + rounding, outer_lo, outer_hi);
    between(1.0f - rounding, inner_lo, inner_hi);
    doubts.add(grazed, outer_lo, inner_lo);
    doubts.add(grazed, inner_hi, outer_hi);
  }
}

/// ρ ≤ w where w ≥ 0, from the roots of ρ² − w². A line flatter than the wall is inside between them, if that
/// is on the side of the apex where w ≥ 0; a steeper one outside of them, and one root is on that side.
template <class Read>
inline void wall_span(Read read, const Passage& in, Doubts& doubts, F& lo, F& hi) {
  const Framed<decltype(read()), 3> atom(read);
  const auto error = read(), radius = read(), slope = read();  // the radius at the height 0 of the frame
  const auto graze = grazing_speed(error, in.window);
  F x[3], v[3];
  for (int i = 0; i < 3; ++i) {
    x[i] = apply(atom.row[i], in.p) + atom.centre[i];
    v[i] = apply(atom.row[i], in.d);
  }
  const F vv = max(dot3(v, v), all(1e-16f)), middle = -dot3(x, v) / vv;
  for (int i = 0; i < 3; ++i) x[i] += middle * v[i];
  const F w = x[2] * slope + (radius + error), dw = v[2] * slope;
  const F a = v[0] * v[0] + v[1] * v[1] - dw * dw;
  const F b = x[0] * v[0] + x[1] * v[1] - w * dw;
  const F c = x[0] * x[0] + x[1] * x[1] - w * w;
  // Rounding as a longer way inside for an atom that adds to the solid: between the roots, or outside of them.
  const Mask steep = less(a, F{}), opens = less(F{}, dw);
  const F longer = (b * b + magnitude(a * c)) * (0x1p-21f * sign_of(error));
  const F inside = b * b - a * c + select(steep, -longer, longer);
  const F square = root(max(inside, F{}));
  const F q = away_from_zero(-(b + select_less(b, F{}, -square, square)));
  const F s = q / away_from_zero(a), t = c / q;
  const F first = min(s, t), second = max(s, t);
  const Mask met = less(F{}, inside) & less(F{}, 2.0f * w + dw * (first + second));
  lo = middle + select(steep, select(opens, second, all(-kNever)), select(met, first, all(kNever)));
  hi = middle + select(steep, select(opens, all(kNever), first), select(met, second, all(-kNever)));
  const Mask grazed = in.lanes & (less(magnitude(inside), max(in_lanes(graze * graze), touch(error) * vv)) |
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

  /// The same about `m`: g(m + s).
  Quartic about(F m) const {
    return {{at(m), slope(m), c[2] + m * (3.0f * c[3] + 6.0f * (m * c[4])), c[3] + 4.0f * (m * c[4]), c[4]}};
  }

  /// Its Bernstein coefficients over [−w, w], which enclose its values there.
  struct Bernstein {
    F b[5];

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
      s = select(between(lo, next, hi), next, 0.5f * (lo + hi));
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

/// The intervals of atoms of a kind.
template <AtomKind kind, class Read>
[[gnu::always_inline]] inline void span(Read read, const Passage& in, Doubts& doubts, F& lo, F& hi) {
  if constexpr (kind == AtomKind::Ball) ball_span(read, in, doubts, lo, hi);
  if constexpr (kind == AtomKind::Ellipsoid) round_span<3>(read, in, doubts, lo, hi);
  if constexpr (kind == AtomKind::Tube) round_span<2>(read, in, doubts, lo, hi);
  if constexpr (kind == AtomKind::Slab) slab_span(read, in, doubts, lo, hi);
  if constexpr (kind == AtomKind::Wall) wall_span(read, in, doubts, lo, hi);
  if constexpr (kind == AtomKind::Torus || kind == AtomKind::SkewTorus) torus_span<kind>(read, in, doubts, lo, hi);
}

constexpr bool is_convex(AtomKind kind) { return kind != AtomKind::Torus && kind != AtomKind::SkewTorus; }

inline Mask less(double a, double b) { return a < b; }
inline double root(double x) { return __builtin_sqrt(x); }

/// Where rays start that an atom is near to.
struct Side {
  Mask inside;
  Mask left;  ///< outside, and it is not ahead unless it is a torus
};

/// By the atom's value at the starts, in double: for surfaces that are nearer than floats can tell. A convex atom that
/// is left behind is never met again. Real: D for a packet, or double for a ray.
template <class Real>
inline Side side_of_start(AtomKind kind, int axis, const Frame& frame, const Real o[3], const Real d[3], double band) {
  const auto real = [](double number) {
    if constexpr (std::is_same_v<Real, double>)
      return number;
    else
      return all(number);
  };
  Real x[3], v[3], rel[3];
  const int first = axis, end = kind == AtomKind::Slab ? axis + 1 : kind == AtomKind::Tube ? 2 : 3;
  for (int j = 0; j < 3; ++j) rel[j] = o[j] - real(frame.offset[j]);
  double steepest = 0;
  for (int i = first; i < end; ++i) {
    const double* row = frame.row[i];
    x[i] = real(row[0]) * rel[0] + real(row[1]) * rel[1] + real(row[2]) * rel[2];
    v[i] = real(row[0]) * d[0] + real(row[1]) * d[1] + real(row[2]) * d[2];
    steepest += row[0] * row[0] + row[1] * row[1] + row[2] * row[2];
  }
  // g, its slope along the ray, and what one band changes of it.
  Real g = real(0), slope = real(0), slack = real(0);
  const Real two = real(2);
  const double per_band = band * __builtin_sqrt(steepest);
  switch (kind) {
    case AtomKind::Ball:
    case AtomKind::Ellipsoid:
    case AtomKind::Tube:
    case AtomKind::Slab:
      g = real(-1);
      for (int i = first; i < end; ++i) g = g + x[i] * x[i], slope = slope + two * x[i] * v[i];
      slack = real(2 * per_band);
      break;
    case AtomKind::Torus:
    case AtomKind::SkewTorus: {
      const double minor = frame.shape[0];
      const Real alpha = x[0] * x[0] + x[1] * x[1] + x[2] * x[2] + real(1 - minor * minor);
      g = alpha * alpha - real(4) * (x[0] * x[0] + x[1] * x[1]);
      slope = real(4) * (alpha * (x[0] * v[0] + x[1] * v[1] + x[2] * v[2]) - two * (x[0] * v[0] + x[1] * v[1]));
      slack = real(16 * minor * per_band + 0x1p-46);
      break;
    }
    case AtomKind::Wall: {
      const Real rho = root(x[0] * x[0] + x[1] * x[1]);
      g = rho - real(frame.shape[0]) - real(frame.shape[1]) * x[2];
      slope = (x[0] * v[0] + x[1] * v[1]) / rho - real(frame.shape[1]) * v[2];
      slack = real(2 * per_band);
      break;
    }
  }
  return {less(g, -slack), less(slack, g) & ~less(slope, real(0))};
}

}  // namespace
