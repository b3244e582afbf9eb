// micro FOLDER MODEL… [--benchmark_…]: reads the models, takes the rays of their pictures, runs all.
#include <fstream>
#include <iostream>
#include <iterator>
#include <stdexcept>

#include "../csg/loader.hpp"
#include "../render/render.hpp"
#include "bench.hpp"

namespace csg::bench {
namespace {

constexpr std::size_t kEveryTile = 13;  // of the picture is traced: a prime, for a tile in each column

std::ifstream open(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error(path + ": cannot be read");
  return file;
}

std::istream& operator>>(std::istream& in, Vec3& v) { return in >> v.x >> v.y >> v.z; }

/// eye, look_at, up, fov_deg, width, height; then position and colour of each light.
View read_view(std::istream&& in) {
  View view;
  in >> view.eye >> view.look_at >> view.up >> view.fov_deg >> view.width >> view.height;
  for (Light light; in >> light.position >> light.color;) view.lights.push_back(light);
  return view;
}

template <class T>
void read(std::istream& in, std::vector<T>& out, std::size_t count) {
  out.resize(count);
  in.read(reinterpret_cast<char*>(out.data()), static_cast<std::streamsize>(count * sizeof(T)));
}

/// Numbers of vertices and of triangles, uint64; then the fields of TriangleMesh.
TriangleMesh read_mesh(std::istream&& in) {
  TriangleMesh mesh;
  std::vector<std::uint64_t> counts;
  read(in, counts, 2);
  read(in, mesh.vertices, counts[0]);
  read(in, mesh.triangles, 3 * counts[1]);
  read(in, mesh.leaf_of_triangle, counts[1]);
  if (!in) throw std::runtime_error("a mesh ends too soon");
  return mesh;
}

/// Passes rays on to another tracer and keeps them.
class Recorder final : public Tracer {
 public:
  explicit Recorder(const Tracer& inner, std::shared_ptr<const CsgTree> tree)
      : Tracer(std::move(tree)), inner_(inner) {}

  std::size_t bytes() const override { return 0; }

  mutable std::vector<std::vector<Ray>> primary, shadow;

 private:
  void trace_batch(std::span<const Ray> rays, std::span<Hit> hits, Counters* counters) const override {
    primary.emplace_back(rays.begin(), rays.end());
    inner_.trace(rays, hits, counters);
  }
  void occluded_batch(std::span<const Ray> rays, std::span<std::uint8_t> blocked, Counters* counters) const override {
    shadow.emplace_back(rays.begin(), rays.end());
    inner_.occluded(rays, blocked, counters);
  }

  const Tracer& inner_;
};

std::vector<std::vector<Ray>> sampled(const std::vector<std::vector<Ray>>& batches) {
  std::vector<std::vector<Ray>> out;
  for (std::size_t i = 0; i < batches.size(); i += kEveryTile) out.push_back(batches[i]);
  return out;
}

}  // namespace

Model load_model(const std::string& folder, const std::string& name) {
  const std::string path = folder + "/" + name;
  Model model;
  model.name = name;
  std::ifstream csg = open(path + ".csg");
  model.text.assign(std::istreambuf_iterator<char>(csg), {});
  model.tree = std::make_shared<CsgTree>(parse_csg(model.text, path + ".csg"));
  model.mesh = std::make_shared<TriangleMesh>(read_mesh(open(path + ".mesh")));
  const SchemeInfo& exact = scheme("hybrid_sdsm");
  const auto tracer = exact.make(model.tree, Params(exact, {}));
  const Recorder recorder(*tracer, model.tree);
  const View view = read_view(open(path + ".view"));
  Picture picture(view.width, view.height);
  render(recorder, view, picture);
  model.primary = sampled(recorder.primary);
  model.shadow = sampled(recorder.shadow);
  return model;
}

}  // namespace csg::bench

int main(int argc, char** argv) {
  using namespace csg::bench;
  benchmark::Initialize(&argc, argv);
  if (argc < 3) {
    std::cerr << "usage: micro FOLDER MODEL… [--benchmark_…]\n";
    return 2;
  }
  try {
    std::vector<std::unique_ptr<const Model>> models;
    add_kernels();
    for (int i = 2; i < argc; ++i) {
      models.push_back(std::make_unique<const Model>(load_model(argv[1], argv[i])));
      add_structures(*models.back());
      add_schemes(*models.back());
    }
    benchmark::RunSpecifiedBenchmarks();
  } catch (const std::exception& error) {
    std::cerr << error.what() << '\n';
    return 1;
  }
}
