"""Branch and bound for the largest |f| of a form over the simplex.

Every part of the simplex is split until it is out of the running for one of three reasons, each of them certain:

- its Bézier coefficients, bounds of f on it, are below a value of f (floats, with a bound of all their rounding);
- they show a slope towards somewhere feasible, so no maximiser is in it;
- it lies in a ``Hill``: a corner-shaped part where rational arithmetic has shown f to be concave, or increasing
  towards a face where it is, so that one tangent plane bounds it. Near a maximiser this bound has any number of digits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from itertools import combinations_with_replacement, permutations
from math import comb, factorial, floor, prod

import numpy as np
from flint import fmpq, fmpq_mpoly, fmpq_mpoly_ctx
from numpy.typing import NDArray

__all__ = ["Form", "maximise"]

Floats = NDArray[np.float64]
Point = tuple[Fraction, ...]

_DEEPEST = 50  # bisections, after which corners are still exact floats
_SMALLEST = 20  # bits of the smallest hill that is tried
_ULP = 2.0**-52  # twice the rounding of one operation
_CLIMBS, _STEPS, _HALVINGS, _GUARD = 4, 60, 20, 20  # climbs a level, steps each, bits more than asked
_NEARLY, _ZERO, _CLOSE, _FLAT, _LARGEST_DENOMINATOR = 1e-9, 1e-12, 1e-7, 1e-7, 1000  # of guesses only


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """The exponents of degree d in k variables, in the order of every array of coefficients.

    ``ups[i]`` says where those of degree d - 1 are when multiplied by variable i, ``corners[i]`` where the coefficient
    is that is the value at corner i.
    """

    k: int
    degree: int
    exponents: tuple[tuple[int, ...], ...]
    multinomials: tuple[int, ...]
    weights: Floats
    powers: Floats
    place: Mapping[tuple[int, ...], int]
    ups: NDArray[np.intp]
    corners: list[int]

    def basis(self, w: Floats) -> Floats:
        """All terms of (w_1 + ... + w_k)^d."""
        return np.asarray(self.weights * np.prod(w**self.powers, axis=1))


@lru_cache(maxsize=64)
def grid(k: int, degree: int) -> Grid:
    """The grid of Bézier coefficients."""
    chosen = combinations_with_replacement(range(k), degree) if degree >= 0 else ()
    exponents = tuple(tuple(c.count(i) for i in range(k)) for c in chosen)
    sizes = tuple(factorial(degree) // prod(map(factorial, e)) for e in exponents)
    place = {e: n for n, e in enumerate(exponents)}
    smaller = grid(k, degree - 1).exponents if degree >= 0 else ()
    ups = np.array([[place[_raised(e, i)] for e in smaller] for i in range(k)], dtype=np.intp)
    corners = [place.get(_raised((0,) * k, *[i] * degree), 0) for i in range(k)]
    powers = np.array(exponents, dtype=float).reshape(-1, k)
    return Grid(k, degree, exponents, sizes, np.array(sizes, dtype=float), powers, place, ups, corners)


def _raised(e: tuple[int, ...], *variables: int) -> tuple[int, ...]:
    return tuple(power + variables.count(i) for i, power in enumerate(e))


@dataclass(frozen=True, slots=True, eq=False)
class Form:
    """A homogeneous polynomial on the simplex, exact and in floats scaled to Bézier coefficients <= 1."""

    poly: fmpq_mpoly
    slopes: tuple[fmpq_mpoly, ...]
    grid: Grid
    scale: Fraction
    bezier: Floats

    @staticmethod
    def of(terms: Mapping[tuple[int, ...], Fraction | int], k: int) -> Form:
        """The form that equals the polynomial where w_1 + ... + w_k = 1."""
        ring = fmpq_mpoly_ctx.get([f"w{i}" for i in range(k)])
        degree = int(max((sum(e) for e, c in terms.items() if c), default=0)) or 1
        parts: dict[int, dict[tuple[int, ...], fmpq]] = {}
        for e, c in terms.items():
            if c:
                parts.setdefault(degree - sum(e), {})[tuple(e)] = fmpq(c.numerator, c.denominator)
        whole = sum(ring.gens(), ring.constant(0))
        poly = sum((ring.from_dict(part) * whole**missing for missing, part in parts.items()), ring.constant(0))
        cells = grid(k, degree)
        exact = _bezier(poly, cells)
        scale = max(map(abs, exact))
        bezier = np.array([float(_fraction(b / scale)) for b in exact] if scale else [0.0] * len(exact))
        return Form(poly, tuple(poly.derivative(i) for i in range(k)), cells, _fraction(scale), bezier)

    def value(self, point: Point) -> Fraction:
        """F at a point."""
        return _fraction(self.poly(*map(_fmpq, point)))

    def slope(self, point: Point) -> list[Fraction]:
        """All derivatives at a point."""
        at = [_fmpq(w) for w in point]
        return [_fraction(p(*at)) for p in self.slopes]

    def height(self, sign: int, w: Floats) -> float:
        """The value of ``sign * f`` in scaled floats, good for a guess."""
        return sign * float(self.bezier @ self.grid.basis(w))

    def model(self, sign: int, w: Floats) -> tuple[Floats, Floats]:
        """Gradient and Hessian of ``sign * f`` in scaled floats, good for a guess."""
        d, k = self.grid.degree, self.grid.k
        below, far_below = grid(k, d - 1), grid(k, d - 2)
        once = sign * d * self.bezier[self.grid.ups]
        return once @ below.basis(w), (d - 1) * once[:, below.ups] @ far_below.basis(w)


def _bezier(poly: fmpq_mpoly, cells: Grid) -> list[fmpq]:
    terms = poly.to_dict()
    return [terms.get(e, fmpq(0)) / size for e, size in zip(cells.exponents, cells.multinomials, strict=True)]


def _fmpq(x: Fraction) -> fmpq:
    return fmpq(x.numerator, x.denominator)


def _fraction(x: fmpq) -> Fraction:
    return Fraction(int(x.p), int(x.q))


# -- branch and bound --------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class _Parts:
    """Parts of the simplex: Bézier coefficients of ``sign * f`` by part, and exact corners [part, corner, w]."""

    bezier: Floats
    corners: Floats
    sign: NDArray[np.int64]

    def only(self, kept: NDArray[np.bool_]) -> _Parts:
        return _Parts(self.bezier[kept], self.corners[kept], self.sign[kept])

    def off(self, hills: list[_Hill]) -> _Parts:
        found = np.ones(len(self.sign), dtype=bool)
        for hill in hills:
            found &= (self.sign != hill.sign) | (self.corners < hill.low).any(axis=(1, 2))
        return self.only(found)

    def halves(self, cells: Grid) -> _Parts:
        """Each part cut across its longest edge."""
        across = ((self.corners[:, :, None] - self.corners[:, None]) ** 2).sum(axis=3)
        longest = across.reshape(len(self.sign), -1).argmax(axis=1)
        found = []
        for kept, moved in permutations(range(cells.k), 2):
            part = self.only(longest == min(kept, moved) * cells.k + max(kept, moved))
            corners = part.corners.copy()
            corners[:, moved] = (corners[:, kept] + corners[:, moved]) / 2
            terms = zip(*_halving(cells.k, cells.degree, kept, moved), strict=True)
            bezier = sum((part.bezier[:, source] * weight for source, weight in terms), np.zeros(1))
            found.append((bezier, corners, part.sign))
        return _Parts(*(np.concatenate(arrays) for arrays in zip(*found, strict=True)))

    def level(self, cells: Grid, error: float) -> NDArray[np.bool_]:
        """Where no feasible direction is shown to go up, so that a maximiser can be inside."""
        touched = (self.corners == 0).any(axis=1)
        found = np.ones(len(self.sign), dtype=bool)
        ups = [self.bezier[:, cells.ups[i]] for i in range(cells.k)]
        for i, j in permutations(range(cells.k), 2):
            feasible = ((self.corners[:, i] >= self.corners[:, j]) | ~touched).all(axis=1)
            found &= ~(feasible & ((ups[i] - ups[j]).min(axis=1) > 3 * error))
        return found


@lru_cache(maxsize=64)
def _halving(k: int, degree: int, kept: int, moved: int) -> tuple[NDArray[np.intp], Floats]:
    """De Casteljau's rule for one corner moved half-way to another: what to add up [term, coefficient], and weights."""
    cells = grid(k, degree)
    source = np.zeros((degree + 1, len(cells.exponents)), dtype=np.intp)
    weight = np.zeros(source.shape)
    for n, e in enumerate(cells.exponents):
        rest = tuple(0 if i in (kept, moved) else power for i, power in enumerate(e))
        for m in range(e[moved] + 1):
            source[m, n] = cells.place[_raised(rest, *[kept] * (e[kept] + e[moved] - m), *[moved] * m)]
            weight[m, n] = comb(e[moved], m) / 2 ** e[moved]
    return source, weight


