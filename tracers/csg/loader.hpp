// OpenSCAD's evaluated .csg → CsgTree. The one loader that all schemes share.
#pragma once
#include <string>
#include <string_view>

#include "csg_tree.hpp"

namespace csg {

/// How an operator with n children becomes binary.
enum class Shape {
  AsWritten,  ///< left-deep, in the order of the source: ((a ∪ b) ∪ c) ∪ d
  Balanced,   ///< halved by position: (a ∪ b) ∪ (c ∪ d); a − b − c − d is a − ((b ∪ c) ∪ d)
};

/// `name` stands before line:col in messages. Throws ModelError.
CsgTree parse_csg(std::string_view text, const std::string& name, Shape shape = Shape::AsWritten);
/// No name: the path.
CsgTree load_csg(const std::string& path, Shape shape = Shape::AsWritten, const std::string& name = {});

}  // namespace csg
