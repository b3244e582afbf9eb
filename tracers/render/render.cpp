#include "render.hpp"

#include <stdexcept>

#include "../error_unit.hpp"

namespace csg {
namespace {

constexpr int kTile = 32, kBlock = 4;

struct Pixel {
  int column, row;
};

/// The pixels of the tile at (x0, y0), block by block, so that neighbours stand together.
void tile_pixels(const View& view, int x0, int y0, std::vector<Pixel>& out) {
  out.clear();
  for (int y = y0; y < std::min(y0 + kTile, view.height); y += kBlock)
    for (int x = x0; x < std::min(x0 + kTile, view.width); x += kBlock)
      for (int row = y; row < std::min(y + kBlock, view.height); ++row)
        for (int column = x; column < std::min(x + kBlock, view.width); ++column) out.push_back({column, row});
}

class Renderer {
 public:
  Renderer(const Tracer& tracer, const View& view, Counters* counters, bool per_pixel_cost)
      : tracer_(tracer), view_(view), camera_(view), counters_(counters), per_pixel_cost_(per_pixel_cost) {
    if (view.lights.size() > 8) throw std::invalid_argument("view: at most 8 lights");
    const std::size_t pixels = static_cast<std::size_t>(view.width) * static_cast<std::size_t>(view.height);
    picture_.width = view.width;
    picture_.height = view.height;
    picture_.rgb.resize(pixels);
    picture_.depth.resize(pixels);
    picture_.normal.resize(pixels);
    picture_.leaf.resize(pixels);
    picture_.lit.resize(pixels);
    if (per_pixel_cost) picture_.cost.resize(pixels);
  }

  Picture run() {
    for (int y = 0; y < view_.height; y += kTile)
      for (int x = 0; x < view_.width; x += kTile) {
        tile_pixels(view_, x, y, pixels_);
        primary();
        for (std::size_t light = 0; light < view_.lights.size(); ++light) shadows(light);
      }
    return std::move(picture_);
  }

 private:
  std::size_t index(const Pixel& p) const {
    return static_cast<std::size_t>(p.row) * static_cast<std::size_t>(view_.width) + static_cast<std::size_t>(p.column);
  }
  Vec3 albedo(std::int32_t leaf) const {
    const Leaf& on = tracer_.tree().leaves()[static_cast<std::size_t>(leaf)];
    return on.has_color ? Vec3{on.color[0], on.color[1], on.color[2]} : view_.albedo;
  }

  /// Calls `batch(begin, count)` for all rays at once, or ray by ray with the cost noted per pixel.
  template <class Batch>
  void costed(std::size_t rays, const std::vector<std::size_t>& pixel_of_ray, Batch batch) {
    picture_.rays += rays;
    if (!per_pixel_cost_) return batch(std::size_t{0}, rays);
    for (std::size_t i = 0; i < rays; ++i) {
      const std::uint64_t before = counters_->primitives_tested;
      batch(i, std::size_t{1});
      picture_.cost[pixel_of_ray[i]] += static_cast<double>(counters_->primitives_tested - before);
    }
  }

  void primary() {
    rays_.clear();
    pixel_of_ray_.clear();
    for (const Pixel& p : pixels_) {
      rays_.push_back(camera_.ray(p.column, p.row));
      pixel_of_ray_.push_back(index(p));
    }
    hits_.resize(rays_.size());
    costed(rays_.size(), pixel_of_ray_, [&](std::size_t begin, std::size_t count) {
      tracer_.trace(std::span(rays_).subspan(begin, count), std::span(hits_).subspan(begin, count), counters_);
    });
    lit_.clear();
    for (std::size_t i = 0; i < rays_.size(); ++i) {
      const std::size_t pixel = pixel_of_ray_[i];
      const Hit& hit = hits_[i];
      picture_.depth[pixel] = hit.t;
      picture_.leaf[pixel] = hit.leaf;
      if (hit.leaf < 0) {
        picture_.rgb[pixel] = view_.background;
        continue;
      }
      const Vec3 color = albedo(hit.leaf), ambient = view_.ambient;
      picture_.normal[pixel] = hit.normal;
      picture_.rgb[pixel] = {color.x * ambient.x, color.y * ambient.y, color.z * ambient.z};
      // The side of the surface that the viewer sees; a shadow ray starts there (rule 12).
      const Vec3 seen = dot(hit.normal, rays_[i].dir) > 0 ? -hit.normal : hit.normal;
      const Vec3 point = rays_[i].origin + hit.t * rays_[i].dir;
      lit_.push_back({pixel, color, seen, point + tracer_.tree().tolerances().shadow_offset(rays_[i].origin) * seen});
    }
  }

  void shadows(std::size_t number) {
    const Light& light = view_.lights[number];
    rays_.clear();
    pixel_of_ray_.clear();
    facing_.clear();
    for (std::size_t i = 0; i < lit_.size(); ++i) {
      const Vec3 to_light = light.position - lit_[i].start;
      if (!(dot(lit_[i].normal, to_light) > 0)) continue;
      rays_.push_back({lit_[i].start, to_light, 0, 1});
      pixel_of_ray_.push_back(lit_[i].pixel);
      facing_.push_back(i);
    }
    blocked_.resize(rays_.size());
    costed(rays_.size(), pixel_of_ray_, [&](std::size_t begin, std::size_t count) {
      tracer_.occluded(std::span(rays_).subspan(begin, count), std::span(blocked_).subspan(begin, count), counters_);
    });
    for (std::size_t i = 0; i < rays_.size(); ++i) {
      if (blocked_[i]) continue;
      const Surface& at = lit_[facing_[i]];
      const double cosine = dot(at.normal, rays_[i].dir) / length(rays_[i].dir);
      picture_.lit[at.pixel] = static_cast<std::uint8_t>(picture_.lit[at.pixel] | 1u << number);
      Vec3& rgb = picture_.rgb[at.pixel];
      rgb = rgb + cosine * Vec3{at.color.x * light.color.x, at.color.y * light.color.y, at.color.z * light.color.z};
    }
  }

  struct Surface {
    std::size_t pixel;
    Vec3 color, normal, start;
  };

  const Tracer& tracer_;
  const View& view_;
  Camera camera_;
  Counters* counters_;
  bool per_pixel_cost_;
  Picture picture_;
  std::vector<Pixel> pixels_;
  std::vector<Ray> rays_;
  std::vector<Hit> hits_;
  std::vector<std::uint8_t> blocked_;
  std::vector<Surface> lit_;
  std::vector<std::size_t> pixel_of_ray_, facing_;
};

}  // namespace

std::uint64_t Picture::hash() const {
  std::uint64_t hash = 0xcbf29ce484222325;
  const auto add = [&](const auto& plane) {
    const auto* bytes = reinterpret_cast<const unsigned char*>(plane.data());
    for (std::size_t i = 0; i < plane.size() * sizeof(plane[0]); ++i) hash = (hash ^ bytes[i]) * 0x100000001b3;
  };
  add(depth);
  add(leaf);
  add(lit);
  return hash;
}

Picture render(const Tracer& tracer, const View& view, Counters* counters, bool per_pixel_cost) {
  return Renderer(tracer, view, counters, per_pixel_cost).run();
}

}  // namespace csg
