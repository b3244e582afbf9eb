// .csg text → a syntax tree of every node kind that OpenSCAD emits, as written and unjudged.
//
//   node  = modifier* kind "(" [argument {"," argument}] ")" (";" | "{" node* "}")
//   value = number | true | false | undef | string | "[" [value {"," value}] "]"
//
// Nodes and values stand in pre-order in flat arrays; `end` is the index past a node's or a list's
// descendants. So `i + 1` is the first child and `end` the next sibling, and no depth of nesting
// needs recursion.
#pragma once
#include <cstdint>
#include <string_view>
#include <vector>

#include "lexer.hpp"

namespace csg {

enum class NodeKind : std::uint8_t {
  Group,
  Union,
  Difference,
  Intersection,
  Multmatrix,
  Color,
  Render,
  Cube,
  Sphere,
  Cylinder,
  RotateExtrude,
  Circle,
  Hull,
  Minkowski,
  Resize,
  Polyhedron,
  LinearExtrude,
  Projection,
  Offset,
  Import,
  Surface,
  Square,
  Polygon,
  Text
};
std::string_view name_of(NodeKind kind);

struct Modifiers {
  bool root : 1 = false;        ///< ! only this subtree
  bool highlight : 1 = false;   ///< # no meaning for the solid
  bool background : 1 = false;  ///< % not part of the solid
  bool disabled : 1 = false;    ///< * as if it did not stand there

  bool left_out() const { return background || disabled; }
};

struct Value {
  enum class Kind : std::uint8_t { Undef, Boolean, Number, String, List };
  Kind kind = Kind::Undef;
  std::uint32_t offset = 0;  ///< in the source
  std::uint32_t end = 0;
  double number = 0;  ///< of a Number; of a Boolean 0 or 1
};

struct Argument {
  std::string_view name;    ///< empty for a positional one
  std::uint32_t value = 0;  ///< index
};

struct SyntaxNode {
  NodeKind kind = NodeKind::Group;
  Modifiers modifiers;
  std::uint32_t offset = 0;  ///< of the kind's name in the source
  std::uint32_t end = 0;
  std::uint32_t first_argument = 0, end_argument = 0;
};

struct SyntaxTree {
  std::vector<SyntaxNode> nodes;
  std::vector<Argument> arguments;
  std::vector<Value> values;
};

/// Throws ModelError at the first token that does not fit. The tree points into the source's text.
SyntaxTree parse(const Source& source);

}  // namespace csg
