#include "render.hpp"

#include <atomic>
#include <stdexcept>
#include <thread>

namespace csg {
namespace {

constexpr int kAcross = 64, kDown = 16;  // of a tile: bytes of its rows are lines of the cache, in most pictures
constexpr int kBlock = 4;

/// Calls `visit(column, row)` for the tile at (x0, y0), block by block, so that neighbours stand together.
template <class Visit>
void for_each_pixel(const View& view, int x0, int y0, Visit visit) {
  for (int y = y0; y < std::min(y0 + kDown, view.height); y += kBlock)
    for (int x = x0; x < std::min(x0 + kAcross, view.width); x += kBlock)
      for (int row = y; row < std::min(y + kBlock, view.height); ++row)
        for (int column = x; column < std::min(x + kBlock, view.width); ++column) visit(column, row);
}

/// What one thread needs to draw tiles of a picture; no pixel belongs to two tiles.
class TileRenderer {
 public:
  TileRenderer(const Tracer& tracer, const View& view, Picture& picture, bool count)
      : tracer_(tracer),
        view_(view),
        camera_(view),
        picture_(picture),
        count_(count),
        shadow_offset_(tracer.tree().tolerances().shadow_offset(view.eye)) {}

  void draw(int x, int y) {
    primary(x, y);
    for (std::size_t light = 0; light < view_.lights.size(); ++light) shadows(light);
  }

  std::uint64_t rays() const { return rays_traced_; }
  const Counters& counted() const { return counted_; }

 private:
  Vec3 albedo(std::int32_t leaf) const {
    const Leaf& on = tracer_.tree().leaves()[static_cast<std::size_t>(leaf)];
    return on.has_color ? Vec3{on.color[0], on.color[1], on.color[2]} : view_.albedo;
  }

  Counters* counters() { return count_ ? &counted_ : nullptr; }

  /// Calls `batch(begin, count)` for all rays at once, or ray by ray with the cost noted for `pixel_of_ray(ray)`.
  template <class PixelOfRay, class Batch>
  void costed(std::size_t rays, PixelOfRay pixel_of_ray, Batch batch) {
    rays_traced_ += rays;
    if (picture_.cost.empty()) return batch(std::size_t{0}, rays);
    for (std::size_t i = 0; i < rays; ++i) {
      const std::uint64_t before = counted_.primitives_tested;
      batch(i, std::size_t{1});
      picture_.cost[pixel_of_ray(i)] += static_cast<double>(counted_.primitives_tested - before);
    }
  }

  void primary(int x, int y) {
    rays_.resize(kAcross * kDown);
    pixels_.resize(rays_.size());
    std::size_t count = 0;
    for_each_pixel(view_, x, y, [&](int column, int row) {
      const std::size_t pixel =
          static_cast<std::size_t>(row) * static_cast<std::size_t>(view_.width) + static_cast<std::size_t>(column);
      // What will be written comes from afar while the rays are traced.
      __builtin_prefetch(&picture_.rgb[pixel], 1);
      __builtin_prefetch(&picture_.depth[pixel], 1);
      __builtin_prefetch(&picture_.normal[pixel], 1);
      __builtin_prefetch(&picture_.leaf[pixel], 1);
      pixels_[count] = pixel;
      rays_[count++] = camera_.ray(column, row);
    });
    hits_.resize(rays_.size());
    costed(
        count, [&](std::size_t i) { return pixels_[i]; },
        [&](std::size_t begin, std::size_t rays) {
          tracer_.trace({&rays_[begin], rays}, {&hits_[begin], rays}, counters());
        });
    lit_.clear();
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t pixel = pixels_[i];
      const Hit& hit = hits_[i];
      picture_.depth[pixel] = hit.t;
      picture_.leaf[pixel] = hit.leaf;
      picture_.lit[pixel] = 0;
      if (hit.leaf < 0) {
        picture_.normal[pixel] = {};
        picture_.rgb[pixel] = view_.background;
        continue;
      }
      const Vec3 color = albedo(hit.leaf), ambient = view_.ambient;
      picture_.normal[pixel] = hit.normal;
      picture_.rgb[pixel] = {color.x * ambient.x, color.y * ambient.y, color.z * ambient.z};
      // The side of the surface that the viewer sees; a shadow ray starts there (rule 12).
      const Vec3 seen = dot(hit.normal, rays_[i].dir) > 0 ? -hit.normal : hit.normal;
      const Vec3 point = rays_[i].origin + hit.t * rays_[i].dir;
      lit_.push_back({pixel, color, seen, point + shadow_offset_ * seen});
    }
  }

  void shadows(std::size_t number) {
    const Light& light = view_.lights[number];
    rays_.resize(kAcross * kDown);
    facing_.resize(rays_.size());
    std::size_t count = 0;
    for (const Surface& at : lit_) {
      const Vec3 to_light = light.position - at.start;
      // Written in any case and counted if it faces the light, which no branch would foresee.
      rays_[count] = {at.start, to_light, 0, 1};
      facing_[count] = &at;
      count += dot(at.normal, to_light) > 0;
    }
    blocked_.resize(rays_.size());
    costed(
        count, [&](std::size_t i) { return facing_[i]->pixel; },
        [&](std::size_t begin, std::size_t rays) {
          tracer_.occluded({&rays_[begin], rays}, {&blocked_[begin], rays}, counters());
        });
    for (std::size_t i = 0; i < count; ++i) {
      if (blocked_[i]) continue;
      const Surface& at = *facing_[i];
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
  Picture& picture_;
  bool count_;
  double shadow_offset_;
  Counters counted_;
  std::uint64_t rays_traced_ = 0;
  std::vector<std::size_t> pixels_;
  std::vector<Ray> rays_;
  std::vector<Hit> hits_;
  std::vector<std::uint8_t> blocked_;
  std::vector<Surface> lit_;
  std::vector<const Surface*> facing_;
};

}  // namespace

Picture::Picture(int columns, int rows, bool per_pixel_cost) : width(columns), height(rows) {
  const std::size_t pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  rgb.assign(pixels, {});
  depth.assign(pixels, kInfinity);
  normal.assign(pixels, {});
  leaf.assign(pixels, -1);
  lit.assign(pixels, 0);
  if (per_pixel_cost) cost.assign(pixels, 0);
}

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

void render(const Tracer& tracer, const View& view, Picture& picture, Counters* counters, int threads) {
  if (picture.width != view.width || picture.height != view.height)
    throw std::invalid_argument("picture: not of the view's size");
  if (view.lights.size() > 8) throw std::invalid_argument("view: at most 8 lights");
  const int columns = (view.width + kAcross - 1) / kAcross, rows = (view.height + kDown - 1) / kDown;
  std::vector<TileRenderer> renderers(static_cast<std::size_t>(std::clamp(threads, 1, columns * rows)),
                                      TileRenderer(tracer, view, picture, counters != nullptr));
  std::atomic<int> next = 0;
  const auto work = [&](TileRenderer& renderer) {
    for (int tile; (tile = next++) < columns * rows;) renderer.draw(tile % columns * kAcross, tile / columns * kDown);
  };
  {
    std::vector<std::jthread> others;
    for (std::size_t i = 1; i < renderers.size(); ++i) others.emplace_back([&, i] { work(renderers[i]); });
    work(renderers[0]);
  }
  for (const TileRenderer& renderer : renderers) {
    picture.rays += renderer.rays();
    if (counters) *counters += renderer.counted();
  }
}

}  // namespace csg
