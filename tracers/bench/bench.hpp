// Microbenchmarks by Google Benchmark: single kernels, structures and schemes, apart from any picture.
// `make bench-micro` builds and runs them; harness/micro.py names the models and reads the results.
#pragma once
#include <benchmark/benchmark.h>

#include <string>

#include "../params.hpp"
#include "../render/view.hpp"

namespace csg::bench {

/// A model, and what a picture of it asks of a tracer.
struct Model {
  std::string name, text;  ///< text: of its .csg
  std::shared_ptr<const CsgTree> tree;
  std::shared_ptr<const TriangleMesh> mesh;  ///< for the schemes that trace one
  /// Batches as render() passes them, tile by tile: a sample of the tiles of its picture.
  std::vector<std::vector<Ray>> primary, shadow;
};

/// Reads NAME.csg, NAME.view and NAME.mesh of a folder; harness/micro.py writes them.
Model load_model(const std::string& folder, const std::string& name);

// Each registers a family. Names are family/what/…; the model must outlive the run.
void add_kernels();
void add_structures(const Model& model);
void add_schemes(const Model& model);

/// Runs `once` again and again, and reports seconds an item of those that it works on, under `per_item`.
template <class Once>
void measure(benchmark::State& state, const std::string& per_item, std::size_t items, Once once) {
  for (auto _ : state) once();
  using benchmark::Counter;
  state.counters[per_item] = Counter(static_cast<double>(items), Counter::kIsIterationInvariantRate | Counter::kInvert);
}

}  // namespace csg::bench
