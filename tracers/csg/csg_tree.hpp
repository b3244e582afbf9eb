// The model: a binary tree of Boolean operators over halfspaces, as every scheme receives it.
#pragma once
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "../error_unit.hpp"
#include "../vec.hpp"

namespace csg {

/// A model that cannot be used; what() is one line, `file:line:col: message` where there is a file.
struct ModelError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// The halfspaces of Figure 7 (Kind::Block is OpenSCAD's cube), and a sphere.
enum class Kind : std::uint8_t { Sphere, Block, Cylinder, Cone, Torus };

/// A halfspace: a bounded primitive centred on its local origin, axis z, placed by an affine map.
struct Leaf {
  Kind kind = Kind::Sphere;
  /// Sphere: radius. Block: three half extents. Cylinder: radius, half height.
  /// Cone: radius at -half height, radius at +half height, half height. Torus: major, minor radius.
  double size[3] = {0, 0, 0};
  Affine world_from_local;
  bool has_color = false;
  float color[3] = {0, 0, 0};  ///< OpenSCAD's color(), linear 0..1; outermost wins as in OpenSCAD

  // Derived by CsgTree; never set by a loader.
  Mat3 local_from_world;        ///< inverse of world_from_local.linear
  bool is_translation = false;  ///< world_from_local.linear is the identity
  double condition = 1;         ///< of world_from_local.linear, Frobenius
  double reach = 0;             ///< radius of a ball around the centre that holds the leaf, up to rounding
  Box bounds;                   ///< world, tight up to rounding, not padded
  double pad = 0;               ///< how much boxes grow before the leaf is judged by them (rule 9)
  double unit = 1;              ///< a power of two near the local radius: float kernels compute in it
  Precision precision = Precision::Float64;
  TorusSolver torus = TorusSolver::Robust;
};

enum class Op : std::uint8_t { Leaf, Union, Intersection, Difference };

/// `left` is the leaf's index for Op::Leaf; else `left` and `right` are indices of nodes.
struct Node {
  Op op = Op::Leaf;
  std::int32_t left = -1;
  std::int32_t right = -1;
};

/// Immutable. Nodes stand in post-order (children before parents, the root last), so that no walk
/// over a tree of any depth needs recursion. Leaves are numbered in the order of the source.
class CsgTree {
 public:
  /// Completes the leaves' derived fields. Throws ModelError if the tree is empty, a number is not
  /// finite, a size is not positive, a torus has major < minor, or a transform is singular.
  CsgTree(std::vector<Leaf> leaves, std::vector<Node> nodes, std::vector<std::string> warnings = {},
          const Numerics& numerics = {});

  const std::vector<Leaf>& leaves() const { return leaves_; }
  const std::vector<Node>& nodes() const { return nodes_; }
  const std::vector<std::string>& warnings() const { return warnings_; }

  Box bounds() const { return bounds_; }  ///< S-bound of the root (Figure 5, upwards), not padded
  /// The same from leaves' bounds that are grown by their pads: outside of it, no ray finds a surface.
  const Box& world() const { return world_; }
  double size() const { return size_; }  ///< the `size` of the hit rule: extent of all leaves and their distance from 0
  double pad() const { return tolerances_.pad(); }  ///< P of the hit rule, rule 9
  const Tolerances& tolerances() const { return tolerances_; }
  const Numerics& numerics() const { return numerics_; }
  std::size_t bytes() const;

  /// The same model in units 2^exponent times as large: every answer scales without rounding.
  CsgTree scaled(int exponent) const;
  /// The same model, its crossings computed in another way.
  CsgTree computed(const Numerics& numerics) const { return CsgTree(leaves_, nodes_, warnings_, numerics); }

 private:
  std::vector<Leaf> leaves_;
  std::vector<Node> nodes_;
  std::vector<std::string> warnings_;
  Box bounds_, world_;
  double size_ = 0;
  Numerics numerics_;
  Tolerances tolerances_;
};

}  // namespace csg
