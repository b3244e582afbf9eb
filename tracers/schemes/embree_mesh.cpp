// Embree over triangles: what a user would pick instead of tracing CSG. Inexact: it traces another surface.
//
// The solid's boundary is made into triangles beforehand (by Manifold, round primitives cut into a
// stated number of segments) and Embree traces them, as single rays or as coherent packets of 16. Depth,
// normal and outline are wrong by the tessellation; the time to make the mesh is reported beside the time
// to build. Packets are native where the machine has AVX-512; elsewhere Embree splits them.
//   segments        of a full circle in the mesh.
//   packet          16 | 1: rays that Embree is given at once.
//   build_threads   of Embree's build; Manifold takes all cores.
#include "../params.hpp"
#include "../structures/embree.hpp"
#include "../structures/parallel.hpp"

namespace csg {
namespace {

constexpr std::size_t kPacket = 16;

/// Up to 16 rays side by side, as Embree takes them.
struct Packet {
  void put(std::size_t lane, const RTCRayHit& one) {
    RTCRay16& ray = rays.ray;
    ray.org_x[lane] = one.ray.org_x, ray.org_y[lane] = one.ray.org_y, ray.org_z[lane] = one.ray.org_z;
    ray.dir_x[lane] = one.ray.dir_x, ray.dir_y[lane] = one.ray.dir_y, ray.dir_z[lane] = one.ray.dir_z;
    ray.tnear[lane] = one.ray.tnear, ray.tfar[lane] = one.ray.tfar;
    ray.time[lane] = one.ray.time, ray.mask[lane] = one.ray.mask, ray.flags[lane] = one.ray.flags;
    rays.hit.geomID[lane] = rays.hit.instID[0][lane] = RTC_INVALID_GEOMETRY_ID;
  }

  alignas(64) int valid[kPacket];  ///< −1, or 0 for a lane to be left alone
  RTCRayHit16 rays;
  double start[kPacket];
};

class EmbreeMesh final : public Tracer {
 public:
  EmbreeMesh(std::shared_ptr<const CsgTree> tree, std::shared_ptr<const TriangleMesh> mesh, bool packets,
             std::size_t threads)
      : Tracer(std::move(tree)),
        leaf_of_triangle_(mesh->leaf_of_triangle),
        packets_(packets),
        units_(tree_->size()),
        scene_(RTC_GEOMETRY_TYPE_TRIANGLE, threads) {
    if (leaf_of_triangle_.empty()) throw std::invalid_argument("embree_mesh: the mesh has no triangles");
    const RTCGeometry geometry = scene_.geometry();
    auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                                 3 * sizeof(float), mesh->vertices.size()));
    auto* triangles = static_cast<std::uint32_t*>(rtcSetNewGeometryBuffer(
        geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(std::uint32_t), leaf_of_triangle_.size()));
    if (!vertices || !triangles) throw std::runtime_error("Embree has no memory for the mesh");
    for (const Vec3& v : mesh->vertices)
      for (int axis = 0; axis < 3; ++axis) *vertices++ = static_cast<float>(units_.scale() * v[axis]);
    std::copy(mesh->triangles.begin(), mesh->triangles.end(), triangles);
    scene_.commit();
  }

  std::size_t bytes() const override {
    return scene_.bytes() + leaf_of_triangle_.size() * sizeof(leaf_of_triangle_[0]);
  }
  std::map<std::string, double> facts() const override {
    return {{"triangles", static_cast<double>(leaf_of_triangle_.size())},
            {"native_packets", static_cast<double>(scene_.has_native_packets())}};
  }

 private:
  /// A ray that starts on a surface must not find it again: it starts a float's tie band further on.
  double start_of(const Ray& ray) const {
    const double speed = length(ray.dir);
    const double band = tree_->tolerances().band(ray.origin, speed) * (kUnitRoundoff<float> / kUnitRoundoff<double>);
    return std::max(ray.t_min + 4 * band, -tree_->tolerances().farthest_origin() / speed);
  }

  /// The hit that Embree found on a ray from `start` on.
  Hit hit_of(const Ray& ray, double start, float tfar, Vec3 normal, unsigned triangle) const {
    const double t = start + tfar / units_.scale();
    if (!(t < ray.t_max)) return {};
    return {t, (1 / length(normal)) * normal, leaf_of_triangle_[triangle]};
  }

