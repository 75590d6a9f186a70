"""Certified extrema of rational polynomials over the simplex: how bad a bias gets on the worst pixel.

In one variable the critical points are the real roots of an integer polynomial, isolated with certainty, and ties with
a rational value are divisibility by the factor they are roots of. In more variables see ``branching``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import chain, count
from math import floor, lcm
from numbers import Rational
from typing import Any

from flint import arb, fmpq, fmpq_poly, fmpz_poly

from truemean.errors import InputError, InputTypeError
from truemean.oracle.branching import Form, maximise
from truemean.oracle.enclose import precision

__all__ = ["Extremum", "below", "supremum", "supremum_ratio", "supremum_simplex"]

_START_BITS = 64


@dataclass(frozen=True, slots=True)
class Extremum:
    """The supremum of |p| as an enclosure, and a rational point that shows it.

    Certified: ``lower <= supremum <= upper``, and unless ``complete`` is false these are at most
    ``10^-digits * min(1, supremum)`` apart; equal if the supremum is a rational attained at a rational critical point
    or corner (of small denominator, in several variables). ``point`` holds w, or (w_1, ..., w_k), with
    ``lower <= |p(point)| <= upper`` exactly, and ``value_sign`` is the sign of p there. If the supremum is only the
    limit at w = 0 (``attained`` is false), then ``|p(point)| >= lower - 10^-digits * min(1, lower)``. Of isolated
    points that agree to all digits the lexicographically smallest is named.
    """

    lower: Fraction
    upper: Fraction
    attained: bool
    point: tuple[Fraction, ...]
    value_sign: int
    complete: bool = True


def supremum(
    coefficients: Sequence[Fraction | int], digits: int = 30, open_at_zero: bool = False, *, absolute: bool = True
) -> Extremum:
    """The supremum of |p| over [0, 1], or (0, 1], coefficients ascending; of p itself if not ``absolute``.

    Certified as ``Extremum`` says; if not ``absolute``, the width is at most ``10^-digits * max(1, |supremum|)``.

    >>> supremum([0, 1, -1])
    Extremum(lower=Fraction(1, 4), upper=Fraction(1, 4), attained=True, point=(Fraction(1, 2),),
             value_sign=1, complete=True)
    """
    _check_digits(digits)
    num, unit = _integers("coefficients", coefficients)
    return _curve_supremum(_Curve(num, unit, open_at_zero), digits, absolute)


def supremum_ratio(
    num: Sequence[Fraction | int], den: Sequence[Fraction | int], digits: int = 30, *, absolute: bool = True
) -> Extremum:
    """The supremum of |num/den| over [0, 1], or over (0, 1] if den(0) = 0, where it then has a limit.

    Certified as for ``supremum``, and that den > 0 on (0, 1] and that the quotient is bounded.

    >>> supremum_ratio([0, 1, -1], [0, 1], digits=2)
    Extremum(lower=Fraction(1, 1), upper=Fraction(1, 1), attained=False, point=(Fraction(1, 100),),
             value_sign=1, complete=True)
    """
    _check_digits(digits)
    (top, top_unit), (bottom, bottom_unit) = _integers("num", num), _integers("den", den)
    rational, factors = _split(bottom)
    if bottom(1) <= 0 or rational or any(_roots(f, _START_BITS) for f in factors):
        raise InputError(f"den: {_text(den)} isn't positive on (0, 1]; divide by something that is")
    common = top.gcd(bottom)
    curve = _Curve(top // common * bottom_unit, bottom // common * top_unit, bottom(0) == 0)
    if curve.den(0) == 0:
        raise InputError(
            f"num: {_text(num)} has fewer factors w than den; the quotient has no supremum, divide by less"
        )
    return _curve_supremum(curve, digits, absolute)


def supremum_simplex(
    terms: Mapping[tuple[int, ...], Fraction | int],
    k: int,
    digits: int = 30,
    budget: int = 5_000_000,
    *,
    absolute: bool = True,
) -> Extremum:
    """The supremum of |p| over w_1 + ... + w_k = 1, w_i >= 0; p by exponents, of any degrees.

    Certified as ``Extremum`` says. ``budget`` limits the Bézier coefficients computed; where that isn't enough, the
    enclosure is wider and ``complete`` false.

    >>> found = supremum_simplex({(1, 1, 1): Fraction(1)}, 3)
    >>> found.upper, found.point
    (Fraction(1, 27), (Fraction(1, 3), Fraction(1, 3), Fraction(1, 3)))
    """
    _check_digits(digits)
    for powers, value in terms.items():
        if len(powers) != k or any(power < 0 for power in powers):
            raise InputError(f"terms: {powers} isn't an exponent for k = {k}; give {k} powers that aren't negative")
        _check_rational("terms", value)
    shift = Fraction(0) if absolute else 1 + sum((abs(Fraction(c)) for c in terms.values()), Fraction(0))
    constant = (0,) * k
    form = Form.of({**terms, constant: terms.get(constant, 0) + shift}, k)
    low, high, peak = maximise(form, Fraction(1, 10 ** (digits + 2)), budget)
    lower, upper = _outward(low, high, digits)
    points = [peak] if lower == upper else _decimals(peak)
    point = next(p for p in points if lower <= abs(form.value(p)) <= upper)
    complete = upper - lower <= _unit(digits, lower)
    result = Extremum(lower, upper, attained=True, point=point, value_sign=_sign(form.value(point)), complete=complete)
    return _lowered(result, shift, form.value(point) - shift)


def below(
    coefficients: Sequence[Fraction | int], tolerance: Fraction | int, near: Fraction | int | None = None
) -> bool:
    """Whether |p(w)| <= tolerance for every w in [0, 1]; ``near`` is looked at first, and often enough for a no.

    Certified either way, touching included: it is compared at every critical point, and equality is divisibility.

    >>> below([0, 1, -1], Fraction(1, 4)), below([0, 1, -1], Fraction(249, 1000), near=Fraction(1, 2))
    (True, False)
    """
    _check_rational("tolerance", tolerance)
    curve = _Curve(*_integers("coefficients", coefficients), open_at_zero=False)
    if near is not None:
        _check_rational("near", near)
        if not 0 <= near <= 1:
            raise InputError(f"near: {near} is outside [0, 1]; give a point inside, or none")
    bound = Fraction(tolerance)
    if any(abs(curve(w)) > bound for w in ([] if near is None else [Fraction(near)])):
        return False
    rational, factors = curve.critical()
    if any(abs(curve(w)) > bound for w in (Fraction(0), Fraction(1), *rational)):
        return False
    return not curve.exceeds([f for f in factors if not curve.ties(f, bound)], bound)


# -- one variable ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Curve:
    """``num/den`` on [0, 1], den without a root there; 0 itself may be left out."""

    num: fmpz_poly
    den: fmpz_poly
    open_at_zero: bool

    def __call__(self, w: Fraction) -> Fraction:
        at = fmpq(w.numerator, w.denominator)
        value = self.num(at) / self.den(at)
        return Fraction(int(value.p), int(value.q))

    def critical(self) -> tuple[list[Fraction], list[fmpz_poly]]:
        return _split(self.num.derivative() * self.den - self.num * self.den.derivative())

    def ties(self, factor: fmpz_poly, value: Fraction) -> bool:
        """Whether |p| is the value at the roots of an irreducible factor."""
        difference = (self.num * value.denominator) ** 2 - (self.den * value.numerator) ** 2
        return not fmpq_poly(difference) % fmpq_poly(factor)

    def balls(self, factors: Iterable[fmpz_poly], bits: int) -> list[tuple[arb, arb]]:
        """Enclosures ``(w, |p(w)|)`` for the roots of the factors, w ascending."""
        with precision(bits):
            found = [(w, abs(self.num(w) / self.den(w))) for f in factors for w in _roots(f, bits)]
        return sorted(found, key=lambda pair: _low(pair[0]))

    def exceeds(self, factors: list[fmpz_poly], value: Fraction) -> bool:
        """Whether |p| is above the value at some root of factors that don't tie with it."""
        bound = fmpq(value.numerator, value.denominator)
        for bits in _doubling(_START_BITS):
            balls = self.balls(factors, bits)
            with precision(bits):
                if any(v > bound for _, v in balls):
                    return True
                if all(v < bound for _, v in balls):
                    return False
        raise AssertionError  # pragma: no cover


