// A picture by one tracer: primary rays, shadow rays, matte shading.
#pragma once
#include <cstdint>
#include <vector>

#include "../large_pages.hpp"
#include "view.hpp"

namespace csg {

/// Values of height × width pixels, row by row from the top.
template <class T>
using Plane = std::vector<T, LargePages<T>>;

/// Made before it is drawn: what the system takes to clear as much memory is no scheme's time.
struct Picture {
  Picture(int columns, int rows, bool per_pixel_cost = false);

  int width = 0, height = 0;
  Plane<Vec3> rgb;           ///< linear
  Plane<double> depth;       ///< from the eye along the ray, +inf where nothing is hit
  Plane<Vec3> normal;        ///< out of the solid, 0 where nothing is hit
  Plane<std::int32_t> leaf;  ///< −1 where nothing is hit
  Plane<std::uint8_t> lit;   ///< bit i: light i faces the surface and reaches it
  std::vector<double> cost;  ///< primitives tested for the pixel; only if asked for
  std::uint64_t rays = 0;    ///< primary and shadow

  /// FNV-1a over the bits of depth, leaf and lit: equal for all exact schemes.
  std::uint64_t hash() const;
};

/// Draws every pixel of a new picture of the view's size. Rays go to the tracer in batches of a tile, in 4×4 order;
/// threads take tiles as they come, and the picture does not depend on their number. For the cost of a pixel each ray
/// is a batch of its own, and `counters` must not be null.
void render(const Tracer& tracer, const View& view, Picture& picture, Counters* counters = nullptr, int threads = 1);

}  // namespace csg
