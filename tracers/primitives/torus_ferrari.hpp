// Torus by Ferrari's closed form, as renderers have it: for the accuracy study, not for use.
//
// The recentred quartic s⁴ + P·s² + Q·s + w is split into (s² + α·s + β)(s² − α·s + γ) by the
// largest root α² of its resolvent cubic (Cardano, Viète). Nothing is polished and nothing checked
// against the surface. It is fast and fails where quartics do: α² near 0 and double roots lose half
// the digits, and on a thin torus the coefficients have lost r before the solver begins.
#pragma once
#include "torus_quartic.hpp"

namespace csg::torus_ferrari {

/// The largest real root of x³ + a·x² + b·x + c.
template <class Real>
Real largest_cubic_root(Real a, Real b, Real c) {
  const Real centre = -a / 3;
  const Real p = (b - a * a / 3) / 3, q = (c + a * (2 * a * a - 9 * b) / 27) / 2;  // y³ + 3p·y + 2q
  const Real discriminant = q * q + p * p * p;
  if (discriminant > 0) {
    const Real u = std::cbrt(-q - std::copysign(std::sqrt(discriminant), q));
    return centre + u - p / u;
  }
  const Real scale = std::sqrt(-p);
  if (!(scale > 0)) return centre;
  const Real cosine = std::clamp<Real>(-q / (scale * scale * scale), -1, 1);
  return centre + 2 * scale * std::cos(std::acos(cosine) / 3);
}

/// Appends the two real roots of s² + b·s + c; a double root touches and is no crossing.
template <class Real>
Real* append_quadratic_roots(Real b, Real c, Real* roots) {
  const Real discriminant = b * b / 4 - c;
  if (!(discriminant > 0)) return roots;
  const Real far = -b / 2 - std::copysign(std::sqrt(discriminant), b);  // no cancellation
  *roots++ = far;
  *roots++ = c / far;
  return roots;
}

/// The contract of torus::crossings, without its accuracy.
template <class Real>
Crossings crossings(const double* size, Line<Real> line) {
  const torus::Approach<Real> to(size, line);
  if (to.misses()) return {};
  const torus::Quartic<Real> quartic(to);
  const Real p = 2 * quartic.p, q = 4 * quartic.q, w = quartic.w;

  // α² and (γ − β)² by the resolvent; the larger of α² and γ − β gives the other by α·(γ − β) = Q,
  // which also serves Q = 0, a quadratic in s².
  const Real squared = std::max<Real>(0, largest_cubic_root<Real>(2 * p, p * p - 4 * w, -q * q)), sum = p + squared;
  Real alpha = std::sqrt(squared), difference = std::sqrt(std::max<Real>(0, sum * sum - 4 * w));
  if (squared > difference)
    difference = q / alpha;
  else if (difference > 0)
    alpha = q / difference;
  Real roots[4];
  Real* end = append_quadratic_roots(alpha, (sum - difference) / 2, roots);
  end = append_quadratic_roots(-alpha, (sum + difference) / 2, end);
  torus::sort_roots(roots, end);
  Crossings out;
  for (const Real* root = roots; root != end; ++root) to.add(out, *root);
  return out;
}

}  // namespace csg::torus_ferrari
