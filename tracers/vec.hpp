// Small fixed-size linear algebra in double: points, linear maps, axis-aligned boxes.
#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace csg {

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Vec3 {
  double x = 0, y = 0, z = 0;
  double operator[](int axis) const { return axis == 0 ? x : axis == 1 ? y : z; }
  double& operator[](int axis) { return axis == 0 ? x : axis == 1 ? y : z; }
  bool operator==(const Vec3&) const = default;
};

inline Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec3 operator-(Vec3 a) { return {-a.x, -a.y, -a.z}; }
inline Vec3 operator*(double s, Vec3 a) { return {s * a.x, s * a.y, s * a.z}; }
inline double dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline double length(Vec3 a) { return std::sqrt(dot(a, a)); }
inline Vec3 cross(Vec3 a, Vec3 b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
inline Vec3 min(Vec3 a, Vec3 b) { return {std::min(a.x, b.x), std::min(a.y, b.y), std::min(a.z, b.z)}; }
inline Vec3 max(Vec3 a, Vec3 b) { return {std::max(a.x, b.x), std::max(a.y, b.y), std::max(a.z, b.z)}; }

/// A linear map, held by its three columns.
struct Mat3 {
  Vec3 col[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
};

inline Vec3 operator*(const Mat3& m, Vec3 v) {
  return {m.col[0].x * v.x + m.col[1].x * v.y + m.col[2].x * v.z,
          m.col[0].y * v.x + m.col[1].y * v.y + m.col[2].y * v.z,
          m.col[0].z * v.x + m.col[1].z * v.y + m.col[2].z * v.z};
}
inline Mat3 operator*(const Mat3& a, const Mat3& b) { return {{a * b.col[0], a * b.col[1], a * b.col[2]}}; }
/// Mᵀv: how covectors (normals, directions of support) go the other way.
inline Vec3 transposed_times(const Mat3& m, Vec3 v) { return {dot(m.col[0], v), dot(m.col[1], v), dot(m.col[2], v)}; }
inline double frobenius(const Mat3& m) {
  return std::sqrt(dot(m.col[0], m.col[0]) + dot(m.col[1], m.col[1]) + dot(m.col[2], m.col[2]));
}

/// x ↦ linear·x + offset.
struct Affine {
  Mat3 linear;
  Vec3 offset;
};
inline Vec3 operator*(const Affine& a, Vec3 v) { return a.linear * v + a.offset; }
inline Affine operator*(const Affine& a, const Affine& b) { return {a.linear * b.linear, a * b.offset}; }

/// An axis-aligned box, closed; the default one is empty.
struct Box {
  Vec3 lo{kInfinity, kInfinity, kInfinity};
  Vec3 hi{-kInfinity, -kInfinity, -kInfinity};

  static Box everything() { return {{-kInfinity, -kInfinity, -kInfinity}, {kInfinity, kInfinity, kInfinity}}; }
  /// Boxes that touch are not empty: coincident faces must stay visible to the hit rule.
  bool empty() const { return !(lo.x <= hi.x && lo.y <= hi.y && lo.z <= hi.z); }
  bool operator==(const Box&) const = default;
  Vec3 center() const { return 0.5 * (lo + hi); }
  Vec3 half() const { return 0.5 * (hi - lo); }
  Box padded(double by) const {
    return empty() ? *this : Box{{lo.x - by, lo.y - by, lo.z - by}, {hi.x + by, hi.y + by, hi.z + by}};
  }
};
inline Box hull(const Box& a, const Box& b) { return {min(a.lo, b.lo), max(a.hi, b.hi)}; }
inline Box intersection(const Box& a, const Box& b) {
  const Box box{max(a.lo, b.lo), min(a.hi, b.hi)};
  return box.empty() ? Box{} : box;
}

}  // namespace csg
