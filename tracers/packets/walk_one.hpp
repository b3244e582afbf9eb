// One ray at a time through the same boxes and cells: eight boxes are tested at once. What is found in a cell, and
// how sure of it floats are, is walk.hpp's.
#pragma once
#include "eight.hpp"
#include "membership_one.hpp"
#include "walk.hpp"

namespace {

template <bool any, bool counting>
class LoneWalker : Walker<any, counting> {
 public:
  using Walker<any, counting>::Walker;

  /// Front to back: octants in the order of the ray, as a packet's.
  void walk() {
    struct Task {
      std::int32_t link;
      float enter, exit;
    } stack[8 * 24];
    int top = 0, octant = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const int down = packet_.inverse[axis].only < 0;
      octant |= down << axis;
      nearer_[axis] = axis + 3 * down;
    }
    active_ = 1;
    limit_ = packet_.end;
    std::int32_t link = 0;
    for (;;) {
      Eight enter, exit;
      const WideNode& node = model_.wide[link];
      for (unsigned met = turned(meets_of(node, enter, exit), octant); met;) {
        const int last = 31 - __builtin_clz(met);
        met ^= 1u << last;
        const int slot = last ^ octant;
        stack[top++] = {node.link[slot], enter[slot], exit[slot]};
      }
      for (;;) {
        if (top == 0) return;
        const Task& task = stack[--top];
        // A boundary may have been found before the box.
        const F from = all(task.enter), to = min(all(task.exit), limit_);
        if (!at_most(from, to)) continue;
        link = task.link;
        if (link >= 0) break;
        pass(model_.cells[~link], 1, from, to);
        if (!active_) return;
      }
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
  using Base::turned;

  /// The ray's interval in each box, and which of them have one.
  unsigned meets_of(const WideNode& node, Eight& enter, Eight& exit) const {
    if (counting) counts_->boxes += 8;
    enter = Eight{}, exit = limit_.only - Eight{};
    for (int axis = 0; axis < 3; ++axis) {
      const Eight near = load_eight(node.side[nearer_[axis]]),
                  far = load_eight(node.side[3 - nearer_[axis] + 2 * axis]);
      const Eight first = near * packet_.inverse[axis].only - packet_.scaled[axis].only;
      const Eight last = far * packet_.inverse[axis].only - packet_.scaled[axis].only;
      enter = enter > first ? enter : first;
      exit = exit < last ? exit : last;
    }
    return signs(enter <= exit);
  }
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