def maximise(form: Form, tolerance: Fraction, budget: int) -> tuple[Fraction, Fraction, Point]:
    """Certain bounds of the supremum of |f|, after about ``budget`` Bézier coefficients, and (nearly) a maximiser.

    The lower bound is a value of |f|. If the bounds are equal, it is the one at the point, else less than ``tolerance``
    times itself (if above 1, ``tolerance``) away from that.
    """
    cells = form.grid
    best = _Best(form, tolerance)
    parts = _Parts(np.array([form.bezier, -form.bezier]), np.array([np.eye(cells.k)] * 2), np.array([1, -1]))
    error, spent = _ULP, 0
    for depth in range(_DEEPEST + 1):
        error = _ULP * (1 + depth * (cells.degree + 3))
        spent += parts.bezier.size
        parts = parts.only(parts.bezier.max(axis=1) + error > best.scaled_down())
        parts = best.look(parts.only(parts.level(cells, error)))
        if not len(parts.sign) or spent > budget:
            break
        parts = parts.halves(cells)
    left = Fraction(float(parts.bezier.max()) + 2 * error) * form.scale if len(parts.sign) else Fraction(0)
    return best.found(left)


class _Best:
    """The largest value so far, and the hills that it and its rivals are on."""

    def __init__(self, form: Form, tolerance: Fraction) -> None:
        self.form, self.tolerance = form, tolerance
        self.point: Point = (*(Fraction(0),) * (form.grid.k - 1), Fraction(1))
        self.value = abs(form.value(self.point))
        self.hills: list[_Hill] = []

    def scaled_down(self) -> float:
        """The value in scaled floats, or less."""
        return float(self.value / self.form.scale) - _ULP if self.form.scale else 0.0

    def _slack(self) -> Fraction:
        return self.tolerance * min(Fraction(1), self.value)

    def see(self, point: Point) -> None:
        value = abs(self.form.value(point))
        if value > self.value:
            self.value, self.point = value, point

    def look(self, parts: _Parts) -> _Parts:
        """Climb from the highest corners, and leave out what is on a hill."""
        parts = parts.off(self.hills)
        tops = parts.bezier[:, self.form.grid.corners]
        for n in np.argsort(-tops.max(axis=1), kind="stable")[:_CLIMBS]:
            start, sign = parts.corners[n, np.argmax(tops[n])], int(parts.sign[n])
            self.see(tuple(map(Fraction, start.tolist())))
            w = _climbed(self.form, sign, start)
            known = any(h.sign == sign and (w >= h.low).all() for h in self.hills)
            if known or self.form.height(sign, w) < self.scaled_down() - _NEARLY:
                continue
            self.see(_on_simplex([Fraction(x) for x in w.tolist()]))
            anchor = _rational(self.form, sign, w) or _refined(self.form, sign, w, self._slack())
            self.see(anchor)
            hill = _hill(self.form, sign, anchor)
            if hill is None:
                break
            self.hills.append(hill)
        return parts.off(self.hills)

    def found(self, left: Fraction) -> tuple[Fraction, Fraction, Point]:
        """The bounds, if nothing that is left is above ``left``."""
        upper = max([self.value, left, *(hill.upper for hill in self.hills)])
        slack = self._slack() if upper > self.value else 0
        peaks = [hill.anchor for hill in self.hills if abs(self.form.value(hill.anchor)) >= self.value - slack]
        return self.value, upper, min([self.point, *peaks])


