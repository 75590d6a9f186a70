"""A form and its moments in any ring.

Given the rows, an estimate is ``b + sum of a_j (sum of the draws of S_j)`` with a and b known on
each row. Tables hold centred sums, so the bias needs no difference of nearly equal numbers, and a
sample that nobody looked at adds exactly zero to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from truemean.oracle.columns import Column
from truemean.oracle.law import Law
from truemean.oracle.linear import Truth
from truemean.oracle.rings import Ring, Term, folded
from truemean.oracle.rows import Block, Entry, Rows, product

__all__ = ["Form", "Part", "Unseen"]


@dataclass(frozen=True, slots=True)
class Unseen:
    """Draws that no decision looked at: their coefficient and number, by row or constant."""

    law: Law
    column: int
    factor: Column
    size: Column


@dataclass(frozen=True, slots=True)
class Part:
    """What one block contributes: coefficients of its entries, of unseen draws, and the rest."""

    block: Block
    factors: tuple[tuple[Entry, int, Column], ...]
    unseen: tuple[Unseen, ...]
    truths: tuple[tuple[Truth, Column], ...]
    rest: Column

    @property
    def trivial(self) -> bool:
        """Whether it adds nothing to the mean."""
        return not self.factors and self.rest.is_zero and all(c.is_zero for _, c in self.truths)


@dataclass(frozen=True, slots=True)
class Form:
    """The estimate of a path, minus the true mean if centred, as parts of independent blocks.

    ``slack`` bounds how far the form can be from the estimate, where that is irrational.
    """

    rows: Rows
    parts: tuple[Part, ...]
    slack: Fraction

    def moments(self, ring: Ring, order: int) -> list[Any]:
        """``[P, E[value; path], E[value^2; path]]`` up to an order, in the ring's numbers."""
        found = [_part_moments(part, ring, range(order + 1)) for part in self.parts]
        others = [b for b in self.rows.blocks if not any(b is p.block for p in self.parts)]
        return product([*found, *([b.mass(ring)] + [_zero(ring)] * order for b in others)])

    def mean(self, ring: Ring) -> Any:
        """E[value; path]: no work for a part that adds nothing."""
        total = _zero(ring)
        for part in self.parts:
            if not part.trivial:
                (term,) = _part_moments(part, ring, range(1, 2))
                for block in self.rows.blocks:
                    term = term if block is part.block else term * block.mass(ring)
                total = total + term
        return total


def _part_moments(part: Part, ring: Ring, orders: range) -> list[Any]:
    if ring.closed and len(part.block.entries) == 1 and part.block.factor is None:
        return [_weighed(part, ring, order) for order in orders]
    return _rowwise(part, ring, orders.stop - 1)[orders.start :]


def _truths(part: Part) -> list[Term]:
    """What the true means add on each row."""
    return [(coefficient, truth, "mean") for truth, coefficient in part.truths]


def _spread(part: Part) -> list[Term]:
    """The variance that unseen draws add on each row."""
    return [(u.factor * u.factor * u.size, (u.law, u.column), "variance") for u in part.unseen]


def _weighed(part: Part, ring: Ring, order: int) -> Any:
    """One entry: a moment as sums over its table, without writing out its rows."""
    (entry,) = part.block.entries
    _, c, a = part.factors[0] if part.factors else (entry, 0, Column.constant(0))

    def weigh(power: int, factor: Column) -> Any:
        return _zero(ring) if factor.is_zero else entry.table.weigh(ring, c, power, factor, entry.index)

    if order == 0:
        return weigh(0, Column.constant(1))
    b = folded(part.rest, _truths(part))
    if order == 1:
        return weigh(1, a) + weigh(0, b)
    return weigh(2, a * a) + weigh(1, a * b * Column.constant(2)) + weigh(0, folded(b * b, _spread(part)))


def _rowwise(part: Part, ring: Ring, order: int) -> list[Any]:
    """Any number of entries: multiply moments row by row, then add up."""
    rows, nothing = part.block.size, Column.constant(0)
    scaled = {id(e): (c, factor) for e, c, factor in part.factors}
    shift = ring.combined(part.rest.spread(rows), _truths(part))
    moments = [[ring.vector(Column.constant(1).spread(rows)), shift, shift * shift]]
    if order > 1:
        moments[0][2] = moments[0][2] + ring.combined(nothing.spread(rows), _spread(part))
    for entry in part.block.entries:
        c, factor = scaled.get(id(entry), (0, nothing))
        mass = entry.table.moment(ring, 0, 0)[entry.index]
        if factor is nothing:
            moments.append([mass] + [mass.scale(nothing.spread(rows))] * order)
        else:
            powers = [(factor**n).spread(rows) for n in range(order + 1)]
            moments.append([entry.table.moment(ring, c, n)[entry.index].scale(p) for n, p in enumerate(powers)])
    joint = product([m[: order + 1] for m in moments])
    if part.block.factor is not None:
        joint = [m.scale(part.block.factor) for m in joint]
    return [m.sum() for m in joint]


def _zero(ring: Ring) -> Any:
    return ring.number(Fraction(0))
