// The walk for x86-64-v3.
#include "walk.hpp"

namespace csg::packets {

void walk_v3(const Model& model, const Rays& rays, Answer& answer, Counts* counts) {
  counts ? walk_packet<true>(model, rays, answer, counts) : walk_packet<false>(model, rays, answer, counts);
}

}  // namespace csg::packets
