// Cells for packets, from those of an octree: shrunk, their trees made of unions of atoms.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstring>
#include <ranges>
#include <span>
#include <vector>

#include "../csg/sbound.hpp"
#include "build.hpp"
#include "frame.hpp"

namespace csg::packets {

inline constexpr double kFloat = kUnitRoundoff<float>;
static_assert(std::uint64_t{kMostOperators} << 1 <= 256);

/// What a float holds of x. Through memory that must be read: where GCC 12 vectorizes the two conversions, it drops
/// them.
inline double as_float(double x) {
  volatile float rounded = static_cast<float>(x);
  return rounded;
}

/// A box with its octants' node, or with ~ of its cell.
struct Boxed {
  float side[6];  ///< low on x, y, z; high on x, y, z
  std::int32_t link;
};

/// Units and the middle of the world.
struct Scale {
  double unit;
  Vec3 middle;
  double band;    ///< the widest of any ray, in units
  double margin;  ///< around a cell, in halves of its side
};

/// Makes the cells of a batch.
class CellMaker {
 public:
  CellMaker(const CsgTree& tree, const std::vector<Frame>& frames, const Scale& scale, bool tight)
      : tree_(tree), frames_(frames), scale_(scale), tight_(tight), classifier_(tree) {}

  struct Batch {
    std::vector<Boxed>
        boxes;  ///< one for each cell of the octree; one with its low side above its high has nothing to be found in it
    std::vector<Line> cells;
    CellTally made{};
  };

  void add(TreeView tree, const Box& cell, Batch& out) {
    out_ = &out;
    margin_ = scale_.margin * cell.half().x;
    const Box box = tight_ ? tighten(tree, cell) : cell;
    Boxed boxed{};
    boxed.side[0] = 1, boxed.side[3] = 0;
    if (!box.empty() && classifier_.localize(tree, box, kept_, margin_) == Class::Partial) {
      const Box entered = box.padded(margin_ / 2);
      for (int axis = 0; axis < 3; ++axis) {
        boxed.side[axis] = static_cast<float>((entered.lo[axis] - scale_.middle[axis]) / scale_.unit);
        boxed.side[3 + axis] = static_cast<float>((entered.hi[axis] - scale_.middle[axis]) / scale_.unit);
      }
      boxed.link = static_cast<std::int32_t>(out.cells.size());
      add_cell(kept_, box, cell);
    }
    out.boxes.push_back(boxed);
  }

 private:
  /// An atom of a leaf, and the axes of the leaf's frame that it is about.
  struct AtomOf {
    AtomKind kind;
    int first_axis, end_axis;
  };
  struct MadeAtom {
    AtomKind kind;
    std::uint32_t leaf_and_axis;
    std::uint16_t slot;  ///< of the operator that it is an operand of
    bool flip, negative;
    float floats[16];
  };
  struct MadeOperator {
    std::uint16_t slot;
    bool flip;
    std::uint64_t atoms;
  };

  /// The part of a cell where its tree is not constant: by the S-bound of its root, then slice by slice.
  Box tighten(TreeView tree, Box box) {
    sbounds(tree_, tree, box, SBoundPasses::One, bounds_);
    box = intersection(box, bounds_[0]);
    if (box.empty()) return box;
    constexpr double kLeast = 1.0 / 16;
    for (int axis = 0; axis < 3; ++axis) {
      for (const bool low : {true, false}) {
        const double whole = box.hi[axis] - box.lo[axis];
        for (double step = whole / 2; step >= kLeast * whole && step < box.hi[axis] - box.lo[axis]; step /= 2) {
          Box slice = box;
          (low ? slice.hi : slice.lo)[axis] = low ? box.lo[axis] + step : box.hi[axis] - step;
          if (classifier_.localize(tree, slice, localized_, margin_) != Class::Partial)
            (low ? box.lo : box.hi)[axis] = (low ? slice.hi : slice.lo)[axis];
        }
      }
    }
    return box;
  }

