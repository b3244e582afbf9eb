// Checks a tree and derives what every scheme needs of it: inverses, world bounds, size, pad.
#include "csg_tree.hpp"

#include <utility>

#include "../error_unit.hpp"
#include "../primitives/primitive.hpp"
#include "../structures/parallel.hpp"
#include "invert.hpp"

namespace csg {
namespace {

const char* name_of(Kind kind) {
  switch (kind) {
    case Kind::Sphere:
      return "sphere";
    case Kind::Block:
      return "block";
    case Kind::Cylinder:
      return "cylinder";
    case Kind::Cone:
      return "cone";
    case Kind::Torus:
      return "torus";
  }
  return "halfspace of unknown kind";
}

int sizes_of(Kind kind) {
  switch (kind) {
    case Kind::Sphere:
      return 1;
    case Kind::Cylinder:
    case Kind::Torus:
      return 2;
    case Kind::Block:
    case Kind::Cone:
      break;
  }
  return 3;
}

bool finite(Vec3 v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

/// What is wrong with a leaf's sizes, or nullptr.
const char* fault_of_sizes(const Leaf& leaf) {
  const double* size = leaf.size;
  for (int i = 0; i < sizes_of(leaf.kind); ++i) {
    if (!std::isfinite(size[i])) return "a size is not finite";
  }
  if (leaf.kind == Kind::Cone) {
    const bool solid = size[0] >= 0 && size[1] >= 0 && size[0] + size[1] > 0 && size[2] > 0;
    return solid ? nullptr : "a size is not positive";
  }
  for (int i = 0; i < sizes_of(leaf.kind); ++i) {
    if (!(size[i] > 0)) return "a size is not positive";
  }
  if (leaf.kind == Kind::Torus && size[0] < size[1]) {
    return "a torus whose major radius is less than its minor radius";
  }
  return nullptr;
}

/// The tight world bounds of a placed primitive, from its support along each world axis.
Box world_bounds(const Leaf& leaf) {
  Box box;
  for (int axis = 0; axis < 3; ++axis) {
    Vec3 along;
    along[axis] = 1;
    box.hi[axis] = support(leaf, along)[axis];
    along[axis] = -1;
    box.lo[axis] = support(leaf, along)[axis];
  }
  return box;
}

/// What is wrong with a leaf, or nullptr.
const char* derive(Leaf& leaf) {
  if (const char* fault = fault_of_sizes(leaf)) return fault;
  const Inverse inverse = invert(leaf.world_from_local.linear);
  if (!inverse.usable()) return "its transform is singular or not finite";
  leaf.local_from_world = inverse.matrix;
  leaf.condition = inverse.condition;
  leaf.is_translation = is_identity(leaf.world_from_local.linear);
  leaf.bounds = world_bounds(leaf);
  leaf.unit = std::ldexp(1.0, std::ilogb(local_radius(leaf)));
  leaf.reach = local_radius(leaf) * largest_stretch(leaf.world_from_local.linear);
  return finite(leaf.bounds.lo) && finite(leaf.bounds.hi) ? nullptr : "its bounds are not finite";
}

/// All leaves, by all cores; the first that something is wrong with is refused.
void derive_all(std::vector<Leaf>& leaves) {
  constexpr std::size_t kBatch = 8192;
  struct Refused {
    std::size_t leaf = 0;
    const char* fault = nullptr;
  };
  std::vector<Refused> refused((leaves.size() + kBatch - 1) / kBatch);
  in_parallel(thread_count(0), refused.size(), [&](std::size_t batch, std::size_t) {
    const std::size_t end = std::min((batch + 1) * kBatch, leaves.size());
    for (std::size_t i = batch * kBatch; i < end && !refused[batch].fault; ++i) refused[batch] = {i, derive(leaves[i])};
  });
  for (const auto& [i, fault] : refused)
    if (fault) throw ModelError("leaf " + std::to_string(i) + " (" + name_of(leaves[i].kind) + "): " + fault);
}

[[noreturn]] void refuse_node(std::size_t index, const char* fault) {
  throw ModelError("node " + std::to_string(index) + ": " + fault);
}

struct RootBounds {
  Box tight, padded;
};

/// Refuses nodes that are not one tree in post-order with each leaf used once. Returns the S-bounds
/// of the root by Figure 5, upwards. The stack holds the subtrees that still wait for their parent.
RootBounds checked_bounds(const std::vector<Leaf>& leaves, const std::vector<Node>& nodes) {
  struct Subtree {
    std::int32_t root;
    RootBounds bounds;
  };
  std::vector<Subtree> waiting;
  std::vector<bool> used(leaves.size(), false);
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    const Node& node = nodes[i];
    const auto root = static_cast<std::int32_t>(i);
    if (node.op == Op::Leaf) {
      const auto leaf = static_cast<std::size_t>(node.left);
      if (node.left < 0 || leaf >= leaves.size()) refuse_node(i, "no such leaf");
      if (used[leaf]) refuse_node(i, "its leaf is used twice");
      used[leaf] = true;
      waiting.push_back({root, {leaves[leaf].bounds, leaves[leaf].bounds.padded(leaves[leaf].pad)}});
      continue;
    }
    if (node.op > Op::Difference) refuse_node(i, "no such operator");
    const bool in_post_order =
        waiting.size() >= 2 && node.right == waiting.back().root && node.left == waiting[waiting.size() - 2].root;
    if (!in_post_order) refuse_node(i, "its children do not stand in post-order");
    const RootBounds right = waiting.back().bounds;
    waiting.pop_back();
    Subtree& left = waiting.back();
    RootBounds& bounds = left.bounds;
    if (node.op == Op::Union) bounds = {hull(bounds.tight, right.tight), hull(bounds.padded, right.padded)};
    if (node.op == Op::Intersection)
      bounds = {intersection(bounds.tight, right.tight), intersection(bounds.padded, right.padded)};
    left.root = root;
  }
  if (waiting.size() != 1) throw ModelError("the nodes are not one tree");
  if (nodes.size() != 2 * leaves.size() - 1) throw ModelError("some leaves stand in no node");
  return waiting.back().bounds;
}

}  // namespace

CsgTree::CsgTree(std::vector<Leaf> leaves, std::vector<Node> nodes, std::vector<std::string> warnings,
                 const Numerics& numerics)
    : leaves_(std::move(leaves)), nodes_(std::move(nodes)), warnings_(std::move(warnings)), numerics_(numerics) {
  if (leaves_.empty() || nodes_.empty()) throw ModelError("the model is empty");
  if (leaves_.size() > std::size_t{1} << 30) throw ModelError("more than 2^30 halfspaces");
  Box all;
  derive_all(leaves_);
  for (Leaf& leaf : leaves_) {
    leaf.precision = numerics.precision;
    leaf.torus = numerics.torus;
    all = hull(all, leaf.bounds);
  }
  const Vec3 diagonal = all.hi - all.lo, center = all.center();
  size_ = std::hypot(diagonal.x, diagonal.y, diagonal.z) + std::hypot(center.x, center.y, center.z);
  if (!std::isfinite(size_)) throw ModelError("the size of the model is not finite");
  tolerances_ = Tolerances(numerics_, size_);
  for (Leaf& leaf : leaves_) leaf.pad = tolerances_.pad(leaf.condition);
  const RootBounds root = checked_bounds(leaves_, nodes_);
  bounds_ = root.tight;
  world_ = root.padded;
}

std::size_t CsgTree::bytes() const {
  std::size_t total = sizeof(*this) + leaves_.capacity() * sizeof(Leaf) + nodes_.capacity() * sizeof(Node) +
                      warnings_.capacity() * sizeof(std::string);
  for (const std::string& warning : warnings_) total += warning.capacity();
  return total;
}

CsgTree CsgTree::scaled(int exponent) const {
  std::vector<Leaf> leaves = leaves_;
  for (Leaf& leaf : leaves) {
    for (double& size : leaf.size) size = std::ldexp(size, exponent);
    for (int axis = 0; axis < 3; ++axis) {
      double& offset = leaf.world_from_local.offset[axis];
      offset = std::ldexp(offset, exponent);
    }
  }
  return CsgTree(std::move(leaves), nodes_, warnings_, numerics_);
}

}  // namespace csg
