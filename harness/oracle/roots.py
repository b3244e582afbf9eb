"""Real roots of integer polynomials, certified: enclosed, ordered, ties proven by a gcd.

Every `Root` has an enclosure in doubles that settles nearly all comparisons; what it does not
settle is settled by rationals, to any precision. Nothing here is decided by a tolerance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cmp_to_key
from itertools import pairwise

import flint
from flint import arb, fmpq, fmpz, fmpz_poly

_START_BITS = 64  # of an enclosure: more than a double holds


class Root:
    """One simple real root of a squarefree polynomial.

    `low < root < high` strictly, in doubles, at most a few ulps apart; ±inf beyond their range.
    `piece` says which surface of a leaf it lies on.
    """

    __slots__ = ("_coefficients", "_index", "_squarefree", "high", "low", "piece")

    def __init__(self, coefficients: tuple, index: int, low: float, high: float, piece: int = 0):
        self._coefficients = coefficients  # ascending; of degree 1, 2 or 4
        self._index = index  # in ascending order, among the sign changes
        self._squarefree: fmpz_poly | None = None
        self.low, self.high, self.piece = low, high, piece

    @property
    def polynomial(self) -> fmpz_poly:
        """Squarefree, and the root is one of its."""
        if self._squarefree is None:
            whole = fmpz_poly(list(self._coefficients))
            self._squarefree = whole if len(whole) < 4 else whole // whole.gcd(whole.derivative())
        return self._squarefree

    def enclose(self, bits: int) -> tuple[fmpq, fmpq]:
        """A closed interval that holds this root of the polynomial and no other."""
        if len(self._coefficients) == 2:
            exact = fmpq(-self._coefficients[0], self._coefficients[1])
            return exact, exact
        if len(self._coefficients) == 3:
            return _surd(self._coefficients, self._index, bits)
        found = _sign_changes(self._coefficients, bits)[self._index]
        middle, radius = _rational(found.mid()), _rational(found.rad())
        return middle - radius, middle + radius


def at(value: fmpq | float) -> Root:
    """A number, finite, as a root to be compared with others."""
    exact = value if isinstance(value, fmpq) else fmpq(*value.as_integer_ratio())
    return _linear(-exact.p, exact.q, 0)


def sign_changes(coefficients: Sequence[fmpz], piece: int = 0) -> list[Root]:
    """The roots at which the polynomial changes its sign, in ascending order. Coefficients in
    ascending powers, of degree 1, 2 or 4 at most; not all of them zero."""
    trimmed = list(coefficients)
    while trimmed[-1] == 0:
        trimmed.pop()
    if len(trimmed) == 1:
        return []
    if len(trimmed) == 2:
        return [_linear(trimmed[0], trimmed[1], piece)]
    if len(trimmed) == 3:
        return _quadratic(*trimmed, piece)
    if _is_without_roots(trimmed):
        return []
    found = _sign_changes(trimmed, _START_BITS)
    key = tuple(trimmed)
    return [
        Root(key, i, _below(float(root.lower())), _above(float(root.upper())), piece)
        for i, root in enumerate(found)
    ]


def compare(a: Root, b: Root) -> int:
    """-1, 0 or 1, proven."""
    if a.high <= b.low:
        return -1
    if b.high <= a.low:
        return 1
    if a._coefficients == b._coefficients:
        return (a._index > b._index) - (a._index < b._index)
    bits, common = _START_BITS, None
    while True:
        (a_low, a_high), (b_low, b_high) = a.enclose(bits), b.enclose(bits)
        if a_high < b_low:
            return -1
        if b_high < a_low:
            return 1
        if common is None:
            common = a.polynomial.gcd(b.polynomial)
        # A root of `common` in both isolating intervals is the root that each isolates; it is
        # simple, so the sign shows it.
        low, high = max(a_low, b_low), min(a_high, b_high)
        if common.degree() > 0 and common(low) * common(high) <= 0:
            return 0
        bits *= 2


def in_order(roots: list[Root]) -> list[list[int]]:
    """Indices of the roots in ascending order, equal ones in one group."""
    order = sorted(range(len(roots)), key=lambda i: roots[i].low)
    groups: list[list[int]] = []
    begin = 0
    while begin < len(order):
        high, end = roots[order[begin]].high, begin + 1
        while end < len(order) and roots[order[end]].low < high:
            high = max(high, roots[order[end]].high)
            end += 1
        if end == begin + 1:
            groups.append([order[begin]])
        else:
            groups += _settled(roots, order[begin:end])
        begin = end
    return groups


def between(a: Root, b: Root) -> fmpq:
    """A rational strictly between two roots, a < b; of few digits where that is possible."""
    if a.high < b.low:
        middle = a.high / 2 + b.low / 2
        return fmpq(*(middle if a.high <= middle <= b.low else a.high).as_integer_ratio())
    if a.high == b.low:
        return fmpq(*a.high.as_integer_ratio())
    bits = _START_BITS
    while True:
        low, high = a.enclose(bits)[1], b.enclose(bits)[0]
        if low < high:
            return (low + high) / 2
        bits *= 2


def _settled(roots: list[Root], order: list[int]) -> list[list[int]]:
    order.sort(key=cmp_to_key(lambda i, j: compare(roots[i], roots[j])))
    groups = [[order[0]]]
    for before, i in pairwise(order):
        if compare(roots[before], roots[i]) == 0:
            groups[-1].append(i)
        else:
            groups.append([i])
    return groups


def _linear(c0: fmpz, c1: fmpz, piece: int) -> Root:
    nearest = quotient(-c0, c1)
    return Root((c0, c1), 0, _below(nearest), _above(nearest), piece)


def _quadratic(c0: fmpz, c1: fmpz, c2: fmpz, piece: int) -> list[Root]:
    if c1 * c1 - 4 * c0 * c2 <= 0:
        return []
    key = (c0, c1, c2)
    roots = []
    for index in (0, 1):
        numerator, denominator, _ = _surd_numerator(key, index, _START_BITS)
        nearest = quotient(numerator, denominator)
        roots.append(Root(key, index, _below(nearest), _above(nearest), piece))
    return roots


def _surd_numerator(coefficients: tuple, index: int, bits: int) -> tuple[fmpz, fmpz, bool]:
    """n and d > 0 with n ≤ d·root ≤ n + 1 and |n| of `bits` bits, or n = d·root exactly."""
    c0, c1, c2 = coefficients
    if c2 < 0:
        c0, c1, c2 = -c0, -c1, -c2
    discriminant = c1 * c1 - 4 * c0 * c2
    shift = max(0, bits - discriminant.bit_length() // 2)
    while True:
        scaled = discriminant << (2 * shift)
        root = scaled.isqrt()
        exact = root * root == scaled
        negated = -(c1 << shift)
        numerator = negated + root if index else negated - root - (not exact)
        if exact or numerator.bit_length() >= bits:
            return numerator, c2 << (shift + 1), exact
        shift += max(bits, c1.bit_length())  # −b ± √D cancels


def _surd(coefficients: tuple, index: int, bits: int) -> tuple[fmpq, fmpq]:
    numerator, denominator, exact = _surd_numerator(coefficients, index, bits)
    low = fmpq(numerator, denominator)
    return low, low if exact else fmpq(numerator + 1, denominator)


def _sign_changes(coefficients: Sequence[fmpz], bits: int) -> list[arb]:
    """The real roots of odd multiplicity, ascending, isolated, to about `bits` bits."""
    precision = flint.ctx.prec
    flint.ctx.prec = bits
    try:
        shift, unit, shifted = _recentred(coefficients)
        roots = shifted.complex_roots()
        odd = [root.real for root, count in roots if root.imag == 0 and count % 2]
        flint.ctx.prec = 2 * bits + shift.bit_length()  # the shift costs no digits
        return [(root + shift) / unit for root in sorted(odd)]  # isolated: `<` is certain
    finally:
        flint.ctx.prec = precision


def _is_without_roots(coefficients: Sequence[fmpz]) -> bool:
    """Whether a quartic has two pairs of complex roots for certain: a positive discriminant, and
    not the signs of four real roots. Most rays that pass a torus' ball miss it, and this is five
    times as fast as finding the roots."""
    e, d, c, b, a = coefficients
    bends = 8 * a * c - 3 * b * b
    depth = 64 * a**3 * e - 16 * a * a * c * c + 16 * a * b * b * c - 16 * a * a * b * d - 3 * b**4
    return (bends > 0 or depth > 0) and fmpz_poly(list(coefficients)).discriminant() > 0


def _recentred(coefficients: Sequence[fmpz]) -> tuple[fmpz, fmpz, fmpz_poly]:
    """n, d, and the polynomial in y = d·t − n, where n/d is about the mean of the roots. Far from a
    ray's origin roots look like one multiple root, and finding them takes half as long again."""
    mean = quotient(-coefficients[-2], coefficients[-1] * (len(coefficients) - 1))
    n, d = mean.as_integer_ratio() if math.isfinite(mean) else (0, 1)
    n, d = fmpz(n), fmpz(d)
    y_plus_n, shifted, power = fmpz_poly([n, 1]), fmpz_poly([coefficients[-1]]), d
    for c in coefficients[-2::-1]:
        shifted = shifted * y_plus_n + c * power
        power *= d
    return n, d, shifted


def _rational(exact: arb) -> fmpq:
    mantissa, exponent = exact.man_exp()
    if exponent >= 0:
        return fmpq(mantissa << int(exponent))
    return fmpq(mantissa, fmpz(1) << int(-exponent))


def quotient(numerator: fmpz, denominator: fmpz) -> float:
    """The nearest double; ±inf beyond their range."""
    try:
        return int(numerator) / int(denominator)
    except OverflowError:
        return math.inf if (numerator > 0) == (denominator > 0) else -math.inf


def _below(value: float) -> float:
    return math.nextafter(value, -math.inf)


def _above(value: float) -> float:
    return math.nextafter(value, math.inf)
