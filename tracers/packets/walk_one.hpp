// One ray at a time through the same boxes and cells: eight boxes are tested at once. What is found in a cell, and
// how sure of it floats are, is walk.hpp's.
#pragma once
#include "eight.hpp"
#include "membership_one.hpp"
#include "walk.hpp"

namespace {

/// What is still to be visited of a ray's way, and its interval there.
struct Stack {
  static constexpr int kMost = 7 * 24 + 8;
  std::int32_t link[kMost];
  float enter[kMost], exit[kMost];
  int top = 0;

  /// Puts at `at` those of a node's boxes that the ray has an interval in, the first on top; says how many. Eight are
  /// written, whatever is kept of them: no branch hangs on the answer.
  int push(int at, const Eight& from, const Eight& to, const WideNode& node, int octant) {
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

template <bool any, bool counting>
class LoneWalker : Walker<any, counting> {
 public:
  using Walker<any, counting>::Walker;
  using Walker<any, counting>::arrive;

  /// Front to back: octants in the order of the ray, as a packet's.
  void walk() {
    octant_ = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const int down = packet_.inverse[axis].only < 0;
      octant_ |= down << axis;
      nearer_[axis] = axis + 3 * down;
    }
    active_ = 1;
    limit_ = packet_.end;
    Stack stack;
    stack.link[0] = 0, stack.enter[0] = 0, stack.exit[0] = limit_.only;
    stack.top = 1;
    for (;;) {
      const std::int32_t link = next_cell(stack);
      if (link >= 0) return;
      const F enter = all(stack.enter[stack.top]), exit = min(all(stack.exit[stack.top]), limit_);
      pass(model_.cells[~link], 1, enter, exit);
      if (!active_) return;
    }
  }

 private:
  using Base = Walker<any, counting>;
  using Base::active_;
  using Base::counts_;
  using Base::limit_;
  using Base::model_;
  using Base::nearer_;
  using Base::packet_;
  using Base::pass;

  /// ~ of the next cell on the way, which stands just above the stack; or 0. A function of its own, so that what it
  /// needs stays in registers.
  [[gnu::noinline]] std::int32_t next_cell(Stack& stack) const {
    const float limit = limit_.only;
    const F inverse[3] = {packet_.inverse[0], packet_.inverse[1], packet_.inverse[2]};
    const F scaled[3] = {packet_.scaled[0], packet_.scaled[1], packet_.scaled[2]};
    const int nearer[3] = {nearer_[0], nearer_[1], nearer_[2]};
    const WideNode* const nodes = model_.wide;
    const int octant = octant_;
    int top = stack.top;
    while (top > 0) {
      --top;
      // A boundary may have been found before the box.
      if (!(stack.enter[top] <= limit)) continue;
      const std::int32_t link = stack.link[top];
      if (link < 0) {
        stack.top = top;
        return link;
      }
      if (counting) counts_->boxes += 8;
      const WideNode& node = nodes[link];
      Eight from[3], to[3];
      for (int axis = 0; axis < 3; ++axis) {
        const auto reached = [&](auto side) { return side * inverse[axis].only - scaled[axis].only; };
        from[axis] = each_eight(reached, load_eight(node.side[nearer[axis]]));
        to[axis] = each_eight(reached, load_eight(node.side[3 - nearer[axis] + 2 * axis]));
      }
      const Eight enter = greater_of(greater_of(from[0], from[1]), greater_of(from[2], Eight{}));
      const Eight exit = lesser_of(lesser_of(to[0], to[1]), lesser_of(to[2], eight_of(limit)));
      top += stack.push(top, enter, exit, node, octant);
    }
    stack.top = 0;
    return 0;
  }

  int octant_ = 0;
};

template <bool any, bool counting>
void walk_each(const Model& model, const Rays& rays, Answer& answer, Counts* counts) {
  answer.hit = answer.unsure = 0;
  for (int i = 0; i < rays.count; ++i) {
    Packet ray;
    const Start start = set_out(model, {rays.first + 8 * i, 1}, ray);
    if (!(start.valid & 1)) continue;
    Answer alone;
    alone.hit = alone.unsure = 0;
    LoneWalker<any, counting> walker(model, ray, alone, counts);
    walker.walk();
    walker.arrive(start);
    answer.hit |= alone.hit << i;
    answer.unsure |= alone.unsure << i;
    answer.t[i] = alone.t[0];
    answer.t_error[i] = alone.t_error[0];
    answer.leaf[i] = alone.leaf[0];
  }
}

inline void walk_one_by_one(const Model& model, const Rays& rays, bool any, Answer& answer, Counts* counts) {
  const auto run = any      ? counts ? walk_each<true, true> : walk_each<true, false>
                   : counts ? walk_each<false, true>
                            : walk_each<false, false>;
  run(model, rays, answer, counts);
}

}  // namespace
