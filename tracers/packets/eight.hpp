// Eight floats side by side, for one ray that tests eight boxes at once.
#pragma once
#include <immintrin.h>

#include <cstring>

namespace {

#if defined(__AVX__)
constexpr int kEach = 8;
#else
constexpr int kEach = 4;
#endif
using FloatsOf = float __attribute__((vector_size(4 * kEach)));

struct alignas(32) Eight {
  FloatsOf part[8 / kEach];
};

inline Eight load_eight(const void* from) {
  Eight out;
  std::memcpy(&out, from, sizeof out);
  return out;
}
template <class One, class... Operand>
inline Eight each_eight(One one, const Operand&... operand) {
  Eight out;
  for (int i = 0; i < 8 / kEach; ++i) out.part[i] = one(operand.part[i]...);
  return out;
}
inline Eight eight_of(float x) {
  return each_eight([x](auto zero) { return x - zero; }, Eight{});
}
inline Eight greater_of(const Eight& a, const Eight& b) {
  return each_eight([](auto x, auto y) { return x > y ? x : y; }, a, b);
}
inline Eight lesser_of(const Eight& a, const Eight& b) {
  return each_eight([](auto x, auto y) { return x < y ? x : y; }, a, b);
}

/// One bit for each, the lowest for the first.
inline unsigned at_most(const Eight& a, const Eight& b) {
  unsigned out = 0;
  for (int i = 0; i < 8 / kEach; ++i) {
#if defined(__AVX__)
    out |= static_cast<unsigned>(_mm256_movemask_ps((__m256)(a.part[i] <= b.part[i]))) << i * kEach;
#else
    out |= static_cast<unsigned>(_mm_movemask_ps((__m128)(a.part[i] <= b.part[i]))) << i * kEach;
#endif
  }
  return out;
}

}  // namespace
