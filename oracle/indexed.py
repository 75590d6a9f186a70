"""A pixel of k values where k is a symbol: one indexed atom stands for all.

A sample of it is known to be constant or not, no more. Its table has one row for "all draws are
I_i" and one for the rest; numbers that mention the index are summed over i wherever rows are.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truemean.oracle.columns import Ints
from truemean.oracle.law import Lattice
from truemean.oracle.subsets import Family
from truemean.oracle.symbolic import SymbolicLaw
from truemean.oracle.symbols import Field, Generator, Ratio

__all__ = ["IndexedLaw"]


@dataclass(frozen=True)
class IndexedLattice(Lattice):
    """The column of the indexed atom."""

    def moment(self, order: int) -> Any:
        (mass,), (value,) = self.masses, self.e
        return (mass * value**order).total()


@dataclass(frozen=True, slots=True, eq=False)
class IndexedSubsets:
    """The atom i, and all atoms."""

    def members(self) -> NDArray[np.bool_]:
        """Membership ``[subsets, 1]``; only the second subset is everything."""
        return np.array([[False], [True]])

    def sums(self, atoms: Ints) -> Ints:
        """The atom itself, and the sum over i."""
        return np.array([atoms[0], atoms[0].total()], dtype=object)

    def only(self, kept: Ints) -> _Kept:
        """Some of the subsets."""
        return _Kept(self, kept)


@dataclass(frozen=True, slots=True, eq=False)
class _Kept:
    whole: IndexedSubsets
    kept: Ints

    def members(self) -> NDArray[np.bool_]:
        return self.whole.members()[self.kept]

    def sums(self, atoms: Ints) -> Ints:
        return self.whole.sums(atoms)[self.kept]


class IndexedLaw(SymbolicLaw):
    """One draw from I[1]..I[k] with weights omega[1]..omega[k], k a symbol."""

    def __init__(self, field: Field, value: Any, weight: Any, count: Any) -> None:
        (index,) = value.indices
        field.index = (index, count)
        super().__init__(field, {field.generator(value, Generator(value, "index")): weight})

    @property
    def indexed(self) -> bool:
        return True

    def _only(self, weight: Any) -> Ratio:
        return self.field.generator(weight, Generator(weight, "weight index", sign=1))

    def _read_lattice(self, values: list[Any]) -> Lattice:
        return IndexedLattice(Fraction(0), Fraction(1), np.array(values, dtype=object), tuple(self.masses), 1)

    def family(self, name: str, n: Any) -> Family:
        two, signs = np.array([0, 1, 1]), np.array([1, -1, 1])
        return Family(2, IndexedSubsets(), two, np.array([0, 0, 1]), signs, {"flat": np.array([0, -1])})
