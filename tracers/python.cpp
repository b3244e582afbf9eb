// The Python module `tracers`: models in, tracers and pictures out. The only binding, the only clock.
#include <embree3/rtcore.h>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/variant.h>
#include <nanobind/stl/vector.h>

#include <chrono>
#include <cstdio>
#include <cstring>
#include <limits>

#include "csg/loader.hpp"
#include "params.hpp"
#include "primitives/distance.hpp"
#include "render/render.hpp"
#include "structures/audit.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using csg::CsgTree;
using csg::Vec3;
using Triple = std::array<double, 3>;

Vec3 vec(const Triple& v) { return {v[0], v[1], v[2]}; }

class Stopwatch {
 public:
  double seconds() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(); }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// A new numpy array of that shape, filled by `fill(T*)`.
template <class T, class Fill>
nb::object array(std::initializer_list<std::size_t> shape, Fill fill) {
  std::size_t size = 1;
  for (const std::size_t n : shape) size *= n;
  T* data = new T[size ? size : 1];
  fill(data);
  const nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
  return nb::cast(nb::ndarray<nb::numpy, T>(data, shape, owner));
}

template <class T, class Memory>
nb::object copied(const std::vector<T, Memory>& from, std::initializer_list<std::size_t> shape) {
  return array<T>(shape, [&](T* out) { std::copy(from.begin(), from.end(), out); });
}

template <class Memory>
nb::object copied(const std::vector<Vec3, Memory>& from, std::initializer_list<std::size_t> shape) {
  return array<double>(shape, [&](double* out) {
    for (const Vec3& v : from) *out++ = v.x, *out++ = v.y, *out++ = v.z;
  });
}

csg::Shape shape_named(const std::string& name) {
  if (name == "as_written") return csg::Shape::AsWritten;
  if (name == "balanced") return csg::Shape::Balanced;
  throw std::invalid_argument("unknown tree shape '" + name + "'; known: as_written, balanced");
}

constexpr std::array<const char*, 5> kKindNames{"sphere", "block", "cylinder", "cone", "torus"};

using Doubles3 = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Matrices = nb::ndarray<const double, nb::shape<-1, 3, 4>, nb::c_contig, nb::device::cpu>;
using Ints3 = nb::ndarray<const std::int32_t, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Indices3 = nb::ndarray<const std::uint32_t, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Ints = nb::ndarray<const std::int32_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using RayRows = nb::ndarray<const double, nb::shape<-1, 8>, nb::c_contig, nb::device::cpu>;

std::shared_ptr<CsgTree> build_tree(const std::vector<std::string>& kinds, const Doubles3& sizes,
                                    const Matrices& matrices, const Ints3& operators) {
  if (sizes.shape(0) != kinds.size() || matrices.shape(0) != kinds.size())
    throw std::invalid_argument("kinds, sizes and matrices must have one row a leaf");
  std::vector<csg::Leaf> leaves(kinds.size());
  for (std::size_t i = 0; i < kinds.size(); ++i) {
    const auto* kind = std::find(kKindNames.begin(), kKindNames.end(), kinds[i]);
    if (kind == kKindNames.end()) throw std::invalid_argument("unknown kind '" + kinds[i] + "'");
    leaves[i].kind = static_cast<csg::Kind>(kind - kKindNames.begin());
    std::copy_n(sizes.data() + 3 * i, 3, leaves[i].size);
    const double* m = matrices.data() + 12 * i;
    leaves[i].world_from_local = {{{{m[0], m[4], m[8]}, {m[1], m[5], m[9]}, {m[2], m[6], m[10]}}}, {m[3], m[7], m[11]}};
  }
  std::vector<csg::Node> nodes(operators.shape(0));
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    const std::int32_t* row = operators.data() + 3 * i;
    if (row[0] < 0 || row[0] > 3)
      throw std::invalid_argument("operators are 0 leaf, 1 union, 2 intersection, 3 difference");
    nodes[i] = {static_cast<csg::Op>(row[0]), row[1], row[2]};
  }
  return std::make_shared<CsgTree>(std::move(leaves), std::move(nodes));
}

