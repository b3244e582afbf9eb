// The stack of a ray that goes alone.
#pragma once
#include "eight.hpp"
#include "packet_model.hpp"

namespace {

using namespace csg::packets;

/// What is still to be visited of a lone ray's way, and its interval there.
struct Stack {
  static constexpr int kMost = 7 * 24 + 8;
  std::int32_t link[kMost];
  float enter[kMost], exit[kMost];
  int top = 0;

  /// Puts at `at` those of a node's boxes that the ray has an interval in, the first on top; says how many. Eight are
  /// written, whatever is kept of them: no branch hangs on the answer.
  int push(int at, const Eight& from, const Eight& to, const Node& node, int octant) {
#if defined(__AVX512VL__)
    const __m256i order = _mm256_xor_si256(_mm256_setr_epi32(7, 6, 5, 4, 3, 2, 1, 0), _mm256_set1_epi32(octant));
    const __m256 first = _mm256_permutexvar_ps(order, (__m256)from.part[0]);
    const __m256 last = _mm256_permutexvar_ps(order, (__m256)to.part[0]);
    const __m256i links = _mm256_permutexvar_epi32(order, _mm256_load_si256((const __m256i*)node.link));
    const __mmask8 met = _mm256_cmp_ps_mask(first, last, _CMP_LE_OQ);
    _mm256_storeu_ps(enter + at, _mm256_maskz_compress_ps(met, first));
    _mm256_storeu_ps(exit + at, _mm256_maskz_compress_ps(met, last));
    _mm256_storeu_si256((__m256i*)(link + at), _mm256_maskz_compress_epi32(met, links));
    return __builtin_popcount(met);
#else
    const unsigned met = at_most(from, to);
    alignas(32) float first[8], last[8];
    std::memcpy(first, &from, sizeof first);
    std::memcpy(last, &to, sizeof last);
    for (int i = 7; i >= 0; --i) {
      const int box = i ^ octant;
      link[at] = node.link[box], enter[at] = first[box], exit[at] = last[box];
      at += met >> box & 1;
    }
    return __builtin_popcount(met);
#endif
  }
};

}  // namespace
