#include "build.hpp"

#include <optional>

#include "../csg/sbound.hpp"
#include "../structures/parallel.hpp"

namespace csg::packets {
namespace {

constexpr double kFloat = kUnitRoundoff<float>;

double norm(const double row[3]) { return std::hypot(row[0], row[1], row[2]); }

bool is_similarity(const Mat3& m) {
  const double scale = dot(m.col[0], m.col[0]);
  const auto small = [&](double x) { return std::fabs(x) <= 8 * kUnitRoundoff<double> * scale; };
  return small(dot(m.col[1], m.col[1]) - scale) && small(dot(m.col[2], m.col[2]) - scale) &&
         small(dot(m.col[0], m.col[1])) && small(dot(m.col[0], m.col[2])) && small(dot(m.col[1], m.col[2]));
}

AtomKind slab_of(int axis) { return static_cast<AtomKind>(static_cast<int>(AtomKind::SlabX) + axis); }

/// The height from which a wall is reckoned: its apex, where its radius is rounded as a small number, if that is near.
double wall_origin(const Frame& frame) {
  const double radius = frame.shape[0], slope = frame.shape[1];
  return 4 * std::fabs(slope) > radius ? -radius / slope : 0;
}

Frame frame_of(const Leaf& leaf, const Vec3& middle, double unit) {
  double per_size[3] = {1, 1, 1};
  Frame frame{};
  const double* size = leaf.size;
  switch (leaf.kind) {
    case Kind::Sphere:
      for (double& s : per_size) s = 1 / size[0];
      break;
    case Kind::Block:
      for (int i = 0; i < 3; ++i) per_size[i] = 1 / size[i];
      break;
    case Kind::Cylinder:
      per_size[0] = per_size[1] = 1 / size[0], per_size[2] = 1 / size[1];
      break;
    case Kind::Cone: {
      const double widest = std::max(size[0], size[1]);
      per_size[0] = per_size[1] = 1 / widest, per_size[2] = 1 / size[2];
      frame.shape[0] = (size[0] + size[1]) / 2 / widest;
      frame.shape[1] = (size[1] - size[0]) / 2 / widest;
      break;
    }
    case Kind::Torus:
      for (double& s : per_size) s = 1 / size[0];
      frame.shape[0] = size[1] / size[0];
      break;
  }
  const Vec3 offset = (1 / unit) * (leaf.world_from_local.offset - middle);
  for (int i = 0; i < 3; ++i) {
    frame.offset[i] = offset[i];
    for (int j = 0; j < 3; ++j) {
      frame.row[i][j] = per_size[i] * unit * leaf.local_from_world.col[j][i];
      frame.narrow[i][j] = static_cast<float>(frame.row[i][j]);
    }
  }
  if (leaf.kind == Kind::Sphere && is_similarity(leaf.local_from_world)) {
    // A ball needs no turning.
    const double per_radius = norm(frame.row[0]);
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) frame.row[i][j] = i == j ? per_radius : 0;
    frame.shape[0] = per_radius;
  }
  for (int i = 0; i < 2; ++i) frame.narrow_shape[i] = static_cast<float>(frame.shape[i]);
  if (leaf.kind == Kind::Cone)
    frame.narrow_shape[0] = static_cast<float>(frame.shape[0] + frame.shape[1] * wall_origin(frame));
  return frame;
}

/// Units and the middle of the world.
struct Scale {
  double unit;
  Vec3 middle;
  double band;    ///< the widest of any ray, in units
  double margin;  ///< around a cell, in halves of its side
};

}  // namespace

/// Makes the cells of a batch.
class Structure::CellMaker {
 public:
  CellMaker(const CsgTree& tree, const std::vector<Frame>& frames, const Scale& scale, bool tight)
      : tree_(tree), frames_(frames), scale_(scale), tight_(tight), classifier_(tree) {}

  struct Batch {
    std::vector<Node>
        nodes;  ///< one for each cell of the octree; one with its low side above its high has nothing to be found in it
    std::vector<Cell> cells;
    std::vector<Atom> atoms;
    std::vector<Operator> operators;
  };

  void add(TreeView tree, const Box& cell, Batch& out) {
    out_ = &out;
    margin_ = scale_.margin * cell.half().x;
    const Box box = tight_ ? tighten(tree, cell) : cell;
    Node node{};
    node.side[0] = 1, node.side[3] = 0;
    if (!box.empty() && classifier_.localize(tree, box, kept_, margin_) == Class::Partial) {
      const Box entered = box.padded(margin_ / 2);
      for (int axis = 0; axis < 3; ++axis) {
        node.side[axis] = static_cast<float>((entered.lo[axis] - scale_.middle[axis]) / scale_.unit);
        node.side[3 + axis] = static_cast<float>((entered.hi[axis] - scale_.middle[axis]) / scale_.unit);
      }
      out.cells.push_back(cell_of(kept_, box, cell));
    }
    out.nodes.push_back(node);
  }

