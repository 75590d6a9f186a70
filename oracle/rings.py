"""Number systems: what probabilities and moments are made of.

A ring turns the weights of a law into vectors over rows. The tables only add and multiply such
vectors and scale them by exact columns, so one code serves every number system:

==========  =====================================================================
`Exact`     Python integers over one common denominator
`Float64`   float64 with a running bound of the error
`Batch`     float64 arrays with the pixels of an image as a second axis
==========  =====================================================================
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from truemean.oracle.columns import Column, Ints, largest
from truemean.oracle.law import Law

__all__ = ["Approx", "Batch", "Exact", "Float64", "Ring", "Subsets", "Term", "Vector", "folded", "rounded"]

Floats = NDArray[np.float64]
_U = 2.0**-53
_TINY = 2.0**-1022
_UP = 1 + 2.0**-48


class Vector(Protocol):
    """Elements of a ring by row."""

    def __len__(self) -> int: ...
    def __getitem__(self, index: Any) -> Self: ...
    def __add__(self, other: Self) -> Self: ...
    def __mul__(self, other: Self) -> Self: ...
    def __pow__(self, n: int) -> Self: ...

    @abstractmethod
    def scale(self, column: Column) -> Self:
        """Each row times an exact number."""

    @abstractmethod
    def group(self, starts: Ints) -> Self:
        """Sums of consecutive rows, each run beginning at one of ``starts``."""

    @abstractmethod
    def sum(self) -> Any:
        """The sum of all rows, in the ring's own number type."""

    @abstractmethod
    def join(self, others: list[Self]) -> Self:
        """These rows followed by those of the others."""

    @abstractmethod
    def numbers(self) -> tuple[list[Any], int]:
        """The rows as ring numbers times a common unit."""


Term = tuple[Column, tuple[Law, int], str]


def folded(rest: Column, terms: list[Term]) -> Column:
    """``rest + sum of coefficient * (mean or variance of a column)``, exactly."""
    for coefficient, (law, column), moment in terms:
        rest = rest + coefficient * Column.constant(law.mean(column) if moment == "mean" else law.variance(column))
    return rest


class Subsets(Protocol):
    """Some subsets of the k atoms."""

    def sums(self, atoms: Ints) -> Ints:
        """Sum of exact atom values over each subset."""

    def members(self) -> NDArray[np.bool_]:
        """Membership ``[subsets, k]``."""


class Ring(Protocol):
    """A number system: weights of a law in, vectors out; ``closed`` if the weights are known exactly."""

    closed: bool

    def subset_sums(self, law: Law, column: int, power: int, subsets: Subsets) -> Any:
        """Sums of ``omega_i (x_i - E[x])**power`` over subsets of the atoms, as a vector."""

    def mean(self, law: Law, column: int) -> Any:
        """The true mean of a column, in the ring's number type."""

    def number(self, value: Fraction) -> Any:
        """An exact number in the ring's number type."""

    def vector(self, column: Column) -> Any:
        """An exact column as a vector."""

    def counted(self, orders: Ints, exponents: Ints, law: Law) -> Any:
        """``orders * product of omega_i ** exponents[:, i]`` by row."""

    def deviation(self, sums: Column, sizes: Column, law: Law, column: int) -> Any:
        """``sums - sizes * E[x]`` by row, as a vector."""

    def combined(self, rest: Column, terms: list[Term]) -> Any:
        """``rest + sum of coefficient * (mean or variance of a column)`` by row, as a vector."""


