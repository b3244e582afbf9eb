// Every scheme of schemes.def at its defaults, on rays of the model's own picture; and the least that any could do.
#include "../hit_rule.hpp"
#include "bench.hpp"

namespace csg::bench {
namespace {

using Batches = std::vector<std::vector<Ray>>;

void trace(benchmark::State& state, const Tracer& tracer, const Batches& batches, bool is_shadow) {
  std::vector<Hit> hits;
  std::vector<std::uint8_t> blocked;
  std::size_t rays = 0;
  for (const auto& batch : batches) rays += batch.size();
  measure(state, "s_per_ray", rays, [&] {
    for (const auto& batch : batches) {
      hits.resize(batch.size());
      blocked.resize(batch.size());
      if (is_shadow)
        tracer.occluded(batch, blocked, nullptr);
      else
        tracer.trace(batch, hits, nullptr);
    }
    benchmark::DoNotOptimize(hits.data());
    benchmark::DoNotOptimize(blocked.data());
  });
}

/// A ray with the leaves that it enters before its hit, and the hit.
struct Known {
  Ray ray;
  std::vector<const Leaf*> entered;
  Hit hit;
  std::uint8_t face = 0;
};

std::vector<Known> known(const CsgTree& model, const Tracer& exact, const Batches& batches) {
  std::vector<Known> out;
  for (const auto& batch : batches) {
    std::vector<Hit> hits(batch.size());
    exact.trace(batch, hits, nullptr);
    for (std::size_t i = 0; i < batch.size(); ++i) {
      Known one{batch[i], {}, hits[i]};
      const double end = std::min(one.hit.t, one.ray.t_max);
      for (const Leaf& leaf : model.leaves()) {
        const Crossings found = crossings(leaf, one.ray);
        if (found.count == 0 || !(found.t[0] <= end && found.t[found.count - 1] > one.ray.t_min)) continue;
        one.entered.push_back(&leaf);
        for (int k = 0; k < found.count; ++k)
          if (found.t[k] == one.hit.t) one.face = found.face[k];
      }
      out.push_back(std::move(one));
    }
  }
  return out;
}

/// What remains if it costs nothing to know which primitives to test: their kernels, and the normal of a hit that is
/// shaded.
void least(benchmark::State& state, const CsgTree& model, const std::vector<Known>& rays, bool is_shadow) {
  std::size_t entered = 0;
  for (const Known& one : rays) entered += one.entered.size();
  measure(state, "s_per_ray", rays.size(), [&] {
    for (const Known& one : rays) {
      for (const Leaf* leaf : one.entered) {
        Crossings found = crossings(*leaf, one.ray);
        benchmark::DoNotOptimize(found);
      }
      if (is_shadow || one.hit.leaf < 0) continue;
      const Leaf& on = model.leaves()[static_cast<std::size_t>(one.hit.leaf)];
      Vec3 normal = unit_normal(on, one.face, one.ray, one.hit.t);
      benchmark::DoNotOptimize(normal);
    }
  });
  state.counters["primitives"] = static_cast<double>(entered) / static_cast<double>(rays.size());
}

/// A scheme with some of its parameters.
struct Setting {
  const SchemeInfo* scheme;
  std::map<std::string, ParamValue> given;

  std::string name() const {
    return scheme->name + (given.empty() ? "" : " packet=" + std::to_string(std::get<long>(given.at("packet"))));
  }

  std::unique_ptr<Tracer> build(const Model& model) const {
    Params params(*scheme, given);
    if (scheme->needs_mesh) params.mesh = model.mesh;
    return scheme->make(model.tree, params);
  }
};

/// Every scheme at its defaults; and, if it takes rays in packets, one at a time, or the other way round.
std::vector<Setting> settings() {
  std::vector<Setting> out;
  for (const SchemeInfo* scheme : schemes()) {
    out.push_back({scheme, {}});
    for (const ParamSpec& param : scheme->params)
      if (param.name == "packet")
        out.push_back({scheme, {{"packet", param.default_value == ParamValue{1L} ? 16L : 1L}}});
  }
  return out;
}

}  // namespace

void add_schemes(const Model& model) {
  for (const bool is_shadow : {false, true}) {
    const std::string name = "scheme/least/" + model.name + (is_shadow ? "/shadow" : "/primary");
    const auto rays = std::make_shared<std::vector<Known>>();  // worked out when first run
    benchmark::RegisterBenchmark(name.c_str(), [&model, rays, is_shadow](benchmark::State& state) {
      if (rays->empty())
        *rays = known(*model.tree, *Setting{&scheme("hybrid_sdsm"), {}}.build(model),
                      is_shadow ? model.shadow : model.primary);
      least(state, *model.tree, *rays, is_shadow);
    });
  }
  for (const Setting& setting : settings()) {
    const auto tracer = std::make_shared<std::unique_ptr<Tracer>>();  // built when first run
    for (const bool is_shadow : {false, true}) {
      const std::string name = "scheme/" + setting.name() + "/" + model.name + (is_shadow ? "/shadow" : "/primary");
      benchmark::RegisterBenchmark(name.c_str(), [&model, setting, tracer, is_shadow](benchmark::State& state) {
        try {
          if (!*tracer) *tracer = setting.build(model);
        } catch (const std::exception& error) {
          return state.SkipWithError(error.what());
        }
        trace(state, **tracer, is_shadow ? model.shadow : model.primary, is_shadow);
      });
    }
  }
}

}  // namespace csg::bench
