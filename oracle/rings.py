"""Number systems: what probabilities and moments are made of.

A ring turns the weights of a law into vectors over rows. The tables only add and multiply such
vectors and scale them by exact columns, so one code serves every number system:

==========  =====================================================================
`Exact`     Python integers over one common denominator, or formulas (Ratios) over 1
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

from truemean.oracle.columns import Column, Ints, quotient
from truemean.oracle.law import Law
from truemean.oracle.symbols import Ratio

__all__ = ["Exact", "Integers", "Ring", "Subsets", "Term", "Vector", "folded"]


class Vector(Protocol):
    """Elements of a ring by row."""

    def __len__(self) -> int: ...
    def __getitem__(self, index: Any) -> Self: ...
    def __add__(self, other: Self) -> Self: ...
    def __mul__(self, other: Self) -> Self: ...
    def __pow__(self, n: Any) -> Self: ...

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

    def __pow__(self, n: Any) -> Integers:
        if isinstance(n, Ratio):
            powers = [n.field.power(n.field.number(quotient(a, self.den)), n) for a in self.num]
            return Integers(np.array(powers, dtype=object), 1)
        return Integers(self.num**n, self.den**n)

    def scale(self, column: Column) -> Integers:
        num, den = column.common()
        return Integers(self.num * num.astype(object), self.den * den)

    def group(self, starts: Ints) -> Integers:
        return Integers(np.add.reduceat(self.num, starts), self.den)

    def sum(self) -> Any:
        total = self.num.sum() if len(self.num) else 0
        return quotient(total.total() if isinstance(total, Ratio) else total, self.den)

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
        first = lattice.moment(1)
        scale = lattice.step.numerator**power
        atoms = [m * (unit * e - first) ** power * scale for m, e in zip(law.masses, lattice.e.tolist(), strict=True)]
        den = unit * (unit * lattice.step.denominator) ** power
        found = subsets.sums(np.array(atoms, dtype=object))
        if law.symbolic:  # whose weights sum to 1, though they need not show it
            whole = (Fraction(1), Fraction(0), law.variance(column))[power] * den
            found[subsets.members().all(axis=1)] = whole
        return Integers(found, den)

    def mean(self, law: Law, column: int) -> Any:
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
            if mass != 1 and most:
                num = num * _powers(mass, most)[powers]
        return Integers(num, law.unit**most)

    def deviation(self, sums: Column, sizes: Column, law: Law, column: int) -> Integers:
        return self.vector(sums - sizes * Column.constant(law.mean(column)))


def _powers(base: Any, most: int) -> Ints:
    powers = np.empty(most + 1, dtype=object)
    power = 1
    for exponent in range(most + 1):
        powers[exponent] = power
        power *= base
    return powers
