// What a node's arguments say, checked: every refusal names the node, the argument and the place.
#pragma once
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>

#include "parser.hpp"

namespace csg {

class Arguments {
 public:
  /// Refuses arguments that are not among `known` (nor $fn, $fa, $fs), and those given twice. The
  /// empty name is the positional one.
  Arguments(const Source& source, const SyntaxTree& tree, const SyntaxNode& node,
            std::initializer_list<std::string_view> known);

  double number(std::string_view name) const;                    ///< finite
  double number_or(std::string_view name, double absent) const;  ///< may be inf or NaN
  bool flag_or(std::string_view name, bool absent) const;
  void vector(std::string_view name, std::span<double> numbers) const;  ///< exactly that many
  Affine matrix() const;                                                ///< the positional 4x4

 private:
  const Value* find(std::string_view name) const;  ///< nullptr if absent
  const Value& require(std::string_view name) const;
  double finite(const Value& value, std::string_view name) const;
  void list(const Value& value, std::string_view name, std::span<double> numbers) const;
  [[noreturn]] void fail(std::size_t offset, std::string_view name, const std::string& fault) const;

  const Source& source_;
  const SyntaxTree& tree_;
  const SyntaxNode& node_;
};

}  // namespace csg
