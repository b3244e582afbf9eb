// Packets of sixteen rays through the boxes and cells of a PacketModel, and what becomes of a ray in a cell, which
// is the same for rays one at a time (walk_one.hpp). Compiled for each instruction set; nothing here but the entry
// has external linkage.
//
// Floats find where a ray first passes into the solid, and say what they are sure of. They bound the
// solid from outside: atoms that add to it are grown by their rounding, those that it is cut by are
// shrunk, so that a ray that misses the bound surely misses. Where it enters the bound, the true
// boundary lies within the window W behind, if no other atom is crossed near there and the surface is not
// grazed. Else the ray is `unsure`, and is traced again by the scalar search.
// After membership.hpp or membership_one.hpp.
#pragma once

namespace {

/// Where rays start and how fast they are, in units; those that are not `valid` end before.
struct Start {
  D at, speed;
  Mask valid;
};

template <bool any, bool counting>
class Walker {
 public:
  Walker(const Model& model, const Packet& packet, Answer& answer, Counts* counts)
      : model_(model), packet_(packet), answer_(answer), counts_(counts) {}

  /// Rays whose directions have the signs of `octant`, front to back.
  void walk(Mask lanes, int octant) {
    struct Task {
      std::int32_t node;
      Mask lanes;
    } stack[8 * 24];
    int top = 0;
    active_ = lanes;
    limit_ = packet_.end;
    for (int axis = 0; axis < 3; ++axis) nearer_[axis] = axis + (octant >> axis & 1 ? 3 : 0);
    F enter, exit;
    stack[top++] = {0, meets(model_.nodes[0], lanes, enter, exit)};
    while (top > 0) {
      const Task task = stack[--top];
      const Mask met = task.lanes & active_;
      if (!met) continue;
      const Node& node = model_.nodes[task.node];
      if (node.octants == 0) {
        const Mask still = meets(node, met, enter, exit);
        if (still) pass(model_.cells[node.link], still, enter, exit);
        if (!active_) return;
        continue;
      }
      // The last of the children first, so that the first is on top. Each is pushed, and kept if it is met: no
      // branch hangs on the answer.
      for (unsigned order = turned(node.octants, octant); order;) {
        const int last = 31 - __builtin_clz(order);
        order ^= 1u << last;
        const unsigned bit = 1u << (last ^ octant);
        const std::int32_t child = node.link + count_of(node.octants & (bit - 1));
        const Mask lanes_met = meets(model_.nodes[child], met, enter, exit);
        stack[top] = {child, lanes_met};
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

 protected:
  /// Bit i of a mask of octants to bit i ^ octant.
  static unsigned turned(unsigned octants, int octant) {
    if (octant & 1) octants = (octants & 0x55) << 1 | (octants & 0xaa) >> 1;
    if (octant & 2) octants = (octants & 0x33) << 2 | (octants & 0xcc) >> 2;
    if (octant & 4) octants = (octants & 0x0f) << 4 | (octants & 0xf0) >> 4;
    return octants;
  }

  /// The rays' interval in a box, and which of `lanes` have one.
  Mask meets(const Node& node, Mask lanes, F& enter, F& exit) const {
    if (counting) counts_->boxes += static_cast<std::uint64_t>(count_of(lanes));
    enter = F{}, exit = limit_;
    for (int axis = 0; axis < 3; ++axis) {
      enter = max(enter, node.side[nearer_[axis]] * packet_.inverse[axis] - packet_.scaled[axis]);
      exit = min(exit, node.side[3 - nearer_[axis] + 2 * axis] * packet_.inverse[axis] - packet_.scaled[axis]);
    }
    return lanes & at_most(enter, exit);
  }

  void pass(const Cell& cell, Mask lanes, F enter, F exit) {
    if (counting) counts_->cells += static_cast<std::uint64_t>(count_of(lanes));
    const F window = all(cell.window);
    if (!cell.trusted) return doubt(cell, lanes, enter, exit);
    Passage in;
    in.lanes = lanes;
    D to[3], at = all<double>(0);
    for (int i = 0; i < 3; ++i) to[i] = all<double>(cell.centre[i]) - packet_.o[i], at = at + to[i] * packet_.d[i];
    for (int i = 0; i < 3; ++i) in.p[i] = narrow(at * packet_.d[i] - to[i]), in.d[i] = packet_.df[i];
    const F nearest = narrow(at);
    in.enter = enter - nearest;
    in.exit = exit - nearest;
    in.start = -nearest;
    in.near_start = lanes & packet_.in_world & less(enter, window);

    const Atom* atoms = model_.atoms + cell.first_atom;
    const int count = cell.atoms;
    Spans spans;
    Doubts doubts;
    Mask unsure = 0;
    for (int i = 0; i < count; ++i) {
      const Atom& atom = atoms[i];
      const Frame& frame = model_.frames[atom.leaf];
      F &lo = spans.lo[i], &hi = spans.hi[i];
      switch (atom.kind) {
        case AtomKind::Ball:
          ball_span(atom, frame.narrow_shape[0], in, doubts, lo, hi);
          break;
        case AtomKind::Ellipsoid:
          round_span<3>(atom, frame.narrow, in, doubts, lo, hi);
          break;
        case AtomKind::Tube:
          round_span<2>(atom, frame.narrow, in, doubts, lo, hi);
          break;
        case AtomKind::SlabX:
          slab_span(atom, frame.narrow[0], atom.centre[0], in, doubts, lo, hi);
          break;
        case AtomKind::SlabY:
          slab_span(atom, frame.narrow[1], atom.centre[1], in, doubts, lo, hi);
          break;
        case AtomKind::SlabZ:
          slab_span(atom, frame.narrow[2], atom.centre[2], in, doubts, lo, hi);
          break;
        case AtomKind::Wall:
          wall_span(atom, frame, in, doubts, lo, hi);
          break;
        case AtomKind::Torus:
          torus_span(atom, frame, in, cell.window, doubts, lo, hi);
          break;
      }
      if (in.near_start) {
        const Mask near = in.near_start & (less(magnitude(lo - in.start), 4.0f * window) |
                                           less(magnitude(hi - in.start), 4.0f * window));
        if (near) settle_start(atom, frame, packet_, model_.band, near, lo, hi, unsure);
      }
    }
    if (counting) counts_->atoms += static_cast<std::uint64_t>(count) * static_cast<std::uint64_t>(count_of(lanes));

    const Operator* operators = model_.operators + cell.first_operator;
    const auto inside = [&](F s, Mask of) {
      if (counting)
        counts_->operators += static_cast<std::uint64_t>(cell.operators) * static_cast<std::uint64_t>(count_of(of));
      return inside_at(cell, atoms, operators, spans, s);
    };
    F s = in.enter;
    unsure |= inside(s, lanes);
    Mask todo = lanes & ~unsure, found = 0;
    const F last = in.exit + window;
    F at_boundary = s;
    while (todo) {
      const F next = next_growth(cell, atoms, spans, s);
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
      for (int i = 0; i < count; ++i) {
        const Mask low = at_most(from, spans.lo[i]) & at_most(spans.lo[i], to_end);
        const Mask high = at_most(from, spans.hi[i]) & at_most(spans.hi[i], to_end);
        twice |= (once & (low | high)) | (low & high);
        once |= low | high;
        which = select(low | high, all<std::int32_t>(atoms[i].leaf), which);
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

  /// Leaves rays to the scalar search, which may start a little before they enter the cell: where they pass through
  /// what is truly the cell's, not its margin alone, all that is before has been searched.
  void doubt(const Cell& cell, Mask lanes, F enter, F exit) {
    answer_.unsure |= lanes;
    active_ &= ~lanes;
    const F from = enter - 4.0f * cell.window;
    for (int axis = 0; axis < 3; ++axis) {
      const auto centre = static_cast<float>(cell.centre[axis]);
      const float least = centre + (cell.lo[axis] + cell.window), most = centre + (cell.hi[axis] - cell.window);
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
      inside &= less(all(cell.lo[axis] + cell.window), x) & less(x, all(cell.hi[axis] - cell.window));
    }
    return inside;
  }

  const Model& model_;
  const Packet& packet_;
  Answer& answer_;
  Counts* counts_;
  Mask active_ = 0;
  int nearer_[3];  // which sides of a box are met first
  F limit_;        // of each ray's way: its end, or a boundary
  // Of the boundary; where a ray is in doubt, t is before any.
  D t_ = all<double>(0), t_error_ = all<double>(0);
  I leaf_ = all<std::int32_t>(0);
};

inline Start set_out(const Model& model, const Rays& rays, Packet& packet) {
  D column[8];
  transpose(rays.first, rays.count, column);
  const D dd = column[3] * column[3] + column[4] * column[4] + column[5] * column[5];
  const D speed = root(dd), per_speed = all<double>(1) / speed;
  D along = all<double>(0);
  D distance = all<double>(0);
  for (int axis = 0; axis < 3; ++axis) {
    distance = distance + column[axis] * column[axis];
    packet.d[axis] = column[3 + axis] * per_speed;
    packet.o[axis] = (column[axis] - all<double>(model.centre[axis])) * all<double>(model.per_unit);
    along = along + packet.o[axis] * packet.d[axis];
  }
  // From where it enters the ball around the world, or where it starts.
  const D units = speed * all<double>(model.per_unit);
  const D from = column[6] * units, enter = all<double>(-model.radius) - along;
  const D start = max(from, enter), end = column[7] * units - start;
  const double near = model.near / model.per_unit;
  for (int axis = 0; axis < 3; ++axis) {
    packet.o[axis] = packet.o[axis] + start * packet.d[axis];
    packet.of[axis] = narrow(packet.o[axis]);
    packet.df[axis] = narrow(packet.d[axis]);
    packet.inverse[axis] = 1.0f / away_from_zero(packet.df[axis]);
    packet.scaled[axis] = packet.of[axis] * packet.inverse[axis];
  }
  packet.end = narrow(end);
  packet.in_world = ~less(from, enter);
  packet.far = less(all<double>(near * near), distance);
  return {start, units, less(column[6], column[7]) & ((1u << rays.count) - 1)};
}

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

inline void walk(const Model& model, const Rays& rays, bool any, Answer& answer, Counts* counts) {
  const auto run = any      ? counts ? walk_packet<true, true> : walk_packet<true, false>
                   : counts ? walk_packet<false, true>
                            : walk_packet<false, false>;
  run(model, rays, answer, counts);
}

}  // namespace
