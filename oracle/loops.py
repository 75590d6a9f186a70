"""`X.draw_until`: one forward recursion over the counts of a growing sample.

The number of drawing orders that reach some counts without stopping before is free of the
weights; every ring turns it into probabilities afterwards.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from truemean.errors import InputError, InputTypeError, NoClosedForm, PlanError, UndefinedValue
from truemean.oracle.columns import Ints, symbolic
from truemean.oracle.evaluate import Evaluator
from truemean.oracle.features import Level
from truemean.oracle.law import Law
from truemean.oracle.quantity import CURRENT, Decision, Quantity, decision
from truemean.oracle.rows import Block, Entry
from truemean.oracle.sample import Sample, Segment
from truemean.oracle.tables import MonomialTable
from truemean.oracle.wording import text

if TYPE_CHECKING:
    from truemean.oracle.paths import Path

__all__ = ["Loop", "Stopped"]

_DIRECT = 1 << 23
_BLOCK = 100_000


class Stopped(MonomialTable):
    """One part of the draws of a stopped sample; the first part carries the probability of the row."""

    def __init__(self, law: Law, counts: Ints, orders: Ints, exponents: Ints) -> None:
        self.law, self.level = law, Level({"counts"})
        self.sizes = counts.sum(axis=1)
        self.states = {"counts": counts}
        self.orders, self._exponents = orders, exponents

    @property
    def exponents(self) -> Ints:
        return self._exponents


class _NoFork:
    """Stands in for the path while ``stop`` describes its decision."""

    def __init__(self, path: Path) -> None:
        self.symbol = path.symbol

    def decide(self, asked: Decision) -> NoReturn:
        raise PlanError(f"stop may not act on {asked!r}: it returns one decision; combine with &, | and np.where")

    def enumerate(self, asked: Quantity, whole: bool = True) -> NoReturn:
        raise PlanError(f"stop may not make a number of {asked!r}: it returns one decision")


@dataclass(frozen=True)
class Loop:
    """A growing sample: ask ``stop`` at sizes start, start + step, ... below most."""

    law: Law
    start: int
    step: int
    most: int
    parts: int
    asked: Decision
    view: Sample
    lenient: bool
    check_budget: Callable[[int, str], None]

    @classmethod
    def declare(
        cls, path: Path, law: Law, colour: bool, stop: Any, start: Any, step: Any, most: Any, parts: Any
    ) -> Loop:
        """Call ``stop`` once on a view of the sample, and keep the decision that it describes."""
        for name, number in (("start", start), ("step", step), ("most", most), ("parts", parts)):
            if not isinstance(number, int):
                raise InputError(f"{name}={number!r} of draw_until depends on the row: give an integer")
        if not callable(stop):
            raise InputTypeError(f"stop={stop!r} of draw_until is not a function of the sample: write lambda S: ...")
        if parts not in (1, 2):
            raise InputError(f"parts={parts} of draw_until: 1, or 2 to keep even and odd draws apart")
        if most < start:
            raise InputError(f"most={most} of draw_until is less than start={start}")
        if law.indexed:
            raise NoClosedForm("X.draw_until counts values, whose number is a symbol: make k concrete")
        view = Sample(path, law, ("view",), "S", [], colour)
        view.segments += [sized_segment(view, part) for part in range(parts)]
        views = [view] if parts == 1 else [view.part(p, p + 1, name) for p, name in enumerate("AB")]
        token = CURRENT.set(_NoFork(path))
        try:
            asked = decision(stop(*views))
        finally:
            CURRENT.reset(token)
        exploration = path.exploration
        return cls(law, start, step, most, parts, asked, view, exploration.lenient, exploration.check_budget)

    def tables(self) -> list[Stopped]:
        """The stopped sample, one table per part, rows in common."""
        grid = _Grid(self.law.k, self.parts, self.most)
        keys, orders = np.zeros(1, dtype=np.int64), np.array([1], dtype=object)
        counts, found = [], []
        ahead: dict[int, tuple[Ints, Ints]] = {}
        rows = 0
        for n in range(self.most + 1):
            if n == self.most or self._asks(n):
                if n not in ahead:
                    ahead = self._look_ahead(grid, keys, n)
                known, stops = ahead[n]
                stopped = stops[np.searchsorted(known, keys)]
                counts.append(grid.counts(keys[stopped], n))
                found.append(orders[stopped])
                keys, orders = keys[~stopped], orders[~stopped]
            rows += len(keys)
            self.check_budget(rows, f"X.draw_until(most={self.most}) on {self.law.k} values")
            if n < self.most:
                keys, orders = grid.grown(keys, orders, n)
        joint, all_orders = np.concatenate(counts), np.concatenate(found)
        first, *rest = np.split(joint, self.parts, axis=1)
        zero, one = np.zeros_like(first), np.ones(len(joint), dtype=object)
        total = sum(rest, first)
        return [Stopped(self.law, first, all_orders, total), *(Stopped(self.law, r, one, zero) for r in rest)]

    def _asks(self, n: int) -> bool:
        return self.start <= n < self.most and (n - self.start) % self.step == 0

    def _look_ahead(self, grid: _Grid, keys: Ints, n: int) -> dict[int, tuple[Ints, Ints]]:
        """Decide for all states that the next sizes could have: many sizes in one evaluation.

        States that would have stopped before are among them; should one of these be undefined,
        only the states that are really there are asked.
        """
        if n == self.most:
            return {n: (keys, np.ones(len(keys), dtype=bool))}
        ahead = {n: keys}
        later, size, total = keys, n, len(keys)
        while total < _BLOCK and size + 1 < self.most:
            later = grid.keys_grown(later, size)
            size += 1
            if self._asks(size):
                ahead[size] = later
                total += len(later)
        try:
            stops = self._stops(np.concatenate([grid.counts(states, at) for at, states in ahead.items()]))
        except UndefinedValue:
            ahead = {n: keys}
            stops = self._stops(grid.counts(keys, n))
        parts = np.split(stops, np.cumsum([len(states) for states in ahead.values()])[:-1])
        return {at: (states, stop) for (at, states), stop in zip(ahead.items(), parts, strict=True)}

    def _stops(self, counts: Ints) -> Any:
        parts = np.split(counts, self.parts, axis=1)
        one, zero = np.ones(len(counts), dtype=object), np.zeros_like(parts[0])
        index = np.arange(len(counts))
        entries = [Entry(self.view, p, p + 1, Stopped(self.law, c, one, zero), index) for p, c in enumerate(parts)]
        holds = Evaluator(Block(tuple(entries), len(counts)), self.lenient).holds(self.asked)
        if symbolic(holds):
            raise NoClosedForm(f"X.draw_until stops by {text(self.asked)}, which a symbol decides: make it a number")
        return holds


def sized_segment(sample: Sample, part: int) -> Segment:
    """Draws whose number is part of what is observed."""
    size = Quantity("stat", sample, (part, part + 1), "size", 0, None)
    return Segment(size, _no_tables)


def _no_tables(size: int, wanted: Level, asked: str) -> NoReturn:
    raise AssertionError("a loop brings its own tables")


class _Grid:
    """Counts packed into one integer; the count of the last atom of each part follows from n."""

    def __init__(self, k: int, parts: int, most: int) -> None:
        self.k, self.parts = k, parts
        self.base = most + 1
        self.free = (k - 1) * parts
        if self.base**self.free >= 1 << 62:
            raise PlanError(
                f"X.draw_until keeps counts of {k} values: too many for most={most}; "
                f"use a while loop on a statistic with fewer states"
            )

    def counts(self, keys: Ints, n: int) -> Ints:
        """Counts ``[states, parts * k]`` of keys at size n."""
        digits = (keys[:, None] // self.base ** np.arange(self.free, dtype=np.int64)) % self.base
        found = np.empty((len(keys), self.parts * self.k), dtype=np.int64)
        for part in range(self.parts):
            mine = digits[:, part * (self.k - 1) : (part + 1) * (self.k - 1)]
            size = (n - part + self.parts - 1) // self.parts
            found[:, part * self.k : (part + 1) * self.k - 1] = mine
            found[:, (part + 1) * self.k - 1] = size - mine.sum(axis=1)
        return found

    def _shifts(self, n: int) -> list[int]:
        first = (n % self.parts) * (self.k - 1)
        return [0, *(self.base ** (first + i) for i in range(self.k - 1))]

    def keys_grown(self, keys: Ints, n: int) -> Ints:
        """The states that one draw more can lead to."""
        return _united([keys + shift for shift in self._shifts(n)], self.base**self.free)[0]

    def grown(self, keys: Ints, orders: Ints, n: int) -> tuple[Ints, Ints]:
        """One draw more: every atom, in the part whose turn it is; equal counts add up."""
        grown, places = _united([keys + shift for shift in self._shifts(n)], self.base**self.free)
        found = np.zeros(len(grown), dtype=object)
        for place in places:
            found[place] += orders
        return grown, found


def _united(lists: list[Ints], bound: int) -> tuple[Ints, list[Ints]]:
    """The distinct keys of several lists, ascending, and where each list's keys are among them."""
    if bound > _DIRECT:
        keys = np.unique(np.concatenate(lists))
        return keys, [np.searchsorted(keys, mine) for mine in lists]
    present = np.zeros(bound, dtype=bool)
    for mine in lists:
        present[mine] = True
    keys = np.flatnonzero(present)
    place = np.empty(bound, dtype=np.int64)
    place[keys] = np.arange(len(keys))
    return keys, [place[mine] for mine in lists]
