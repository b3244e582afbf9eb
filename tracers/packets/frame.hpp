// The frames of leaves, in units of a packet model.
#pragma once
#include <algorithm>
#include <cmath>

#include "../primitives/primitive.hpp"
#include "packet_model.hpp"

namespace csg::packets {

inline double norm(const double row[3]) { return std::hypot(row[0], row[1], row[2]); }

/// The height from which a wall is reckoned: its apex, where its radius is rounded as a small number, if that is near.
inline double wall_origin(const Frame& frame) {
  const double radius = frame.shape[0], slope = frame.shape[1];
  return 4 * std::fabs(slope) > radius ? -radius / slope : 0;
}

inline Frame frame_of(const Leaf& leaf, const Vec3& middle, double unit) {
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
    }
  }
  return frame;
}

/// How far a frame is from a similarity, in the squares of lengths: OpenSCAD writes rotations with six digits. Lengths
/// by the first row's norm are right up to twice as much, and up to 3.3 times where a torus is turned by its axis
/// alone.
inline double skewness(const Frame& frame) {
  const auto product = [&](int i, int j) {
    return frame.row[i][0] * frame.row[j][0] + frame.row[i][1] * frame.row[j][1] + frame.row[i][2] * frame.row[j][2];
  };
  const double scale = product(0, 0);
  double most = 0;
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      const double off = std::fabs(product(i, j) - (i == j ? scale : 0));
      if (!(off <= most)) most = off;
    }
  }
  return most / scale;
}

}  // namespace csg::packets
