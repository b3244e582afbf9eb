// Sixteen rays side by side: lanes of float and double, and masks of one bit a lane.
//
// Included by walk_v2.cpp, walk_v3.cpp and walk_v4.cpp, which are compiled for three instruction sets.
// Everything here has internal linkage, so that no function for AVX-512 can be linked into code that
// runs anywhere.
#pragma once
#include <immintrin.h>

#include <cstdint>
#include <cstring>

namespace {

constexpr int kLanes = 16;
using Mask = std::uint32_t;  // the low 16 bits
using F = float __attribute__((vector_size(4 * kLanes)));
using I = std::int32_t __attribute__((vector_size(4 * kLanes)));
using D8 = double __attribute__((vector_size(64)));
using F8 = float __attribute__((vector_size(32)));

/// Sixteen doubles in two registers.
struct D {
  D8 half[2];
};

inline F all(float x) { return x - F{}; }
inline I all_int(std::int32_t x) { return x - I{}; }

#if defined(__AVX512F__) && defined(__AVX512DQ__)
inline Mask less(F a, F b) { return _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ); }
inline Mask at_most(F a, F b) { return _mm512_cmp_ps_mask(a, b, _CMP_LE_OQ); }
inline F select(Mask m, F yes, F no) { return _mm512_mask_blend_ps(static_cast<__mmask16>(m), no, yes); }
inline I select(Mask m, I yes, I no) {
  return (I)_mm512_mask_blend_epi32(static_cast<__mmask16>(m), (__m512i)no, (__m512i)yes);
}
inline F root(F a) { return _mm512_sqrt_ps(a); }
inline F narrow(const D& d) {
  return _mm512_insertf32x8(_mm512_castps256_ps512(_mm512_cvtpd_ps(d.half[0])), _mm512_cvtpd_ps(d.half[1]), 1);
}
#else
/// One bit of each lane's sign.
inline Mask signs(I mask) {
  Mask bits = 0;
#if defined(__AVX2__)
  __m256 part[2];
  std::memcpy(part, &mask, sizeof part);
  for (int i = 0; i < 2; ++i) bits |= static_cast<Mask>(_mm256_movemask_ps(part[i])) << 8 * i;
#else
  __m128 part[4];
  std::memcpy(part, &mask, sizeof part);
  for (int i = 0; i < 4; ++i) bits |= static_cast<Mask>(_mm_movemask_ps(part[i])) << 4 * i;
#endif
  return bits;
}
inline I lanes_of(Mask m) {
  const I bit = {1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768};
  return (all_int(static_cast<std::int32_t>(m)) & bit) != 0;
}
inline Mask less(F a, F b) { return signs(a < b); }
inline Mask at_most(F a, F b) { return signs(a <= b); }
inline F select(Mask m, F yes, F no) { return lanes_of(m) ? yes : no; }
inline I select(Mask m, I yes, I no) { return lanes_of(m) ? yes : no; }
inline F root(F a) {
#if defined(__AVX2__)
  __m256 part[2];
  std::memcpy(part, &a, sizeof part);
  for (__m256& p : part) p = _mm256_sqrt_ps(p);
#else
  __m128 part[4];
  std::memcpy(part, &a, sizeof part);
  for (__m128& p : part) p = _mm_sqrt_ps(p);
#endif
  std::memcpy(&a, part, sizeof part);
  return a;
}
inline F narrow(const D& d) {
  const F8 part[2] = {__builtin_convertvector(d.half[0], F8), __builtin_convertvector(d.half[1], F8)};
  F out;
  std::memcpy(&out, part, sizeof part);
  return out;
}
#endif

inline F min(F a, F b) { return a < b ? a : b; }
inline F max(F a, F b) { return a > b ? a : b; }
inline F magnitude(F a) { return (F)((I)a & 0x7fffffff); }
/// |a| kept from 0, with its sign: for divisors.
inline F away_from_zero(F a) {
  const I sign = (I)a & static_cast<std::int32_t>(0x80000000);
  return (F)((I)max(magnitude(a), all(1e-20f)) | sign);
}
inline int count_of(Mask m) { return __builtin_popcount(m); }
inline int first_of(Mask m) { return __builtin_ctz(m); }

#if defined(__AVX512F__)
inline Mask less(D8 a, D8 b) { return _mm512_cmp_pd_mask(a, b, _CMP_LT_OQ); }
#else
inline Mask less(D8 a, D8 b) {
  Mask bits = 0;
  for (int i = 0; i < 8; ++i) bits |= static_cast<Mask>(a[i] < b[i]) << i;
  return bits;
}
#endif
inline Mask less(const D& a, const D& b) { return less(a.half[0], b.half[0]) | less(a.half[1], b.half[1]) << 8; }
inline D max(const D& a, const D& b) {
  return {{a.half[0] > b.half[0] ? a.half[0] : b.half[0], a.half[1] > b.half[1] ? a.half[1] : b.half[1]}};
}
inline D operator+(const D& a, const D& b) { return {{a.half[0] + b.half[0], a.half[1] + b.half[1]}}; }
inline D operator-(const D& a, const D& b) { return {{a.half[0] - b.half[0], a.half[1] - b.half[1]}}; }
inline D operator*(const D& a, const D& b) { return {{a.half[0] * b.half[0], a.half[1] * b.half[1]}}; }
inline D operator/(const D& a, const D& b) { return {{a.half[0] / b.half[0], a.half[1] / b.half[1]}}; }
inline D all_double(double x) { return {{x - D8{}, x - D8{}}}; }
inline double lane(const D& d, int i) { return d.half[i / 8][i % 8]; }
inline void set_lane(D& d, int i, double x) { d.half[i / 8][i % 8] = x; }

}  // namespace
