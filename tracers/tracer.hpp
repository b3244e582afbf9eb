// The contract between the schemes and everybody else: rays in, hits out, work counted.
#pragma once
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "csg/csg_tree.hpp"
#include "vec.hpp"

namespace csg {

/// One row of an (N, 8) array. Model units; `dir` need not be a unit vector.
struct Ray {
  Vec3 origin, dir;
  double t_min = 0, t_max = kInfinity;
};

/// A ray in units of t in which its direction is near 1: the given ray's t is 2^exponent times its own.
struct ScaledRay {
  Ray ray;
  int exponent = 0;
};
/// What is traced for a ray; nothing if it has a NaN or no direction.
std::optional<ScaledRay> scaled(const Ray& given);

/// The first boundary of the regularized solid; the normal is a unit vector out of the solid.
struct Hit {
  double t = kInfinity;
  Vec3 normal;
  std::int32_t leaf = -1;
};

/// Work done, the noise-free cost. Counted only where a Counters is passed: each scheme's code is
/// compiled with counting and without, so that counting never slows a timed run.
struct Counters {
  std::uint64_t cells_entered = 0;       ///< cells, voxels or leaf boxes that a ray was handed
  std::uint64_t bounds_tested = 0;       ///< S-bounds (boxes of tree nodes) tested against a ray
  std::uint64_t primitives_tested = 0;   ///< calls of a primitive's crossing kernel
  std::uint64_t booleans_evaluated = 0;  ///< operator nodes whose value was recomputed

  Counters& operator+=(const Counters& other) {
    cells_entered += other.cells_entered;
    bounds_tested += other.bounds_tested;
    primitives_tested += other.primitives_tested;
    booleans_evaluated += other.booleans_evaluated;
    return *this;
  }
};

/// The counting and the silent variant of a tracing loop.
struct CountWork {
  Counters& counters;
  void cell() { ++counters.cells_entered; }
  void bound() { ++counters.bounds_tested; }
  void primitive() { ++counters.primitives_tested; }
  void boolean() { ++counters.booleans_evaluated; }
};
struct CountNothing {
  void cell() {}
  void bound() {}
  void primitive() {}
  void boolean() {}
};

/// Triangles standing in for the solid, for the schemes that trace them.
struct TriangleMesh {
  std::vector<Vec3> vertices;
  std::vector<std::uint32_t> triangles;  ///< three indices a triangle
  std::vector<std::int32_t> leaf_of_triangle;
};

/// Building is construction; a Tracer is immutable and may be used by many threads.
class Tracer {
 public:
  virtual ~Tracer() = default;

  /// The nearest boundary of each ray. Rays with a NaN or a zero direction miss.
  /// `counters` may be null. Precondition: rays.size() == hits.size().
  void trace(std::span<const Ray> rays, std::span<Hit> hits, Counters* counters) const;

  /// 1 where `trace` would find a boundary, else 0.
  void occluded(std::span<const Ray> rays, std::span<std::uint8_t> blocked, Counters* counters) const;

  virtual std::size_t bytes() const = 0;  ///< of the structure, without the CsgTree
  /// What the structure consists of: cells, levels, halfspaces a cell…
  virtual std::map<std::string, double> facts() const { return {}; }

  const CsgTree& tree() const { return *tree_; }

 protected:
  explicit Tracer(std::shared_ptr<const CsgTree> tree) : tree_(std::move(tree)) {}

  /// Rays are finite, start no farther than rule 9 allows, and come in tile order.
  virtual void trace_batch(std::span<const Ray>, std::span<Hit>, Counters*) const = 0;
  virtual void occluded_batch(std::span<const Ray>, std::span<std::uint8_t>, Counters*) const;

  std::shared_ptr<const CsgTree> tree_;
};

}  // namespace csg
