// The walk for x86-64-v2.
#include "walk.hpp"

namespace csg::packets {

void walk_v2(const Model& model, const Rays& rays, bool any, Answer& answer, Counts* counts) {
  walk(model, rays, any, answer, counts);
}

}  // namespace csg::packets
