// The walk for x86-64-v3.
#include "walk.hpp"

namespace csg::packets {

void walk_v3(const Model& model, const Rays& rays, bool any, Answer& answer, Counts* counts) {
  walk(model, rays, any, answer, counts);
}

}  // namespace csg::packets