  /// Calls `trace(i, ray, start)` for each ray that has a way to go.
  template <class Trace>
  void one_by_one(std::span<const Ray> rays, Trace trace) const {
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const double start = start_of(rays[i]);
      if (start < rays[i].t_max) trace(i, embree_ray(units_, rays[i], start, rays[i].t_max), start);
    }
  }

  /// Calls `trace(begin, packet)` for every 16 consecutive rays, and the rest.
  template <class Trace>
  void in_packets(std::span<const Ray> rays, Trace trace) const {
    Packet packet{};  // where Embree splits packets it looks at lanes that are left alone, too
    for (std::size_t begin = 0; begin < rays.size(); begin += kPacket) {
      for (std::size_t lane = 0; lane < kPacket; ++lane) {
        packet.valid[lane] = 0;
        if (begin + lane >= rays.size()) continue;
        const Ray& ray = rays[begin + lane];
        const double start = packet.start[lane] = start_of(ray);
        packet.valid[lane] = start < ray.t_max ? -1 : 0;
        packet.put(lane, embree_ray(units_, ray, start, ray.t_max));
      }
      trace(begin, packet);
    }
  }

  void trace_batch(std::span<const Ray> rays, std::span<Hit> hits, Counters* counters) const override {
    std::ranges::fill(hits, Hit{});
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    if (packets_) {
      context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
      in_packets(rays, [&](std::size_t begin, Packet& packet) {
        rtcIntersect16(packet.valid, scene_.scene(), &context, &packet.rays);
        const RTCHit16& hit = packet.rays.hit;
        for (std::size_t lane = 0; lane < kPacket; ++lane)
          if (packet.valid[lane] && hit.geomID[lane] != RTC_INVALID_GEOMETRY_ID)
            hits[begin + lane] = hit_of(rays[begin + lane], packet.start[lane], packet.rays.ray.tfar[lane],
                                        {hit.Ng_x[lane], hit.Ng_y[lane], hit.Ng_z[lane]}, hit.primID[lane]);
      });
    } else {
      one_by_one(rays, [&](std::size_t i, RTCRayHit one, double start) {
        rtcIntersect1(scene_.scene(), &context, &one);
        if (one.hit.geomID != RTC_INVALID_GEOMETRY_ID)
          hits[i] = hit_of(rays[i], start, one.ray.tfar, {one.hit.Ng_x, one.hit.Ng_y, one.hit.Ng_z}, one.hit.primID);
      });
    }
    if (counters) counters->cells_entered += rays.size();
  }

  void occluded_batch(std::span<const Ray> rays, std::span<std::uint8_t> blocked, Counters* counters) const override {
    std::ranges::fill(blocked, std::uint8_t{0});
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    if (packets_) {
      context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
      in_packets(rays, [&](std::size_t begin, Packet& packet) {
        rtcOccluded16(packet.valid, scene_.scene(), &context, &packet.rays.ray);
        for (std::size_t lane = 0; lane < kPacket; ++lane)
          if (packet.valid[lane]) blocked[begin + lane] = packet.rays.ray.tfar[lane] < 0;  // Embree sets it to −inf
      });
    } else {
      one_by_one(rays, [&](std::size_t i, RTCRayHit one, double) {
        rtcOccluded1(scene_.scene(), &context, &one.ray);
        blocked[i] = one.ray.tfar < 0;
      });
    }
    if (counters) counters->cells_entered += rays.size();
  }

  std::vector<std::int32_t> leaf_of_triangle_;
  bool packets_;
  EmbreeUnits units_;
  EmbreeScene scene_;
};

}  // namespace

extern const SchemeInfo scheme_embree_mesh;
const SchemeInfo scheme_embree_mesh{
    .name = "embree_mesh",
    .title = "Embree on a triangle mesh",
    .exact = false,
    .needs_mesh = true,
    .own_numerics = true,
    .params = {{.name = "segments",
                .meaning = "segments of a full circle in the mesh (the mesh itself is made beforehand)",
                .default_value = 64L,
                .minimum = 3,
                .maximum = 4096,
                .trial_values = {16L, 64L}},
               {.name = "packet",
                .meaning = "rays handed to Embree at once: 1 or 16",
                .default_value = 1L,
                .minimum = 1,
                .maximum = kPacket,
                .trial_values = {1L, 16L}},
               build_threads_param()},
    .make = [](std::shared_ptr<const CsgTree> tree, const Params& params) -> std::unique_ptr<Tracer> {
      const int packet = params.integer("packet");
      if (packet != 1 && packet != kPacket) throw std::invalid_argument("embree_mesh: 'packet' is 1 or 16");
      return std::make_unique<EmbreeMesh>(std::move(tree), params.mesh, packet == kPacket,
                                          thread_count(params.integer("build_threads")));
    }};

}  // namespace csg
