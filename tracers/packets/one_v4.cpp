// The walk of one ray at a time for x86-64-v4.
#include "walk_one.hpp"

namespace csg::packets {

void one_v4(const Model& model, const Rays& rays, bool any, Answer& answer, Counts* counts) {
  walk_one_by_one(model, rays, any, answer, counts);
}

}  // namespace csg::packets