# -- exact ----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Integers:
    """Rationals by row as Python integers ``num`` over one denominator ``den``."""

    num: Ints
    den: int

    def __len__(self) -> int:
        return len(self.num)

    def __getitem__(self, index: Any) -> Integers:
        return Integers(self.num[index], self.den)

    def __add__(self, other: Integers) -> Integers:
        if self.den == other.den:
            return Integers(self.num + other.num, self.den)
        den = math.lcm(self.den, other.den)
        return Integers(self.num * (den // self.den) + other.num * (den // other.den), den)

    def __mul__(self, other: Integers) -> Integers:
        return Integers(self.num * other.num, self.den * other.den)

    def __pow__(self, n: int) -> Integers:
        return Integers(self.num**n, self.den**n)

    def scale(self, column: Column) -> Integers:
        num, den = column.common()
        return Integers(self.num * num.astype(object), self.den * den)

    def group(self, starts: Ints) -> Integers:
        return Integers(np.add.reduceat(self.num, starts), self.den)

    def sum(self) -> Fraction:
        return Fraction(int(self.num.sum()) if len(self.num) else 0, self.den)

    def join(self, others: list[Integers]) -> Integers:
        den = math.lcm(self.den, *(v.den for v in others))
        return Integers(np.concatenate([v.num * (den // v.den) for v in (self, *others)]), den)

    def numbers(self) -> tuple[list[Any], int]:
        return self.num.tolist(), self.den


class Exact:
    """Rational arithmetic: integers over the common denominators of weights and values."""

    closed = True

    def subset_sums(self, law: Law, column: int, power: int, subsets: Subsets) -> Integers:
        lattice, unit = law.lattice(column), law.unit
        first = sum(mass * e for mass, e in zip(law.masses, lattice.e.tolist(), strict=True))
        scale = lattice.step.numerator**power
        atoms = [m * (unit * e - first) ** power * scale for m, e in zip(law.masses, lattice.e.tolist(), strict=True)]
        den = unit * (unit * lattice.step.denominator) ** power
        return Integers(subsets.sums(np.array(atoms, dtype=object)), den)

    def mean(self, law: Law, column: int) -> Fraction:
        return law.mean(column)

    def combined(self, rest: Column, terms: list[Term]) -> Integers:
        return self.vector(folded(rest, terms))

    def number(self, value: Fraction) -> Fraction:
        return value

    def vector(self, column: Column) -> Integers:
        num, den = column.common()
        return Integers(num.astype(object), den)

    def counted(self, orders: Ints, exponents: Ints, law: Law) -> Integers:
        top = exponents.sum(axis=1) if exponents.size else np.zeros(len(orders), dtype=np.int64)
        most = int(top.max(initial=0))
        num = orders.astype(object)
        for mass, powers in zip([*law.masses, law.unit], [*exponents.T, most - top], strict=True):
            if mass != 1:
                num = num * _powers(mass, most)[powers]
        return Integers(num, law.unit**most)

    def deviation(self, sums: Column, sizes: Column, law: Law, column: int) -> Integers:
        return self.vector(sums - sizes * Column.constant(law.mean(column)))


def _powers(base: int, most: int) -> Ints:
    powers = np.empty(most + 1, dtype=object)
    power = 1
    for exponent in range(most + 1):
        powers[exponent] = power
        power *= base
    return powers


# -- float64 with a bound -------------------------------------------------------------------------


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


# -- float64 over the pixels of an image ----------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Plane:
    """Floats by row and pixel: ``array [rows, pixels]``."""

    array: Floats

    def __len__(self) -> int:
        return len(self.array)

    def __getitem__(self, index: Any) -> Plane:
        return Plane(self.array[index])

    def __add__(self, other: Plane) -> Plane:
        return Plane(self.array + other.array)

    def __mul__(self, other: Plane) -> Plane:
        return Plane(self.array * other.array)

    def __pow__(self, n: int) -> Plane:
        return Plane(self.array**n)

    def scale(self, column: Column) -> Plane:
        return Plane(self.array * column.floats()[:, None])

    def group(self, starts: Ints) -> Plane:
        return Plane(np.add.reduceat(self.array, starts, axis=0))

    def sum(self) -> Floats:
        return np.asarray(self.array.sum(axis=0))

    def join(self, others: list[Plane]) -> Plane:
        return Plane(np.concatenate([v.array for v in (self, *others)]))

    def numbers(self) -> tuple[list[Any], int]:
        return list(self.array), 1


class Batch:
    """Many pixels of the same values at once: ``weights [k, ...]`` in the order of the law's atoms."""

    closed = False

    def __init__(self, law: Law, weights: Floats) -> None:
        self.law, self.shape = law, weights.shape[1:]
        self.array = weights.reshape(len(weights), -1)

    def _weights(self, law: Law) -> Floats:
        """The open weights for the pixel's own law, the fixed ones for any other."""
        if law is self.law:
            return self.array
        return np.repeat(np.array(law.weights, dtype=float)[:, None], self.array.shape[1], axis=1)

    def _values(self, law: Law, column: int) -> Floats:
        return np.array([float(x) for x in law.column(column)])

    def subset_sums(self, law: Law, column: int, power: int, subsets: Subsets) -> Plane:
        atoms = self._weights(law) * (self._values(law, column)[:, None] - self.mean(law, column)) ** power
        return Plane(subsets.members().astype(float) @ atoms)

    def mean(self, law: Law, column: int) -> Floats:
        return np.asarray(self._values(law, column) @ self._weights(law))

    def variance(self, law: Law, column: int) -> Floats:
        """The variance of a column, by pixel."""
        deviations = self._values(law, column)[:, None] - self.mean(law, column)
        return np.asarray((self._weights(law) * deviations**2).sum(axis=0))

    def number(self, value: Fraction) -> Floats:
        return np.full(self.array.shape[1], float(value))

    def vector(self, column: Column) -> Plane:
        return Plane(np.repeat(column.floats()[:, None], self.array.shape[1], axis=1))

    def combined(self, rest: Column, terms: list[Term]) -> Plane:
        total = self.vector(rest)
        for coefficient, (law, column), moment in terms:
            by_pixel = self.mean(law, column) if moment == "mean" else self.variance(law, column)
            total = total + Plane(coefficient.spread(len(rest)).floats()[:, None] * by_pixel)
        return total

    def counted(self, orders: Ints, exponents: Ints, law: Law) -> Plane:
        logs = np.array([math.log(int(n)) for n in orders])[:, None]
        with np.errstate(divide="ignore"):
            log_weights = np.log(self._weights(law))
        for powers, log_weight in zip(exponents.T, log_weights, strict=True):
            used = powers[:, None] > 0
            logs = logs + np.where(used, powers[:, None] * np.where(used, log_weight, 0.0), 0.0)
        return Plane(np.exp(logs))

    def deviation(self, sums: Column, sizes: Column, law: Law, column: int) -> Plane:
        return Plane(sums.floats()[:, None] - sizes.floats()[:, None] * self.mean(law, column))
