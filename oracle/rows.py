"""Rows: the outcomes that a path has told apart, and what it has not is not there.

A `Block` is a set of joint rows of some samples; blocks are independent of each other. A decision
touches one block only: those of the samples it reads are joined first. An `Entry` says which row
of which table each joint row means. Rows are values: every operation gives new ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from truemean.errors import NoClosedForm
from truemean.oracle.columns import Column, Ints, grouping, plus, symbolic
from truemean.oracle.features import Level
from truemean.oracle.law import Law
from truemean.oracle.rings import Ring
from truemean.oracle.symbols import Ratio
from truemean.oracle.tables import Table

__all__ = ["Block", "Entry", "Rows", "StackedTable", "pool"]


@dataclass(frozen=True, slots=True)
class Entry:
    """Segments ``first..last`` of a sample as one table; joint row r is its row ``index[r]``."""

    sample: Any
    first: int
    last: int
    table: Table
    index: Ints


@dataclass(frozen=True, slots=True)
class Block:
    """Joint rows of the samples of its entries; ``factor`` holds probabilities of the plan's own choices."""

    entries: tuple[Entry, ...]
    size: int
    factor: Column | None = None

    def select(self, index: Ints) -> Block:
        """Only some of the joint rows, in the given order, possibly repeated."""
        entries = tuple(replace(e, index=e.index[index]) for e in self.entries)
        return Block(entries, len(index), None if self.factor is None else self.factor.spread(self.size)[index])

    def entries_of(self, sample: Any) -> list[Entry]:
        """What is known of one sample, in the order of its segments."""
        return sorted((e for e in self.entries if e.sample.label == sample.label), key=lambda e: e.first)

    def mass(self, ring: Ring) -> Any:
        """The probability of the whole block."""
        if not self.entries:  # what a symbol decided before anything was drawn
            return ring.number(Fraction(1)) if self.factor is None else ring.vector(self.factor).sum()
        if len(self.entries) == 1 and self.factor is None:
            (entry,) = self.entries
            return entry.table.weigh(ring, 0, 0, Column.constant(1), entry.index)
        (mass,) = product([[e.table.moment(ring, 0, 0)[e.index]] for e in self.entries])
        return (mass if self.factor is None else mass.scale(self.factor)).sum()

    def beside(self, other: Block) -> Block:
        """All pairs of joint rows of two independent blocks."""
        left = self.select(np.repeat(np.arange(self.size), other.size))
        right = other.select(np.tile(np.arange(other.size), self.size))
        _check_indices(left.entries, right.entries)
        factors = [b.factor for b in (left, right) if b.factor is not None]
        product = factors[0] * factors[1] if len(factors) == 2 else factors[0] if factors else None
        return Block((*left.entries, *right.entries), left.size, product)

    def extended(self, sample: Any, first: int, last: int, table: Table, pairs: tuple[Ints, Ints]) -> Block:
        """Each joint row paired with the rows of a further table that go with it."""
        left, right = pairs
        wider = self.select(left)
        if table.law.indexed:
            _check_indices(wider.entries)
        return replace(wider, entries=(*wider.entries, Entry(sample, first, last, table, right)))

    def merged(self, sample: Any, level: Level) -> Block:
        """One table for all segments of a sample: joint rows of equal state and size add up."""
        mine, others = self.entries_of(sample), [e for e in self.entries if e.sample.label != sample.label]
        sizes = sum((e.table.sizes[e.index] for e in mine[1:]), mine[0].table.sizes[mine[0].index])
        states = {name: pool(mine, name) for name in stored(level)}
        order, starts = grouping([*states.values(), sizes, *(e.index for e in others)])
        first = order[starts]
        table = GroupedTable(
            law=mine[0].table.law,
            level=level,
            sizes=sizes[first],
            states={name: values[first] for name, values in states.items()},
            parts=[(e.table, e.index[order]) for e in mine],
            factor=None if self.factor is None else self.factor.spread(self.size)[order],
            starts=starts,
        )
        entry = Entry(sample, mine[0].first, mine[-1].last, table, np.arange(len(first)))
        return Block((entry, *(replace(e, index=e.index[first]) for e in others)), len(first))


@dataclass(frozen=True, slots=True)
class Rows:
    """The independent blocks of a path."""

    blocks: tuple[Block, ...] = ()

    def probability(self, ring: Ring) -> Any:
        """The probability of the path that these rows are of."""
        total = ring.number(Fraction(1))
        for block in self.blocks:
            total = total * block.mass(ring)
        return total

    def of(self, sample: Any) -> Block | None:
        """The block that a sample is in, None while it is unseen."""
        return next((b for b in self.blocks if any(e.sample.label == sample.label for e in b.entries)), None)

    def entries_of(self, sample: Any) -> list[Entry]:
        """What is known of a sample, in the order of its segments."""
        block = self.of(sample)
        return block.entries_of(sample) if block else []

    def covered(self, sample: Any) -> int:
        """How many segments of a sample have been observed."""
        entries = self.entries_of(sample)
        return entries[-1].last if entries else 0

    def put(self, old: tuple[Block, ...], new: Block) -> Rows:
        """One block in place of others."""
        return Rows((*(b for b in self.blocks if not any(b is o for o in old)), new))

    def joined(self, samples: list[Any]) -> tuple[Rows, Block]:
        """The samples in one block (an empty block of one row if there are none)."""
        found: list[Block] = []
        for sample in samples:
            block = self.of(sample)
            if block is not None and not any(block is b for b in found):
                found.append(block)
        if len(found) < 2:
            return self, found[0] if found else Block((), 1)
        joint = found[0]
        for block in found[1:]:
            joint = joint.beside(block)
        return self.put(tuple(found), joint), joint

    def split(self, block: Block, holds: Any) -> tuple[Rows | None, Rows | None]:
        """The rows where a decision holds and those where it doesn't; None where there are none.

        A row whose truth a symbol decides goes to both sides, times its condition or the negation.
        """
        if symbolic(holds):
            block = block if block.entries else next((b for b in self.blocks if not b.entries), block)
            return self._divided(block, holds), self._divided(block, 1 - holds)
        sides: list[Rows | None] = []
        for side in (holds, ~holds):
            index = np.flatnonzero(side)
            whole = len(index) == block.size
            kept = self if whole else self.put((block,), block.select(index)) if len(index) else None
            sides.append(kept)
        return sides[0], sides[1]

    def _divided(self, block: Block, share: Ints) -> Rows | None:
        factor = Column.whole(share) if block.factor is None else block.factor * Column.whole(share)
        possible = np.array([x.field.once(x) if isinstance(x, Ratio) else x for x in factor.spread(block.size).num])
        index = np.flatnonzero(possible)
        if not len(index):
            return None
        return self.put((block,), replace(block, factor=Column.whole(possible)).select(index))


