// What the picture is of: a pinhole camera, point lights, matte surfaces.
#pragma once
#include <vector>

#include "../tracer.hpp"

namespace csg {

struct Light {
  Vec3 position;
  Vec3 color;  ///< linear rgb; no falloff with distance
};

/// Right-handed; pixel (0, 0) is top left; rays go through pixel centres; |dir| = 1.
struct View {
  Vec3 eye, look_at, up;
  double fov_deg = 40;  ///< vertical, full angle
  int width = 512, height = 512;
  std::vector<Light> lights;
  Vec3 ambient, background;
  Vec3 albedo;  ///< where the model gives no color()
};

/// Maps pixels to rays.
class Camera {
 public:
  /// Throws std::invalid_argument if the view is degenerate.
  explicit Camera(const View& view);
  Ray ray(int column, int row) const {
    const Vec3 dir = forward_ + (column + 0.5 - half_width_) * right_ + (row + 0.5 - half_height_) * down_;
    return {eye_, (1 / length(dir)) * dir, 0, kInfinity};
  }

 private:
  Vec3 eye_, forward_, right_, down_;  // right_ and down_ span a pixel's width and height at |forward| = 1
  double half_width_, half_height_;
};

}  // namespace csg
