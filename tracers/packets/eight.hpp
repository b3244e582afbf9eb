// Eight floats side by side, for what one ray does with eight boxes or eight atoms at once.
#pragma once
#include "lane.hpp"

namespace {

using Eight = float __attribute__((vector_size(32)));
using EightInts = std::int32_t __attribute__((vector_size(32)));

inline Eight eight_of(float x) { return x - Eight{}; }

template <class Eights = Eight>
inline Eights load_eight(const void* at) {
  Eights out;
  std::memcpy(&out, at, sizeof out);
  return out;
}

/// The sign bit of each.
inline unsigned signs(EightInts m) {
#if defined(__AVX__)
  return static_cast<unsigned>(_mm256_movemask_ps((__m256)m));
#else
  __m128 half[2];
  std::memcpy(half, &m, sizeof m);
  return static_cast<unsigned>(_mm_movemask_ps(half[0]) | _mm_movemask_ps(half[1]) << 4);
#endif
}

/// All ones where a bit of the lowest eight is set.
inline EightInts spread(unsigned bits) {
  constexpr EightInts kBit = {1, 2, 4, 8, 16, 32, 64, 128};
  return ((static_cast<std::int32_t>(bits) - EightInts{}) & kBit) != 0;
}

}  // namespace
