// One ray by itself, under the names of lanes.hpp: the code of spans.hpp and walk.hpp is for either. Numbers are
// scalars, a mask is its lowest bit.
//
// Included by one_v2.cpp, one_v3.cpp and one_v4.cpp, before the rest. Internal linkage, as there.
#pragma once
#include <immintrin.h>

#include <cstdint>
#include <cstring>

namespace {

constexpr int kLanes = 1;
using Mask = std::uint32_t;  // the lowest bit; those above it may be anything

template <class Scalar>
struct Wide {
  Scalar only;

  Scalar operator[](int) const { return only; }
};
using F = Wide<float>;
using I = Wide<std::int32_t>;
using D = Wide<double>;

template <class Scalar>
inline Wide<Scalar> all(Scalar x) {
  return {x};
}

#define LANE_OPERATOR(op)                                                         \
  template <class Scalar>                                                         \
  inline Wide<Scalar> operator op(const Wide<Scalar>& a, const Wide<Scalar>& b) { \
    return {a.only op b.only};                                                    \
  }                                                                               \
  inline F operator op(float a, const F& b) { return {a op b.only}; }             \
  inline F operator op(const F& a, float b) { return {a.only op b}; }
LANE_OPERATOR(+)
LANE_OPERATOR(-)
LANE_OPERATOR(*)
LANE_OPERATOR(/)
#undef LANE_OPERATOR
template <class Scalar>
inline Wide<Scalar> operator-(const Wide<Scalar>& a) {
  return {-a.only};
}
template <class Scalar>
inline Wide<Scalar>& operator+=(Wide<Scalar>& a, const Wide<Scalar>& b) {
  return a = a + b;
}

template <class Scalar>
inline Wide<Scalar> min(const Wide<Scalar>& a, const Wide<Scalar>& b) {
  return {a.only < b.only ? a.only : b.only};
}
template <class Scalar>
inline Wide<Scalar> max(const Wide<Scalar>& a, const Wide<Scalar>& b) {
  return {a.only > b.only ? a.only : b.only};
}
template <class Scalar>
inline Mask less(const Wide<Scalar>& a, const Wide<Scalar>& b) {
  return a.only < b.only;
}
template <class Scalar>
inline Mask at_most(const Wide<Scalar>& a, const Wide<Scalar>& b) {
  return a.only <= b.only;
}
template <class Scalar>
inline Wide<Scalar> select(Mask m, const Wide<Scalar>& yes, const Wide<Scalar>& no) {
  return {m & 1 ? yes.only : no.only};
}

inline F root(const F& a) { return {__builtin_sqrtf(a.only)}; }
inline D root(const D& a) { return {__builtin_sqrt(a.only)}; }
inline F magnitude(const F& a) { return {__builtin_fabsf(a.only)}; }
/// |a| kept from 0, with its sign: for divisors.
inline F away_from_zero(const F& a) { return {__builtin_copysignf(max(magnitude(a), all(1e-20f)).only, a.only)}; }

inline F narrow(const D& d) { return {static_cast<float>(d.only)}; }
inline D widen(const F& a) { return {static_cast<double>(a.only)}; }

/// A row of eight doubles as eight columns.
inline void transpose(const double* row, int, D columns[8]) { std::memcpy(columns, row, 8 * sizeof(double)); }

inline int count_of(Mask m) { return static_cast<int>(m & 1); }
inline int first_of(Mask) { return 0; }

}  // namespace