nb::object matrices_of(const CsgTree& tree) {
  return array<double>({tree.leaves().size(), 3, 4}, [&](double* out) {
    for (const csg::Leaf& leaf : tree.leaves())
      for (int row = 0; row < 3; ++row) {
        for (const Vec3& column : leaf.world_from_local.linear.col) *out++ = column[row];
        *out++ = leaf.world_from_local.offset[row];
      }
  });
}

struct BuiltTracer {
  std::unique_ptr<csg::Tracer> tracer;
  double build_s;
};

struct Hits {
  std::vector<csg::Hit> hits;
  double trace_s;
  csg::Counters counters;
};

struct TimedPicture {
  csg::Picture picture;
  double trace_s;
  csg::Counters counters;
};

std::map<std::string, std::uint64_t> as_map(const csg::Counters& c) {
  return {{"cells_entered", c.cells_entered},
          {"bounds_tested", c.bounds_tested},
          {"primitives_tested", c.primitives_tested},
          {"booleans_evaluated", c.booleans_evaluated}};
}

std::vector<csg::Ray> rays_of(const RayRows& rows) {
  std::vector<csg::Ray> rays(rows.shape(0));
  static_assert(sizeof(csg::Ray) == 8 * sizeof(double));
  if (!rays.empty()) std::memcpy(static_cast<void*>(rays.data()), rows.data(), rays.size() * sizeof(csg::Ray));
  return rays;
}

Hits trace(const BuiltTracer& built, const RayRows& rows, bool count) {
  const std::vector<csg::Ray> rays = rays_of(rows);
  Hits out{std::vector<csg::Hit>(rays.size()), 0, {}};
  const nb::gil_scoped_release unlocked;
  const Stopwatch watch;
  built.tracer->trace(rays, out.hits, count ? &out.counters : nullptr);
  out.trace_s = watch.seconds();
  return out;
}

TimedPicture render(const BuiltTracer& built, const csg::View& view, bool count, bool cost, int threads) {
  TimedPicture out{{view.width, view.height, cost}, 0, {}};
  const nb::gil_scoped_release unlocked;
  const Stopwatch watch;
  csg::render(*built.tracer, view, out.picture, count || cost ? &out.counters : nullptr, threads);
  out.trace_s = watch.seconds();
  return out;
}

BuiltTracer make(const std::string& name, std::shared_ptr<CsgTree> tree,
                 const std::map<std::string, csg::ParamValue>& given,
                 const std::optional<std::tuple<Doubles3, Indices3, Ints>>& mesh) {
  const csg::SchemeInfo& info = csg::scheme(name);
  csg::Params params(info, given);
  if (info.needs_mesh != mesh.has_value())
    throw std::invalid_argument(name + (info.needs_mesh ? " needs" : " takes no") + " mesh");
  if (mesh) {
    const auto& [vertices, triangles, leaves] = *mesh;
    auto out = std::make_shared<csg::TriangleMesh>();
    for (std::size_t i = 0; i < vertices.shape(0); ++i) {
      const double* v = vertices.data() + 3 * i;
      out->vertices.push_back({v[0], v[1], v[2]});
    }
    out->triangles.assign(triangles.data(), triangles.data() + triangles.size());
    out->leaf_of_triangle.assign(leaves.data(), leaves.data() + leaves.size());
    if (out->leaf_of_triangle.size() * 3 != out->triangles.size())
      throw std::invalid_argument("mesh: one leaf a triangle is needed");
    for (const std::int32_t leaf : out->leaf_of_triangle)
      if (leaf < 0 || static_cast<std::size_t>(leaf) >= tree->leaves().size())
        throw std::invalid_argument("mesh: a triangle names a leaf that is not there");
    for (const std::uint32_t v : out->triangles)
      if (v >= out->vertices.size()) throw std::invalid_argument("mesh: a triangle names a vertex that is not there");
    params.mesh = std::move(out);
  }
  const nb::gil_scoped_release unlocked;
  std::shared_ptr<const CsgTree> model = std::move(tree);
  if (params.numerics() != model->numerics()) model = std::make_shared<CsgTree>(model->computed(params.numerics()));
  const Stopwatch watch;
  BuiltTracer built{info.make(std::move(model), params), 0};
  built.build_s = watch.seconds();
  return built;
}

