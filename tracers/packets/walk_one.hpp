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

  /// Those of eight boxes that the ray has an interval in, box order[0] first. Eight are written, whatever is
  /// kept of them: no branch hangs on the answer.
  int push(int at, Eight from, Eight to, EightInts links, EightInts order) {
#if defined(__AVX512VL__)
    const auto turned = (__m256i)order;
    const __m256 first = _mm256_permutexvar_ps(turned, (__m256)from), last = _mm256_permutexvar_ps(turned, (__m256)to);
    const __mmask8 met = _mm256_cmp_ps_mask(first, last, _CMP_LE_OQ);
    _mm256_storeu_ps(enter + at, _mm256_maskz_compress_ps(met, first));
    _mm256_storeu_ps(exit + at, _mm256_maskz_compress_ps(met, last));
    const __m256i to_visit = _mm256_permutexvar_epi32(turned, (__m256i)links);
    _mm256_storeu_si256((__m256i*)(link + at), _mm256_maskz_compress_epi32(met, to_visit));
    return __builtin_popcount(met);
#else
    const unsigned met = signs(from <= to);
    for (int i = 0; i < 8; ++i) {
      const int box = order[i];
      link[at] = links[box], enter[at] = from[box], exit[at] = to[box];
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

  /// Front to back: octants in the order of the ray, as a packet's.
  void walk() {
    int octant = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const int down = packet_.inverse[axis].only < 0;
      octant |= down << axis;
      nearer_[axis] = axis + 3 * down;
    }
    // The last that is met comes first, so that the first is on top.
    order_ = (EightInts{7, 6, 5, 4, 3, 2, 1, 0}) ^ octant;
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
    const EightInts order = order_;
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
      Eight enter[3], exit[3];
      for (int axis = 0; axis < 3; ++axis) {
        enter[axis] = load_eight(node.side[nearer[axis]]) * inverse[axis].only - scaled[axis].only;
        exit[axis] = load_eight(node.side[3 - nearer[axis] + 2 * axis]) * inverse[axis].only - scaled[axis].only;
      }
      const auto more = [](const Eight& a, const Eight& b) { return a > b ? a : b; };
      const auto less = [](const Eight& a, const Eight& b) { return a < b ? a : b; };
      top += stack.push(top, more(more(enter[0], enter[1]), more(enter[2], Eight{})),
                 less(less(exit[0], exit[1]), less(exit[2], eight_of(limit))), load_eight<EightInts>(node.link), order);
    }
    stack.top = 0;
    return 0;
  }

  EightInts order_;
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
    LoneWalker<any, counting>(model, ray, alone, counts).walk();
    arrive(start, alone);
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
