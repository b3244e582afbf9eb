#include "arguments.hpp"

#include <algorithm>
#include <cmath>

namespace csg {

Arguments::Arguments(const Source& source, const SyntaxTree& tree, const SyntaxNode& node,
                     std::initializer_list<std::string_view> known)
    : source_(source), tree_(tree), node_(node) {
  for (std::uint32_t i = node.first_argument; i < node.end_argument; ++i) {
    const Argument& argument = tree.arguments[i];
    const bool is_known = std::find(known.begin(), known.end(), argument.name) != known.end() ||
                          argument.name == "$fn" || argument.name == "$fa" || argument.name == "$fs";
    const std::size_t offset = tree.values[argument.value].offset;
    if (!is_known) fail(offset, argument.name, "is not known here");
    if (find(argument.name) != &tree.values[argument.value]) {
      fail(offset, argument.name, "is given twice");
    }
  }
}

double Arguments::number(std::string_view name) const { return finite(require(name), name); }

double Arguments::number_or(std::string_view name, double absent) const {
  const Value* value = find(name);
  if (!value) return absent;
  if (value->kind != Value::Kind::Number) fail(value->offset, name, "is not a number");
  return value->number;
}

bool Arguments::flag_or(std::string_view name, bool absent) const {
  const Value* value = find(name);
  if (!value) return absent;
  if (value->kind != Value::Kind::Boolean) fail(value->offset, name, "is not true or false");
  return value->number != 0;
}

void Arguments::vector(std::string_view name, std::span<double> numbers) const { list(require(name), name, numbers); }

Affine Arguments::matrix() const {
  const Value& rows = require("");
  Affine result;
  std::uint32_t row = static_cast<std::uint32_t>(&rows - tree_.values.data()) + 1;
  for (int r = 0; r < 4; ++r) {
    double entries[4];
    if (rows.kind != Value::Kind::List || row >= rows.end) {
      fail(rows.offset, "", "is not a 4x4 matrix");
    }
    list(tree_.values[row], "", entries);
    row = tree_.values[row].end;
    if (r < 3) {
      for (int c = 0; c < 3; ++c) result.linear.col[c][r] = entries[c];
      result.offset[r] = entries[3];
    } else if (!(entries[0] == 0 && entries[1] == 0 && entries[2] == 0 && entries[3] == 1)) {
      fail(rows.offset, "", "is not affine: the last row must be [0, 0, 0, 1]");
    }
  }
  if (row != rows.end) fail(rows.offset, "", "is not a 4x4 matrix");
  return result;
}

const Value* Arguments::find(std::string_view name) const {
  for (std::uint32_t i = node_.first_argument; i < node_.end_argument; ++i) {
    const Argument& argument = tree_.arguments[i];
    if (argument.name == name) return &tree_.values[argument.value];
  }
  return nullptr;
}

const Value& Arguments::require(std::string_view name) const {
  const Value* value = find(name);
  if (!value) fail(node_.offset, name, "is missing");
  return *value;
}

double Arguments::finite(const Value& value, std::string_view name) const {
  if (value.kind != Value::Kind::Number) fail(value.offset, name, "is not a number");
  if (!std::isfinite(value.number)) fail(value.offset, name, "is not finite");
  return value.number;
}

void Arguments::list(const Value& value, std::string_view name, std::span<double> numbers) const {
  const auto refuse_length = [&] {
    fail(value.offset, name, "is not a list of " + std::to_string(numbers.size()) + " numbers");
  };
  if (value.kind != Value::Kind::List) refuse_length();
  std::uint32_t element = static_cast<std::uint32_t>(&value - tree_.values.data()) + 1;
  for (double& number : numbers) {
    if (element >= value.end) refuse_length();
    number = finite(tree_.values[element], name);
    element = tree_.values[element].end;
  }
  if (element != value.end) refuse_length();
}

void Arguments::fail(std::size_t offset, std::string_view name, const std::string& fault) const {
  source_.fail(offset, std::string(name_of(node_.kind)) + ": " + (name.empty() ? "the argument" : std::string(name)) +
                           " " + fault);
}

}  // namespace csg
