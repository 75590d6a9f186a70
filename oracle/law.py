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

from truemean.oracle.columns import Ints, integers

__all__ = ["Lattice", "Law", "SubLaw"]

Atom = tuple[Fraction, ...]


@dataclass(frozen=True)
class Lattice:
    """One column of the atoms as ``base + step * e``, with its moments under the law."""

    base: Fraction
    step: Fraction
    e: Ints
    masses: tuple[int, ...]

    @cached_property
    def mean(self) -> Fraction:
        """Base + step E[e]."""
        return self.base + self.step * Fraction(self._moment(1), sum(self.masses))

    @cached_property
    def variance(self) -> Fraction:
        """step^2 (E[e^2] - E[e]^2), in integers."""
        unit, first = sum(self.masses), self._moment(1)
        return self.step**2 * Fraction(unit * self._moment(2) - first * first, unit * unit)

    def _moment(self, order: int) -> int:
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
        self._weights: tuple[Fraction, ...] = tuple(weight for _, weight in pairs)
        self._values: tuple[Atom, ...] = tuple(atom for atom, _ in pairs)
        self.channels = len(self.values[0])
        self.ratios: dict[Atom, Fraction] | None = None  # density ratios of a proposal
        self.open = False  # whether the weights only stand for others, to be given later
        self._lattices = [self._read_lattice(list(column)) for column in zip(*self.values, strict=True)]

    @property
    def values(self) -> tuple[Atom, ...]:
        """The atoms in ascending order, tuples by column."""
        return self._values

    @property
    def weights(self) -> tuple[Fraction, ...]:
        """The weights of the atoms."""
        return self._weights

    @property
    def cost(self) -> Fraction:
        """What one draw costs, in draws."""
        return self._cost

    @property
    def oracle_calls(self) -> Fraction:
        """What one draw costs, in oracle calls."""
        return self._oracle_calls

    @property
    def k(self) -> int:
        """Number of atoms."""
        return len(self.values)

    @cached_property
    def unit(self) -> int:
        """The common denominator A of the weights."""
        return math.lcm(*(w.denominator for w in self.weights))

    @cached_property
    def masses(self) -> list[int]:
        """Integer weights a_i = A omega_i."""
        return [int(w * self.unit) for w in self.weights]

    def lattice(self, column: int) -> Lattice:
        """The column as integers."""
        return self._lattices[column]

    def column(self, column: int) -> list[Fraction]:
        """The column's number at each atom."""
        lattice = self.lattice(column)
        return [lattice.base + lattice.step * int(e) for e in lattice.e]

    def mean(self, column: int) -> Fraction:
        """The true mean of a column."""
        return self.lattice(column).mean

    def variance(self, column: int) -> Fraction:
        """The variance of a column."""
        return self.lattice(column).variance

    def add_column(self, values: Sequence[Fraction]) -> int:
        """Attach a further column; the same numbers get the same place."""
        for number in range(len(self._lattices)):
            if self.column(number) == list(values):
                return number
        self._lattices.append(self._read_lattice(list(values)))
        return len(self._lattices) - 1

    def _read_lattice(self, values: list[Fraction]) -> Lattice:
        unit = math.lcm(*(v.denominator for v in values))
        numbers = [v.numerator * (unit // v.denominator) for v in values]
        base = min(numbers)
        step = math.gcd(*(n - base for n in numbers)) or 1
        e = integers((n - base) // step for n in numbers)
        return Lattice(Fraction(base, unit), Fraction(step, unit), e, tuple(self.masses))


class SubLaw(Law):
    """The law of a sub-estimate: mean, variance and cost as derived, its atoms only if somebody looks."""

    def __init__(self, name: str, derivation: Any) -> None:
        self.name, self.ratios, self.open = name, None, False
        self.channels = derivation.pixel.channels or 1
        self._derivation = derivation
        self._colour = derivation.pixel.channels is not None

    @property
    def cost(self) -> Fraction:
        """Draws that the sub-estimate takes on average."""
        return Fraction(self._derivation.cost)

    @property
    def oracle_calls(self) -> Fraction:
        """Oracle calls that it takes on average."""
        return Fraction(self._derivation.oracle_calls)

    @cached_property
    def _full(self) -> Law:
        law = self._derivation.distribution()
        return Law([v if self._colour else (v,) for v in law], list(law.values()), self.name)

    @property
    def values(self) -> tuple[Atom, ...]:
        return self._full.values

    @property
    def weights(self) -> tuple[Fraction, ...]:
        return self._full.weights

    def lattice(self, column: int) -> Lattice:
        return self._full.lattice(column)

    def mean(self, column: int) -> Fraction:
        return self._of_channel(self._derivation.expectation, column)

    def variance(self, column: int) -> Fraction:
        return self._of_channel(self._derivation.variance, column)

    def _of_channel(self, value: Any, column: int) -> Fraction:
        return Fraction(value[column] if self._colour else value)