 private:
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

  Cell cell_of(const std::vector<TreeNode>& tree, const Box& box, const Box& whole) {
    Cell cell{};
    const Vec3 centre = (1 / scale_.unit) * (box.center() - scale_.middle);
    for (int axis = 0; axis < 3; ++axis) {
      cell.centre[axis] = centre[axis];
      cell.lo[axis] = static_cast<float>((whole.lo[axis] - box.center()[axis]) / scale_.unit);
      cell.hi[axis] = static_cast<float>((whole.hi[axis] - box.center()[axis]) / scale_.unit);
    }
    const double reach = length(box.padded(margin_).half()) / scale_.unit;
    cell.first_atom = static_cast<std::uint32_t>(out_->atoms.size());
    cell.first_operator = static_cast<std::uint32_t>(out_->operators.size());
    // Wide against what rounding costs, narrow against the margin, and against what lies close together.
    const double margin = margin_ / scale_.unit;
    cell.window = static_cast<float>(std::clamp(64 * scale_.band, margin / 32, margin / 8));
    cell.trusted = true;

    // Operators in pre-order, to be turned round; a complement is carried to the leaves to tell which
    // atoms the solid is cut by.
    struct Made {
      std::uint16_t slot;  // of the operator that its operands feed
      bool inverts;        // whether its value is the complement of that operator's
      bool negative;
    };
    std::vector<Made> made(tree.size());
    std::vector<Operator> operators;
    const auto add_operator = [&](std::uint16_t parent, bool flip) {
      operators.push_back({parent, static_cast<std::uint16_t>(flip ? 0xffff : 0), 0});
      return static_cast<std::uint16_t>(operators.size() - 1);
    };
    for (std::size_t i = 0; i < tree.size() && cell.trusted; ++i) {
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
      AtomKind kinds[3];
      const int count = atoms_of(leaf, box, kinds);
      if (count > 1) {  // an intersection of atoms, where unions are made
        if (!flip) slot = add_operator(slot, true);
        atom_flip = true;
      }
      for (int k = 0; k < count; ++k)
        add_atom(cell, leaf, node.leaf(), kinds[k], slot, atom_flip, negative, centre, reach);
      if (count == 0) cell.trusted = false;
    }
    const auto last = static_cast<std::uint16_t>(operators.size() - 1);
    cell.atoms = static_cast<std::uint16_t>(out_->atoms.size() - cell.first_atom);
    cell.operators = static_cast<std::uint16_t>(operators.size());
    if (cell.atoms > kMostAtoms || cell.operators > kMostOperators) cell.trusted = false;
    if (!cell.trusted) {
      out_->atoms.resize(cell.first_atom);
      return cell;
    }
    for (std::size_t i = 0; i < cell.atoms; ++i) {
      Atom& atom = out_->atoms[cell.first_atom + i];
      operators[atom.parent].atoms |= std::uint64_t{1} << i;
      cell.flipped |= std::uint64_t{atom.flip != 0} << i;
      cell.negative |= std::uint64_t{atom.negative} << i;
      atom.parent = static_cast<std::uint16_t>(last - atom.parent);
    }
    for (std::size_t i = operators.size(); i-- > 0;)
      out_->operators.push_back(
          {static_cast<std::uint16_t>(last - operators[i].parent), operators[i].flip, operators[i].atoms});
    return cell;
  }

  /// The atoms of a leaf that cut the box; those that hold all of it are dropped.
  int atoms_of(const Leaf& leaf, const Box& box, AtomKind kinds[3]) const {
    switch (leaf.kind) {
      case Kind::Sphere:
        kinds[0] = is_similarity(leaf.local_from_world) ? AtomKind::Ball : AtomKind::Ellipsoid;
        return 1;
      case Kind::Torus:
        kinds[0] = AtomKind::Torus;
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
        if (!(most[axis] < size[axis])) kinds[count++] = slab_of(axis);
      return count;
    }
    if (!enclosed) kinds[count++] = leaf.kind == Kind::Cone ? AtomKind::Wall : AtomKind::Tube;
    if (!(most[2] < size[leaf.kind == Kind::Cone ? 2 : 1])) kinds[count++] = AtomKind::SlabZ;
    return count;
  }

