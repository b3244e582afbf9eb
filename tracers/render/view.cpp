#include "view.hpp"

#include <numbers>
#include <stdexcept>

namespace csg {

Camera::Camera(const View& view) : eye_(view.eye), half_width_(view.width / 2.0), half_height_(view.height / 2.0) {
  const Vec3 to = view.look_at - view.eye, side = cross(to, view.up);
  if (view.width < 1 || view.height < 1) throw std::invalid_argument("view: width and height must be positive");
  if (!(view.fov_deg > 0 && view.fov_deg < 180)) throw std::invalid_argument("view: fov_deg must lie in 0..180");
  if (!(length(side) > 0 && length(side) < kInfinity))
    throw std::invalid_argument("view: eye, look_at and up must not lie on a line");
  forward_ = (1 / length(to)) * to;
  right_ = (1 / length(side)) * side;
  down_ = cross(forward_, right_);
  const double pixel = 2 * std::tan(view.fov_deg * std::numbers::pi / 360) / view.height;
  right_ = pixel * right_;
  down_ = pixel * down_;
}

}  // namespace csg
