// What a kernel answers: where the whole line through a ray crosses a primitive's surface.
#pragma once
#include <cmath>
#include <cstdint>
#include <utility>

#include "../vec.hpp"

namespace csg {

/// Crossings in ascending t, an even number; odd ones enter. `face` names the piece of surface, so
/// that the normal there needs no guessing.
struct Crossings {
  int count = 0;
  double t[4];
  std::uint8_t face[4];

  void add(double at, std::uint8_t on) {
    t[count] = at;
    face[count++] = on;
  }

  /// In another parameter, t ↦ shift + step·t. Two that rounding makes one are none: which of their
  /// faces is met would be anyone's guess.
  Crossings moved(double shift, double step = 1) const {
    Crossings out;
    for (int i = 0; i < count; ++i) {
      const double at = shift + step * t[i];
      if (out.count > 0 && out.t[out.count - 1] == at)
        --out.count;
      else
        out.add(at, face[i]);
    }
    return out;
  }
};

/// A line in a primitive's local frame.
template <class Real>
struct Line {
  Real ox, oy, oz, dx, dy, dz;

  void advance(Real by) {
    ox += by * dx;
    oy += by * dy;
    oz += by * dz;
  }
};

/// Moves the line's origin to its point nearest the local origin and returns the parameter of that
/// point. One step leaves a rounding error of the size of the old origin: lines come from
/// primitive.cpp, which has made a first one in the world.
template <class Real>
Real recentre(Line<Real>& line) {
  const Real dd = line.dx * line.dx + line.dy * line.dy + line.dz * line.dz;
  const Real by = -(line.ox * line.dx + line.oy * line.dy + line.oz * line.dz) / dd;
  line.advance(by);
  return by;
}

/// A convex primitive's chord, built by intersecting pieces of surface.
template <class Real>
struct Chord {
  Real enter = -std::numeric_limits<Real>::infinity(), leave = std::numeric_limits<Real>::infinity();
  std::uint8_t enter_face = 0, leave_face = 0;

  void clip(Real from, Real to, std::uint8_t from_face, std::uint8_t to_face) {
    if (from > enter) enter = from, enter_face = from_face;
    if (to < leave) leave = to, leave_face = to_face;
  }
  void clear() { enter = std::numeric_limits<Real>::infinity(), leave = -enter; }

  /// |coordinate| ≤ half, faces `low` and `low + 1`.
  void clip_slab(Real o, Real d, Real half, std::uint8_t low) {
    if (d == 0) {
      if (!(std::fabs(o) < half)) clear();
      return;
    }
    const Real a = (-half - o) / d, b = (half - o) / d;
    const auto high = static_cast<std::uint8_t>(low + 1);
    if (d > 0)
      clip(a, b, low, high);
    else
      clip(b, a, high, low);
  }

  /// An empty or touching chord crosses nothing: the solid is regularized.
  Crossings crossings(Real shift = 0) const {
    Crossings out;
    const Real a = shift + enter, b = shift + leave;
    if (a < b) out.add(a, enter_face), out.add(b, leave_face);
    return out;
  }
};

}  // namespace csg
