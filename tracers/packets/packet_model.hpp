// What packets of rays walk through: plain numbers, so that the code for each instruction set shares no
// inline function with the rest (see walk.hpp).
//
// Lengths are in units of a power of two near the model's size, from the middle of the world.
#pragma once
#include <cstdint>

namespace csg::packets {

/// Of a cell that packets pass through; one that has more is not trusted.
inline constexpr int kMostAtoms = 64, kMostOperators = 128;

/// Floats are read so many at a time, whatever there are.
inline constexpr int kLanesRead = 16;

/// The boxes of up to eight octants, for one ray that tests all of them or for many that test one after the other.
/// Where there is no octant, the box is met by no ray.
struct alignas(64) Node {
  float side[6][8];       ///< low on x, y, z; high on x, y, z
  std::int32_t link[8];   ///< another of these, or ~ of a cell's first line
  std::uint32_t octants;  ///< one bit for each that there is
};

/// A primitive is the intersection of its atoms, of which a cell keeps those that cut it.
/// All convex but the torus. A wall is a cone without its caps.
enum class AtomKind : std::uint8_t { Ball, Ellipsoid, Tube, Slab, Wall, Torus };
inline constexpr int kAtomKinds = 6;

/// How many floats say what an atom of each kind is; spans.hpp says which.
inline constexpr int kFloatsOf[kAtomKinds] = {6, 14, 10, 6, 16, 16};

/// An atom in a cell, but for its floats. Its frame is that of the leaf, scaled so that the atom's size is 1.
struct Atom {
  std::int32_t leaf;
  std::uint16_t parent;  ///< operator of the cell that it is an operand of
  std::uint16_t flip;    ///< all ones if it is complemented there, else 0
  AtomKind kind;
  std::uint8_t first_axis, end_axis;  ///< of its frame that it is about
  bool negative;                      ///< whether the solid shrinks where the atom grows
};

/// acc[parent] |= acc[this] ^ flip: unions and complements are enough. Operands come first; the last
/// operator is the root, whose parent is itself.
struct Operator {
  std::uint16_t parent, flip;
  std::uint64_t atoms;  ///< that are operands of it, one bit each
};

/// A cell, behind which stand its operators, its atoms, and the atoms' floats: kind by kind, and of a kind all atoms'
/// first floats, then all second ones. All of it is fetched at once.
struct Cell {
  double centre[3];
  float lo[3], hi[3];  ///< of the octree's cell, from the centre of what it was shrunk to
  float window;        ///< W: how far behind a float's crossing the true one may lie, where the surface is not grazed
  std::uint8_t of_kind[kAtomKinds];  ///< atoms, which stand kind by kind
  std::uint8_t atoms, operators;
  std::uint64_t flipped, negative;  ///< one bit an atom
  bool trusted;                     ///< whether floats can tell anything here
};

/// Cells begin with a line of the cache.
struct alignas(64) Line {
  std::uint8_t bytes[64];
};

/// The frame of a leaf: local = rows·(p − offset), rows scaled to the leaf's sizes.
struct Frame {
  double row[3][3], offset[3];
  double shape[2];  ///< ball: 1/radius. Wall: radius at the middle, half the difference of the ends. Torus: minor/major
};

struct Model {
  const Node* nodes;  ///< the first has one box, of all
  const Line* cells;  ///< and one more line
  const Frame* frames;
  double centre[3], per_unit;  ///< of the world, and 1 / unit
  double radius;               ///< of a ball around the world, in units
  double near, band;           ///< the tie band of rays from not farther than `near`
  int few;                     ///< so many rays, or fewer, go on one at a time
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
Walk walk_up_to(int level);

}  // namespace csg::packets
