// Where rays meet balls, ellipsoids, tubes, slabs and walls: intervals along rays, in floats.
#pragma once
#include "passage.hpp"

namespace {

/// Where an atom ends because of rounding: as a larger atom if it adds to the solid, else as a smaller.
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
  chord(middle, (size * size - distance) * inverse, outwards, inverse * inverse * (graze * graze),
        inverse * touch(error), in, doubts, lo, hi);
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
  const auto faces = [&](const auto& size, F& first, F& last) {
    const F low = (-size - z) * inverse, high = (size - z) * inverse;
    first = min(low, high);
    last = max(low, high);
  };
  faces(rounded_size(error), lo, hi);
  const Mask grazed = in.lanes & less(magnitude(v), in_lanes(grazing_speed(error, in.window)));
  if (grazed) [[unlikely]] {
    const auto rounding = magnitude(error) + 0x1p-21f;
    F outer_lo, outer_hi, inner_lo, inner_hi;
    faces(1.0f + rounding, outer_lo, outer_hi);
    faces(1.0f - rounding, inner_lo, inner_hi);
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

}  // namespace
