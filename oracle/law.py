"""The law of one draw: atoms with exact weights, and columns of numbers attached to the atoms.

A column is what may be averaged: the value itself, one channel of a colour, or a weighted value.
Every column is a lattice, ``base + step * e`` with small non-negative integers ``e``, so sums of
draws are sums of integers. Choices of the estimator and sub-estimates are laws like any other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np

from truemean.oracle.columns import Ints, integers, quotient
from truemean.oracle.subsets import Family, family
from truemean.oracle.symbols import Ratio

__all__ = ["Lattice", "Law"]

Atom = tuple[Any, ...]


@dataclass(frozen=True)
class Lattice:
    """One column of the atoms as ``base + step * e``, with its moments under the law."""

    base: Fraction
    step: Fraction
    e: Ints
    masses: tuple[Any, ...]
    unit: int

    @cached_property
    def mean(self) -> Any:
        """Base + step E[e]."""
        return self.base + self.step * quotient(self.moment(1), self.unit)

    @cached_property
    def variance(self) -> Any:
        """step^2 (E[e^2] - E[e]^2), in integers."""
        unit, first = self.unit, self.moment(1)
        return self.step**2 * quotient(unit * self.moment(2) - first * first, unit * unit)

    def moment(self, order: int) -> Any:
        """The sum of masses times e^order."""
        return sum(mass * e**order for mass, e in zip(self.masses, self.e.tolist(), strict=True))


class Law:
    """A finite law: ``atoms`` in ascending order (tuples by column), ``weights`` all positive.

    ``cost`` and ``oracle_calls`` are what one draw costs; a choice of the estimator costs nothing.
    """

    def __init__(
        self,
        atoms: Sequence[Atom],
        weights: Sequence[Fraction],
        name: str = "X",
        cost: Fraction = Fraction(1),
        oracle_calls: Fraction = Fraction(0),
    ) -> None:
        unit = math.lcm(*(v.denominator for atom in atoms for v in atom))
        pairs = [(atom, weight) for atom, weight in zip(atoms, weights, strict=True) if weight]
        pairs.sort(key=lambda pair: [v.numerator * (unit // v.denominator) for v in pair[0]])
        self.name, self._cost, self._oracle_calls = name, cost, oracle_calls
        self._weights: tuple[Any, ...] = tuple(weight for _, weight in pairs)
        self._values: tuple[Atom, ...] = tuple(atom for atom, _ in pairs)
        self.channels = len(self.values[0])
        self.ratios: dict[Atom, Any] | None = None  # density ratios of a proposal
        self.open = False  # whether the weights only stand for others, to be given later
        self._lattices = [self._read_lattice(list(column)) for column in zip(*self.values, strict=True)]

    @property
    def values(self) -> tuple[Atom, ...]:
        """The atoms in ascending order, tuples by column."""
        return self._values

    @property
    def weights(self) -> tuple[Any, ...]:
        """The weights of the atoms."""
        return self._weights

    @property
    def cost(self) -> Any:
        """What one draw costs, in draws."""
        return self._cost

    @property
    def oracle_calls(self) -> Any:
        """What one draw costs, in oracle calls."""
        return self._oracle_calls

    @property
    def drawn(self) -> bool:
        """Whether it is drawn from a pixel, and no choice or sub-estimate."""
        return bool(self.cost)

    @property
    def symbolic(self) -> bool:
        """Whether weights or values are formulas."""
        return False

    @property
    def symbolic_values(self) -> bool:
        """Whether values are formulas."""
        return False

    @property
    def indexed(self) -> bool:
        """Whether one atom stands for all of a symbolic number."""
        return False

    @property
    def ordered(self) -> bool:
        """Whether the atoms ascend, so that the lowest and highest seen are a window of them."""
        return self.channels == 1

    @property
    def k(self) -> int:
        """Number of atoms."""
        return len(self.values)

    @cached_property
    def unit(self) -> int:
        """The common denominator A of the weights."""
        return math.lcm(*(w.denominator for w in self.weights))

    @cached_property
    def masses(self) -> list[Any]:
        """Integer weights a_i = A omega_i."""
        return [int(w * self.unit) for w in self.weights]

    def lattice(self, column: int) -> Lattice:
        """The column as integers."""
        return self._lattices[column]

    def column(self, column: int) -> list[Any]:
        """The column's number at each atom."""
        lattice = self.lattice(column)
        return [lattice.base + lattice.step * e for e in lattice.e.tolist()]

    def mean(self, column: int) -> Any:
        """The true mean of a column."""
        return self.lattice(column).mean

    def variance(self, column: int) -> Any:
        """The variance of a column."""
        return self.lattice(column).variance

    @property
    def least_sign(self) -> int:
        """The sign of the smallest value: 1, 0, or -1 where it may be negative."""
        least = self.lattice(0).base
        return (least > 0) - (least < 0)

    def family(self, name: str, n: Any) -> Family:
        """The subsets of the atoms that a feature of n draws needs."""
        return family(name, self.k, n if isinstance(n, int) else self.k + 1)

    def ends(self, support: Ints) -> tuple[Ints, Ints]:
        """Smallest and largest value of sets of atoms whose order is not known."""
        raise AssertionError("the order of numbers is known")

    def add_column(self, values: Sequence[Any]) -> int:
        """Attach a further column; the same numbers get the same place."""
        for number in range(len(self._lattices)):
            if self.column(number) == list(values):
                return number
        self._lattices.append(self._read_lattice(list(values)))
        return len(self._lattices) - 1

    def _read_lattice(self, values: list[Any]) -> Lattice:
        if any(isinstance(v, Ratio) for v in values):
            field = next(v.field for v in values if isinstance(v, Ratio))
            e = np.array([field.number(v) for v in values], dtype=object)
            return Lattice(Fraction(0), Fraction(1), e, tuple(self.masses), self.unit)
        unit = math.lcm(*(v.denominator for v in values))
        numbers = [v.numerator * (unit // v.denominator) for v in values]
        base = min(numbers)
        step = math.gcd(*(n - base for n in numbers)) or 1
        e = integers((n - base) // step for n in numbers)
        return Lattice(Fraction(base, unit), Fraction(step, unit), e, tuple(self.masses), self.unit)