  void add_cell(const std::vector<TreeNode>& tree, const Box& box, const Box& whole) {
    Cell cell{};
    for (int axis = 0; axis < 3; ++axis) {
      const auto in_units = [&](double x) { return (x - scale_.middle[axis]) / scale_.unit; };
      centre_[axis] = as_float(in_units(box.center()[axis]));
      cell.centre[axis] = static_cast<float>(centre_[axis]);
      cell.lo[axis] = static_cast<float>(in_units(whole.lo[axis]) - centre_[axis]);
    }
    cell.side = static_cast<float>(2 * whole.half().x / scale_.unit);
    reach_ = length(box.padded(margin_).half()) / scale_.unit +
             length(centre_ - (1 / scale_.unit) * (box.center() - scale_.middle));
    atoms_.clear();
    // Wide against what rounding costs, narrow against the margin, and against what lies close together.
    const double margin = margin_ / scale_.unit;
    window_ = cell.window = static_cast<float>(std::clamp(64 * scale_.band, margin / 64, margin / 8));
    trusted_ = true;

    // Operators in pre-order, to be turned round; a complement is carried to the leaves to tell which
    // atoms the solid is cut by.
    struct Made {
      std::uint16_t slot;  // of the operator that its operands feed
      bool inverts;        // whether its value is the complement of that operator's
      bool negative;
    };
    std::vector<Made> made(tree.size());
    std::vector<MadeOperator> operators;
    const auto add_operator = [&](std::uint16_t slot, bool flip) {
      operators.push_back({slot, flip, 0});
      return static_cast<std::uint16_t>(operators.size() - 1);
    };
    for (std::size_t i = 0; i < tree.size() && trusted_; ++i) {
      const TreeNode& node = tree[i];
      const bool root = i == 0;
      const Made above = root ? Made{0, false, false} : made[node.parent()];
      const bool negative = above.negative != node.complemented();
      // Whether the operand is complemented where it feeds the operator above.
      const bool flip = node.complemented() != above.inverts;
      if (!node.is_leaf()) {
        const bool inverts = !node.is_union();
        if (!root && flip == inverts)  // an operand that is a union where a union is made
          made[i] = {above.slot, inverts, negative};
        else
          made[i] = {add_operator(above.slot, flip != inverts), inverts, negative};
        continue;
      }
      std::uint16_t slot = above.slot;
      bool atom_flip = flip;
      if (root) slot = add_operator(0, false);
      const Leaf& leaf = tree_.leaves()[static_cast<std::size_t>(node.leaf())];
      AtomOf parts[3];
      const int count = atoms_of(leaf, frames_[static_cast<std::size_t>(node.leaf())], box, parts);
      if (count > 1) {  // an intersection of atoms, where unions are made
        if (!flip) slot = add_operator(slot, true);
        atom_flip = true;
      }
      for (int k = 0; k < count; ++k) add_atom(leaf, node.leaf(), parts[k], slot, atom_flip, negative);
      if (count == 0) trusted_ = false;
    }
    ++out_->made.cells;
    if (atoms_.size() > kMostAtoms || operators.size() > kMostOperators) trusted_ = false;
    if (!trusted_) {
      ++out_->made.untrusted;
      return write(cell, {});
    }
    out_->made.atoms += atoms_.size();
    std::ranges::stable_sort(atoms_, {}, &MadeAtom::kind);
    for (std::size_t i = 0; i < atoms_.size(); ++i) {
      operators[atoms_[i].slot].atoms |= std::uint64_t{1} << i;
      cell.flipped |= std::uint64_t{atoms_[i].flip} << i;
      cell.negative |= std::uint64_t{atoms_[i].negative} << i;
    }
    cell.operators = static_cast<std::uint8_t>(operators.size());
    write(cell, operators);
  }

