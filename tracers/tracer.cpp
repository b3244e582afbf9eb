// What every scheme is spared: rays that are no rays, that start too far away (rule 9), or whose
// directions have extreme lengths.
#include "tracer.hpp"

#include <bit>

#include "error_unit.hpp"
#include "slab.hpp"

namespace csg {
namespace {

bool finite(const Vec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

bool is_ray(const Ray& ray) {
  return finite(ray.origin) && finite(ray.dir) && (ray.dir.x != 0 || ray.dir.y != 0 || ray.dir.z != 0) &&
         !std::isnan(ray.t_min) && !std::isnan(ray.t_max);
}

/// Bits that are in the order of |x|; NaN is above all.
std::uint64_t magnitude(double x) { return std::bit_cast<std::uint64_t>(std::fabs(x)); }

/// Whether rays are as schemes want them: near, with directions whose squares and quotients are in range. All that
/// preparing them would do is to scale them by a power of two. Every ray comes by here: there are no branches.
bool are_ready(std::span<const Ray> rays, double farthest) {
  const std::uint64_t least = magnitude(0x1p-32), most = magnitude(0x1p32);
  bool ready = true;
  for (const Ray& ray : rays) {
    const std::uint64_t x = magnitude(ray.dir.x), y = magnitude(ray.dir.y), z = magnitude(ray.dir.z);
    const std::uint64_t largest = std::max({x, y, z});
    const std::uint64_t smallest = std::min({x - 1, y - 1, z - 1});  // what is 0 becomes largest: it may be
    ready &= (largest >= least) & (largest <= most) & (smallest >= least - 1) &
             (dot(ray.origin, ray.origin) <= farthest * farthest) & !std::isunordered(ray.t_min, ray.t_max);
  }
  return ready;
}

/// A ray as schemes get it, and the way back: t = (t' + shift)·2^exponent.
struct Prepared {
  Ray ray;
  double shift = 0;
  int exponent = 0;
};

Prepared prepare(const CsgTree& tree, const Ray& given) {
  const Ray nowhere{{0, 0, 0}, {0, 0, 1}, 0, -kInfinity};
  const std::optional<ScaledRay> near_one = scaled(given);
  if (!near_one) return {nowhere};
  Prepared out{near_one->ray, 0, near_one->exponent};
  Ray& ray = out.ray;
  const auto is_far = [&] { return length(ray.origin) > tree.tolerances().farthest_origin(); };
  if (!is_far()) return out;
  // Moving costs what the far origin's band says: the ends give way by as much, so that no hit comes
  // back at t_min or from beyond t_max. From very far, one move lands as far off as its rounding.
  const double band = tree.tolerances().band(ray.origin, length(ray.dir));
  // The pads of ill-conditioned leaves may make the world larger than is far, though not the solid.
  const double most = 2 * tree.size();
  const Box world = intersection(tree.world(), {{-most, -most, -most}, {most, most, most}});
  constexpr int kMostMoves = 8;
  for (int move = 0; is_far(); ++move) {
    const Interval inside = slab(world, ray.origin, Reciprocal(ray.dir));
    if (inside.empty() || move == kMostMoves) return {nowhere};
    out.shift += inside.lo;
    // With one rounding, of what is near: so the line stays where it was.
    for (int axis = 0; axis < 3; ++axis) ray.origin[axis] = std::fma(inside.lo, ray.dir[axis], ray.origin[axis]);
  }
  ray.t_min += band - out.shift;
  ray.t_max -= band + out.shift;
  return out;
}

/// Runs `batch(begin, rays, prepared)` in chunks; `prepared` is empty if the rays were ready.
template <class Batch>
void in_chunks(const CsgTree& tree, std::span<const Ray> rays, Batch batch) {
  constexpr std::size_t kChunk = 1024;
  std::vector<Prepared> prepared;
  std::vector<Ray> ready;
  for (std::size_t begin = 0; begin < rays.size(); begin += kChunk) {
    const std::span<const Ray> chunk = rays.subspan(begin, std::min(kChunk, rays.size() - begin));
    prepared.clear();
    if (are_ready(chunk, tree.tolerances().farthest_origin())) {
      batch(begin, chunk, prepared);
      continue;
    }
    ready.clear();
    for (const Ray& ray : chunk) {
      prepared.push_back(prepare(tree, ray));
      ready.push_back(prepared.back().ray);
    }
    batch(begin, std::span<const Ray>(ready), prepared);
  }
}

}  // namespace

std::optional<ScaledRay> scaled(const Ray& given) {
  if (!is_ray(given)) return {};
  ScaledRay out{given};
  Ray& ray = out.ray;
  // A direction near 1, by a power of two: squares of its entries then stay in range.
  const int exponent = std::ilogb(std::max({std::fabs(ray.dir.x), std::fabs(ray.dir.y), std::fabs(ray.dir.z)}));
  if (exponent != 0) {
    out.exponent = -exponent;
    for (int axis = 0; axis < 3; ++axis) ray.dir[axis] = std::ldexp(ray.dir[axis], -exponent);
    ray.t_min = std::ldexp(ray.t_min, exponent);
    // A t that no double can hold is no hit, as beyond t_max.
    ray.t_max = std::ldexp(std::min(ray.t_max, std::numeric_limits<double>::max()), exponent);
  }
  // Entries that no path can tell from 0, so that nothing hangs on denormals: with or without them
  // flushed to zero the bits are the same.
  for (int axis = 0; axis < 3; ++axis)
    if (std::fabs(ray.dir[axis]) < kParallel) ray.dir[axis] = 0;
  return out;
}

void Tracer::trace(std::span<const Ray> rays, std::span<Hit> hits, Counters* counters) const {
  in_chunks(*tree_, rays, [&](std::size_t begin, std::span<const Ray> ready, const std::vector<Prepared>& prepared) {
    const std::span<Hit> out = hits.subspan(begin, ready.size());
    trace_batch(ready, out, counters);
    for (std::size_t i = 0; i < prepared.size(); ++i)
      if (out[i].leaf >= 0) out[i].t = std::ldexp(out[i].t + prepared[i].shift, prepared[i].exponent);
  });
}

void Tracer::occluded(std::span<const Ray> rays, std::span<std::uint8_t> blocked, Counters* counters) const {
  in_chunks(*tree_, rays, [&](std::size_t begin, std::span<const Ray> ready, const auto&) {
    occluded_batch(ready, blocked.subspan(begin, ready.size()), counters);
  });
}

void Tracer::occluded_batch(std::span<const Ray> rays, std::span<std::uint8_t> blocked, Counters* counters) const {
  std::vector<Hit> hits(rays.size());
  trace_batch(rays, hits, counters);
  for (std::size_t i = 0; i < rays.size(); ++i) blocked[i] = hits[i].leaf >= 0;
}

}  // namespace csg
