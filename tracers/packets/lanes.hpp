// Sixteen rays side by side, or sixteen atoms: lanes of float, int and double in as many registers as they take, and
// masks of one bit a lane.
//
// Included by walk_v2.cpp, walk_v3.cpp and walk_v4.cpp, which are compiled for three instruction sets.
// Everything here has internal linkage, so that no function for AVX-512 can be linked into code that
// runs anywhere.
#pragma once
#include <immintrin.h>

#include <cstdint>
#include <cstring>
#include <type_traits>
#include <utility>

namespace {

constexpr int kLanes = 16;
using Mask = std::uint32_t;  // the low 16 bits

#if defined(__AVX512F__) && defined(__AVX512DQ__)
constexpr int kRegister = 64;
#elif defined(__AVX2__)
constexpr int kRegister = 32;
#else
constexpr int kRegister = 16;
#endif

/// Sixteen of a scalar.
template <class Scalar>
struct Wide {
  typedef Scalar Register __attribute__((vector_size(kRegister)));
  static constexpr int kEach = kRegister / static_cast<int>(sizeof(Scalar)), kParts = kLanes / kEach;

  Register part[kParts];

  Scalar operator[](int i) const {
    Scalar lane;
    std::memcpy(&lane, reinterpret_cast<const char*>(part) + static_cast<unsigned>(i) * sizeof lane, sizeof lane);
    return lane;
  }
};
using F = Wide<float>;
using I = Wide<std::int32_t>;
using D = Wide<double>;

template <class Scalar>
inline Wide<Scalar> all(Scalar x) {
  Wide<Scalar> out;
  for (auto& part : out.part) part = x - typename Wide<Scalar>::Register{};
  return out;
}

/// `one` of each register of some operands.
template <class Scalar, class One, class... Operand>
inline Wide<Scalar> each(One one, const Operand&... operand) {
  Wide<Scalar> out;
  for (int i = 0; i < Wide<Scalar>::kParts; ++i) out.part[i] = one(operand.part[i]...);
  return out;
}
/// A bit for each lane, from the bits of each register.
template <class Scalar, class One, class... Operand>
inline Mask bits(One one, const Wide<Scalar>& first, const Operand&... operand) {
  Mask out = 0;
  for (int i = 0; i < Wide<Scalar>::kParts; ++i)
    out |= static_cast<Mask>(one(first.part[i], operand.part[i]...)) << i * Wide<Scalar>::kEach;
  return out;
}

#define LANES_OPERATOR(op)                                                        \
  template <class Scalar>                                                         \
  inline Wide<Scalar> operator op(const Wide<Scalar>& a, const Wide<Scalar>& b) { \
    return each<Scalar>([](auto x, auto y) { return x op y; }, a, b);             \
  }                                                                               \
  inline F operator op(float a, const F& b) { return all(a) op b; }               \
  inline F operator op(const F& a, float b) { return a op all(b); }
LANES_OPERATOR(+)
LANES_OPERATOR(-)
LANES_OPERATOR(*)
LANES_OPERATOR(/)
#undef LANES_OPERATOR
template <class Scalar>
inline Wide<Scalar> operator-(const Wide<Scalar>& a) {
  return each<Scalar>([](auto x) { return -x; }, a);
}
template <class Scalar>
inline Wide<Scalar>& operator+=(Wide<Scalar>& a, const Wide<Scalar>& b) {
  return a = a + b;
}

template <class Scalar>
inline Wide<Scalar> min(const Wide<Scalar>& a, const Wide<Scalar>& b) {
  return each<Scalar>([](auto x, auto y) { return x < y ? x : y; }, a, b);
}
template <class Scalar>
inline Wide<Scalar> max(const Wide<Scalar>& a, const Wide<Scalar>& b) {
  return each<Scalar>([](auto x, auto y) { return x > y ? x : y; }, a, b);
}

/// `yes` where a < b, else `no`: with no mask between, which costs most where a mask is no register of its own.
inline F select_less(const F& a, const F& b, const F& yes, const F& no) {
  return each<float>([](auto x, auto y, auto p, auto q) { return x < y ? p : q; }, a, b, yes, no);
}

using FloatRegister = F::Register;
using IntRegister = I::Register;
using DoubleRegister = D::Register;
using LongRegister = Wide<std::int64_t>::Register;

#if defined(__AVX512F__) && defined(__AVX512DQ__)
inline Mask less(const F& a, const F& b) {
  return bits([](auto x, auto y) { return _mm512_cmp_ps_mask(x, y, _CMP_LT_OQ); }, a, b);
}
inline Mask at_most(const F& a, const F& b) {
  return bits([](auto x, auto y) { return _mm512_cmp_ps_mask(x, y, _CMP_LE_OQ); }, a, b);
}
inline Mask less(const D& a, const D& b) {
  return bits([](auto x, auto y) { return _mm512_cmp_pd_mask(x, y, _CMP_LT_OQ); }, a, b);
}
/// a ≤ x < b, and a ≤ x ≤ b.
inline Mask in_half_open(const F& a, const F& x, const F& b) {
  const auto one = [](auto p, auto q, auto r) {
    return _mm512_mask_cmp_ps_mask(_mm512_cmp_ps_mask(p, q, _CMP_LE_OQ), q, r, _CMP_LT_OQ);
  };
  return bits(one, a, x, b);
}
inline Mask in_closed(const F& a, const F& x, const F& b) {
  const auto one = [](auto p, auto q, auto r) {
    return _mm512_mask_cmp_ps_mask(_mm512_cmp_ps_mask(p, q, _CMP_LE_OQ), q, r, _CMP_LE_OQ);
  };
  return bits(one, a, x, b);
}
inline F select(Mask m, const F& yes, const F& no) {
  return {{_mm512_mask_blend_ps(static_cast<__mmask16>(m), no.part[0], yes.part[0])}};
}
inline I select(Mask m, const I& yes, const I& no) {
  return {{(IntRegister)_mm512_mask_blend_epi32(static_cast<__mmask16>(m), (__m512i)no.part[0], (__m512i)yes.part[0])}};
}
inline D select(Mask m, const D& yes, const D& no) {
  return {{_mm512_mask_blend_pd(static_cast<__mmask8>(m), no.part[0], yes.part[0]),
           _mm512_mask_blend_pd(static_cast<__mmask8>(m >> 8), no.part[1], yes.part[1])}};
}
inline F root(const F& a) { return {{_mm512_sqrt_ps(a.part[0])}}; }
inline D root(const D& a) {
  return each<double>([](auto x) { return _mm512_sqrt_pd(x); }, a);
}
#else
#if defined(__AVX2__)
inline Mask signs(IntRegister m) { return static_cast<Mask>(_mm256_movemask_ps((__m256)m)); }
inline Mask signs(LongRegister m) { return static_cast<Mask>(_mm256_movemask_pd((__m256d)m)); }
inline FloatRegister root_of(FloatRegister x) { return _mm256_sqrt_ps(x); }
inline DoubleRegister root_of(DoubleRegister x) { return _mm256_sqrt_pd(x); }
#else
inline Mask signs(IntRegister m) { return static_cast<Mask>(_mm_movemask_ps((__m128)m)); }
inline Mask signs(LongRegister m) { return static_cast<Mask>(_mm_movemask_pd((__m128d)m)); }
inline FloatRegister root_of(FloatRegister x) { return _mm_sqrt_ps(x); }
inline DoubleRegister root_of(DoubleRegister x) { return _mm_sqrt_pd(x); }
#endif
inline Mask less(const F& a, const F& b) {
  return bits([](auto x, auto y) { return signs(x < y); }, a, b);
}
inline Mask at_most(const F& a, const F& b) {
  return bits([](auto x, auto y) { return signs(x <= y); }, a, b);
}
inline Mask less(const D& a, const D& b) {
  return bits([](auto x, auto y) { return signs(x < y); }, a, b);
}
/// a ≤ x < b, and a ≤ x ≤ b.
inline Mask in_half_open(const F& a, const F& x, const F& b) {
  return bits([](auto p, auto q, auto r) { return signs((p <= q) & (q < r)); }, a, x, b);
}
inline Mask in_closed(const F& a, const F& x, const F& b) {
  return bits([](auto p, auto q, auto r) { return signs((p <= q) & (q <= r)); }, a, x, b);
}
/// All ones in the lanes of a mask.
template <class Scalar>
inline auto spread(Mask m, int part) {
  using Bits = std::conditional_t<sizeof(Scalar) == 4, std::int32_t, std::int64_t>;
  typename Wide<Bits>::Register bit;
  constexpr Bits kBit[] = {1, 2, 4, 8, 16, 32, 64, 128};
  std::memcpy(&bit, kBit, sizeof bit);
  return ((static_cast<Bits>(m >> part * Wide<Bits>::kEach) - typename Wide<Bits>::Register{}) & bit) != 0;
}
template <class Scalar>
inline Wide<Scalar> select(Mask m, const Wide<Scalar>& yes, const Wide<Scalar>& no) {
  Wide<Scalar> out;
  for (int i = 0; i < Wide<Scalar>::kParts; ++i) out.part[i] = spread<Scalar>(m, i) ? yes.part[i] : no.part[i];
  return out;
}
template <class Scalar>
inline Wide<Scalar> root(const Wide<Scalar>& a) {
  return each<Scalar>([](auto x) { return root_of(x); }, a);
}
#endif

inline F magnitude(const F& a) {
  return each<float>([](auto x) { return (FloatRegister)((IntRegister)x & 0x7fffffff); }, a);
}
constexpr auto kSignBit = static_cast<std::int32_t>(0x80000000);
/// |a| kept from 0, with its sign: for divisors.
inline F away_from_zero(const F& a) {
  const auto one = [](auto x, auto size) { return (FloatRegister)((IntRegister)size | ((IntRegister)x & kSignBit)); };
  return each<float>(one, a, max(magnitude(a), all(1e-20f)));
}

inline F load(const float* from) {
  F out;
  std::memcpy(&out, from, sizeof out);
  return out;
}
inline void store(const F& a, float* to) { std::memcpy(to, &a, sizeof a); }

inline float least(const F& a) {
  using Four = float __attribute__((vector_size(16)));
  using FourInts = std::int32_t __attribute__((vector_size(16)));
  const auto less_of = [](auto x, auto y) { return x < y ? x : y; };
  FloatRegister least = a.part[0];
  for (int i = 1; i < F::kParts; ++i) least = less_of(least, a.part[i]);
  Four part[kRegister / 16];
  std::memcpy(part, &least, sizeof part);
  Four four = part[0];
  for (int i = 1; i < kRegister / 16; ++i) four = less_of(four, part[i]);
  const Four two = less_of(four, __builtin_shuffle(four, FourInts{2, 3, 0, 1}));
  return less_of(two[0], two[1]);
}

/// Two halves of a register side by side, and each of them again.
template <int... lane, class Half>
inline auto joined(std::integer_sequence<int, lane...>, Half low, Half high) {
  return __builtin_shufflevector(low, high, lane...);
}
template <int from, int... lane, class Register>
inline auto half_of(std::integer_sequence<int, lane...>, Register whole) {
  return __builtin_shufflevector(whole, whole, (from + lane)...);
}

inline F narrow(const D& d) {
  using Half = float __attribute__((vector_size(kRegister / 2)));
  F out;
  for (int i = 0; i < F::kParts; ++i)
    out.part[i] = joined(std::make_integer_sequence<int, F::kEach>(), __builtin_convertvector(d.part[2 * i], Half),
                         __builtin_convertvector(d.part[2 * i + 1], Half));
  return out;
}
inline D widen(const F& a) {
  constexpr std::make_integer_sequence<int, D::kEach> kHalf;
  D out;
  for (int i = 0; i < F::kParts; ++i) {
    out.part[2 * i] = __builtin_convertvector(half_of<0>(kHalf, a.part[i]), DoubleRegister);
    out.part[2 * i + 1] = __builtin_convertvector(half_of<D::kEach>(kHalf, a.part[i]), DoubleRegister);
  }
  return out;
}

/// Changes the blocks of `side` rows and columns that stand across the diagonal.
template <int side, int... lane>
inline void exchange(std::integer_sequence<int, lane...>, DoubleRegister* row) {
  constexpr int kSide = D::kEach;
  for (int i = 0; i < kSide; ++i) {
    if (i & side) continue;
    const DoubleRegister a = row[i], b = row[i | side];
    row[i] = __builtin_shufflevector(a, b, (lane & side ? kSide + (lane ^ side) : lane)...);
    row[i | side] = __builtin_shufflevector(a, b, (lane & side ? kSide + lane : lane ^ side)...);
  }
}
/// Sixteen rows of eight doubles, or the first `count` and the first of them again, as eight columns.
inline void transpose(const double* rows, int count, D columns[8]) {
  constexpr int kSide = D::kEach;
  constexpr std::make_integer_sequence<int, kSide> kLane;
  for (int part = 0; part < D::kParts; ++part) {
    for (int first = 0; first < 8; first += kSide) {
      DoubleRegister square[kSide];
      for (int i = 0; i < kSide; ++i) {
        const int row = part * kSide + i;
        std::memcpy(&square[i], rows + 8 * (row < count ? row : 0) + first, sizeof square[i]);
      }
      exchange<1>(kLane, square);
      if constexpr (kSide > 2) exchange<2>(kLane, square);
      if constexpr (kSide > 4) exchange<4>(kLane, square);
      for (int j = 0; j < kSide; ++j) columns[first + j].part[part] = square[j];
    }
  }
}

inline int count_of(Mask m) { return __builtin_popcount(m); }
inline int first_of(Mask m) { return __builtin_ctz(m); }

}  // namespace
