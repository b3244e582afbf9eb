// What packets of rays walk through: plain numbers, so that the code for each instruction set shares no
// inline function with the rest (see walk.hpp).
//
// Lengths are in units of a power of two near the model's size, from the middle of the world.
#pragma once
#include <cstdint>

namespace csg::packets {

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
/// All convex but the tori. A wall is a cone without its caps. A ball and a torus are as round in the world as in
/// their frames; an ellipsoid and a skew torus are not.
enum class AtomKind : std::uint8_t { Ball, Ellipsoid, Tube, Slab, Wall, Torus, SkewTorus };
inline constexpr int kAtomKinds = 7;

/// How many floats say what an atom of each kind is; quadric_spans.hpp and torus_span.hpp say which.
inline constexpr int kFloatsOf[kAtomKinds] = {5, 13, 9, 5, 15, 9, 14};

/// An atom's leaf, below so many bits for the axis of its frame that a slab is about.
inline constexpr int kLeafBits = 30;

/// A cell. Behind it stand
///   for each operator, the atoms that are its operands, one bit each: 64 bits;
///   for each atom, its leaf and axis: 32 bits;
///   for each atom, then for each operator, what it feeds: acc[feed >> 1] |= acc[this] ^ (feed & 1). Unions and
///     complements are enough. Operands come first; the last operator is the root, which feeds itself. 8 bits, and as
///     many to spare as fill up 32;
///   the atoms' floats: kind by kind, and of a kind all atoms' first floats, then all second ones.
/// It is one piece, so that a lone ray can ask for it ahead.
struct Cell {
  float centre[3];    ///< from the middle of the world
  float lo[3], side;  ///< of the octree's cell, from the centre
  float window;       ///< W: how far behind a float's crossing the true one may lie, where the surface is not grazed
  std::uint8_t end[kAtomKinds];  ///< of the atoms of each kind, which stand kind by kind
  std::uint8_t operators;        ///< 0 if floats can tell nothing here
  std::uint64_t flipped;         ///< atoms that are complemented where they feed, one bit each
  std::uint64_t negative;        ///< those by which the solid shrinks where they grow
};
inline constexpr int kMostAtoms = 64, kMostOperators = 128;  ///< a cell that has more is not trusted

/// Cells begin with a line of the cache.
struct alignas(64) Line {
  std::uint8_t bytes[64];
};

/// The frame of a leaf: local = rows·(p − offset), rows scaled to the leaf's sizes.
struct Frame {
  double row[3][3], offset[3];
  double shape[2];  ///< Wall: radius at the middle, half the difference of the ends. Torus: minor/major
};

struct Model {
  const Node* nodes;  ///< the first has one box, of all
  const Line* cells;  ///< and one more line
  const Frame* frames;
  double centre[3], per_unit;  ///< of the world, and 1 / unit
  double radius;               ///< of a ball around the world, in units
  double near, band;           ///< the tie band of rays from not farther than `near`
  int few;                     ///< so many rays of a packet, or fewer, below a node or in a cell go on one at a time
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
