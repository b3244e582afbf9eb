// Torus by Algorithm 1010, roots polished on the surface: for the accuracy study.
//
// A. G. Orellana and C. De Michele, Algorithm 1010: Boosting Efficiency in Solving Quartic Equations
// with No Compromise in Accuracy, ACM Transactions on Mathematical Software 46(2), 2020. The quartic,
// as a form in (s², s, 1), is factored as L·D·Lᵀ. The dominant root φ of a resolvent cubic makes one
// pivot vanish, and the two left give two quadratics. Where a quantity can be computed in several
// ways, the one that reproduces the quartic best is taken; Newton's iteration then refines the
// quadratics' coefficients together.
//
// Where d₂ is no more than noise the published code puts 0 for it, if that fits better, but takes as
// noise one epsilon only, and lines through the axis exceed that. Here both are always compared.
//
// The quartic has no cubic term (a = 0), so that the paper's l₁ is 0, and its coefficients are
// of the order of 1 (torus_quartic.hpp), so that its rescaling against overflow is not needed.
// Accurate to the quartic's last digit, it still fails where the coefficients have lost r: on thin
// tori, and near tangency, where polishing cannot bring back a pair that was missed.
#pragma once
#include <complex>

#include "torus_quartic.hpp"

namespace csg::torus_1010 {

/// s⁴ + b·s² + c·s + d.
template <class Real>
struct Monic {
  Real b, c, d;
};

/// (s² + a1·s + b1)(s² + a2·s + b2).
template <class Scalar>
struct Factors {
  Scalar a1, b1, a2, b2;
};

/// |value − wanted|, relative where there is something to be relative to.
template <class Scalar, class Real>
Real relative_error(const Scalar& value, Real wanted) {
  const Real error = std::abs(value - wanted);
  return wanted == 0 ? error : error / std::fabs(wanted);
}

/// Of the product's coefficients, from s³ down; the constant one only if asked for.
template <class Scalar, class Real>
Real error_of(const Factors<Scalar>& f, const Monic<Real>& m, bool with_constant = true) {
  const Real upper = relative_error(f.b1 + f.a1 * f.a2 + f.b2, m.b) + relative_error(f.b1 * f.a2 + f.a1 * f.b2, m.c) +
                     relative_error(f.a1 + f.a2, Real{0});
  return with_constant ? upper + relative_error(f.b1 * f.b2, m.d) : upper;
}

/// The root of x³ + g·x + h that is largest in magnitude, in a form that cannot overflow.
template <class Real>
Real dominant_cubic_root(Real g, Real h) {
  const Real q = -g / 3, r = h / 2;
  if (r == 0) return g < 0 ? std::sqrt(-g) : 0;
  const bool by_r = std::fabs(q) < std::fabs(r);
  const Real ratio = by_r ? q / r : r / q;
  const Real excess = by_r ? 1 - q * ratio * ratio : std::copysign(Real{1}, q) * (ratio * ratio / q - 1);
  if (excess < 0) {  // three real roots
    const Real root = std::sqrt(q), cosine = std::clamp<Real>(std::fabs(r) / (q * root), -1, 1);
    return -std::copysign(2 * root * std::cos(std::acos(cosine) / 3), r);
  }
  const Real u = by_r ? std::fabs(r) * (1 + std::sqrt(excess))
                      : std::fabs(r) + std::sqrt(std::fabs(q)) * std::fabs(q) * std::sqrt(excess);
  const Real a = -std::copysign(std::cbrt(u), r);
  return a == 0 ? 0 : a + q / a;
}

/// φ: the dominant root of the resolvent, which is formed after a shift of s that lessens
/// cancellation in it, and refined by Newton's iteration while that helps.
template <class Real>
Real dominant_resolvent_root(const Monic<Real>& m) {
  const auto [b, c, d] = m;
  const Real shift = b < 0 ? 2 * b / std::sqrt(-24 * b) : 0;
  const Real shifted_a = 4 * shift, shifted_b = b + 6 * shift * shift;
  const Real shifted_c = c + shift * (2 * b + 4 * shift * shift);
  const Real shifted_d = d + shift * (c + shift * (b + shift * shift));
  const Real ac = shifted_a * shifted_c, bb = shifted_b * shifted_b / 9;
  const Real g = ac - 4 * shifted_d - 3 * bb;
  const Real h =
      (8 * shifted_d + ac - 2 * bb) * shifted_b / 3 - shifted_c * shifted_c - shifted_d * shifted_a * shifted_a;

  Real x = dominant_cubic_root(g, h);
  Real value = x * (x * x + g) + h;
  const Real largest = std::max({std::fabs(x * x * x), std::fabs(g * x), std::fabs(h)});
  if (std::fabs(value) <= std::numeric_limits<Real>::epsilon() * largest) return x;
  for (int step = 0; step < 8; ++step) {
    const Real slope = 3 * x * x + g;
    if (slope == 0) break;
    const Real next = x - value / slope, next_value = next * (next * next + g) + h;
    if (!(std::fabs(next_value) < std::fabs(value))) break;
    x = next, value = next_value;
  }
  return x;
}

/// Newton's iteration on the four coefficients together, while the product comes nearer.
template <class Real>
void refine(Factors<Real>& f, const Monic<Real>& m) {
  Real error = error_of(f, m);
  for (int step = 0; step < 8 && error != 0; ++step) {
    const auto [a1, b1, a2, b2] = f;
    const Real da = a1 - a2, db = b2 - b1, cross = b1 * a2 - a1 * b2;
    const Real determinant = b1 * b1 - b1 * (a2 * da + 2 * b2) + b2 * (a1 * da + b2);
    if (determinant == 0) return;
    const Real e0 = b1 * b2 - m.d, e1 = b1 * a2 + a1 * b2 - m.c, e2 = b1 + a1 * a2 + b2 - m.b, e3 = a1 + a2;
    const Real last = -b1 * db - a1 * cross;
    const Real common = da * e0 + db * e1 + cross * e2;
    const Factors<Real> next{
        a1 - (common + last * e3) / determinant,
        b1 - ((a1 * da + db) * e0 - b1 * (da * e1 + db * e2 + cross * e3)) / determinant,
        a2 - (-common + (cross * a2 + db * b2) * e3) / determinant,
        b2 - (-(a2 * da + db) * e0 + b2 * (da * e1 + db * e2 + cross * e3)) / determinant,
    };
    const Real next_error = error_of(next, m);
    if (!(next_error < error)) return;
    f = next, error = next_error;
  }
}

/// The smaller constant term follows from the larger.
template <class Real>
void balance_constants(Factors<Real>& f, Real d) {
  if (std::fabs(f.b2) < std::fabs(f.b1))
    f.b2 = d / f.b1;
  else if (std::fabs(f.b2) > std::fabs(f.b1))
    f.b1 = d / f.b2;
}

/// The pivot d₂ and the entry l₂ of L, by whichever of three formulas the product fits best.
template <class Real>
std::pair<Real, Real> best_pivot(const Monic<Real>& m, Real phi, Real l3) {
  const Real pivot = 2 * m.b / 3 - phi, d3 = m.d - l3 * l3;
  std::pair<Real, Real> best{0, 0};
  Real least = std::numeric_limits<Real>::infinity();
  const auto consider = [&](Real d2, Real l2) {
    const Real error = relative_error(d2 + 2 * l3, m.b) + relative_error(2 * d2 * l2, m.c) +
                       relative_error(d2 * l2 * l2 + l3 * l3, m.d);
    if (error < least) least = error, best = {d2, l2};
  };
  if (pivot != 0) consider(pivot, m.c / (2 * pivot));
  if (m.c != 0) {
    const Real l2 = 2 * d3 / m.c;
    if (l2 != 0) consider(m.c / (2 * l2), l2);
    consider(pivot, l2);
  }
  return best;
}

/// Real factors, if there are any; without them the quartic has no real root.
template <class Real>
bool factor(const Monic<Real>& m, Factors<Real>& out) {
  const Real phi = dominant_resolvent_root(m), l3 = m.b / 6 + phi / 2;
  const auto [d2, l2] = best_pivot(m, phi, l3);
  Real error = std::numeric_limits<Real>::infinity();
  bool real = false;
  if (d2 < 0) {
    const Real root = std::sqrt(-d2);
    Factors<Real> f{root, l3 + root * l2, -root, l3 - root * l2};
    balance_constants(f, m.d);
    const Real candidates[]{(m.c - f.a1 * f.b2) / f.b1, (m.b - f.b1 - f.b2) / f.a1, -f.a1};
    Real least = std::numeric_limits<Real>::infinity();
    for (const Real a2 : candidates) {  // one divided by 0 never fits best
      const Real fit = error_of(Factors<Real>{f.a1, f.b1, a2, f.b2}, m, false);
      if (fit < least) least = fit, f.a2 = a2;
    }
    real = true, out = f, error = error_of(f, m);
  } else if (d2 > 0) {
    const std::complex<Real> a{0, std::sqrt(d2)}, b{l3, std::sqrt(d2) * l2};
    error = error_of(Factors<std::complex<Real>>{a, b, std::conj(a), std::conj(b)}, m);
  }
  // Is d₂ = 0 nearer?
  const Real d3 = m.d - l3 * l3, root = std::sqrt(std::fabs(d3));
  if (d3 <= 0) {
    Factors<Real> f{0, l3 + root, 0, l3 - root};
    balance_constants(f, m.d);
    if (error_of(f, m) < error) real = true, out = f;
  } else {
    const std::complex<Real> b{l3, root};
    if (error_of(Factors<std::complex<Real>>{0, b, 0, std::conj(b)}, m) < error) real = false;
  }
  if (real) refine(out, m);
  return real;
}

/// Newton's steps on the distance from the surface, each kept only if it comes nearer.
template <class Real>
Real polish(const torus::Probe<Real>& probe, Real s) {
  torus::Sample<Real> here = probe.at(s);
  for (int step = 0; step < 2 && here.distance != 0; ++step) {
    const Real slope = probe.scaled_slope(here);
    if (slope == 0) break;
    const Real next = s - here.distance * here.from_circle * here.rho / slope;
    const torus::Sample<Real> there = probe.at(next);
    if (!(std::fabs(there.distance) < std::fabs(here.distance))) break;
    s = next, here = there;
  }
  return s;
}

/// The contract of torus::crossings, without its accuracy on thin tori.
template <class Real>
Crossings crossings(const double* size, Line<Real> line) {
  const torus::Approach<Real> to(size, line);
  if (to.misses()) return {};
  const torus::Quartic<Real> quartic(to);
  Factors<Real> f;
  if (!factor(Monic<Real>{2 * quartic.p, 4 * quartic.q, quartic.w}, f)) return {};

  Real roots[4];
  int count = 0;
  for (const auto& [a, b] : {std::pair{f.a1, f.b1}, std::pair{f.a2, f.b2}}) {
    const Real discriminant = a * a - 4 * b;
    if (!(discriminant > 0)) continue;  // a double root touches and is no crossing
    const Real far = (-a - std::copysign(std::sqrt(discriminant), a)) / 2;
    roots[count++] = polish(to.probe, far);
    roots[count++] = polish(to.probe, b / far);
  }
  torus::sort_roots(roots, roots + count);
  Crossings out;
  for (int i = 0; i < count; ++i) to.add(out, roots[i]);
  return out;
}

}  // namespace csg::torus_1010
