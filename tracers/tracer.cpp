// What every scheme is spared: rays that are no rays, and rays that start too far away (rule 9).
#include "tracer.hpp"

#include "error_unit.hpp"
#include "slab.hpp"

namespace csg {
namespace {

bool finite(const Vec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

bool is_ray(const Ray& ray) {
  const double squared = dot(ray.dir, ray.dir);
  return finite(ray.origin) && finite(ray.dir) && std::isnormal(squared) && !std::isnan(ray.t_min) &&
         !std::isnan(ray.t_max);
}

/// Runs `batch(rays)` on prepared rays in chunks; a ray that is none becomes one that cannot hit.
template <class Batch>
void prepared(const CsgTree& tree, std::span<const Ray> rays, Batch batch) {
  constexpr std::size_t kChunk = 1024;
  Ray moved[kChunk];
  double shift[kChunk];
  const Box world = tree.world();
  for (std::size_t begin = 0; begin < rays.size(); begin += kChunk) {
    const std::size_t count = std::min(kChunk, rays.size() - begin);
    for (std::size_t i = 0; i < count; ++i) {
      Ray ray = rays[begin + i];
      shift[i] = 0;
      if (!is_ray(ray)) {
        ray = {{0, 0, 0}, {0, 0, 1}, 0, -kInfinity};
      } else if (length(ray.origin) > kFarthestOrigin * tree.size()) {
        const Interval inside = slab(world, ray.origin, Reciprocal(ray.dir));
        if (inside.empty()) {
          ray = {{0, 0, 0}, {0, 0, 1}, 0, -kInfinity};
        } else {
          // Moving costs what the far origin's band says: the ends give way by as much, so that no
          // hit comes back at t_min or from beyond t_max.
          const double band = tie_band(ray.origin, length(ray.dir), tree.size());
          shift[i] = inside.lo;
          ray.origin = ray.origin + inside.lo * ray.dir;
          ray.t_min += band - inside.lo;
          ray.t_max -= band + inside.lo;
        }
      }
      moved[i] = ray;
    }
    batch(begin, std::span<const Ray>(moved, count), shift);
  }
}

}  // namespace

void Tracer::trace(std::span<const Ray> rays, std::span<Hit> hits, Counters* counters) const {
  prepared(*tree_, rays, [&](std::size_t begin, std::span<const Ray> chunk, const double* shift) {
    const std::span<Hit> out = hits.subspan(begin, chunk.size());
    trace_batch(chunk, out, counters);
    for (std::size_t i = 0; i < chunk.size(); ++i)
      if (out[i].leaf >= 0) out[i].t += shift[i];
  });
}

void Tracer::occluded(std::span<const Ray> rays, std::span<std::uint8_t> blocked, Counters* counters) const {
  prepared(*tree_, rays, [&](std::size_t begin, std::span<const Ray> chunk, const double*) {
    occluded_batch(chunk, blocked.subspan(begin, chunk.size()), counters);
  });
}

void Tracer::occluded_batch(std::span<const Ray> rays, std::span<std::uint8_t> blocked, Counters* counters) const {
  std::vector<Hit> hits(rays.size());
  trace_batch(rays, hits, counters);
  for (std::size_t i = 0; i < rays.size(); ++i) blocked[i] = hits[i].leaf >= 0;
}

}  // namespace csg
