// Which walk this machine runs. All give the same answers: what floats are unsure of is traced anew.
#include "packet_model.hpp"

namespace csg::packets {

void walk_v2(const Model&, const Rays&, bool any, Answer&, Counts*);
void walk_v3(const Model&, const Rays&, bool any, Answer&, Counts*);
void walk_v4(const Model&, const Rays&, bool any, Answer&, Counts*);

Walk walk_for_this_machine() {
  static const Walk walk = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
                                   __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw")
                               ? walk_v4
                           : __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") ? walk_v3
                                                                                             : walk_v2;
  return walk;
}

}  // namespace csg::packets
