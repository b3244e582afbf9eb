// Embree over triangles: what a user would pick instead of tracing CSG. Inexact: it traces another surface.
//
// The solid's boundary is made into triangles beforehand (by Manifold, round primitives cut into a
// stated number of segments) and Embree traces them as single rays. Depth, normal and outline are
// wrong by the tessellation; the time to make the mesh is reported beside the time to build.
#include "../params.hpp"
#include "../structures/embree.hpp"

namespace csg {
namespace {

class EmbreeMesh final : public Tracer {
 public:
  EmbreeMesh(std::shared_ptr<const CsgTree> tree, std::shared_ptr<const TriangleMesh> mesh)
      : Tracer(std::move(tree)),
        leaf_of_triangle_(mesh->leaf_of_triangle),
        units_(tree_->size()),
        scene_(RTC_GEOMETRY_TYPE_TRIANGLE) {
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
    return {{"triangles", static_cast<double>(leaf_of_triangle_.size())}};
  }

 private:
  /// A ray that starts on a surface must not find it again: it starts a float's tie band further on.
  double start_of(const Ray& ray) const {
    const double speed = length(ray.dir);
    const double band = tree_->tolerances().band(ray.origin, speed) * (kUnitRoundoff<float> / kUnitRoundoff<double>);
    return std::max(ray.t_min + 4 * band, -tree_->tolerances().farthest_origin() / speed);
  }

  void trace_batch(std::span<const Ray> rays, std::span<Hit> hits, Counters* counters) const override {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    for (std::size_t i = 0; i < rays.size(); ++i) {
      hits[i] = {};
      const double start = start_of(rays[i]);
      if (!(start < rays[i].t_max)) continue;
      RTCRayHit embree = embree_ray(units_, rays[i], start, rays[i].t_max);
      rtcIntersect1(scene_.scene(), &context, &embree);
      const double t = start + embree.ray.tfar / units_.of_t(rays[i].dir);
      if (embree.hit.geomID == RTC_INVALID_GEOMETRY_ID || !(t < rays[i].t_max)) continue;
      const Vec3 normal{embree.hit.Ng_x, embree.hit.Ng_y, embree.hit.Ng_z};
      hits[i] = {t, (1 / length(normal)) * normal, leaf_of_triangle_[embree.hit.primID]};
    }
    if (counters) counters->cells_entered += rays.size();
  }

  void occluded_batch(std::span<const Ray> rays, std::span<std::uint8_t> blocked, Counters* counters) const override {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    for (std::size_t i = 0; i < rays.size(); ++i) {
      blocked[i] = 0;
      const double start = start_of(rays[i]);
      if (!(start < rays[i].t_max)) continue;
      RTCRay embree = embree_ray(units_, rays[i], start, rays[i].t_max).ray;
      rtcOccluded1(scene_.scene(), &context, &embree);
      blocked[i] = embree.tfar < 0;  // Embree sets it to −inf
    }
    if (counters) counters->cells_entered += rays.size();
  }

  std::vector<std::int32_t> leaf_of_triangle_;
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
                .trial_values = {16L, 64L}}},
    .make = [](std::shared_ptr<const CsgTree> tree, const Params& params) -> std::unique_ptr<Tracer> {
      return std::make_unique<EmbreeMesh>(std::move(tree), params.mesh);
    }};

}  // namespace csg
