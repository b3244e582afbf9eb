#include "leaf_reader.hpp"

#include <cmath>

namespace csg {
namespace {

using Outcome = LeafReading::Outcome;

LeafReading solid(Kind kind, double size0, double size1, double size2, Vec3 center) {
  LeafReading reading;
  reading.outcome = Outcome::Solid;
  reading.leaf.kind = kind;
  reading.leaf.size[0] = size0;
  reading.leaf.size[1] = size1;
  reading.leaf.size[2] = size2;
  reading.center = center;
  return reading;
}

LeafReading unsupported(const char* fault) {
  LeafReading reading;
  reading.outcome = Outcome::Unsupported;
  reading.fault = fault;
  return reading;
}

/// A node that hands a lone child on as it is.
bool passes_through(NodeKind kind) {
  switch (kind) {
    case NodeKind::Group:
    case NodeKind::Union:
    case NodeKind::Difference:
    case NodeKind::Intersection:
    case NodeKind::Multmatrix:
    case NodeKind::Color:
    case NodeKind::Render:
      return true;
    default:
      return false;
  }
}

/// The sides of a circle under a positive $fn, as OpenSCAD counts them.
double sides_under(double fn) { return std::isfinite(fn) && fn >= 3 ? std::trunc(fn) : 3; }

}  // namespace

bool LeafReader::reads(NodeKind kind) {
  return kind == NodeKind::Sphere || kind == NodeKind::Cube || kind == NodeKind::Cylinder ||
         kind == NodeKind::RotateExtrude;
}

LeafReading LeafReader::read(std::uint32_t index) {
  const SyntaxNode& node = tree_.nodes[index];
  if (node.kind == NodeKind::RotateExtrude) return torus(index);
  if (node.end != index + 1) {
    source_.fail(tree_.nodes[index + 1].offset, "a " + std::string(name_of(node.kind)) + " has no children");
  }
  if (node.kind == NodeKind::Sphere) return sphere(node);
  if (node.kind == NodeKind::Cube) return cube(node);
  return cylinder(node);
}

LeafReading LeafReader::sphere(const SyntaxNode& node) {
  const Arguments arguments(source_, tree_, node, {"r"});
  const double r = arguments.number("r");
  if (r <= 0) return empty(node);
  warn_of_facets(node, arguments, "sphere", "polyhedron");
  return solid(Kind::Sphere, r, 0, 0, {});
}

LeafReading LeafReader::cube(const SyntaxNode& node) {
  const Arguments arguments(source_, tree_, node, {"size", "center"});
  double size[3];
  arguments.vector("size", size);
  const bool center = arguments.flag_or("center", false);
  if (!(size[0] > 0 && size[1] > 0 && size[2] > 0)) return empty(node);
  const Vec3 half{size[0] / 2, size[1] / 2, size[2] / 2};
  return solid(Kind::Block, half.x, half.y, half.z, center ? Vec3{} : half);
}

LeafReading LeafReader::cylinder(const SyntaxNode& node) {
  const Arguments arguments(source_, tree_, node, {"h", "r1", "r2", "center"});
  const double h = arguments.number("h"), r1 = arguments.number("r1"), r2 = arguments.number("r2");
  const bool center = arguments.flag_or("center", false);
  if (!(h > 0 && r1 >= 0 && r2 >= 0 && r1 + r2 > 0)) return empty(node);
  const Vec3 middle = center ? Vec3{} : Vec3{0, 0, h / 2};
  if (r1 == r2) {
    warn_of_facets(node, arguments, "cylinder", "prism");
    return solid(Kind::Cylinder, r1, h / 2, 0, middle);
  }
  warn_of_facets(node, arguments, "cone", "pyramid");
  return solid(Kind::Cone, r1, r2, h / 2, middle);
}

/// A torus is the full turn of one circle, moved in its plane. As in OpenSCAD the plane's y becomes
/// z, a transform acts by its x and y alone, and the circle may stand on either side of the axis.
LeafReading LeafReader::torus(std::uint32_t index) {
  const SyntaxNode& extrusion = tree_.nodes[index];
  const Arguments extrusion_arguments(source_, tree_, extrusion, {"angle", "convexity"});
  if (extrusion_arguments.number_or("angle", 360) != 360) {
    return unsupported("rotate_extrude by an angle other than 360");
  }
  constexpr const char* kOther = "rotate_extrude of something other than one translated circle";
  Affine place;
  std::uint32_t at = index;
  do {  // down the only children
    std::uint32_t only = 0;
    int count = 0;
    for (std::uint32_t i = at + 1; i < tree_.nodes[at].end; i = tree_.nodes[i].end) {
      if (tree_.nodes[i].modifiers.left_out()) continue;
      only = i;
      ++count;
    }
    if (count == 0 && tree_.nodes[at].kind != NodeKind::Circle) return {};
    if (count != 1) return unsupported(kOther);
    at = only;
    if (tree_.nodes[at].kind == NodeKind::Multmatrix) {
      const Affine step = Arguments(source_, tree_, tree_.nodes[at], {""}).matrix();
      const auto in_plane = [](Vec3 v) { return Vec3{v.x, v.y, 0}; };
      place = place *
              Affine{{in_plane(step.linear.col[0]), in_plane(step.linear.col[1]), {0, 0, 1}}, in_plane(step.offset)};
    }
  } while (passes_through(tree_.nodes[at].kind));
  const SyntaxNode& node = tree_.nodes[at];
  if (node.kind != NodeKind::Circle) return unsupported(kOther);

  // Only a similarity keeps the circle a circle. A rotation of six digits is one, exactly.
  const Vec3 x = place.linear.col[0], y = place.linear.col[1];
  const bool similar = (x.x == y.y && x.y == -y.x) || (x.x == -y.y && x.y == y.x);
  if (!similar) return unsupported("rotate_extrude of a circle that is stretched to an ellipse");
  const Arguments arguments(source_, tree_, node, {"r"});
  const double minor = arguments.number("r") * std::hypot(x.x, x.y);
  const double major = std::abs(place.offset.x);
  if (minor <= 0) return empty(node);
  if (major < minor) {
    source_.fail(extrusion.offset, "a torus whose major radius is less than its minor radius");
  }
  warn_of_facets(extrusion, extrusion_arguments, "torus", "polyhedron");
  warn_of_facets(node, arguments, "torus", "polygon turned");
  return solid(Kind::Torus, major, minor, 0, {0, 0, place.offset.y});
}

LeafReading LeafReader::empty(const SyntaxNode& node) {
  warnings_.add(std::string(name_of(node.kind)) + " of zero or negative size is empty", node.offset);
  return {};
}

/// Twelve sides or fewer are likely to be meant as sides.
void LeafReader::warn_of_facets(const SyntaxNode& node, const Arguments& arguments, const char* shape,
                                const char* facetted) {
  const double fn = arguments.number_or("$fn", 0);
  const double sides = sides_under(fn);
  if (fn <= 0 || sides > 12) return;
  const std::string count = std::to_string(static_cast<int>(sides));
  warnings_.add(std::string(name_of(node.kind)) + " with $fn=" + count + " is read as a round " + shape +
                    ", not as a " + facetted + " of " + count + " sides",
                node.offset);
}

}  // namespace csg