def _check_indices(*sides: tuple[Entry, ...]) -> None:
    """Two samples of k values, k a symbol, would need two indices: NoClosedForm."""
    named = [e.sample.name for entries in sides for e in entries if e.table.law.indexed]
    if len(named) >= len(sides) and named:
        raise NoClosedForm(f"{named[0]} is looked at together with other draws: make k, the number of values, concrete")


def stored(level: Level) -> list[str]:
    """The names of the states that a table of a level holds."""
    names: list[str] = []
    for feature in sorted(level):
        names += ["lowest", "highest"] if feature == "extremes" else [feature]
    return names


def pool(entries: list[Entry], feature: str) -> Ints:
    """The state of several segments together: the sum, in the level's monoid, of their states."""
    states = [e.table.state(feature)[e.index] for e in entries]
    joint = states[0]
    for state in states[1:]:
        joint = _add_states(feature, joint, state)
    return joint


def _add_states(feature: str, a: Ints, b: Ints) -> Ints:
    if feature == "lowest":
        return np.minimum(a, b)
    if feature == "highest":
        return np.maximum(a, b)
    if feature == "support":
        return a | b
    if feature == "flat":
        return np.where(a == -2, b, np.where((b == -2) | (a == b), a, -1))
    if feature == "sequence":
        return np.concatenate([a, b], axis=1)
    return plus(a, b)


class GroupedTable(Table):
    """Rows of several tables taken together and added up by state: how a sample grows."""

    def __init__(
        self,
        law: Law,
        level: Level,
        sizes: Ints,
        states: dict[str, Ints],
        parts: list[tuple[Table, Ints]],
        factor: Column | None,
        starts: Ints,
    ) -> None:
        self.law, self.level, self.sizes, self.states = law, level, sizes, states
        self.parts, self._factor, self._starts = parts, factor, starts

    def has_moments(self, column: int) -> bool:
        return all(table.has_moments(column) for table, _ in self.parts)

    def mass(self, ring: Ring) -> Any:
        return self.moment(ring, 0, 0)

    def _moment(self, ring: Ring, column: int, order: int) -> Any:
        if order and self.knows(f"sum:{column}"):
            return super()._moment(ring, column, order)
        self._prepare(ring, column, order)
        moments = product([[t.moment(ring, column, o)[i] for o in range(order + 1)] for t, i in self.parts])[order]
        return (moments if self._factor is None else moments.scale(self._factor)).group(self._starts)

    def _prepare(self, ring: Ring, column: int, order: int) -> None:
        """Evaluate ancestors oldest first, so that long growth needs no deep recursion."""
        chain: list[GroupedTable] = []
        table: Table = self.parts[0][0]
        while isinstance(table, GroupedTable) and (ring, column if order else 0, order) not in table.memo:
            chain.append(table)
            table = table.parts[0][0]
        for ancestor in reversed(chain[1:]):
            ancestor.moment(ring, column, order)


class StackedTable(Table):
    """Tables of different sizes one below the other: a sample whose size depends on the row."""

    def __init__(self, tables: list[Table], level: Level) -> None:
        self.law = tables[0].law
        self.level = level
        self.tables = tables
        self.sizes = np.concatenate([t.sizes for t in tables])
        self.states = {}

    def has_moments(self, column: int) -> bool:
        return all(table.has_moments(column) for table in self.tables)

    def state(self, feature: str) -> Ints:
        if feature not in self.states:
            self.states[feature] = np.concatenate([t.state(feature) for t in self.tables])
        return self.states[feature]

    def mass(self, ring: Ring) -> Any:
        return self.moment(ring, 0, 0)

    def _moment(self, ring: Ring, column: int, order: int) -> Any:
        first, *rest = [t.moment(ring, column, order) for t in self.tables]
        return first.join(rest)


def product(moments: list[list[Any]]) -> list[Any]:
    """Moments of a sum of independent parts: (P,M1,M2)(p,m1,m2) = (Pp, P m1 + M1 p, P m2 + 2 M1 m1 + M2 p)."""
    joint = moments[0]
    for part in moments[1:]:
        both = [joint[0] * part[0]]
        if len(joint) > 1:
            both.append(joint[0] * part[1] + joint[1] * part[0])
        if len(joint) > 2:
            cross = joint[1] * part[1]
            both.append(joint[0] * part[2] + (cross + cross) + joint[2] * part[0])
        joint = both
    return joint
