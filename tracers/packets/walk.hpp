// Packets of sixteen rays through the boxes and cells of a PacketModel. Where few of a packet are left they go on one
// at a time: a box's octants, or a cell's atoms, then are tested side by side for one ray (Benthin et al. 2012,
// "Combining single and packet-ray tracing"). Compiled for each instruction set; nothing here but the entry has
// external linkage.
//
// Floats find where a ray first passes into the solid, and say what they are sure of. They bound the
// solid from outside: atoms that add to it are grown by their rounding, those that it is cut by are
// shrunk, so that a ray that misses the bound surely misses. Where it enters the bound, the true
// boundary lies within the window W behind, if no other atom is crossed near there and the surface is not
// grazed. Else the ray is `unsure`, and is traced again by the scalar search.
#pragma once
#include "membership.hpp"
#include "spans.hpp"
#include "stack.hpp"
#include "start.hpp"

namespace {

template <bool any, bool counting>
class Walker {
 public:
  Walker(const Model& model, const Packet& packet, Answer& answer, Counts* counts)
      : model_(model), packet_(packet), answer_(answer), counts_(counts) {}

  /// Rays whose directions have the signs of `octant`, front to back.
  void walk(Mask lanes, int octant) {
    struct Task {
      std::int32_t node;
      int box;
      Mask lanes;
    } stack[8 * 24];
    int top = 0;
    active_ = lanes;
    limit_ = packet_.end;
    octant_ = octant;
    for (int axis = 0; axis < 3; ++axis) nearer_[axis] = axis + (octant >> axis & 1 ? 3 : 0);
    F enter, exit;
    stack[top++] = {0, 0, meets(model_.nodes[0], 0, lanes, enter, exit)};
    while (top > 0) {
      const Task task = stack[--top];
      Mask met = task.lanes & active_;
      if (!met) continue;
      const Node& parent = model_.nodes[task.node];
      const std::int32_t link = parent.link[task.box];
      if (link < 0) {
        const Mask still = meets(parent, task.box, met, enter, exit);
        if (still) pass(cell_at(link), still, enter, exit);
        if (!active_) return;
        continue;
      }
      if (count_of(met) <= model_.few) {
        for (; met; met &= met - 1) walk_alone(link, first_of(met));
        if (!active_) return;
        continue;
      }
      // The last of the octants first, so that the first is on top. Each is pushed, and kept if it is met: no branch
      // hangs on the answer.
      const Node& node = model_.nodes[link];
      for (unsigned order = turned(node.octants, octant); order;) {
        const int last = 31 - __builtin_clz(order);
        order ^= 1u << last;
        const int box = last ^ octant;
        const Mask lanes_met = meets(node, box, met, enter, exit);
        stack[top] = {link, box, lanes_met};
        top += lanes_met != 0;
      }
    }
  }

  /// The answer, for rays that set out as `start` says.
  void arrive(const Start& start) const {
    answer_.hit &= ~answer_.unsure;
    if (any && !answer_.unsure) return;
    const D t = (t_ + start.at) / start.speed, t_error = t_error_ / start.speed;
    std::memcpy(answer_.t, &t, sizeof t);
    std::memcpy(answer_.t_error, &t_error, sizeof t_error);
    std::memcpy(answer_.leaf, &leaf_, sizeof leaf_);
  }

 private:
  /// Bit i of a mask of octants to bit i ^ octant.
  static unsigned turned(unsigned octants, int octant) {
    if (octant & 1) octants = (octants & 0x55) << 1 | (octants & 0xaa) >> 1;
    if (octant & 2) octants = (octants & 0x33) << 2 | (octants & 0xcc) >> 2;
    if (octant & 4) octants = (octants & 0x0f) << 4 | (octants & 0xf0) >> 4;
    return octants;
  }

  /// The rays' interval in a box, and which of `lanes` have one.
  Mask meets(const Node& node, int box, Mask lanes, F& enter, F& exit) const {
    if (counting) counts_->boxes += static_cast<std::uint64_t>(count_of(lanes));
    enter = F{}, exit = limit_;
    for (int axis = 0; axis < 3; ++axis) {
      const int far = 3 - nearer_[axis] + 2 * axis;
      enter = max(enter, node.side[nearer_[axis]][box] * packet_.inverse[axis] - packet_.scaled[axis]);
      exit = min(exit, node.side[far][box] * packet_.inverse[axis] - packet_.scaled[axis]);
    }
    return lanes & at_most(enter, exit);
  }

