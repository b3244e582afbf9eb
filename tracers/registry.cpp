// The list of schemes.def as data, and the checking of their parameters.
#include <algorithm>
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
  std::string known;
  for (const std::string& choice : spec.choices) known += (known.empty() ? "" : ", ") + choice;
  if (value.index() != spec.default_value.index())
    throw std::invalid_argument(where + "wants " + (known.empty() ? "a whole number" : "a word: " + known));
  if (const long* number = std::get_if<long>(&value)) {
    if (*number < spec.minimum || *number > spec.maximum)
      throw std::invalid_argument(where + "is " + std::to_string(*number) + ", outside " +
                                  std::to_string(spec.minimum) + ".." + std::to_string(spec.maximum));
    return;
  }
  if (std::ranges::find(spec.choices, std::get<std::string>(value)) != spec.choices.end()) return;
  throw std::invalid_argument(where + "is '" + std::get<std::string>(value) + "'; known: " + known);
}

const ParamSpec* find(const std::vector<ParamSpec>& specs, const std::string& name) {
  for (const ParamSpec& spec : specs)
    if (spec.name == name) return &spec;
  return nullptr;
}

ParamSpec choice_of(std::string name, std::string meaning, std::vector<std::string> choices) {
  ParamSpec spec{
      .name = std::move(name), .meaning = std::move(meaning), .default_value = choices[0], .implied_by_default = true};
  for (const std::string& choice : choices) spec.trial_values.emplace_back(choice);
  spec.choices = std::move(choices);
  return spec;
}

}  // namespace

const std::vector<ParamSpec>& numerics_params() {
  static const std::vector<ParamSpec> specs{
      choice_of("precision", "scalar of the kernels", {"float64", "float32"}),
      choice_of("torus", "solver of the torus' quartic", {"robust", "ferrari", "algorithm_1010"}),
      choice_of("tie_band", "within which crossings are one: multiples of E, or model units",
                {"16E", "0", "4E", "64E", "fixed_5e-4"}),
      choice_of("shadow", "how far off a surface shadow rays start: 16 bands, or model units",
                {"band", "0", "fixed_1e-4", "fixed_5e-4"}),
  };
  return specs;
}

Params::Params(const SchemeInfo& scheme, const std::map<std::string, ParamValue>& given) {
  std::vector<ParamSpec> specs = scheme.params;
  if (!scheme.own_numerics) specs.insert(specs.end(), numerics_params().begin(), numerics_params().end());
  std::string known;
  for (const ParamSpec& spec : specs) {
    values_[spec.name] = spec.default_value;
    if (spec.implied_by_default) implied_[spec.name] = spec.default_value;
    known += (known.empty() ? "" : ", ") + spec.name;
  }
  for (const auto& [name, value] : given) {
    const ParamSpec* spec = find(specs, name);
    if (!spec)
      throw std::invalid_argument(scheme.name + ": unknown parameter '" + name +
                                  "'; known: " + (known.empty() ? "none" : known));
    check(scheme.name, *spec, value);
    values_[name] = value;
  }
}

int Params::integer(const std::string& name) const { return static_cast<int>(std::get<long>(values_.at(name))); }
const std::string& Params::choice(const std::string& name) const { return std::get<std::string>(values_.at(name)); }

Numerics Params::numerics() const {
  Numerics numerics;
  if (!values_.contains("precision")) return numerics;
  if (choice("precision") == "float32") numerics.precision = Precision::Float32;
  if (choice("torus") == "ferrari") numerics.torus = TorusSolver::Ferrari;
  if (choice("torus") == "algorithm_1010") numerics.torus = TorusSolver::Algorithm1010;
  const auto length_of = [](const std::string& text) { return std::stod(text.substr(text.find('_') + 1)); };
  const std::string &band = choice("tie_band"), &shadow = choice("shadow");
  if (band.ends_with('E') || band == "0")
    numerics.band_in_E = std::stod(band);
  else
    numerics.fixed_band = length_of(band);
  if (shadow != "band") numerics.fixed_shadow = length_of(shadow);
  return numerics;
}

std::map<std::string, ParamValue> Params::values() const {
  std::map<std::string, ParamValue> values = values_;
  for (const auto& implied : implied_)
    if (values.at(implied.first) == implied.second) values.erase(implied.first);
  return values;
}

}  // namespace csg