  /// What stands behind a cell: its operators, last first, and atoms_, of which those of a kind have their floats side
  /// by side. The cell is told where each kind ends.
  void pack(Cell& cell, std::span<const MadeOperator> operators) {
    const auto put = [&](const auto& number) {
      const auto* bytes = reinterpret_cast<const std::uint8_t*>(&number);
      behind_.insert(behind_.end(), bytes, bytes + sizeof number);
    };
    const auto feed = [&](const auto& operand) {
      put(static_cast<std::uint8_t>((operators.size() - 1 - operand.slot) << 1 | operand.flip));
    };
    for (const MadeOperator& one : operators | std::views::reverse) put(one.atoms);
    for (const MadeAtom& atom : atoms_) put(atom.leaf_and_axis);
    for (const MadeAtom& atom : atoms_) feed(atom);
    for (const MadeOperator& one : operators | std::views::reverse) feed(one);
    behind_.resize((behind_.size() + 3) / 4 * 4);
    for (std::size_t kind = 0, first = 0, end = 0; kind < kAtomKinds; ++kind, first = end) {
      while (end < atoms_.size() && static_cast<std::size_t>(atoms_[end].kind) == kind) ++end;
      for (int k = 0; k < kFloatsOf[kind]; ++k)
        for (std::size_t i = first; i < end; ++i) put(atoms_[i].floats[k]);
      cell.end[kind] = static_cast<std::uint8_t>(end);
    }
  }

  /// A cell and what stands behind it, from a new line on.
  void write(Cell& cell, std::span<const MadeOperator> operators) {
    behind_.clear();
    if (cell.operators > 0) pack(cell, operators);
    const std::size_t first = out_->cells.size();
    out_->cells.resize(first + (sizeof cell + behind_.size() + sizeof(Line) - 1) / sizeof(Line));
    std::uint8_t* to = out_->cells[first].bytes;
    std::memcpy(to, &cell, sizeof cell);
    std::ranges::copy(behind_, to + sizeof cell);
  }

  /// What it costs in the cell to take a frame for a similarity.
  double error_if_round(const Frame& frame) const {
    Vec3 local;
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) local[i] += frame.row[i][j] * (centre_[j] - frame.offset[j]);
    return 6 * skewness(frame) * (length(local) + norm(frame.row[0]) * reach_);
  }
  /// Whether that is little against the window, for else too many rays graze.
  bool is_round(const Frame& frame) const { return error_if_round(frame) <= norm(frame.row[0]) * window_ / 16; }

  /// The atoms of a leaf that cut the box; those that hold all of it are dropped.
  int atoms_of(const Leaf& leaf, const Frame& frame, const Box& box, AtomOf parts[3]) const {
    switch (leaf.kind) {
      case Kind::Sphere:
        parts[0] = {is_round(frame) ? AtomKind::Ball : AtomKind::Ellipsoid, 0, 3};
        return 1;
      case Kind::Torus:
        parts[0] = {is_round(frame) ? AtomKind::Torus : AtomKind::SkewTorus, 0, 3};
        return 1;
      case Kind::Block:
      case Kind::Cylinder:
      case Kind::Cone:
        break;
    }
    const Box padded = box.padded(leaf.pad + margin_);
    const double* size = leaf.size;
    double most[3] = {0, 0, 0};
    bool enclosed = true;  // by the side, if it is round: then by its corners
    for (int corner = 0; corner < 8; ++corner) {
      const Vec3 p = to_local(leaf, {corner & 1 ? padded.hi.x : padded.lo.x, corner & 2 ? padded.hi.y : padded.lo.y,
                                     corner & 4 ? padded.hi.z : padded.lo.z});
      for (int axis = 0; axis < 3; ++axis) most[axis] = std::max(most[axis], std::fabs(p[axis]));
      const double radius =
          leaf.kind == Kind::Cone ? (size[0] + size[1]) / 2 + (size[1] - size[0]) / (2 * size[2]) * p.z : size[0];
      enclosed = enclosed && radius > 0 && p.x * p.x + p.y * p.y < radius * radius;
    }
    int count = 0;
    if (leaf.kind == Kind::Block) {
      for (int axis = 0; axis < 3; ++axis)
        if (!(most[axis] < size[axis])) parts[count++] = {AtomKind::Slab, axis, axis + 1};
      return count;
    }
    if (!enclosed)
      parts[count++] = leaf.kind == Kind::Cone ? AtomOf{AtomKind::Wall, 0, 3} : AtomOf{AtomKind::Tube, 0, 2};
    if (!(most[2] < size[leaf.kind == Kind::Cone ? 2 : 1])) parts[count++] = {AtomKind::Slab, 2, 3};
    return count;
  }