# -- hills -------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class _Hill:
    """Where w >= low, ``sign * f <= upper``; the anchor is (nearly) its maximiser."""

    low: Floats
    sign: int
    anchor: Point
    upper: Fraction


def _hill(form: Form, sign: int, anchor: Point) -> _Hill | None:
    """The largest hill around an anchor that can be shown to be one."""
    units = [8 << bits for bits in range(_SMALLEST + 1)]
    for low in dict.fromkeys(tuple(Fraction(max(0, floor(w * unit) - 8), unit) for w in anchor) for unit in units):
        upper = _tangent_bound(form, sign, anchor, low)
        if upper is not None:
            return _Hill(np.array(low, dtype=float), sign, anchor, upper)
    return None


def _tangent_bound(form: Form, sign: int, anchor: Point, low: Point) -> Fraction | None:
    """An upper bound of ``sign * f`` where w >= low, from the tangent plane at the anchor; None if it need not hold."""
    # Bézier coefficients on the part, a small copy of the simplex
    cells, k, size = form.grid, form.grid.k, 1 - sum(low, Fraction(0))
    ring = form.poly.context()
    variables = ring.gens()
    whole = sum(variables, ring.constant(0))
    images = [whole * _fmpq(x) + w * _fmpq(size) for x, w in zip(low, variables, strict=True)]
    b = _bezier(form.poly.compose(*images, ctx=ring) * sign, cells)
    # Move all that increases f when moved into a coordinate of the anchor
    inside = [up for up, w in zip(cells.ups.tolist(), anchor, strict=True) if w]
    kept: list[int] = []
    gone: list[int] = []
    for i, from_here in enumerate(cells.ups.tolist()):
        moves = not anchor[i] and any(all(b[p] <= b[q] for p, q in zip(from_here, up, strict=True)) for up in inside)
        (gone if moves else kept).append(i)
    # Show that f is concave on the face where this ends
    first, *others = kept
    for e in grid(k, cells.degree - 2).exponents:
        if not any(e[i] for i in gone):
            at = {(i, j): b[cells.place[_raised(e, i, j)]] for i in kept for j in kept}
            bends = [[at[i, j] - at[i, first] - at[first, j] + at[first, first] for j in others] for i in others]
            if not _negative_semidefinite(bends):
                return None
    # The tangent plane is highest at a corner of it
    slope = form.slope(anchor)
    middle = sum((s * (x - w) for s, x, w in zip(slope, low, anchor, strict=True)), Fraction(0))
    return max(sign * (form.value(anchor) + middle + size * slope[i]) for i in kept)


