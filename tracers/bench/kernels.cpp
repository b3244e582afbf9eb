// One primitive against lines that hit it, that miss the ball around it, and that graze it.
#include <random>

#include "../primitives/primitive.hpp"
#include "bench.hpp"

namespace csg::bench {
namespace {

struct Solid {
  const char* name;
  Kind kind;
  double size[3];
  TorusSolver torus = TorusSolver::Robust;
};

constexpr Solid kSolids[] = {
    {"sphere", Kind::Sphere, {1}},
    {"block", Kind::Block, {0.5, 0.75, 1}},
    {"cylinder", Kind::Cylinder, {0.5, 1}},
    {"cone", Kind::Cone, {0.75, 0.25, 1}},
    {"torus", Kind::Torus, {1, 0.25}},
    {"torus ferrari", Kind::Torus, {1, 0.25}, TorusSolver::Ferrari},
    {"torus algorithm_1010", Kind::Torus, {1, 0.25}, TorusSolver::Algorithm1010},
};
constexpr std::pair<const char*, Precision> kPrecisions[] = {{"float64", Precision::Float64},
                                                             {"float32", Precision::Float32}};
constexpr std::size_t kRays = 1024;

/// Placed by a translation and a rotation, as most leaves of a model are.
CsgTree placed(const Solid& solid, Precision precision) {
  Leaf leaf;
  leaf.kind = solid.kind;
  std::copy_n(solid.size, 3, leaf.size);
  leaf.world_from_local = {{{{0.6, 0.8, 0}, {-0.8, 0.6, 0}, {0, 0, 1}}}, {0.3, -0.2, 0.1}};
  return {{leaf}, {{Op::Leaf, 0, -1}}, {}, {.precision = precision, .torus = solid.torus}};
}

/// Lines past a leaf, from a few radii away.
class Aim {
 public:
  explicit Aim(const Leaf& leaf) : leaf_(leaf) {}

  Ray hit() { return sure_hit().first; }

  Ray miss_ball() {
    const Vec3 dir = unit();
    const Vec3 aside = cross(dir, unit());
    return from_outside((std::uniform_real_distribution(1.1, 2.0)(random_) / length(aside)) * aside, dir);
  }

  /// Touches the surface at a random point but for a millionth of the radius, inside or outside.
  Ray graze() {
    const auto [ray, at] = sure_hit();
    const Vec3 point = ray.origin + at.t[0] * ray.dir, normal = leaf_normal(leaf_, at.face[0], point);
    const Vec3 along = cross(normal, unit());
    const double off = std::uniform_real_distribution(-0x1p-20, 0x1p-20)(random_) / length(normal);
    return from_outside((1 / leaf_.reach) * (point - centre()) + off * normal, (1 / length(along)) * along);
  }

 private:
  Vec3 centre() const { return leaf_.world_from_local.offset; }

  Vec3 unit() {
    std::normal_distribution<double> normal;
    const Vec3 v{normal(random_), normal(random_), normal(random_)};
    return (1 / length(v)) * v;
  }

  /// Through a point given in radii from the centre.
  Ray from_outside(const Vec3& through, const Vec3& dir) const {
    return {centre() + leaf_.reach * (through - 4 * dir), dir};
  }

  std::pair<Ray, Crossings> sure_hit() {
    for (;;) {
      const Ray ray = from_outside(0.7 * unit(), unit());
      const Crossings at = crossings(leaf_, ray);
      if (at.count > 0) return {ray, at};
    }
  }

  const Leaf& leaf_;
  std::mt19937_64 random_{1};
};

constexpr std::pair<const char*, Ray (Aim::*)()> kMixes[] = {
    {"hit", &Aim::hit}, {"miss", &Aim::miss_ball}, {"graze", &Aim::graze}};

}  // namespace

void add_kernels() {
  for (const Solid& solid : kSolids)
    for (const auto& [precision_name, precision] : kPrecisions)
      for (const auto& [mix_name, mix] : kMixes) {
        const std::string name = std::string("kernel/") + solid.name + "/" + precision_name + "/" + mix_name;
        benchmark::RegisterBenchmark(name.c_str(), [&solid, precision, mix](benchmark::State& state) {
          const CsgTree tree = placed(solid, precision);
          const Leaf& leaf = tree.leaves()[0];
          Aim aim(leaf);
          std::vector<Ray> rays;
          while (rays.size() < kRays) rays.push_back((aim.*mix)());
          measure(state, "s_per_test", rays.size(), [&] {
            for (const Ray& ray : rays) benchmark::DoNotOptimize(crossings(leaf, ray));
          });
        });
      }
}

}  // namespace csg::bench
