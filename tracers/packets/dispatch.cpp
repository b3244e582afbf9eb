// Which walk this machine runs. All give the same answers: what floats are unsure of is traced anew.
#include "packet_model.hpp"

namespace csg::packets {

void walk_v2(const Model&, const Rays&, bool any, Answer&, Counts*);
void walk_v3(const Model&, const Rays&, bool any, Answer&, Counts*);
void walk_v4(const Model&, const Rays&, bool any, Answer&, Counts*);

Walk walk_up_to(int level) {
  const bool has_v3 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2");
  const bool has_v4 = has_v3 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
                      __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw") &&
                      __builtin_cpu_supports("avx512cd");
  if (level >= 4 && has_v4) return walk_v4;
  if (level >= 3 && has_v3) return walk_v3;
  return walk_v2;
}

}  // namespace csg::packets