std::map<std::string, std::string> machine() {
  const auto embree_version = [] {
    const RTCDevice device = rtcNewDevice(nullptr);
    const ssize_t number = rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_VERSION);
    rtcReleaseDevice(device);
    return std::to_string(number / 10000) + "." + std::to_string(number / 100 % 100) + "." +
           std::to_string(number % 100);
  };
  return {{"compiler", COMPILER}, {"flags", FLAGS}, {"embree", embree_version()}};
}

}  // namespace

NB_MODULE(tracers, m) {
  m.doc() = "Ray tracing of CSG solids by exchangeable acceleration schemes.";
  nb::exception<csg::ModelError>(m, "ModelError", PyExc_ValueError);

  nb::class_<CsgTree>(m, "CsgTree", "A binary CSG tree over halfspaces; immutable.")
      .def_static("build", &build_tree, "kinds"_a, "sizes"_a.noconvert(), "matrices"_a.noconvert(),
                  "operators"_a.noconvert(),
                  "From arrays: kinds (n), sizes (n, 3) float64, matrices (n, 3, 4) float64, operators (2n-1, 3) "
                  "int32 in post-order. Raises ModelError.")
      .def_prop_ro("halfspaces", [](const CsgTree& t) { return t.leaves().size(); })
      .def_prop_ro("nodes", [](const CsgTree& t) { return t.nodes().size(); })
      .def_prop_ro("warnings", &CsgTree::warnings)
      .def_prop_ro("size", &CsgTree::size)
      .def_prop_ro("bytes", &CsgTree::bytes)
      .def_prop_ro(
          "bounds", [](const CsgTree& t) { return copied(std::vector<Vec3>{t.bounds().lo, t.bounds().hi}, {2, 3}); },
          "(2, 3) float64: corners of the solid's S-bound, model units")
      .def_prop_ro("kinds",
                   [](const CsgTree& t) {
                     std::vector<std::string> names;
                     for (const csg::Leaf& leaf : t.leaves())
                       names.emplace_back(kKindNames[static_cast<std::size_t>(leaf.kind)]);
                     return names;
                   })
      .def_prop_ro(
          "sizes",
          [](const CsgTree& t) {
            return array<double>({t.leaves().size(), 3}, [&](double* out) {
              for (const csg::Leaf& leaf : t.leaves()) out = std::copy_n(leaf.size, 3, out);
            });
          },
          "(n, 3) float64")
      .def_prop_ro("matrices", &matrices_of, "(n, 3, 4) float64, world from local")
      .def_prop_ro(
          "colors",
          [](const CsgTree& t) {
            return array<float>({t.leaves().size(), 3}, [&](float* out) {
              for (const csg::Leaf& leaf : t.leaves())
                for (const float channel : leaf.color)
                  *out++ = leaf.has_color ? channel : std::numeric_limits<float>::quiet_NaN();
            });
          },
          "(n, 3) float32, NaN where the source gives none")
      .def_prop_ro(
          "operators",
          [](const CsgTree& t) {
            return array<std::int32_t>({t.nodes().size(), 3}, [&](std::int32_t* out) {
              for (const csg::Node& node : t.nodes())
                *out++ = static_cast<int>(node.op), *out++ = node.left, *out++ = node.right;
            });
          },
          "(nodes, 3) int32: operator, left, right")
      .def(
          "scaled", [](const CsgTree& t, int exponent) { return std::make_shared<CsgTree>(t.scaled(exponent)); },
          "exponent"_a, "The model in units 2**exponent times as large.");

  m.def(
      "load_csg",
      [](const std::string& path, const std::string& shape, const std::string& name) {
        return std::make_shared<CsgTree>(csg::load_csg(path, shape_named(shape), name));
      },
      "path"_a, "shape"_a = "as_written", "name"_a = "",
      "Loads OpenSCAD's evaluated .csg. Raises ModelError `file:line:col: …`, with `name` for the file if there is "
      "one.");
  m.def(
      "parse_csg",
      [](const std::string& text, const std::string& name, const std::string& shape) {
        return std::make_shared<CsgTree>(csg::parse_csg(text, name, shape_named(shape)));
      },
      "text"_a, "name"_a = "<text>", "shape"_a = "as_written");

  nb::class_<csg::ParamSpec>(m, "Parameter")
      .def_ro("name", &csg::ParamSpec::name)
      .def_ro("meaning", &csg::ParamSpec::meaning)
      .def_ro("default", &csg::ParamSpec::default_value)
      .def_ro("minimum", &csg::ParamSpec::minimum)
      .def_ro("maximum", &csg::ParamSpec::maximum)
      .def_ro("choices", &csg::ParamSpec::choices)
      .def_ro("trial_values", &csg::ParamSpec::trial_values)
      .def_prop_ro("type", [](const csg::ParamSpec& p) { return p.choices.empty() ? "int" : "choice"; });
  nb::class_<csg::SchemeInfo>(m, "Scheme")
      .def_ro("name", &csg::SchemeInfo::name)
      .def_ro("title", &csg::SchemeInfo::title)
      .def_ro("exact", &csg::SchemeInfo::exact)
      .def_ro("needs_mesh", &csg::SchemeInfo::needs_mesh)
      .def_ro("parameters", &csg::SchemeInfo::params);
  m.def("schemes", &csg::schemes, nb::rv_policy::reference, "All schemes of schemes.def.");

  nb::class_<csg::View>(m, "View", "A pinhole camera, point lights and matte shading.")
      .def(
          "__init__",
          [](csg::View* view, const Triple& eye, const Triple& look_at, const Triple& up, double fov_deg, int width,
             int height, const std::vector<std::array<double, 6>>& lights, const Triple& ambient,
             const Triple& background, const Triple& albedo) {
            std::vector<csg::Light> all;
            for (const auto& l : lights) all.push_back({{l[0], l[1], l[2]}, {l[3], l[4], l[5]}});
            csg::View made{vec(eye), vec(look_at), vec(up),      fov_deg,         width,
                           height,   all,          vec(ambient), vec(background), vec(albedo)};
            csg::Camera check(made);
            new (view) csg::View(std::move(made));
          },
          "eye"_a, "look_at"_a, "up"_a, "fov_deg"_a, "width"_a, "height"_a, "lights"_a, "ambient"_a, "background"_a,
          "albedo"_a)
      .def_ro("width", &csg::View::width)
      .def_ro("height", &csg::View::height)
      .def(
          "primary_rays",
          [](const csg::View& view) {
            const csg::Camera camera(view);
            const auto rows = static_cast<std::size_t>(view.height), columns = static_cast<std::size_t>(view.width);
            return array<double>({rows * columns, 8}, [&](double* out) {
              for (int row = 0; row < view.height; ++row)
                for (int column = 0; column < view.width; ++column, out += 8) {
                  const csg::Ray ray = camera.ray(column, row);
                  std::memcpy(out, &ray, sizeof ray);
                }
            });
          },
          "(height * width, 8) float64, row by row from the top: origin, unit direction, t_min, t_max");

  nb::class_<Hits>(m, "Hits")
      .def_prop_ro(
          "t",
          [](const Hits& h) {
            return array<double>({h.hits.size()}, [&](double* out) {
              for (const auto& hit : h.hits) *out++ = hit.t;
            });
          },
          "(N,) float64, +inf for a miss")
      .def_prop_ro(
          "normal",
          [](const Hits& h) {
            return array<double>({h.hits.size(), 3}, [&](double* out) {
              for (const auto& hit : h.hits) *out++ = hit.normal.x, *out++ = hit.normal.y, *out++ = hit.normal.z;
            });
          },
          "(N, 3) float64, out of the solid")
      .def_prop_ro(
          "leaf",
          [](const Hits& h) {
            return array<std::int32_t>({h.hits.size()}, [&](std::int32_t* out) {
              for (const auto& hit : h.hits) *out++ = hit.leaf;
            });
          },
          "(N,) int32, -1 for a miss")
      .def_ro("trace_s", &Hits::trace_s)
      .def_prop_ro("counters", [](const Hits& h) { return as_map(h.counters); });

  nb::class_<TimedPicture>(m, "Picture")
      .def_prop_ro(
          "rgb",
          [](const TimedPicture& p) {
            return copied(p.picture.rgb,
                          {static_cast<std::size_t>(p.picture.height), static_cast<std::size_t>(p.picture.width), 3});
          },
          "(H, W, 3) float64, linear")
      .def_prop_ro(
          "normal",
          [](const TimedPicture& p) {
            return copied(p.picture.normal,
                          {static_cast<std::size_t>(p.picture.height), static_cast<std::size_t>(p.picture.width), 3});
          },
          "(H, W, 3) float64, out of the solid, 0 for a miss")
      .def_prop_ro(
          "depth",
          [](const TimedPicture& p) {
            return copied(p.picture.depth,
                          {static_cast<std::size_t>(p.picture.height), static_cast<std::size_t>(p.picture.width)});
          },
          "(H, W) float64, +inf for a miss")
      .def_prop_ro(
          "leaf",
          [](const TimedPicture& p) {
            return copied(p.picture.leaf,
                          {static_cast<std::size_t>(p.picture.height), static_cast<std::size_t>(p.picture.width)});
          },
          "(H, W) int32, -1 for a miss")
      .def_prop_ro(
          "lit",
          [](const TimedPicture& p) {
            return copied(p.picture.lit,
                          {static_cast<std::size_t>(p.picture.height), static_cast<std::size_t>(p.picture.width)});
          },
          "(H, W) uint8: bit i is set where light i faces the surface and reaches it")
      .def_prop_ro(
          "cost",
          [](const TimedPicture& p) -> nb::object {
            if (p.picture.cost.empty()) return nb::none();
            return copied(p.picture.cost,
                          {static_cast<std::size_t>(p.picture.height), static_cast<std::size_t>(p.picture.width)});
          },
          "(H, W) float64: primitives tested for the pixel; None unless rendered with cost=True")
      .def_prop_ro("rays", [](const TimedPicture& p) { return p.picture.rays; })
      .def_prop_ro(
          "hash",
          [](const TimedPicture& p) {
            char text[17];
            std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(p.picture.hash()));
            return std::string(text);
          },
          "16 hex digits over the bits of depth, leaf and lit")
      .def_ro("trace_s", &TimedPicture::trace_s)
      .def_prop_ro("counters", [](const TimedPicture& p) { return as_map(p.counters); });

  nb::class_<BuiltTracer>(m, "Tracer", "A model in one scheme's structure.")
      .def_ro("build_s", &BuiltTracer::build_s)
      .def_prop_ro("bytes", [](const BuiltTracer& b) { return b.tracer->bytes(); })
      .def_prop_ro("facts", [](const BuiltTracer& b) { return b.tracer->facts(); })
      .def("trace", &trace, "rays"_a.noconvert(), "count"_a = false, "rays: (N, 8) float64, model units")
      .def(
          "occluded",
          [](const BuiltTracer& built, const RayRows& rows) {
            const std::vector<csg::Ray> rays = rays_of(rows);
            return array<std::uint8_t>(
                {rays.size()}, [&](std::uint8_t* out) { built.tracer->occluded(rays, {out, rays.size()}, nullptr); });
          },
          "rays"_a.noconvert(), "(N,) uint8: 1 where trace() would hit")
      .def("render", &render, "view"_a, "count"_a = false, "cost"_a = false, "threads"_a = 1);

  m.def(
      "complete",
      [](const std::string& name, const std::map<std::string, csg::ParamValue>& given) {
        return csg::Params(csg::scheme(name), given).values();
      },
      "name"_a, "params"_a,
      "All parameters of a scheme: those given, checked, and the others' defaults; of the numerics those not at "
      "their default. Raises ValueError.");
  m.def("numerics_parameters", &csg::numerics_params, nb::rv_policy::reference,
        "What every scheme has besides its own parameters.");
  m.def("make", &make, "name"_a, "tree"_a, "params"_a = std::map<std::string, csg::ParamValue>{}, "mesh"_a = nb::none(),
        "Builds a scheme's structure. mesh: (vertices (V, 3) float64, triangles (T, 3) uint32, leaf of each (T,) "
        "int32).");
  m.def(
      "audit_classes",
      [](const CsgTree& tree, const RayRows& cells, const RayRows& rows) {
        std::vector<csg::Box> boxes;
        for (std::size_t i = 0; i < cells.shape(0); ++i) {
          const double* c = cells.data() + 8 * i;
          boxes.push_back({{c[0], c[1], c[2]}, {c[3], c[4], c[5]}});
        }
        if (cells.shape(0) != rows.shape(0)) throw std::invalid_argument("audit_classes: one cell a ray");
        const csg::AuditResult result = csg::audit_classes(tree, boxes, rays_of(rows));
        return std::make_tuple(result.constants, result.violations);
      },
      "tree"_a, "cells"_a.noconvert(), "rays"_a.noconvert(),
      "(leaves called Empty or Full, those not constant along the ray), over pairs of a cell (N, 8: lo, hi, unused) "
      "and "
      "a ray (N, 8). The premise of all pruning; the second number must be 0.");
  m.def(
      "limits",
      [](const std::string& precision) {
        const auto limits = csg::Limits::of(precision == "float32" ? csg::Precision::Float32 : csg::Precision::Float64);
        return std::map<std::string, double>{{"min_cosine", limits.min_cosine},
                                             {"pad", std::ldexp(1.0, limits.pad_exponent)}};
      },
      "precision"_a, "Of the tie band's widening, and P of rule 9 in sizes; see error_unit.hpp.");
  m.def(
      "crossings",
      [](const CsgTree& tree, const RayRows& rows, const std::map<std::string, csg::ParamValue>& numerics,
         std::size_t leaf) {
        if (leaf >= tree.leaves().size()) throw std::invalid_argument("crossings: no such leaf");
        const CsgTree model = tree.computed(csg::Params(csg::scheme("naive"), numerics).numerics());
        std::vector<std::optional<csg::ScaledRay>> lines;
        for (const csg::Ray& ray : rays_of(rows)) lines.push_back(csg::scaled(ray));
        std::vector<csg::Crossings> found(lines.size());
        const Stopwatch watch;
        for (std::size_t i = 0; i < lines.size(); ++i)
          if (lines[i]) found[i] = csg::crossings(model.leaves()[leaf], lines[i]->ray);
        const double seconds = watch.seconds();
        for (std::size_t i = 0; i < lines.size(); ++i)
          for (int k = 0; k < found[i].count; ++k) found[i].t[k] = std::ldexp(found[i].t[k], lines[i]->exponent);
        nb::object count = array<std::int32_t>({found.size()}, [&](std::int32_t* out) {
          for (const csg::Crossings& c : found) *out++ = c.count;
        });
        nb::object t = array<double>({found.size(), 4}, [&](double* out) {
          for (const csg::Crossings& c : found)
            for (int i = 0; i < 4; ++i) *out++ = i < c.count ? c.t[i] : std::numeric_limits<double>::infinity();
        });
        return nb::make_tuple(count, t, seconds);
      },
      "tree"_a, "rays"_a.noconvert(), "numerics"_a = std::map<std::string, csg::ParamValue>{}, "leaf"_a = 0,
      "One kernel on whole lines: counts (N,) int32, t (N, 4) float64 ascending, +inf where there is none, and the "
      "seconds that it took. What trace() takes for no ray has none; a t that no double can hold is infinite.");
  m.def(
      "distance_bounds",
      [](const CsgTree& tree, const Doubles3& points) {
        return array<double>({points.shape(0), tree.leaves().size()}, [&](double* out) {
          for (std::size_t i = 0; i < points.shape(0); ++i) {
            const double* p = points.data() + 3 * i;
            for (const csg::Leaf& leaf : tree.leaves())
              *out++ = csg::smallest_stretch(leaf) * csg::local_distance(leaf, {p[0], p[1], p[2]}).value;
          }
        });
      },
      "tree"_a, "points"_a.noconvert(),
      "(N, leaves) float64, model units, of points (N, 3): each leaf's signed distance bound, negative inside. The "
      "premise of sphere tracing: none exceeds the distance to the surface.");
  m.def("machine", &machine, "Compiler, its flags, Embree's version.");
}