def _negative_semidefinite(matrix: list[list[fmpq]]) -> bool:
    """Whether an exact symmetric matrix has no positive eigenvalue, by symmetric elimination."""
    if not matrix:
        return True
    (pivot, *row), *rest = matrix
    if pivot > 0 or (pivot == 0 and any(x != 0 for x in row)):
        return False
    if pivot == 0:
        return _negative_semidefinite([r[1:] for r in rest])
    return _negative_semidefinite([[x - r[0] * y / pivot for x, y in zip(r[1:], row, strict=True)] for r in rest])


# -- guesses, none of which has to be right -----------------------------------------------------------


def _climbed(form: Form, sign: int, w: Floats) -> Floats:
    """A local maximiser of ``sign * f`` in floats, by Newton steps on the face that it is on."""
    for _ in range(_STEPS):
        slope, bend = form.model(sign, w)
        free = np.flatnonzero((w > 0) | (slope > slope @ w + _NEARLY))
        steps = np.zeros((2, len(w)))
        steps[:, free] = _newton(slope[free], bend[np.ix_(free, free)]), slope[free] - slope[free].mean()
        height = form.height(sign, w)
        for step in (step / 2**halvings for step in steps for halvings in range(_HALVINGS)):
            trial = np.where(w + step < _ZERO, 0.0, w + step)
            trial /= trial.sum()
            if form.height(sign, trial) > height:
                break
        else:
            return w
        w = trial
    return w


def _newton(slope: Floats, bend: Floats) -> Floats:
    """The step to the top of a quadratic along the simplex, turned uphill and without its flat directions."""
    project = np.eye(len(slope)) - 1 / len(slope)
    sizes, directions = np.linalg.eigh(project @ bend @ project)
    sizes = np.abs(sizes)
    steep = sizes > _FLAT * max(1e-300, sizes.max())
    steps = np.where(steep, (directions.T @ project @ slope) / np.where(steep, sizes, 1.0), 0.0)
    return np.asarray(project @ directions @ steps)


def _rational(form: Form, sign: int, w: Floats) -> Point | None:
    """A maximiser of small denominator close to w, if the derivatives there say that it is one."""
    for q in range(1, _LARGEST_DENOMINATOR + 1):
        rounded = np.rint(q * w)
        if np.abs(rounded - q * w).max() < q * _CLOSE and rounded.sum() == q:
            point = tuple(Fraction(int(x), q) for x in rounded)
            slope = [sign * s for s in form.slope(point)]
            top = max(slope)
            if all(s == top for s, x in zip(slope, point, strict=True) if x):
                return point
    return None


def _refined(form: Form, sign: int, w: Floats, slack: Fraction) -> Point:
    """A float maximiser to more digits, by steps with exact derivatives and one float Hessian."""
    support = np.flatnonzero(w)
    bend = form.model(sign, w)[1][np.ix_(support, support)]
    bits = _GUARD + (floor(form.scale * form.grid.degree**2 / slack).bit_length() if slack else 0)
    point = [Fraction(x) for x in w.tolist()]
    for _ in range(_STEPS):
        point = list(_on_simplex([Fraction(round(x * 2**bits), 2**bits) for x in point]))
        slope = form.slope(tuple(point))
        mean = sum((slope[i] for i in support), Fraction(0)) / len(support)
        steps = np.zeros(len(w))
        steps[support] = _newton(np.array([sign * float((slope[i] - mean) / form.scale) for i in support]), bend)
        moved = [x + Fraction(step) for x, step in zip(point, steps.tolist(), strict=True)]
        if min(moved) < 0 or np.abs(steps).max() < 2.0 ** (1 - bits):
            break
        point = moved
    return _on_simplex(point)


def _on_simplex(point: list[Fraction]) -> Point:
    largest = point.index(max(point))
    return tuple(w + 1 - sum(point) if i == largest else w for i, w in enumerate(point))