  void add_atom(Cell& cell, const Leaf& leaf, std::int32_t number, AtomKind kind, std::uint16_t slot, bool flip,
                bool negative, const Vec3& centre, double reach) {
    const Frame& frame = frames_[static_cast<std::size_t>(number)];
    Atom atom{};
    atom.kind = kind;
    atom.leaf = number;
    atom.parent = slot;
    atom.flip = flip ? 0xffff : 0;
    atom.negative = negative;
    const auto [first, end] = kAxes[static_cast<int>(kind)];
    double error = 0, far = 0;
    for (int i = 0; i < 3; ++i) {
      double c = 0;
      for (int j = 0; j < 3; ++j) c += frame.row[i][j] * (centre[j] - frame.offset[j]);
      if (kind == AtomKind::Wall && i == 2) c -= wall_origin(frame);
      atom.centre[i] = static_cast<float>(c);
      if (i < first || i >= end) continue;
      // A wall feels an error of z by its slope only.
      const double weight = kind == AtomKind::Wall && i == 2 ? std::fabs(frame.shape[1]) : 1;
      const double extent = norm(frame.row[i]) * reach + std::fabs(c);
      error = std::hypot(error, weight * (8 * kFloat * extent + norm(frame.row[i]) * scale_.band));
      far = std::hypot(far, extent);
    }
    error += 0x1p-48 * leaf.condition;  // kernels, and the search in double
    const double window = static_cast<double>(cell.window);
    if (kind == AtomKind::Torus) {
      // The line may be off by `error`; that costs the slope at the surface, 8 r. The rest is rounding of the
      // quartic's coefficients, of which the first is small where the torus is near.
      const double minor = leaf.size[1] / leaf.size[0], along = norm(frame.row[0]) * reach;
      const double near = 1.5 * along + minor;
      atom.size =
          static_cast<float>(12 * minor * error + 4 * kFloat * (16 * near * near + 6 * far * (far * far + 3) * along));
      // A tube hardly thicker than the window has no slope to speak of.
      if (minor < 16 * window * norm(frame.row[0])) cell.trusted = false;
    } else {
      error = (kind == AtomKind::Wall ? 4 : 1) * error + 4 * kFloat;
      atom.size = static_cast<float>(negative ? 1 - error : 1 + error);
      atom.graze = static_cast<float>(2 * error / window);
    }
    if (!(error < 0x1p-8)) cell.trusted = false;
    out_->atoms.push_back(atom);
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
};

namespace {

/// The boxes above the cells. Children stand together, after those of their older siblings; a box with one child is
/// that child.
class NodeMaker {
 public:
  NodeMaker(const Octree& octree, std::span<const Node> cells, std::vector<Node>& nodes)
      : octree_(octree), cells_(cells), nodes_(nodes) {
    nodes_.push_back({});  // the place of the root
    if (const std::optional<Node> root = make(octree.root()))
      nodes_[0] = *root;
    else
      nodes_.clear();
  }

 private:
  std::optional<Node> make(Octree::Link link) {
    if (octree_.is_cell(link)) {
      if (!octree_.cell(link).is_partial()) return std::nullopt;
      const Node& cell = cells_[octree_.cell(link).tree()];
      if (!(cell.side[0] <= cell.side[3])) return std::nullopt;
      return cell;
    }
    Node children[8], node{};
    int count = 0;
    unsigned octants = 0;
    for (int i = 0; i < 8; ++i) {
      if (const std::optional<Node> child = make(octree_.child(link, i))) {
        octants |= 1u << i;
        children[count++] = *child;
      }
    }
    if (count == 0) return std::nullopt;
    node = children[0];
    if (count == 1) return node;
    for (const Node& child : std::span(children, static_cast<std::size_t>(count))) {
      for (int axis = 0; axis < 3; ++axis) {
        node.side[axis] = std::min(node.side[axis], child.side[axis]);
        node.side[3 + axis] = std::max(node.side[3 + axis], child.side[3 + axis]);
      }
    }
    node.octants = octants;
    node.link = static_cast<std::int32_t>(nodes_.size());
    nodes_.insert(nodes_.end(), children, children + count);
    return node;
  }

  const Octree& octree_;
  std::span<const Node> cells_;
  std::vector<Node>& nodes_;
};

/// The boxes of each divided node's octants side by side; nodes stand in the order in which they are met.
class Widener {
 public:
  Widener(std::span<const Node> nodes, std::vector<WideNode>& wide) : nodes_(nodes), wide_(wide) {
    const Node& root = nodes_[0];
    if (root.octants != 0)
      widen(root);
    else
      put(root, 0, wide_[add()]);
  }

 private:
  std::size_t add() {
    WideNode none{};
    for (int axis = 0; axis < 3; ++axis) {
      std::ranges::fill(none.side[axis], std::numeric_limits<float>::infinity());
      std::ranges::fill(none.side[3 + axis], -std::numeric_limits<float>::infinity());
    }
    wide_.push_back(none);
    return wide_.size() - 1;
  }

  static void put(const Node& node, int slot, WideNode& in) {
    for (int side = 0; side < 6; ++side) in.side[side][slot] = node.side[side];
    in.link[slot] = ~node.link;
  }

