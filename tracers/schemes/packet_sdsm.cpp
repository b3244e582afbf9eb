// Packet SDSM: sixteen rays at a time through the SDSM octree, in floats that know what they do not know.
//
// The octree's cells are those of sdsm. Each is shrunk to where its tree is not constant (the S-bound taken to
// its end), the boxes above it are refitted, and primitives are split into atoms, so that a cell keeps the side
// of a cylinder without its caps. Packets find the leaf that is crossed first; the crossing itself is the
// leaf's own kernel's. Rays of which the floats are not sure go through the octree as in sdsm.
//   d, h, build_threads, budget_mb   as for sdsm.
//   boxes         tight | cells: shrunk, or as the octree has them.
//   packet        16 | 1: rays that go together. With 1 each goes alone, and tests eight boxes or 16 atoms at once.
//   instructions  avx512 | avx2 | sse4: no wider than these.
#include <bit>

#include "../packets/build.hpp"
#include "../structures/parallel.hpp"

namespace csg {
namespace {

static_assert(sizeof(Ray) == 8 * sizeof(double));

class PacketSdsm final : public Tracer {
 public:
  PacketSdsm(std::shared_ptr<const CsgTree> tree, const OctreeLimits& limits, bool tight, bool packets, int level)
      : Tracer(std::move(tree)),
        octree_(*tree_, limits),
        packets_(*tree_, octree_, limits.margin, tight, packets, thread_count(limits.build.threads)),
        walk_(packets::walk_up_to(level)) {}

  std::size_t bytes() const override { return octree_.bytes() + packets_.bytes(); }
  std::map<std::string, double> facts() const override {
    std::map<std::string, double> facts = octree_.facts();
    packets_.describe(facts);
    return facts;
  }

 private:
  struct Unsure {
    std::size_t ray;
    double from;  ///< its t before which there is no boundary
  };

  /// Calls `answered(first, answer)` for each packet, whose `first` ray is given.
  template <class Answered>
  void in_packets(std::span<const Ray> rays, bool any, Counters* counters, Answered answered) const {
    packets::Counts counts{};
    packets::Answer answer;
    for (std::size_t first = 0; first < rays.size(); first += 16) {
      const auto count = static_cast<int>(std::min<std::size_t>(16, rays.size() - first));
      answer.hit = answer.unsure = 0;
      if (!packets_.empty())
        walk_(packets_.model(), {&rays[first].origin.x, count}, any, answer, counters ? &counts : nullptr);
      answered(first, count, answer);
    }
    if (counters) {
      counters->cells_entered += counts.cells;
      counters->bounds_tested += counts.boxes;
      counters->primitives_tested += counts.atoms;
      counters->booleans_evaluated += counts.operators;
    }
  }

  void trace_batch(std::span<const Ray> rays, std::span<Hit> hits, Counters* counters) const override {
    std::vector<Unsure> unsure;
    in_packets(rays, false, counters, [&](std::size_t first, int count, const packets::Answer& answer) {
      // Leaves are far apart: all are asked for before the first is needed, and their frames, for rays that will start
      // there.
      for (int i = 0; i < count; ++i) {
        if (!(answer.hit >> i & 1)) continue;
        fetch(tree_->leaves()[static_cast<std::size_t>(answer.leaf[i])]);
        fetch(packets_.model().frames[answer.leaf[i]]);
      }
      for (int i = 0; i < count; ++i) {
        const std::size_t at = first + static_cast<std::size_t>(i);
        hits[at] = {};
        if (answer.hit >> i & 1 && settle(rays[at], answer, i, hits[at])) continue;
        if (answer.hit >> i & 1)
          unsure.push_back({at, -kInfinity});
        else if (answer.unsure >> i & 1)
          unsure.push_back({at, answer.t[i]});
      }
      if (counters) counters->primitives_tested += static_cast<std::uint64_t>(std::popcount(answer.hit));
    });
    const std::vector<Hit> found = search(rays, unsure, counters);
    for (std::size_t i = 0; i < unsure.size(); ++i) hits[unsure[i].ray] = found[i];
  }