def _curve_supremum(curve: _Curve, digits: int, absolute: bool) -> Extremum:
    if not absolute:
        shift = floor(_curve_supremum(curve, 1, absolute=True).upper) + 1
        raised = replace(curve, num=curve.num + curve.den * shift)
        result = _curve_supremum(raised, digits, absolute=True)
        return _lowered(result, Fraction(shift), curve(result.point[0] if result.attained else Fraction(0)))
    rational, factors = curve.critical()
    zero, one = Fraction(0), Fraction(1)
    points = [*rational, one] if curve.open_at_zero else [zero, *rational, one]
    best = max(points, key=lambda w: (abs(curve(w)), -w))
    top = max(abs(curve(best)), abs(curve(zero)))
    rivals = [f for f in factors if not curve.ties(f, top)]
    if curve.exceeds(rivals, top):
        return _irrational(curve, rivals, digits)
    if abs(curve(best)) == top:
        return Extremum(top, top, attained=True, point=(best,), value_sign=_sign(curve(best)))
    tied = [f for f in factors if f not in rivals]
    if curve.balls(tied, _START_BITS):
        return _irrational(curve, tied, digits)
    near = next(w for w in _tenths() if abs(curve(w)) >= top - _unit(digits, top))
    return Extremum(top, top, attained=False, point=(near,), value_sign=_sign(curve(zero)))