  std::int32_t widen(const Node& node) {
    const std::size_t at = add();
    auto child = static_cast<std::size_t>(node.link);
    for (int octant = 0; octant < 8; ++octant) {
      if (!(node.octants >> octant & 1)) continue;
      const Node& in = nodes_[child++];
      put(in, octant, wide_[at]);
      if (in.octants != 0) {
        const std::int32_t link = widen(in);
        wide_[at].link[octant] = link;
      }
    }
    return static_cast<std::int32_t>(at);
  }

  std::span<const Node> nodes_;
  std::vector<WideNode>& wide_;
};

}  // namespace

Structure::Structure(const CsgTree& tree, const Octree& octree, double margin, bool tight, Together together,
                     std::size_t threads) {
  if (tree.world().empty()) return;
  build(tree, octree, margin, tight, threads);
  if (together == Together::One && !nodes_.empty()) {
    Widener(nodes_, wide_);
    nodes_ = {};
    wide_.shrink_to_fit();
  }
  cells_.shrink_to_fit(), atoms_.shrink_to_fit(), operators_.shrink_to_fit();
  model_.nodes = nodes_.data(), model_.wide = wide_.data(), model_.cells = cells_.data(), model_.atoms = atoms_.data();
  model_.operators = operators_.data(), model_.frames = frames_.data();
}

void Structure::build(const CsgTree& tree, const Octree& octree, double margin, bool tight, std::size_t threads) {
  // The widest band of any ray, and at least what double loses.
  Scale scale{std::ldexp(1.0, std::ilogb(tree.size())), octree.world().center(), 0, margin};
  const auto band = [&](double distance) {
    const Vec3 origin{distance, 0, 0};
    return std::max(tree.tolerances().band(origin, 1), Tolerances({}, tree.size()).band(origin, 1)) / scale.unit;
  };
  scale.band = band(tree.tolerances().farthest_origin());
  for (int axis = 0; axis < 3; ++axis) model_.centre[axis] = scale.middle[axis];
  model_.per_unit = 1 / scale.unit;
  model_.radius = length(octree.world().half()) / scale.unit * (1 + margin);
  model_.near = 2 * tree.size() / scale.unit;
  model_.band = band(2 * tree.size());
  for (const Leaf& leaf : tree.leaves()) frames_.push_back(frame_of(leaf, scale.middle, scale.unit));

  std::vector<Box> boxes(octree.trees().count());
  octree.for_each_partial([&](csg::Cell cell, const Box& box) { boxes[cell.tree()] = box; });
  constexpr std::size_t kBatch = 64;
  std::vector<CellMaker::Batch> batches((boxes.size() + kBatch - 1) / kBatch);
  std::vector<CellMaker> makers(threads, CellMaker(tree, frames_, scale, tight));
  in_parallel(threads, batches.size(), [&](std::size_t i, std::size_t thread) {
    for (std::size_t k = i * kBatch; k < std::min((i + 1) * kBatch, boxes.size()); ++k)
      makers[thread].add(octree.trees().tree(k), boxes[k], batches[i]);
  });

  std::vector<Node> leaves;
  for (const CellMaker::Batch& batch : batches) {
    std::size_t made = 0;
    for (Node node : batch.nodes) {
      node.link = static_cast<std::int32_t>(cells_.size());
      leaves.push_back(node);
      if (!(node.side[0] <= node.side[3])) continue;
      Cell cell = batch.cells[made++];
      cell.first_atom += static_cast<std::uint32_t>(atoms_.size());
      cell.first_operator += static_cast<std::uint32_t>(operators_.size());
      cells_.push_back(cell);
    }
    atoms_.insert(atoms_.end(), batch.atoms.begin(), batch.atoms.end());
    operators_.insert(operators_.end(), batch.operators.begin(), batch.operators.end());
  }
  NodeMaker(octree, leaves, nodes_);
}

std::size_t Structure::bytes() const {
  return nodes_.size() * sizeof(Node) + wide_.size() * sizeof(WideNode) + cells_.size() * sizeof(Cell) +
         atoms_.size() * sizeof(Atom) + operators_.size() * sizeof(Operator) + frames_.size() * sizeof(Frame);
}

void Structure::describe(std::map<std::string, double>& facts) const {
  std::size_t untrusted = 0;
  for (const Cell& cell : cells_) untrusted += !cell.trusted;
  facts["packet_cells"] = static_cast<double>(cells_.size());
  facts["untrusted_cells"] = static_cast<double>(untrusted);
  facts["mean_atoms"] = cells_.empty() ? 0 : static_cast<double>(atoms_.size()) / static_cast<double>(cells_.size());
}

}  // namespace csg::packets
