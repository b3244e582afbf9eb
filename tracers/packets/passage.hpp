// A ray's part in a cell, in floats from the point of the ray nearest the cell's centre, and what every kind of atom
// needs to say where they meet. A lane is a ray of a packet that meets one atom, or an atom that one ray meets: the
// same code is for either, and an atom's numbers are floats in the first case, lanes in the second.
#pragma once
#include "lanes.hpp"
#include "packet_model.hpp"

namespace {

using namespace csg::packets;

constexpr float kNever = __builtin_inff();

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

/// 1 with the sign of x. An atom's error is below 0 if it is `negative`.
inline float sign_of(float x) { return __builtin_copysignf(1, x); }
inline F sign_of(const F& x) {
  return each<float>([](auto one) { return (FloatRegister)(((IntRegister)one & kSignBit) | 0x3f800000); }, x);
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

}  // namespace
