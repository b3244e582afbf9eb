// Where rays start: packets made ready, and which side of an atom's surface a start is on that floats cannot tell
// apart.
#pragma once
#include "lanes.hpp"
#include "packet_model.hpp"

namespace {

using namespace csg::packets;

struct Packet {
  D o[3], d[3];                           // start and unit direction, units
  F of[3], df[3], inverse[3], scaled[3];  // the same in floats; scaled = o·inverse
  F end;
  Mask in_world;  // not moved to where they enter the world
  Mask far;       // origins beyond Model::near
};

/// Where rays start and how fast they are, in units; those that are not `valid` end before.
struct Start {
  D at, speed;
  Mask valid;
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

inline Mask less(double a, double b) { return a < b; }
inline double root(double x) { return __builtin_sqrt(x); }

/// Where rays start that an atom is near to.
struct Side {
  Mask inside;
  Mask left;  ///< outside, and it is not ahead unless it is a torus
};

/// By the atom's value at the starts, in double: for surfaces that are nearer than floats can tell. A convex atom that
/// is left behind is never met again. Real: D for a packet, or double for a ray.
template <class Real>
inline Side side_of_start(AtomKind kind, int axis, const Frame& frame, const Real o[3], const Real d[3], double band) {
  const auto real = [](double number) {
    if constexpr (std::is_same_v<Real, double>)
      return number;
    else
      return all(number);
  };
  Real x[3], v[3], rel[3];
  const int first = axis, end = kind == AtomKind::Slab ? axis + 1 : kind == AtomKind::Tube ? 2 : 3;
  for (int j = 0; j < 3; ++j) rel[j] = o[j] - real(frame.offset[j]);
  double steepest = 0;
  for (int i = first; i < end; ++i) {
    const double* row = frame.row[i];
    x[i] = real(row[0]) * rel[0] + real(row[1]) * rel[1] + real(row[2]) * rel[2];
    v[i] = real(row[0]) * d[0] + real(row[1]) * d[1] + real(row[2]) * d[2];
    steepest += row[0] * row[0] + row[1] * row[1] + row[2] * row[2];
  }
  // g, its slope along the ray, and what one band changes of it.
  Real g = real(0), slope = real(0), slack = real(0);
  const Real two = real(2);
  const double per_band = band * __builtin_sqrt(steepest);
  switch (kind) {
    case AtomKind::Ball:
    case AtomKind::Ellipsoid:
    case AtomKind::Tube:
    case AtomKind::Slab:
      g = real(-1);
      for (int i = first; i < end; ++i) g = g + x[i] * x[i], slope = slope + two * x[i] * v[i];
      slack = real(2 * per_band);
      break;
    case AtomKind::Torus:
    case AtomKind::SkewTorus: {
      const double minor = frame.shape[0];
      const Real alpha = x[0] * x[0] + x[1] * x[1] + x[2] * x[2] + real(1 - minor * minor);
      g = alpha * alpha - real(4) * (x[0] * x[0] + x[1] * x[1]);
      slope = real(4) * (alpha * (x[0] * v[0] + x[1] * v[1] + x[2] * v[2]) - two * (x[0] * v[0] + x[1] * v[1]));
      slack = real(16 * minor * per_band + 0x1p-46);
      break;
    }
    case AtomKind::Wall: {
      const Real rho = root(x[0] * x[0] + x[1] * x[1]);
      g = rho - real(frame.shape[0]) - real(frame.shape[1]) * x[2];
      slope = (x[0] * v[0] + x[1] * v[1]) / rho - real(frame.shape[1]) * v[2];
      slack = real(2 * per_band);
      break;
    }
  }
  return {less(g, -slack), less(slack, g) & ~less(slope, real(0))};
}

}  // namespace
