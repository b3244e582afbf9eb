// Every scheme of schemes.def at its defaults, on rays of the model's own picture.
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

std::unique_ptr<Tracer> build(const SchemeInfo& scheme, const Model& model) {
  Params params(scheme, {});
  if (scheme.needs_mesh) params.mesh = model.mesh;
  return scheme.make(model.tree, params);
}

}  // namespace

void add_schemes(const Model& model) {
  for (const SchemeInfo* scheme : schemes()) {
    const auto tracer = std::make_shared<std::unique_ptr<Tracer>>();  // built when first run
    for (const bool is_shadow : {false, true}) {
      const std::string name = "scheme/" + scheme->name + "/" + model.name + (is_shadow ? "/shadow" : "/primary");
      benchmark::RegisterBenchmark(name.c_str(), [&model, scheme, tracer, is_shadow](benchmark::State& state) {
        try {
          if (!*tracer) *tracer = build(*scheme, model);
        } catch (const std::exception& error) {
          return state.SkipWithError(error.what());
        }
        trace(state, **tracer, is_shadow ? model.shadow : model.primary, is_shadow);
      });
    }
  }
}

}  // namespace csg::bench