  void add_atom(const Leaf& leaf, std::int32_t number, const AtomOf& part, std::uint16_t slot, bool flip,
                bool negative) {
    const auto [kind, first, end] = part;
    const Frame& frame = frames_[static_cast<std::size_t>(number)];
    const bool round = kind == AtomKind::Ball || kind == AtomKind::Torus;  // of which the frame need not be turned
    double row[3][3] = {}, in_frame[3], error = 0, far = 0;
    for (int i = 0; i < 3; ++i) {
      double c = 0;
      for (int j = 0; j < 3; ++j) {
        row[i][j] = !round ? frame.row[i][j] : i == j ? norm(frame.row[0]) : 0;
        c += row[i][j] * (centre_[j] - frame.offset[j]);
      }
      if (kind == AtomKind::Wall && i == 2) c -= wall_origin(frame);
      in_frame[i] = c;
      if (i < first || i >= end) continue;
      // A wall feels an error of z by its slope only. A round torus feels that of its axis besides.
      const double weight = kind == AtomKind::Wall && i == 2 ? std::fabs(frame.shape[1]) : 1;
      const double extent = norm(row[i]) * reach_ + std::fabs(c);
      const double roundings = kind == AtomKind::Torus ? 16 : 8;
      error = std::hypot(error, weight * (roundings * kFloat * extent + norm(row[i]) * scale_.band));
      far = std::hypot(far, extent);
    }
    error += 0x1p-48 * leaf.condition;  // kernels, and the search in double
    if (round) error += error_if_round(frame);

    atoms_.push_back({kind,
                      static_cast<std::uint32_t>(number) | static_cast<std::uint32_t>(first) << kLeafBits,
                      slot,
                      flip,
                      negative,
                      {}});
    float* floats = atoms_.back().floats;
    const auto add = [&](double x) { *floats++ = static_cast<float>(x); };
    const auto add_error = [&](double x) { add(negative ? -x : x); };
    if (kind == AtomKind::Ball) {
      for (const double c : in_frame) add(c / row[0][0]);
      add(1 / row[0][0]);
    } else {
      if (!round)
        for (int i = first; i < end; ++i)
          for (const double x : row[i]) add(x);
      for (int i = first; i < end; ++i) add(in_frame[i]);
    }
    if (leaf.kind == Kind::Torus) {
      // The line may be off by `error`; that costs the slope at the surface, 8 r. The rest is rounding of the
      // quartic's coefficients, of which the first is small where the torus is near.
      const double minor = leaf.size[1] / leaf.size[0], along = norm(row[0]) * reach_;
      const double near = 1.5 * along + minor;
      if (round) {
        add(row[0][0]);
        for (const double x : frame.row[2]) add(x / norm(frame.row[2]));
      }
      add_error(12 * minor * error + 4 * kFloat * (16 * near * near + 6 * far * (far * far + 3) * along));
      add(minor);
      // A tube hardly thicker than the window has no slope to speak of.
      if (minor < 16 * window_ * norm(row[0])) trusted_ = false;
    } else {
      error = (kind == AtomKind::Wall ? 4 : 1) * error + (round ? 8 : 4) * kFloat;
      add_error(error);
      if (kind == AtomKind::Wall) add(frame.shape[0] + frame.shape[1] * wall_origin(frame)), add(frame.shape[1]);
    }
    if (!(error < 0x1p-8)) trusted_ = false;
  }

  const CsgTree& tree_;
  const std::vector<Frame>& frames_;
  const Scale& scale_;
  bool tight_;
  CellClassifier classifier_;
  Batch* out_ = nullptr;
  double margin_ = 0;
  std::vector<Box> bounds_;
  std::vector<TreeNode> kept_, localized_;
  // Of the cell:
  Vec3 centre_;
  double reach_ = 0, window_ = 0;  // from the centre to what is farthest; how far behind a crossing
  bool trusted_ = true;
  std::vector<MadeAtom> atoms_;
  std::vector<std::uint8_t> behind_;
};

}  // namespace csg::packets
