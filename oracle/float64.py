"""float64 with a bound of the error that holds: every operation adds its own rounding."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truemean.oracle.columns import Column, Ints, largest
from truemean.oracle.law import Law
from truemean.oracle.rings import Exact, Integers, Subsets, Term, folded

__all__ = ["Approx", "Bounded", "Float64", "round_integers", "rounded"]

Floats = NDArray[np.float64]
_U = 2.0**-53
_TINY = 2.0**-1022
_UP = 1 + 2.0**-48


@dataclass(frozen=True, slots=True)
class Approx:
    """A float and a bound of its distance from the exact value.

    >>> abs(Approx(0.5, 1e-16))
    Approx(value=0.5, error=1e-16)
    """

    value: float
    error: float

    def __float__(self) -> float:
        return self.value

    def __abs__(self) -> Approx:
        return Approx(abs(self.value), self.error)

    def __neg__(self) -> Approx:
        return Approx(-self.value, self.error)

    def __add__(self, other: Approx | int) -> Approx:
        if isinstance(other, int):
            other = rounded(Fraction(other))
        value = self.value + other.value
        return Approx(value, (self.error + other.error + _U * abs(value)) * _UP)

    __radd__ = __add__

    def __sub__(self, other: Approx) -> Approx:
        return self + -other

    def __mul__(self, other: Approx) -> Approx:
        a, b = self, other
        if (a.value == a.error == 0) or (b.value == b.error == 0):
            return Approx(0.0, 0.0)
        value = a.value * b.value
        error = abs(a.value) * b.error + abs(b.value) * a.error + a.error * b.error
        return Approx(value, (error + _U * abs(value)) * _UP + _TINY)

    def __truediv__(self, other: Approx) -> Approx:
        if abs(other.value) <= other.error:
            return Approx(math.nan, math.inf)
        value = self.value / other.value
        error = (self.error + abs(value) * other.error) / (abs(other.value) - other.error)
        return Approx(value, (error + _U * abs(value)) * _UP + _TINY)


def rounded(value: Fraction) -> Approx:
    """The float nearest to an exact number, with a bound of the distance."""
    try:
        nearest = value.numerator / value.denominator
    except OverflowError:
        return Approx(math.copysign(math.inf, value), math.inf)
    exact = Fraction(nearest) == value
    return Approx(nearest, 0.0 if exact else _U * abs(nearest) * _UP + (_TINY if abs(nearest) < _TINY * 2 else 0.0))


@dataclass(frozen=True, slots=True)
class Bounded:
    """Floats by row, each with a bound of its error; every operation adds its own rounding."""

    value: Floats
    error: Floats

    def __len__(self) -> int:
        return len(self.value)

    def __getitem__(self, index: Any) -> Bounded:
        return Bounded(self.value[index], self.error[index])

    def __add__(self, other: Bounded) -> Bounded:
        value = self.value + other.value
        return Bounded(value, (self.error + other.error + _U * abs(value)) * _UP)

    def __mul__(self, other: Bounded) -> Bounded:
        value = self.value * other.value
        error = abs(self.value) * other.error + abs(other.value) * self.error + self.error * other.error
        exact_zero = ((self.value == 0) & (self.error == 0)) | ((other.value == 0) & (other.error == 0))
        return Bounded(value, np.where(exact_zero, 0.0, (error + _U * abs(value)) * _UP + _TINY))

    def __pow__(self, n: int) -> Bounded:
        value = self.value**n
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = np.where(self.value == 0, 0.0, self.error / abs(self.value))
        error = abs(value) * (np.expm1(n * np.log1p(relative)) + 16 * _U) * _UP + (_TINY if n else 0.0)
        return Bounded(value, np.where((self.value == 0) & (self.error == 0), 0.0, error))

    def scale(self, column: Column) -> Bounded:
        return self * _floats(column)

    def group(self, starts: Ints) -> Bounded:
        ends = np.append(starts[1:], len(self.value))
        sums = [self[a:b].sum() for a, b in zip(starts, ends, strict=True)]
        return Bounded(np.array([s.value for s in sums]), np.array([s.error for s in sums]))

    def sum(self) -> Approx:
        value = math.fsum(self.value)
        return Approx(value, (math.fsum(self.error) + _U * abs(value)) * _UP)

    def join(self, others: list[Bounded]) -> Bounded:
        both = (self, *others)
        return Bounded(np.concatenate([v.value for v in both]), np.concatenate([v.error for v in both]))

    def numbers(self) -> tuple[list[Any], int]:
        return list(map(Approx, self.value.tolist(), self.error.tolist())), 1


class Float64:
    """float64, with atoms and integer tables rounded from their exact values."""

    closed = True

    def subset_sums(self, law: Law, column: int, power: int, subsets: Subsets) -> Bounded:
        return round_integers(Exact().subset_sums(law, column, power, subsets))

    def mean(self, law: Law, column: int) -> Approx:
        return rounded(law.mean(column))

    def combined(self, rest: Column, terms: list[Term]) -> Bounded:
        return self.vector(folded(rest, terms))

    def number(self, value: Fraction) -> Approx:
        return rounded(value)

    def vector(self, column: Column) -> Bounded:
        return _floats(column)

    def counted(self, orders: Ints, exponents: Ints, law: Law) -> Bounded:
        return round_integers(Exact().counted(orders, exponents, law))

    def deviation(self, sums: Column, sizes: Column, law: Law, column: int) -> Bounded:
        return _floats(sums - sizes * Column.constant(law.mean(column)))


def round_integers(exact: Integers) -> Bounded:
    """Exact numbers by row, rounded to nearest."""
    value = np.array([a / exact.den for a in exact.num], dtype=float)
    return Bounded(value, np.where(value == 0, np.where(exact.num == 0, 0.0, _TINY), _U * _UP * abs(value) + _TINY))


def _floats(column: Column) -> Bounded:
    value = column.floats()
    if len(column.den) == 1 and column.den[0] == 1 and largest(column.num) < 1 << 53:
        return Bounded(value, np.zeros_like(value))
    return Bounded(value, np.where(column.num == 0, 0.0, _U * _UP * abs(value) + _TINY))
