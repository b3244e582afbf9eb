// What packets of rays walk through: plain numbers, so that the code for each instruction set shares no
// inline function with the rest (see walk.hpp).
//
// Lengths are in units of a power of two near the model's size, from the middle of the world.
#pragma once
#include <cstdint>

namespace csg::packets {

/// Of a cell that packets pass through; one that has more is not trusted.
inline constexpr int kMostAtoms = 64, kMostOperators = 128;

/// A box with its octants, or with a cell.
struct Node {
  float side[6];          ///< low on x, y, z; high on x, y, z
  std::int32_t link;      ///< the first child's node, or the cell
  std::uint32_t octants;  ///< one bit for each child, which stand in their order; 0 for a cell
};

/// The boxes of eight octants, for a ray that tests them at once. Where there is no octant, the box is met by no ray.
struct alignas(32) WideNode {
  float side[6][8];      ///< low on x, y, z; high on x, y, z
  std::int32_t link[8];  ///< another of these, or ~cell
};

/// How many rays go together: it says which nodes a model has.
enum class Together : std::uint8_t { One, Sixteen };

/// A primitive is the intersection of its atoms, of which a cell keeps those that cut it.
/// All convex but the torus. A wall is a cone without its caps.
enum class AtomKind : std::uint8_t { Ball, Ellipsoid, Tube, SlabX, SlabY, SlabZ, Wall, Torus };

/// The axes of its frame that each kind is about: from `first` to before `end`.
inline constexpr struct {
  int first, end;
} kAxes[] = {{0, 3}, {0, 3}, {0, 2}, {0, 1}, {1, 2}, {2, 3}, {0, 3}, {0, 3}};

/// An atom in a cell. Its frame is that of the leaf, scaled so that the atom's size is 1.
struct Atom {
  float centre[3];  ///< the cell's centre in the frame
  float size;       ///< 1 and the rounding, as a larger atom if it adds to the solid, else a smaller
  float graze;      ///< below this speed towards the surface, rounding may move a crossing by W/2
  std::int32_t leaf;
  std::uint16_t parent;  ///< operator of the cell that it is an operand of
  std::uint16_t flip;    ///< all ones if it is complemented there, else 0
  AtomKind kind;
  bool negative;  ///< whether the solid shrinks where the atom grows
};

/// acc[parent] |= acc[this] ^ flip: unions and complements are enough. Operands come first; the last
/// operator is the root, whose parent is itself.
struct Operator {
  std::uint16_t parent, flip;
  std::uint64_t atoms;  ///< that are operands of it, one bit each
};

struct Cell {
  double centre[3];
  float lo[3], hi[3];  ///< of the octree's cell, from the centre of what it was shrunk to
  std::uint32_t first_atom, first_operator;
  std::uint16_t atoms, operators;
  std::uint64_t flipped, negative;  ///< one bit an atom
  float window;  ///< W: how far behind a float's crossing the true one may lie, where the surface is not grazed
  bool trusted;  ///< whether floats can tell anything here
};

/// The frame of a leaf: local = rows·(p − offset), rows scaled to the leaf's sizes. `narrow` is the
/// same rounded.
struct Frame {
  double row[3][3], offset[3];
  double shape[2];  ///< ball: 1/radius. Wall: radius at the middle, half the difference of the ends. Torus: minor/major
  float narrow[3][3], narrow_shape[2];  ///< of a wall: its radius at the height 0 of its atoms' frame, and slope
};

struct Model {
  const Node* nodes;     ///< for packets of rays
  const WideNode* wide;  ///< for rays one at a time
  const Cell* cells;
  const Atom* atoms;
  const Operator* operators;
  const Frame* frames;
  double centre[3], per_unit;  ///< of the world, and 1 / unit
  double radius;               ///< of a ball around the world, in units
  double near, band;           ///< the tie band of rays from not farther than `near`
};

/// Sixteen rays or fewer. `first` points to `count` rays of eight doubles (origin, direction, t_min, t_max),
/// already prepared.
struct Rays {
  const double* first;
  int count;
};

/// One bit a ray. Those in neither mask have no boundary.
struct Answer {
  std::uint32_t hit, unsure;
  double t[16];  ///< of `hit`: near the crossing, by less than t_error; of `unsure`: there is no boundary before
  double t_error[16];
  std::int32_t leaf[16];  ///< of `hit`: the leaf that is crossed
};

struct Counts {
  std::uint64_t cells, boxes, atoms, operators;
};

/// Finds the first boundary of each ray, or any if that will do; `counts` may be null.
using Walk = void (*)(const Model&, const Rays&, bool any, Answer&, Counts* counts);

/// The walk for the widest instruction set that this machine has, up to a level of x86-64: 2, 3 or 4.
Walk walk_up_to(int level, Together together);

}  // namespace csg::packets
