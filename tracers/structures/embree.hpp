// Embree, wrapped as far as the schemes need it: a device, a scene, and user geometry of boxes.
// Embree's rays and bounds are float; whoever uses it here takes from it only which boxes to look at.
#pragma once
#include <embree3/rtcore.h>

#include <atomic>
#include <stdexcept>
#include <vector>

#include "../slab.hpp"
#include "../tracer.hpp"

namespace csg {

/// Embree's floats are safe near 1: boxes, origins and t are handed over in units of 2^exponent, exactly.
/// Directions are near 1 as every scheme gets them.
class EmbreeUnits {
 public:
  explicit EmbreeUnits(double size) : scale_(std::ldexp(1.0, -std::ilogb(size))) {}

  double scale() const { return scale_; }

 private:
  double scale_;
};

/// Float rays and boxes stray from the double ones by a few 2⁻²⁴ of the world: boxes are grown by
/// 2⁻¹⁹ of its size, more than Embree's own arithmetic adds.
inline constexpr double kEmbreePad = 0x1p-19;

/// How large what rays are traced in is: pads of ill-conditioned leaves may make the world many times the
/// model's size, and with it the floats of a ray that enters it.
inline double size_with_pads(const Box& world, double size) {
  if (world.empty()) return size;
  for (int axis = 0; axis < 3; ++axis) size = std::max({size, std::fabs(world.lo[axis]), std::fabs(world.hi[axis])});
  return size;
}

/// Owns a device and a scene of one geometry, built by `threads`. Embree's pool is the process's, as large as any live
/// device asks for: while a scene that was built by more lives, others are built by more too.
class EmbreeScene {
 public:
  EmbreeScene(RTCGeometryType type, std::size_t threads)
      : device_(rtcNewDevice(("threads=" + std::to_string(threads) + ",start_threads=0").c_str())) {
    if (!device_) throw std::runtime_error("Embree cannot start on this machine");
    rtcSetDeviceMemoryMonitorFunction(device_, &count_bytes, &bytes_);
    scene_ = rtcNewScene(device_);
    // No box may be lost. Triangles are traced as Embree's users do by default: a seventh faster on ngk, with
    // one hit more or less in a hundred thousand.
    if (type == RTC_GEOMETRY_TYPE_USER) rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST);
    geometry_ = rtcNewGeometry(device_, type);
  }
  ~EmbreeScene() {
    rtcReleaseGeometry(geometry_);
    rtcReleaseScene(scene_);
    rtcReleaseDevice(device_);
  }
  EmbreeScene(const EmbreeScene&) = delete;
  EmbreeScene& operator=(const EmbreeScene&) = delete;

  RTCGeometry geometry() const { return geometry_; }
  RTCScene scene() const { return scene_; }
  std::size_t bytes() const { return bytes_ > 0 ? static_cast<std::size_t>(bytes_) : 0; }
  bool has_native_packets() const {
    return rtcGetDeviceProperty(device_, RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED) != 0;
  }

  void commit() {
    rtcCommitGeometry(geometry_);
    rtcAttachGeometry(scene_, geometry_);
    rtcCommitScene(scene_);
    if (const RTCError error = rtcGetDeviceError(device_); error != RTC_ERROR_NONE)
      throw std::runtime_error("Embree failed to build, error " + std::to_string(error));
  }

 private:
  static bool count_bytes(void* sum, ssize_t bytes, bool) {
    *static_cast<std::atomic<ssize_t>*>(sum) += bytes;
    return true;
  }

  std::atomic<ssize_t> bytes_ = 0;  // several threads build
  RTCDevice device_;
  RTCScene scene_;
  RTCGeometry geometry_;
};

/// A float ray over [t0, t1] of a double one, starting there, so that a far origin costs no bits.
inline RTCRayHit embree_ray(const EmbreeUnits& units, const Ray& ray, double t0, double t1) {
  const Vec3 o = units.scale() * (ray.origin + t0 * ray.dir), d = ray.dir;
  RTCRayHit out{};
  out.ray.org_x = static_cast<float>(o.x), out.ray.org_y = static_cast<float>(o.y),
  out.ray.org_z = static_cast<float>(o.z);
  out.ray.dir_x = static_cast<float>(d.x), out.ray.dir_y = static_cast<float>(d.y);
  out.ray.dir_z = static_cast<float>(d.z);
  out.ray.tnear = 0;
  out.ray.tfar = static_cast<float>((t1 - t0) * units.scale() * (1 + kEmbreePad));
  out.ray.mask = ~0u;
  out.hit.geomID = out.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  return out;
}

/// Boxes with numbers: `query` calls `visit(number)` for every box that a ray meets, in no order but
/// roughly near to far. `visit` may return a t beyond which boxes no longer matter, else +inf.
class EmbreeBoxes {
 public:
  /// `size`: of the model with its pads, which sets units and padding. `threads`: that build.
  EmbreeBoxes(std::vector<Box> boxes, double size, std::size_t threads)
      : boxes_(std::move(boxes)), units_(size), pad_(kEmbreePad * size), scene_(RTC_GEOMETRY_TYPE_USER, threads) {
    const RTCGeometry geometry = scene_.geometry();
    rtcSetGeometryUserPrimitiveCount(geometry, static_cast<unsigned>(boxes_.size()));
    rtcSetGeometryUserData(geometry, this);
    rtcSetGeometryBoundsFunction(geometry, &bounds, nullptr);
    rtcSetGeometryIntersectFunction(geometry, &intersect);
    scene_.commit();
  }

  const Box& box(std::size_t number) const { return boxes_[number]; }
  std::size_t bytes() const { return boxes_.size() * sizeof(Box) + scene_.bytes(); }

  template <class Visit>
  void query(const Ray& ray, double t0, double t1, Visit visit) const {
    Query query{
        {}, t0, units_.scale(), &visit, [](void* to, unsigned number) { return (*static_cast<Visit*>(to))(number); }};
    rtcInitIntersectContext(&query.context);
    RTCRayHit embree = embree_ray(units_, ray, t0, t1);
    rtcIntersect1(scene_.scene(), &query.context, &embree);
  }

 private:
  struct Query {
    RTCIntersectContext context;  // first: Embree hands back a pointer to it
    double t0, per_t;
    void* visit;
    double (*call)(void*, unsigned);
  };

  static void bounds(const RTCBoundsFunctionArguments* args) {
    const auto* self = static_cast<const EmbreeBoxes*>(args->geometryUserPtr);
    Box box = self->boxes_[args->primID].padded(self->pad_);
    box = {self->units_.scale() * box.lo, self->units_.scale() * box.hi};
    *args->bounds_o = {static_cast<float>(box.lo.x), static_cast<float>(box.lo.y), static_cast<float>(box.lo.z), 0,
                       static_cast<float>(box.hi.x), static_cast<float>(box.hi.y), static_cast<float>(box.hi.z), 0};
  }

  static void intersect(const RTCIntersectFunctionNArguments* args) {
    if (!args->valid[0]) return;
    const auto* query = reinterpret_cast<const Query*>(args->context);
    const double limit = query->call(query->visit, args->primID);
    if (limit == kInfinity) return;
    auto& ray = reinterpret_cast<RTCRayHit*>(args->rayhit)->ray;
    ray.tfar = std::min(ray.tfar, static_cast<float>((limit - query->t0) * query->per_t * (1 + kEmbreePad)));
  }

  std::vector<Box> boxes_;
  EmbreeUnits units_;
  double pad_;
  EmbreeScene scene_;
};

}  // namespace csg
