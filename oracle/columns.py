"""Columns: vectors of exact rationals, one entry per row, and the few roots that decisions need.

A `Column` holds integer numerators and denominators, in int64 while they fit and in Python
integers beyond. A denominator 0 marks an entry that is undefined (0/0); it stays undefined under
arithmetic, and only what finally uses it complains. A `Surd` is ``a + b*sqrt(c)`` with columns.
Where symbols are left open the numerators are Ratios, and a comparison may have neither answer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truemean.errors import NoClosedForm
from truemean.oracle.symbols import HOLDS, Ratio, root_relation

__all__ = [
    "Column",
    "NotRational",
    "Surd",
    "grouping",
    "integers",
    "largest",
    "negation",
    "plus",
    "quotient",
    "symbolic",
    "times",
    "truths",
]

Ints = NDArray[Any]
Bools = NDArray[np.bool_]
_LIMIT = 1 << 62


class NotRational(Exception):
    """The value has no form that columns can hold exactly; use enclosures."""


def integers(values: Iterable[Any]) -> Ints:
    """Integers as int64 if they all fit, as Python integers otherwise."""
    listed = list(values)
    if all(type(v) is not Ratio and -_LIMIT < v < _LIMIT for v in listed):
        return np.array(listed, dtype=np.int64)
    return np.array(listed, dtype=object)


def symbolic(array: Any) -> bool:
    """Whether an array holds numbers that depend on symbols."""
    return array.dtype == object and any(type(x) is Ratio for x in array.flat)


def quotient(num: Any, den: int) -> Any:
    """A Fraction, or a Ratio if the numerator is one."""
    return num * Fraction(1, den) if type(num) in (Ratio, Fraction) else Fraction(int(num), den)


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
    ranked = [_ranked(key) if key.dtype == object else key for key in flat]
    order = np.lexsort(ranked[::-1])
    change = np.zeros(len(order), dtype=bool)
    change[:1] = True
    for key in ranked:
        change[1:] |= key[order][1:] != key[order][:-1]
    return order, np.flatnonzero(change)


def _number(value: Any) -> Any:
    """A formula without symbols as the number that it is."""
    return value.constant if type(value) is Ratio and value.is_constant else value


def _ranked(key: Ints) -> Ints:
    """Equal numbers for equal entries; formulas have no order, so any will do."""
    if symbolic(key):
        seen: dict[Any, int] = {}
        return np.array([seen.setdefault(x, len(seen)) for x in key], dtype=np.int64)
    return np.unique(key, return_inverse=True)[1]


@dataclass(frozen=True, slots=True)
class Column:
    """Rationals ``num / den`` by row; both 1-D and of equal length, or of length 1 for a constant."""

    num: Ints
    den: Ints

    @classmethod
    def constant(cls, value: Any) -> Column:
        """The same number on every row."""
        value = _number(value)
        return cls(integers([value.numerator]), integers([value.denominator]))

    @classmethod
    def of(cls, values: Iterable[Any]) -> Column:
        """One number per row."""
        listed = list(map(_number, values))
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

    def fractions(self) -> list[Any]:
        """All entries as Fractions (or Ratios); none may be undefined."""
        if len(self.den) == 1:
            den = int(self.den[0])
            return [quotient(a, den) for a in self.num]
        num = np.broadcast_to(self.num, self.den.shape)
        return [quotient(a, int(b)) for a, b in zip(num, self.den, strict=True)]

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
        if symbolic(other.num):
            inverses = [_inverse(a) for a in other.num]
            return self * Column(times(np.array([a for a, _ in inverses], dtype=object), other.den), _ones(inverses))
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

    def holds(self, op: str) -> Any:
        """The truth of ``entry op 0`` by row: True or False, or a 0/1 Ratio where a symbol decides it."""
        if not symbolic(self.num):
            return HOLDS[op](self.sign())
        num, den = (np.broadcast_to(x, (len(self),)) for x in (self.num, self.den))
        return truths(
            HOLDS[op](0) if b == 0 else a.field.condition(a, op) if type(a) is Ratio else HOLDS[op](a)
            for a, b in zip(num, den, strict=True)
        )

    def sign(self) -> NDArray[np.int64]:
        """-1, 0 or 1 by row; 0 where undefined (ask `undefined` first)."""
        shape = (len(self),)
        if symbolic(self.num):
            above, below = self.holds(">"), self.holds("<")
            if symbolic(above) or symbolic(below):
                raise undecided(self.num)
            return np.asarray(above, dtype=np.int64) - np.asarray(below, dtype=np.int64)
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
        self._check_whole()
        return Column(*_parts(round(Fraction(a, b)) if b else None for a, b in zip(*self._python(), strict=True)))

    def _rounded(self, function: Callable[[Ints, Ints], Ints]) -> Column:
        self._check_whole()
        defined = self.den != 0
        return Column(np.asarray(function(self.num, np.where(defined, self.den, 1))), np.where(defined, 1, 0))

    def _check_whole(self) -> None:
        if symbolic(self.num):
            number = next(x for x in self.num if type(x) is Ratio and not x.is_constant)
            raise NoClosedForm(f"{number} can't be rounded while it is a formula: make its symbols numbers")

    def where(self, mask: Any, other: Column) -> Column:
        """This column where ``mask`` holds, ``other`` elsewhere; where that is open, both times their conditions."""
        if symbolic(mask):
            chosen = Column.whole(mask)
            return self * chosen + other * (Column.constant(1) - chosen)
        return Column(np.where(mask, self.num, other.num), np.where(mask, self.den, other.den))


def truths(values: Iterable[Any]) -> Any:
    """Truths by row: booleans if all are decided."""
    listed = list(values)
    return np.array(listed, dtype=object if any(type(v) is Ratio for v in listed) else bool)


def negation(truths: Any) -> Any:
    """The opposite, by row."""
    return 1 - truths if symbolic(truths) else ~truths


def undecided(entries: Ints) -> NoClosedForm:
    """The error for a number whose sign a symbol decides where that can't be left open."""
    number = next(x for x in entries if type(x) is Ratio and not x.is_constant)
    return NoClosedForm(f"the sign of {number} is decided by a symbol: make it a number, or declare positive=True")


