// The list of schemes.def as data, and the checking of their parameters.
#include <stdexcept>

#include "params.hpp"

namespace csg {

#define SCHEME(name) extern const SchemeInfo scheme_##name;
#include "schemes/schemes.def"
#undef SCHEME

const std::vector<const SchemeInfo*>& schemes() {
  static const std::vector<const SchemeInfo*> all{
#define SCHEME(name) &scheme_##name,
#include "schemes/schemes.def"
#undef SCHEME
  };
  return all;
}

const SchemeInfo& scheme(const std::string& name) {
  std::string known;
  for (const SchemeInfo* info : schemes()) {
    if (info->name == name) return *info;
    known += (known.empty() ? "" : ", ") + info->name;
  }
  throw std::invalid_argument("unknown scheme '" + name + "'; known: " + known);
}

namespace {

void check(const std::string& scheme, const ParamSpec& spec, const ParamValue& value) {
  const std::string where = scheme + ": parameter '" + spec.name + "' ";
  if (value.index() != spec.default_value.index())
    throw std::invalid_argument(where + "wants " + (spec.choices.empty() ? "a whole number" : "a word"));
  if (const long* number = std::get_if<long>(&value)) {
    if (*number < spec.minimum || *number > spec.maximum)
      throw std::invalid_argument(where + "is " + std::to_string(*number) + ", outside " +
                                  std::to_string(spec.minimum) + ".." + std::to_string(spec.maximum));
    return;
  }
  std::string known;
  for (const std::string& choice : spec.choices) {
    if (choice == std::get<std::string>(value)) return;
    known += (known.empty() ? "" : ", ") + choice;
  }
  throw std::invalid_argument(where + "is '" + std::get<std::string>(value) + "'; known: " + known);
}

}  // namespace

Params::Params(const std::string& scheme, const std::vector<ParamSpec>& specs,
               const std::map<std::string, ParamValue>& given) {
  std::string known;
  for (const ParamSpec& spec : specs) {
    values_[spec.name] = spec.default_value;
    known += (known.empty() ? "" : ", ") + spec.name;
  }
  for (const auto& [name, value] : given) {
    if (!values_.contains(name))
      throw std::invalid_argument(scheme + ": unknown parameter '" + name +
                                  "'; known: " + (known.empty() ? "none" : known));
    for (const ParamSpec& spec : specs)
      if (spec.name == name) check(scheme, spec, value);
    values_[name] = value;
  }
}

int Params::integer(const std::string& name) const { return static_cast<int>(std::get<long>(values_.at(name))); }
const std::string& Params::choice(const std::string& name) const { return std::get<std::string>(values_.at(name)); }

}  // namespace csg