def _irrational(curve: _Curve, factors: list[fmpz_poly], digits: int) -> Extremum:
    """The supremum at a root of factors, where it is known to be, and above all values at rational points."""
    low = high = Fraction(0)
    for bits in _doubling(_START_BITS + 4 * digits):
        balls = curve.balls(factors, bits)
        if all(v.is_finite() for _, v in balls):
            low, high = max(_low(v) for _, v in balls), max(_high(v) for _, v in balls)
            if low > 0 and high - low <= _unit(digits + 1, low):
                break
    lower, upper = _outward(low, high, digits)
    root = next(w for w, v in balls if _high(v) >= low)
    near = ((_low(root) - r, _high(root) + r) for r in _tenths())
    points = (_simplest(max(a, Fraction(0)), min(b, Fraction(1))) for a, b in near)
    point = next(w for w in points if w > 0 and lower <= abs(curve(w)) <= upper)
    return Extremum(lower, upper, attained=True, point=(point,), value_sign=_sign(curve(point)))


def _split(poly: fmpz_poly) -> tuple[list[Fraction], list[fmpz_poly]]:
    """The rational roots in (0, 1), ascending, and the irreducible factors that have irrational ones."""
    factors = [f for f, _ in poly.factor()[1]] if poly else []
    roots = sorted(Fraction(-int(f[0]), int(f[1])) for f in factors if f.degree() == 1)
    return [w for w in roots if 0 < w < 1], [f for f in factors if f.degree() > 1]


def _roots(factor: fmpz_poly, bits: int) -> list[arb]:
    """Enclosures of the roots in (0, 1) of an irreducible factor, none of them rational."""
    for enough in _doubling(bits):
        with precision(enough):
            isolated: Any = factor.complex_roots()
            real = [z.real for z, _ in isolated if z.imag == 0]
            inside = [z for z in real if z > 0 and z < 1]
            if len(inside) + sum(bool(z < 0 or z > 1) for z in real) == len(real):
                return inside
    raise AssertionError  # pragma: no cover


def _unit(digits: int, value: Fraction) -> Fraction:
    return min(Fraction(1), value) * Fraction(1, 10**digits)


def _outward(low: Fraction, high: Fraction, digits: int) -> tuple[Fraction, Fraction]:
    """Decimal bounds that leave room below for a rounder point; an exact value stays as it is."""
    if low == high:
        return low, high
    steps = next(10**m for m in count(digits + 1) if 10**m * _unit(digits, low or high) >= 10)
    return Fraction(floor(low * steps) - 1, steps), Fraction(-floor(-high * steps), steps)


def _lowered(result: Extremum, shift: Fraction, value: Fraction) -> Extremum:
    """What was found for p + shift, for p: ``value`` is where its sign is looked up."""
    return replace(result, lower=result.lower - shift, upper=result.upper - shift, value_sign=_sign(value))


def _sign(x: Fraction) -> int:
    return (x > 0) - (x < 0)


def _tenths() -> Iterator[Fraction]:
    return (Fraction(1, 10**j) for j in count(1))


def _doubling(bits: int) -> Iterator[int]:
    return (bits << j for j in count())


def _low(x: arb) -> Fraction:
    return _exact(x.mid()) - _exact(x.rad())


def _high(x: arb) -> Fraction:
    return _exact(x.mid()) + _exact(x.rad())


def _exact(x: arb) -> Fraction:
    value: fmpq = x.fmpq()
    return Fraction(int(value.p), int(value.q))


def _simplest(low: Fraction, high: Fraction) -> Fraction:
    """The fraction of smallest denominator in [low, high]."""
    whole = -floor(-low)
    if whole <= high:
        return Fraction(whole)
    return whole - 1 + 1 / _simplest(1 / (high - whole + 1), 1 / (low - whole + 1))


def _decimals(point: tuple[Fraction, ...]) -> Iterator[tuple[Fraction, ...]]:
    """Points of the simplex of ever larger denominators, ever closer to one."""
    largest = point.index(max(point))
    for q in chain(range(1, 100), (10**j for j in count(2))):
        rounded = [round(w * q) for w in point]
        rounded[largest] += q - sum(rounded)
        yield tuple(Fraction(n, q) for n in rounded)


# -- arguments ---------------------------------------------------------------------------------------


def _check_digits(digits: int) -> None:
    if digits < 1:
        raise InputError(f"digits: {digits} is none; ask for one or more")


def _check_rational(name: str, value: object) -> None:
    if not isinstance(value, Rational):
        raise InputTypeError(f"{name}: {value!r} isn't rational; write Fraction or int")


def _integers(name: str, coefficients: Sequence[Fraction | int]) -> tuple[fmpz_poly, fmpz_poly]:
    """The polynomial as one of integers, over a constant one."""
    for c in coefficients:
        _check_rational(name, c)
    unit = lcm(*(c.denominator for c in coefficients))
    return fmpz_poly([int(c * unit) for c in coefficients]), fmpz_poly([unit])


def _text(coefficients: Sequence[Fraction | int]) -> str:
    return "[" + ", ".join(map(str, coefficients)) + "]"
