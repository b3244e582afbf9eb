// Primitive nodes of the syntax tree → leaves in their own frame.
#pragma once
#include "arguments.hpp"
#include "csg_tree.hpp"
#include "parser.hpp"
#include "tally.hpp"

namespace csg {

struct LeafReading {
  enum class Outcome : std::uint8_t {
    Solid,        ///< `leaf` has kind and size; its centre stands at `center`
    Empty,        ///< as OpenSCAD reads it: zero or negative size, or nothing to extrude
    Unsupported,  ///< `fault` says what it is
  };
  Outcome outcome = Outcome::Empty;
  Leaf leaf;
  Vec3 center;
  const char* fault = nullptr;
};

class LeafReader {
 public:
  LeafReader(const Source& source, const SyntaxTree& tree, Tally& warnings)
      : source_(source), tree_(tree), warnings_(warnings) {}

  static bool reads(NodeKind kind);
  /// The node at `index`, of a kind that it reads; a rotate_extrude is read with its children.
  LeafReading read(std::uint32_t index);

 private:
  LeafReading sphere(const SyntaxNode& node);
  LeafReading cube(const SyntaxNode& node);
  LeafReading cylinder(const SyntaxNode& node);
  LeafReading torus(std::uint32_t index);

  LeafReading empty(const SyntaxNode& node);
  void warn_of_facets(const SyntaxNode& node, const Arguments& arguments, const char* shape, const char* facetted);

  const Source& source_;
  const SyntaxTree& tree_;
  Tally& warnings_;
};

}  // namespace csg
