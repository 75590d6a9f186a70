"""Columns: vectors of exact rationals, one entry per row, and the few roots that decisions need.

A `Column` holds integer numerators and denominators, in int64 while they fit and in Python
integers beyond. A denominator 0 marks an entry that is undefined (0/0); it stays undefined under
arithmetic, and only what finally uses it complains. A `Surd` is ``a + b*sqrt(c)`` with columns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Column", "NotRational", "Surd", "grouping", "integers", "largest", "plus", "times"]

Ints = NDArray[Any]
Bools = NDArray[np.bool_]
_LIMIT = 1 << 62


class NotRational(Exception):
    """The value has no form that columns can hold exactly; use enclosures."""


def integers(values: Iterable[int]) -> Ints:
    """Integers as int64 if they all fit, as Python integers otherwise."""
    listed = list(values)
    if all(-_LIMIT < v < _LIMIT for v in listed):
        return np.array(listed, dtype=np.int64)
    return np.array(listed, dtype=object)


def largest(array: Ints) -> int:
    """The largest absolute value (0 for an empty array)."""
    return int(max(array.max(), -array.min())) if array.size else 0


def times(a: Ints, b: Ints) -> Ints:
    """Product that never overflows."""
    if a.dtype != object and b.dtype != object and largest(a) * largest(b) >= _LIMIT:
        a = a.astype(object)
    return np.asarray(a * b)


def plus(a: Ints, b: Ints) -> Ints:
    """Sum that never overflows."""
    if a.dtype != object and b.dtype != object and largest(a) + largest(b) >= _LIMIT:
        a = a.astype(object)
    return np.asarray(a + b)


def grouping(keys: list[Ints]) -> tuple[Ints, Ints]:
    """``(order, starts)``: a permutation that brings equal keys together, and where each run begins."""
    flat = [column for key in keys for column in (key.T if key.ndim == 2 else (key,))]
    ranked = [np.unique(key, return_inverse=True)[1] if key.dtype == object else key for key in flat]
    order = np.lexsort(ranked[::-1])
    change = np.zeros(len(order), dtype=bool)
    change[:1] = True
    for key in ranked:
        change[1:] |= key[order][1:] != key[order][:-1]
    return order, np.flatnonzero(change)


@dataclass(frozen=True, slots=True)
class Column:
    """Rationals ``num / den`` by row; both 1-D and of equal length, or of length 1 for a constant."""

    num: Ints
    den: Ints

    @classmethod
    def constant(cls, value: Fraction | int) -> Column:
        """The same number on every row."""
        return cls(integers([value.numerator]), integers([value.denominator]))

    @classmethod
    def of(cls, values: Iterable[Fraction | int]) -> Column:
        """One number per row."""
        listed = list(values)
        return cls(integers(v.numerator for v in listed), integers(v.denominator for v in listed))

    @classmethod
    def whole(cls, num: Ints, den: int = 1) -> Column:
        """Integers over one common denominator."""
        return cls(num, integers([den]))

    def __len__(self) -> int:
        return max(len(self.num), len(self.den))

    def __getitem__(self, index: Any) -> Column:
        num = self.num if len(self.num) == 1 else self.num[index]
        den = self.den if len(self.den) == 1 else self.den[index]
        return Column(num, den)

    def spread(self, rows: int) -> Column:
        """The same column with all its entries written out."""
        return Column(np.broadcast_to(self.num, (rows,)), np.broadcast_to(self.den, (rows,)))

    @property
    def undefined(self) -> Bools:
        """Where the entry is 0/0 or x/0."""
        return np.asarray(self.den == 0, dtype=bool)

    @property
    def is_zero(self) -> bool:
        """Whether every entry is 0."""
        return not self.num.any()

    def fractions(self) -> list[Fraction]:
        """All entries as Fractions; none may be undefined."""
        if len(self.den) == 1:
            den = int(self.den[0])
            return [Fraction(int(a), den) for a in self.num]
        num = np.broadcast_to(self.num, self.den.shape)
        return [Fraction(int(a), int(b)) for a, b in zip(num, self.den, strict=True)]

    def common(self) -> tuple[Ints, int]:
        """``(numerators, one denominator)``; no entry may be undefined."""
        if len(self.den) == 1:
            return self.num, int(self.den[0])
        den = math.lcm(*(int(d) for d in set(self.den.tolist())))
        if den >= _LIMIT:
            return times(self.num, np.array([den // int(d) for d in self.den], dtype=object)), den
        return times(self.num, np.asarray(den // self.den)), den

    def floats(self) -> NDArray[np.float64]:
        """Entries rounded to float64 (to nearest)."""
        if largest(self.num) < 1 << 53 and largest(self.den) < 1 << 53:
            with np.errstate(divide="ignore", invalid="ignore"):
                return np.asarray(self.num.astype(float) / self.den.astype(float))
        return np.array([a / b if b else math.nan for a, b in zip(*self._python(), strict=True)], dtype=float)

    def _python(self) -> tuple[list[int], list[int]]:
        rows = len(self)
        num, den = (np.broadcast_to(x, (rows,)).astype(object).tolist() for x in (self.num, self.den))
        return num, den

    # -- arithmetic --------------------------------------------------------------------------

    def __add__(self, other: Column) -> Column:
        if len(self.den) == len(other.den) == 1:
            a, b = int(self.den[0]), int(other.den[0])
            if a == b:
                return Column(plus(self.num, other.num), self.den)
            if a and b:
                den = math.lcm(a, b)
                left, right = integers([den // a]), integers([den // b])
                return Column(plus(times(self.num, left), times(other.num, right)), integers([den]))
        num = plus(times(self.num, other.den), times(other.num, self.den))
        return _tidy(num, times(self.den, other.den))

    def __neg__(self) -> Column:
        return Column(-self.num, self.den)

    def __sub__(self, other: Column) -> Column:
        return self + -other

    def __mul__(self, other: Column) -> Column:
        return _tidy(times(self.num, other.num), times(self.den, other.den))

    def __truediv__(self, other: Column) -> Column:
        sign = np.where(other.num < 0, -1, 1)
        den = times(times(self.den, np.asarray(other.num * sign)), np.where(other.den == 0, 0, 1))
        return _tidy(times(times(self.num, other.den), sign), den)

    def __pow__(self, exponent: int) -> Column:
        if exponent < 0:
            return Column.constant(1) / self**-exponent
        power = Column.constant(1)
        for _ in range(exponent):
            power = power * self
        return power

    # -- functions by entry ------------------------------------------------------------------

    def sign(self) -> NDArray[np.int64]:
        """-1, 0 or 1 by row; 0 where undefined (ask `undefined` first)."""
        shape = (len(self),)
        signs = np.broadcast_to(np.sign(self.num).astype(np.int64), shape)
        return np.asarray(np.where(np.broadcast_to(self.den, shape) != 0, signs, 0))

    def floor(self) -> Column:
        """The largest integer not above."""
        return self._rounded(lambda a, b: a // b)

    def ceil(self) -> Column:
        """The smallest integer not below."""
        return self._rounded(lambda a, b: -(-a // b))

    def round(self) -> Column:
        """The nearest integer, ties to even as Python rounds."""
        return Column(*_parts(round(Fraction(a, b)) if b else None for a, b in zip(*self._python(), strict=True)))

    def _rounded(self, function: Callable[[Ints, Ints], Ints]) -> Column:
        defined = self.den != 0
        return Column(np.asarray(function(self.num, np.where(defined, self.den, 1))), np.where(defined, 1, 0))

    def where(self, mask: Bools, other: Column) -> Column:
        """This column where ``mask`` holds, ``other`` elsewhere."""
        return Column(np.where(mask, self.num, other.num), np.where(mask, self.den, other.den))


def _parts(values: Iterable[int | None]) -> tuple[Ints, Ints]:
    listed = list(values)
    return integers(v or 0 for v in listed), integers(0 if v is None else 1 for v in listed)


def _tidy(num: Ints, den: Ints) -> Column:
    """Divide out common factors once numbers have outgrown int64; constants always."""
    if len(den) == 1 and len(num) > 1 and den.dtype != object:
        return Column(num, den)
    if den.dtype == object or num.dtype == object or len(num) == 1:
        wide_num, wide_den = np.broadcast_arrays(num, den)
        common = np.gcd(wide_num.astype(object), wide_den.astype(object))
        common = np.where(common == 0, 1, common)
        num, den = _narrow(wide_num // common), _narrow(wide_den // common)
    return Column(num, den)


def _narrow(array: Ints) -> Ints:
    return array.astype(np.int64) if array.size and largest(array) < _LIMIT else array


@dataclass(frozen=True, slots=True)
class Surd:
    """``rational + factor * sqrt(radicand)`` by row, radicand >= 0; enough for standard errors."""

    rational: Column
    factor: Column
    radicand: Column

    @classmethod
    def root(cls, radicand: Column) -> Surd:
        """The square root of a column; undefined where it is negative."""
        negative = Column(radicand.num, np.where(radicand.num < 0, 0, radicand.den))
        return cls(Column.constant(0), Column.constant(1), negative)

    @property
    def undefined(self) -> Bools:
        """Where any part is undefined."""
        return np.asarray(self.rational.undefined | self.factor.undefined | self.radicand.undefined)

    def __neg__(self) -> Surd:
        return Surd(-self.rational, -self.factor, self.radicand)

    def __add__(self, other: Column | Surd) -> Surd:
        if isinstance(other, Column):
            return Surd(self.rational + other, self.factor, self.radicand)
        if other.radicand is not self.radicand:
            raise NotRational("a sum of different roots")
        return Surd(self.rational + other.rational, self.factor + other.factor, self.radicand)

    def __mul__(self, other: Column | Surd) -> Column | Surd:
        if isinstance(other, Column):
            return Surd(self.rational * other, self.factor * other, self.radicand)
        if not (self.rational.is_zero and other.rational.is_zero):
            raise NotRational("a product of sums with roots")
        factor = self.factor * other.factor
        if other.radicand is self.radicand:
            return factor * self.radicand
        return Surd(Column.constant(0), factor, self.radicand * other.radicand)

    def inverse(self) -> Surd:
        """``1 / self`` for a pure root."""
        if not self.rational.is_zero:
            raise NotRational("a quotient by a sum with a root")
        return Surd(Column.constant(0), Column.constant(1) / (self.factor * self.radicand), self.radicand)

    def sign(self) -> NDArray[np.int64]:
        """-1, 0 or 1 by row, decided by squaring: no root is ever taken."""
        a, b = self.rational.sign(), self.factor.sign() * self.radicand.sign()
        squares = self.rational * self.rational - self.factor * self.factor * self.radicand
        return np.asarray(np.where(b == 0, a, np.where(a == b, a, np.where(a == 0, b, a * squares.sign()))))
