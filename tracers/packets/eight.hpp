// Eight floats side by side, for what one ray does with eight boxes or eight atoms at once. Bits are of a mask, the
// lowest for the first.
#pragma once
#include "lane.hpp"

namespace {

#if defined(__AVX__)
constexpr int kEach = 8;
#else
constexpr int kEach = 4;
#endif
using FloatsOf = float __attribute__((vector_size(4 * kEach)));
using IntsOf = std::int32_t __attribute__((vector_size(4 * kEach)));

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

inline unsigned signs(IntsOf m) {
#if defined(__AVX__)
  return static_cast<unsigned>(_mm256_movemask_ps((__m256)m));
#else
  return static_cast<unsigned>(_mm_movemask_ps((__m128)m));
#endif
}
inline unsigned at_most(const Eight& a, const Eight& b) {
  unsigned out = 0;
  for (int i = 0; i < 8 / kEach; ++i) out |= signs(a.part[i] <= b.part[i]) << i * kEach;
  return out;
}
inline unsigned less(const Eight& a, const Eight& b) {
  unsigned out = 0;
  for (int i = 0; i < 8 / kEach; ++i) out |= signs(a.part[i] < b.part[i]) << i * kEach;
  return out;
}
inline Eight select(unsigned bits, const Eight& yes, const Eight& no) {
  constexpr std::int32_t kBit[] = {1, 2, 4, 8, 16, 32, 64, 128};
  Eight out;
  for (int i = 0; i < 8 / kEach; ++i) {
    IntsOf bit;
    std::memcpy(&bit, kBit + i * kEach, sizeof bit);
    out.part[i] = ((static_cast<std::int32_t>(bits) - IntsOf{}) & bit) != 0 ? yes.part[i] : no.part[i];
  }
  return out;
}
inline float least(const Eight& a) {
  using Four = float __attribute__((vector_size(16)));
  using FourInts = std::int32_t __attribute__((vector_size(16)));
  Four half[2];
  std::memcpy(half, &a, sizeof half);
  const auto less_of = [](auto x, auto y) { return x < y ? x : y; };
  const Four four = less_of(half[0], half[1]);
  const Four two = less_of(four, __builtin_shuffle(four, FourInts{2, 3, 0, 1}));
  return less_of(two[0], two[1]);
}

}  // namespace