  void occluded_batch(std::span<const Ray> rays, std::span<std::uint8_t> blocked, Counters* counters) const override {
    std::vector<Unsure> unsure;
    in_packets(rays, true, counters, [&](std::size_t first, int count, const packets::Answer& answer) {
      for (int i = 0; i < count; ++i) {
        blocked[first + static_cast<std::size_t>(i)] = answer.hit >> i & 1;
        if (answer.unsure >> i & 1) unsure.push_back({first + static_cast<std::size_t>(i), answer.t[i]});
      }
    });
    const std::vector<Hit> found = search(rays, unsure, counters);
    for (std::size_t i = 0; i < unsure.size(); ++i) blocked[unsure[i].ray] = found[i].leaf >= 0;
  }

  /// What the scalar search says of rays that floats are not sure of.
  std::vector<Hit> search(std::span<const Ray> rays, const std::vector<Unsure>& unsure, Counters* counters) const {
    std::vector<Ray> again;
    for (const Unsure& one : unsure) {
      again.push_back(rays[one.ray]);
      again.back().t_min = std::max(again.back().t_min, one.from);
    }
    std::vector<Hit> found(again.size());
    trace_cells(*tree_, octree_.world(), octree_, again, found, counters,
                [&](auto&&... along) { octree_.walk(along...); });
    return found;
  }

  template <class Large>
  static void fetch(const Large& large) {
    for (std::size_t at = 0; at < sizeof large; at += 64)
      __builtin_prefetch(reinterpret_cast<const char*>(&large) + at);
  }

  /// The leaf's crossing near where floats have found it; false if it is not the only one there.
  bool settle(const Ray& ray, const packets::Answer& answer, int i, Hit& hit) const {
    const Leaf& leaf = tree_->leaves()[static_cast<std::size_t>(answer.leaf[i])];
    const Crossings found = crossings(leaf, ray);
    int at = -1;
    for (int k = 0; k < found.count; ++k) {
      if (!(std::fabs(found.t[k] - answer.t[i]) <= answer.t_error[i])) continue;
      if (at >= 0) return false;
      at = k;
    }
    if (at < 0) return false;
    const Vec3 normal = unit_normal(leaf, found.face[at], ray, found.t[at]);
    hit = {found.t[at], dot(normal, ray.dir) > 0 ? -normal : normal, answer.leaf[i]};
    return true;
  }

  Octree octree_;
  packets::Structure packets_;
  packets::Walk walk_;
};

std::vector<ParamSpec> packet_params() {
  std::vector<ParamSpec> params = octree_params();
  params.push_back(
      {.name = "boxes",
       .meaning = "tight: cells shrunk to where their trees are not constant; cells: as the octree has them",
       .default_value = std::string("tight"),
       .choices = {"tight", "cells"},
       .trial_values = {std::string("tight"), std::string("cells")}});
  params.push_back({.name = "packet",
                    .meaning = "rays that go together: 16, or 1, which tests eight boxes at once",
                    .default_value = 16L,
                    .minimum = 1,
                    .maximum = 16,
                    .trial_values = {16L, 1L},
                    .implied_by_default = true});
  params.push_back({.name = "instructions",
                    .meaning = "the widest that packets may use, if the machine has them; the answers are the same",
                    .default_value = std::string("avx512"),
                    .choices = {"avx512", "avx2", "sse4"},
                    .trial_values = {std::string("avx512"), std::string("avx2"), std::string("sse4")},
                    .implied_by_default = true});
  return params;
}

}  // namespace

extern const SchemeInfo scheme_packet_sdsm;
const SchemeInfo scheme_packet_sdsm{
    .name = "packet_sdsm",
    .title = "Packet SDSM (16 rays or 1, tight boxes, atoms)",
    .params = packet_params(),
    .make = [](std::shared_ptr<const CsgTree> tree, const Params& params) -> std::unique_ptr<Tracer> {
      OctreeLimits limits = OctreeLimits::of(params);
      limits.margin = packets::margin_for(params.numerics().precision);
      const std::string& instructions = params.choice("instructions");
      const int level = instructions == "avx512" ? 4 : instructions == "avx2" ? 3 : 2;
      const int packet = params.integer("packet");
      if (packet != 1 && packet != 16) throw std::invalid_argument("packet_sdsm: 'packet' is 1 or 16");
      const bool tight = params.choice("boxes") == "tight";
      return std::make_unique<PacketSdsm>(std::move(tree), limits, tight, packet > 1, level);
    }};

}  // namespace csg
