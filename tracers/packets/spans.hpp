// Where rays meet atoms, by their kinds.
#pragma once
#include "quadric_spans.hpp"
#include "torus_span.hpp"

namespace {

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

}  // namespace
