"""The law of a pixel with symbols: the same atoms, lattices and masses, made of Ratios."""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from truemean.errors import AssumptionError
from truemean.oracle.assumptions import declare_values, declare_weight, possible_signs
from truemean.oracle.columns import Ints
from truemean.oracle.exact import is_symbolic
from truemean.oracle.law import Law
from truemean.oracle.symbols import Field, Generator, Ratio

__all__ = ["SymbolicLaw"]

_MOST_UNORDERED = 6


class SymbolicLaw(Law):
    """One draw from a pixel whose weights or values are formulas.

    Numeric values keep their integer lattice, so that decisions stay cheap and exact; symbolic ones
    are a lattice of Ratios. The weights are their own masses, over the unit 1. ``law`` maps values to
    weights, both as a pixel or a derivation has them.
    """

    def __init__(self, field: Field, law: Mapping[Any, Any], ordered: bool = False, name: str = "X") -> None:
        self.field, self.name = field, name
        self._cost, self._oracle_calls, self.ratios, self.open = Fraction(1), Fraction(0), None, False
        pairs = [(v if isinstance(v, tuple) else (v,), w) for v, w in law.items() if w != 0]
        formulas = any(is_formula(x) for v, _ in pairs for x in v)
        pairs = self._read(pairs, ordered) if formulas else sorted(pairs, key=lambda pair: pair[0])
        self._values = tuple(value for value, _ in pairs)
        self.channels = len(self._values[0])
        self.masses = [self._mass(weight) for _, weight in pairs] if len(pairs) > 1 else [self._only(pairs[0][1])]
        self._weights = tuple(self.masses)
        places = tuple(p for mass in self.masses if (p := field.place(str(mass))) is not None)
        if len(set(places)) == len(pairs) > 1:
            field.simplices[places] = None
        self._lattices = [self._read_lattice(list(column)) for column in zip(*self._values, strict=True)]

    def _only(self, weight: Any) -> Ratio:
        """The weight of the only value there is: 1, whatever it is called."""
        return self.field.number(1)

    def _mass(self, weight: Any) -> Ratio:
        return declare_weight(self.field, weight)

    def _read(self, pairs: list[tuple[Any, Any]], ordered: bool) -> list[tuple[Any, Any]]:
        """Values as Ratios, brought into ascending order if it is known."""
        if len(pairs[0][0]) > 1:
            raise AssumptionError(f"{pairs[0][0]}: symbols in colours are not supported, give their channels numbers")
        found = declare_values(self.field, [value for (value,), _ in pairs], ordered)
        above = [sum(1 for y in found if possible_signs(x - y) == {1}) for x in found]
        places = range(len(found))
        order = sorted(places, key=lambda i: above[i]) if sorted(above) == list(places) else places
        return [((found[i],), pairs[i][1]) for i in order]

    @property
    def symbolic(self) -> bool:
        return True

    @property
    def symbolic_values(self) -> bool:
        return isinstance(self._values[0][0], Ratio)

    @cached_property
    def unit(self) -> int:
        return 1

    @cached_property
    def ordered(self) -> bool:
        if not self.symbolic_values:
            return self.channels == 1
        return all(possible_signs(y - x) == {1} for (x,), (y,) in pairwise(self._values))

    @property
    def least_sign(self) -> int:
        if not self.symbolic_values:
            return super().least_sign
        signs = frozenset().union(*(possible_signs(v) for (v,) in self._values))
        return min(signs)

    def monomials(self, exponents: Ints, coefficients: Ints) -> Ratio:
        places = [place for mass in self.masses if (place := self.field.place(str(mass))) is not None]
        if len(set(places)) < self.k:
            products = [math.prod(m ** int(e) for m, e in zip(self.masses, row, strict=True)) for row in exponents]
            terms = zip(products, coefficients, strict=True)
            return sum((p * int(c) for p, c in terms), self.field.number(0))
        wide = np.zeros((len(exponents), self.field.width), dtype=np.int64)
        wide[:, places] = exponents
        gathered: dict[tuple[int, ...], int] = {}
        for row, coefficient in zip(wide.tolist(), coefficients.tolist(), strict=True):
            gathered[tuple(row)] = gathered.get(tuple(row), 0) + coefficient
        return Ratio(self.field, self.field.context.from_dict(gathered))

    def ends(self, support: Ints) -> tuple[Ints, Ints]:
        """Smallest and largest value of unordered sets of atoms, as numbers of their own."""
        if self.k > _MOST_UNORDERED:
            names = ", ".join(str(v) for (v,) in self._values)
            raise AssumptionError(f"the order of {names} is not known: give an order, Pixel.symbolic(k, ordered=True)")
        ends = {mask: self._ends(mask) for mask in set(support.tolist())}
        low, high = ([ends[mask][side] for mask in support.tolist()] for side in (0, 1))
        return np.array(low, dtype=object), np.array(high, dtype=object)

    def _ends(self, mask: int) -> tuple[Any, Any]:
        from sympy import Max, Min

        seen = [v for i, (v,) in enumerate(self._values) if mask >> i & 1]
        if len(seen) == 1:
            return seen[0], seen[0]
        low, high = (extreme(*(v.expression() for v in seen)) for extreme in (Min, Max))
        least = self.field.generator(("min", mask), Generator(low, "value"))
        return least, least + self.field.generator(("range", mask), Generator(high - low, "value", sign=1))


def is_formula(value: Any) -> bool:
    """Whether a number depends on symbols, as SymPy or as the engine writes it."""
    return isinstance(value, Ratio) or is_symbolic(value)
