// Parameters of a scheme: declared with type, default, range and meaning; checked before building.
#pragma once
#include <map>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include "tracer.hpp"

namespace csg {

using ParamValue = std::variant<long, std::string>;

struct ParamSpec {
  std::string name;
  std::string meaning;
  ParamValue default_value;
  long minimum = 0, maximum = 0;           ///< of an int
  std::vector<std::string> choices{};      ///< of a choice
  std::vector<ParamValue> trial_values{};  ///< what the conformance suite tries
  bool implied_by_default = false;         ///< not named where it has its default: it changes no answer
};

/// What every scheme has besides its own parameters: precision, and the knobs of the accuracy study.
const std::vector<ParamSpec>& numerics_params();

struct SchemeInfo;

/// Every declared parameter of a scheme with its value.
class Params {
 public:
  /// Throws std::invalid_argument on an unknown name, naming the known, and on a bad value.
  Params(const SchemeInfo& scheme, const std::map<std::string, ParamValue>& given);

  int integer(const std::string& name) const;
  const std::string& choice(const std::string& name) const;
  Numerics numerics() const;
  /// All but those that are implied by default, and are at their default: numerics, limits of building.
  std::map<std::string, ParamValue> values() const;

  std::shared_ptr<const TriangleMesh> mesh;  ///< for the schemes that trace one

 private:
  std::map<std::string, ParamValue> values_, implied_;
};

struct SchemeInfo {
  std::string name;
  std::string title;
  bool exact = true;  ///< same leaf, normal and bits of t as naive, for every ray
  bool needs_mesh = false;
  bool own_numerics = false;  ///< computes in a way of its own: numerics_params are none of its parameters
  std::vector<ParamSpec> params{};
  std::unique_ptr<Tracer> (*make)(std::shared_ptr<const CsgTree>, const Params&) = nullptr;
};

/// All schemes of schemes.def, in its order.
const std::vector<const SchemeInfo*>& schemes();

/// Throws std::invalid_argument naming the known schemes.
const SchemeInfo& scheme(const std::string& name);

}  // namespace csg