def _inverse(a: Any) -> tuple[Any, int]:
    """``(1 / a, 1)``, or ``(1, 0)`` for 0: undefined."""
    return (1 / a if type(a) is Ratio else Fraction(1, int(a)), 1) if a else (1, 0)


def _ones(inverses: list[tuple[Any, int]]) -> Ints:
    return np.array([b for _, b in inverses], dtype=np.int64)


def _parts(values: Iterable[int | None]) -> tuple[Ints, Ints]:
    listed = list(values)
    return integers(v or 0 for v in listed), integers(0 if v is None else 1 for v in listed)


def _tidy(num: Ints, den: Ints) -> Column:
    """Divide out common factors once numbers have outgrown int64; constants always."""
    if len(den) == 1 and len(num) > 1 and den.dtype != object:
        return Column(num, den)
    if symbolic(num):
        return Column(*_absorbed(num, den))
    if den.dtype == object or num.dtype == object or len(num) == 1:
        wide_num, wide_den = np.broadcast_arrays(num, den)
        common = np.gcd(wide_num.astype(object), wide_den.astype(object))
        common = np.where(common == 0, 1, common)
        num, den = _narrow(wide_num // common), _narrow(wide_den // common)
    return Column(num, den)


def _absorbed(num: Ints, den: Ints) -> tuple[Ints, Ints]:
    """Numerators that are formulas take their denominators in: what is left of these is 1, or 0 for undefined."""
    wide_num, wide_den = np.broadcast_arrays(num, den)
    field = next(x.field for x in num if type(x) is Ratio)
    whole = [field.number(quotient(a, int(b)) if b else 0) for a, b in zip(wide_num, wide_den, strict=True)]
    if all(x.is_constant for x in whole):
        known = [x.constant for x in whole]
        defined = np.where(wide_den == 0, 0, 1)
        return integers(x.numerator for x in known), integers(x.denominator for x in known) * defined
    return np.array(whole, dtype=object), np.where(wide_den == 0, 0, 1).astype(np.int64)


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
        if symbolic(radicand.num):
            return cls(Column.constant(0), Column.constant(1), radicand)
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

    def holds(self, op: str) -> Any:
        """The truth of ``entry op 0`` by row, as for columns."""
        columns = (self.rational, self.factor, self.radicand)
        if not any(symbolic(c.num) for c in columns):
            return HOLDS[op](self.sign())
        rows = max(map(len, columns))
        a, b, c = (x.spread(rows).fractions() for x in columns)
        return truths(root_relation(*row, op) for row in zip(a, b, c, strict=True))

    def sign(self) -> NDArray[np.int64]:
        """-1, 0 or 1 by row, decided by squaring: no root is ever taken."""
        a, b = self.rational.sign(), self.factor.sign() * self.radicand.sign()
        squares = self.rational * self.rational - self.factor * self.factor * self.radicand
        return np.asarray(np.where(b == 0, a, np.where(a == b, a, np.where(a == 0, b, a * squares.sign()))))