  /// One ray of the packet through all that is below a node.
  void walk_alone(std::int32_t node, int lane) {
    Lone ray{lane, limit_[lane], {}, {}};
    for (int axis = 0; axis < 3; ++axis)
      ray.inverse[axis] = packet_.inverse[axis][lane], ray.scaled[axis] = packet_.scaled[axis][lane];
    Stack stack;
    stack.link[0] = node, stack.enter[0] = 0, stack.exit[0] = ray.limit;
    stack.top = 1;
    while (active_ >> lane & 1) {
      const std::int32_t link = next_cell(stack, ray);
      if (link >= 0) return;
      fetch(link);
      if (stack.top > 0) fetch(stack.link[stack.top - 1]);
      const float exit = stack.exit[stack.top];
      pass_alone(cell_at(link), lane, stack.enter[stack.top], exit < ray.limit ? exit : ray.limit);
      ray.limit = limit_[lane];
    }
  }

  /// A ray of the packet by itself.
  struct Lone {
    int lane;
    float limit;
    float inverse[3], scaled[3];
  };

  /// ~ of the next cell on the way, which stands just above the stack; or 0. A function of its own, so that what it
  /// needs stays in registers.
  [[gnu::noinline]] std::int32_t next_cell(Stack& stack, const Lone& ray) const {
    const float limit = ray.limit;
    const float inverse[3] = {ray.inverse[0], ray.inverse[1], ray.inverse[2]};
    const float scaled[3] = {ray.scaled[0], ray.scaled[1], ray.scaled[2]};
    const int nearer[3] = {nearer_[0], nearer_[1], nearer_[2]};
    const Node* const nodes = model_.nodes;
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
      const Node& node = nodes[link];
      Eight from[3], to[3];
      for (int axis = 0; axis < 3; ++axis) {
        const auto reached = [&](auto side) { return side * inverse[axis] - scaled[axis]; };
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

  /// Asks for what is behind a link before it is needed.
  void fetch(std::int32_t link) const {
    constexpr int kLines = 6;  // most cells have no more, a node has fewer
    const auto* lines = link < 0 ? model_.cells + ~link : reinterpret_cast<const Line*>(model_.nodes + link);
    for (int i = 0; i < kLines; ++i) __builtin_prefetch(lines + i);
  }
  const Cell& cell_at(std::int32_t link) const { return *reinterpret_cast<const Cell*>(model_.cells + ~link); }

  /// Calls `each(kind, first atom, atoms, floats)` for each kind of atom that a cell has.
  template <class Each>
  static void for_each_kind(const Cell& cell, const float* floats, Each each) {
    int first = 0;
    const auto one = [&](auto kind) {
      const int end = cell.end[kind()], atoms = end - first;
      if (atoms == 0) return;
      each(kind, first, atoms, floats);
      first = end;
      floats += kFloatsOf[kind()] * atoms;
    };
    [&]<int... kind>(std::integer_sequence<int, kind...>) {
      (one(std::integral_constant<int, kind>()), ...);
    }(std::make_integer_sequence<int, kAtomKinds>());
  }

  void pass(const Cell& cell, Mask lanes, F enter, F exit) {
    if (count_of(lanes) <= model_.few) {
      for (; lanes; lanes &= lanes - 1) {
        const int lane = first_of(lanes);
        pass_alone(cell, lane, enter[lane], exit[lane]);
      }
      return;
    }
    if (counting) counts_->cells += static_cast<std::uint64_t>(count_of(lanes));
    const F window = all(cell.window);
    if (cell.operators == 0) return doubt(cell, lanes, enter, exit);
    Passage in;
    in.lanes = lanes, in.window = cell.window;
    D to[3], at = all<double>(0);
    for (int i = 0; i < 3; ++i)
      to[i] = all(static_cast<double>(cell.centre[i])) - packet_.o[i], at = at + to[i] * packet_.d[i];
    for (int i = 0; i < 3; ++i) in.p[i] = narrow(at * packet_.d[i] - to[i]), in.d[i] = packet_.df[i];
    const F nearest = narrow(at);
    in.enter = enter - nearest;
    in.exit = exit - nearest;
    in.start = -nearest;
    const Mask near_start = lanes & packet_.in_world & less(enter, window);

    const Parts parts(cell);
    const int atoms = atoms_in(cell);
    Spans spans;
    Doubts doubts;
    Mask unsure = 0;
    for_each_kind(cell, parts.floats, [&](auto kind, int first, int of_kind, const float* floats) {
      for (int k = 0; k < of_kind; ++k) {
        F &lo = spans.lo[first + k], &hi = spans.hi[first + k];
        span<AtomKind{kind()}>(OneAtom{floats + k, of_kind}, in, doubts, lo, hi);
        if (near_start) {
          const Mask near = near_start & (less(magnitude(lo - in.start), 4.0f * window) |
                                          less(magnitude(hi - in.start), 4.0f * window));
          if (near) unsure |= settle_start(parts, first + k, AtomKind{kind()}, near, lo, hi);
        }
      }
    });
    if (counting) counts_->atoms += static_cast<std::uint64_t>(atoms) * static_cast<std::uint64_t>(count_of(lanes));

    const auto inside = [&](F s, Mask of) {
      if (counting)
        counts_->operators += static_cast<std::uint64_t>(cell.operators) * static_cast<std::uint64_t>(count_of(of));
      return inside_at(cell, parts, spans, s);
    };
    F s = in.enter;
    unsure |= inside(s, lanes);
    Mask todo = lanes & ~unsure, found = 0;
    const F last = in.exit + window;
    F at_boundary = s;
    while (todo) {
      const F next = next_growth(cell, spans, s);
      todo &= at_most(next, last);
      if (!todo) break;
      s = select(todo, next, s);
      const Mask now = inside(s, todo) & todo;
      found |= now;
      at_boundary = select(now, s, at_boundary);
      todo &= ~now;
    }
    unsure &= lanes;
    Mask settled = 0;
    if (found) {
      // Only one crossing may lie where the boundary may be.
      const F from = at_boundary - 2.0f * window, to_end = at_boundary + 3.0f * window;
      Mask once = 0, twice = 0;
      I which = all<std::int32_t>(0);
      for (int i = 0; i < atoms; ++i) {
        const Mask low = in_closed(from, spans.lo[i], to_end), high = in_closed(from, spans.hi[i], to_end);
        twice |= (once & (low | high)) | (low & high);
        once |= low | high;
        which = select(low | high, all<std::int32_t>(parts.leaf(i)), which);
      }
      unsure |= found & (twice | ~once | doubts.between(from, to_end));
      const F left = packet_.end - nearest - at_boundary;
      unsure |= found & less(left, 4.0f * window);
      const Mask sure = found & ~unsure;
      answer_.hit |= sure;
      limit_ = select(sure, at_boundary + nearest, limit_);
      settled = any ? sure : sure & well_inside(cell, in, at_boundary);
      t_ = select(sure, widen(at_boundary) + at, t_);
      t_error_ = select(sure, all(4 * static_cast<double>(cell.window)), t_error_);
      leaf_ = select(sure, which, leaf_);
    }
    active_ &= ~settled;
    if (unsure) doubt(cell, unsure, enter, exit);
  }

  /// The same for one ray, whose atoms stand side by side.
  void pass_alone(const Cell& cell, int lane, float enter, float exit) {
    const Mask ray = Mask{1} << lane;
    if (counting) ++counts_->cells;
    const float window = cell.window;
    if (cell.operators == 0) return doubt(cell, ray, all(enter), all(exit));
    const double o[3] = {packet_.o[0][lane], packet_.o[1][lane], packet_.o[2][lane]};
    const double d[3] = {packet_.d[0][lane], packet_.d[1][lane], packet_.d[2][lane]};
    double to[3], at = 0;
    for (int i = 0; i < 3; ++i) to[i] = cell.centre[i] - o[i], at += to[i] * d[i];
    const auto nearest = static_cast<float>(at);
    Passage in;
    in.window = window;
    for (int i = 0; i < 3; ++i)
      in.p[i] = all(static_cast<float>(at * d[i] - to[i])), in.d[i] = all(static_cast<float>(d[i]));
    in.enter = all(enter - nearest);
    in.exit = all(exit - nearest);
    in.start = all(-nearest);
    const bool near_start = (packet_.in_world & ray) && enter < window;

    const Parts parts(cell);
    LoneSpans spans(cell);
    Doubts doubts;
    std::uint64_t near = 0;
    for_each_kind(cell, parts.floats, [&](auto kind, int first, int of_kind, const float* floats) {
      for (int k = 0; k < of_kind; k += kLanes) {
        in.lanes = of_kind - k < kLanes ? (1u << (of_kind - k)) - 1 : 0xffff;
        F lo, hi;
        span<AtomKind{kind()}>(AtomEachLane{floats + k, of_kind}, in, doubts, lo, hi);
        if (near_start) {
          const Mask so = in.lanes & (less(magnitude(lo - in.start), all(4 * window)) |
                                      less(magnitude(hi - in.start), all(4 * window)));
          near |= std::uint64_t{so} << (first + k);
        }
        spans.put(first + k, lo, hi);
      }
    });
    bool unsure = near != 0 && (packet_.far & ray);
    for (; near; near &= near - 1) {
      const int i = __builtin_ctzll(near);
      unsure |= !settle_start(parts, i, kind_of(cell, i), o, d, spans.lo(i), spans.hi(i));
    }
    if (counting) counts_->atoms += static_cast<std::uint64_t>(atoms_in(cell));

    const auto inside = [&](float s) {
      if (counting) counts_->operators += cell.operators;
      return spans.inside_at(parts, s);
    };
    float s = enter - nearest;
    const float last = exit - nearest + window;
    unsure |= inside(s);
    bool found = false;
    while (!unsure && !found) {
      s = spans.next_growth(s);
      if (!(s <= last)) return;
      found = inside(s);
    }
    int which = -1;
    if (!unsure) {
      // Only one crossing may lie where the boundary may be.
      const float from = s - 2 * window, to_end = s + 3 * window;
      which = spans.crossed_once(from, to_end);
      unsure = which < 0 || doubts.between(all(from), all(to_end)) || packet_.end[lane] - nearest - s < 4 * window;
    }
    if (unsure) return doubt(cell, ray, all(enter), all(exit));
    answer_.hit |= ray;
    limit_ = select(ray, all(s + nearest), limit_);
    t_ = select(ray, all(static_cast<double>(s) + at), t_);
    t_error_ = select(ray, all(4 * static_cast<double>(window)), t_error_);
    leaf_ = select(ray, all(parts.leaf(which)), leaf_);
    if (any || well_inside(cell, in, all(s)) & 1) active_ &= ~ray;
  }

  /// What becomes of an atom's interval along rays that start near its surface; those that cannot be told of.
  Mask settle_start(const Parts& parts, int atom, AtomKind kind, Mask near, F& lo, F& hi) const {
    const Frame& frame = model_.frames[parts.leaf(atom)];
    const Side at = side_of_start(kind, parts.axis(atom), frame, packet_.o, packet_.d, model_.band);
    // A torus may be met again, but not in this cell if its one crossing here is the one behind.
    const Mask once = is_convex(kind) ? 0xffff : less(lo, all(-1e30f));
    const Mask left = near & at.left & once, inside = near & at.inside;
    lo = select(left, all(kNever), lo);
    hi = select(left, all(-kNever), hi);
    lo = select(inside, all(-kNever), lo);
    return near & (~(left | inside) | packet_.far);
  }
  /// The same for one ray; false if it cannot be told.
  bool settle_start(const Parts& parts, int atom, AtomKind kind, const double o[3], const double d[3], float& lo,
                    float& hi) const {
    const Frame& frame = model_.frames[parts.leaf(atom)];
    const Side at = side_of_start(kind, parts.axis(atom), frame, o, d, model_.band);
    const bool once = is_convex(kind) || lo < -1e30f;
    if (at.left && once)
      lo = kNever, hi = -kNever;
    else if (at.inside)
      lo = -kNever;
    else
      return false;
    return true;
  }

  /// Leaves rays to the scalar search, which may start a little before they enter the cell: where they pass through
  /// what is truly the cell's, not its margin alone, all that is before has been searched.
  void doubt(const Cell& cell, Mask lanes, F enter, F exit) {
    answer_.unsure |= lanes;
    active_ &= ~lanes;
    const F from = enter - 4.0f * cell.window;
    for (int axis = 0; axis < 3; ++axis) {
      const float least = cell.centre[axis] + (cell.lo[axis] + cell.window);
      const float most = cell.centre[axis] + (cell.lo[axis] + cell.side - cell.window);
      const bool down = nearer_[axis] > axis;
      enter = max(enter, (down ? most : least) * packet_.inverse[axis] - packet_.scaled[axis]);
      exit = min(exit, (down ? least : most) * packet_.inverse[axis] - packet_.scaled[axis]);
    }
    t_ = select(lanes, widen(select(less(enter, exit), from, all(-kNever))), t_);
  }

  /// Cells come in the order of the ray, but not their margins: where a ray runs along a wall, the margin of one
  /// cell may come before the cell itself. A boundary in there is the first as far as is known.
  static Mask well_inside(const Cell& cell, const Passage& in, F s) {
    Mask inside = 0xffff;
    for (int axis = 0; axis < 3; ++axis) {
      const F x = in.p[axis] + s * in.d[axis];
      inside &= less(all(cell.lo[axis] + cell.window), x) & less(x, all(cell.lo[axis] + cell.side - cell.window));
    }
    return inside;
  }

  const Model& model_;
  const Packet& packet_;
  Answer& answer_;
  Counts* counts_;
  Mask active_ = 0;
  int octant_ = 0;
  int nearer_[3];  // which sides of a box are met first
  F limit_;        // of each ray's way: its end, or a boundary
  // Of the boundary; where a ray is in doubt, t is before any.
  D t_ = all<double>(0), t_error_ = all<double>(0);
  I leaf_ = all<std::int32_t>(0);
};

/// Of the rays that have a boundary: what is unsure is none, and t in units of the rays' own.
template <bool any, bool counting>
void walk_packet(const Model& model, const Rays& rays, Answer& answer, Counts* counts) {
  Packet packet;
  const Start start = set_out(model, rays, packet);
  answer.hit = answer.unsure = 0;
  Walker<any, counting> walker(model, packet, answer, counts);
  Mask down[3];
  for (int axis = 0; axis < 3; ++axis) down[axis] = less(packet.inverse[axis], F{});
  for (Mask todo = start.valid; todo;) {
    const int i = first_of(todo);
    int octant = 0;
    Mask alike = todo;
    for (int axis = 0; axis < 3; ++axis) {
      const bool is_down = down[axis] >> i & 1;
      octant |= is_down << axis;
      alike &= is_down ? down[axis] : ~down[axis];
    }
    walker.walk(alike, octant);
    todo &= ~alike;
  }
  walker.arrive(start);
}

/// Lanes that stand for no atom hold whatever bits follow in memory. Read as floats these may be denormal, of which
/// each would cost more than all the rest: here they are 0.
class DenormalsAreZero {
 public:
  DenormalsAreZero() : before_(_mm_getcsr()) { _mm_setcsr(before_ | 0x8040); }
  ~DenormalsAreZero() { _mm_setcsr(before_); }
  DenormalsAreZero(const DenormalsAreZero&) = delete;
  DenormalsAreZero& operator=(const DenormalsAreZero&) = delete;

 private:
  unsigned before_;
};

inline void walk(const Model& model, const Rays& rays, bool any, Answer& answer, Counts* counts) {
  const DenormalsAreZero denormals_are_zero;
  const auto run = any      ? counts ? walk_packet<true, true> : walk_packet<true, false>
                   : counts ? walk_packet<false, true>
                            : walk_packet<false, false>;
  run(model, rays, answer, counts);
}

}  // namespace
