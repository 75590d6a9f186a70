"""Outcomes as evidence sees them: tallies of distinct values, one look at a time and all together."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from truemean.errors import InputError

__all__ = ["NOTHING", "Batch", "FloatArray", "Moments", "Outcomes"]

FloatArray = NDArray[np.float64]
FEW = 256  # distinct values of a batch; beyond, outcomes are shared between the points of a grid
ALL_FEW = 4096  # the same for all batches together


@dataclass(frozen=True)
class Batch:
    """One look: ``counts[j]`` outcomes ``values[j]``, values ascending.

    What a bounded bet wins is concave in the outcome. So sharing an outcome between its two neighbours on
    a grid, whatever the grid, can only understate the evidence: that is how many distinct values become few.
    """

    values: FloatArray
    counts: FloatArray

    @classmethod
    def of(cls, outcomes: FloatArray) -> Batch:
        """The tally of outcomes as they came, ``[n]``; InputError for none.

        >>> Batch.of(np.array([0.5, 0.0, 0.5])).counts
        array([1., 2.])
        """
        if not np.size(outcomes):
            raise InputError("outcomes=[] is no look: give one at least")
        ascending = np.sort(np.asarray(outcomes, dtype=float))
        ends = np.append(np.flatnonzero(ascending[1:] != ascending[:-1]), ascending.size - 1)
        counts = ends + 1.0
        counts[1:] -= counts[:-1].copy()
        return cls(ascending[ends], counts)

    @cached_property
    def few(self) -> Batch:
        """The same outcomes, shared out among at most 256 values: for bounded bets only."""
        return self.shortened(FEW)

    def shortened(self, limit: int) -> Batch:
        """Shared out among at most ``limit`` values: half of them quantiles, half evenly spaced."""
        values, counts = self.values, self.counts
        if values.size <= limit:
            return self
        ranks = np.searchsorted(np.cumsum(counts), np.linspace(0, counts.sum(), limit // 2)[1:-1])
        even = np.linspace(values[0], values[-1], limit // 2)
        grid = np.unique(np.concatenate([values[[0, -1]], values[ranks], even]))
        # Cell i holds the values from grid[i], exclusive but for the first, to grid[i + 1].
        cells = np.diff(np.searchsorted(values, grid[1:-1], side="right"), prepend=0, append=values.size)
        part = counts * (values - np.repeat(grid[:-1], cells)) / np.repeat(np.diff(grid), cells)
        left = np.repeat(np.arange(grid.size - 1), cells)
        shares: FloatArray = np.bincount(left, counts - part, grid.size).astype(float)
        shares[1:] += np.bincount(left, part)
        kept = shares > 0  # where nothing lies, an infinite gain would make no number
        return Batch(grid[kept], shares[kept])

    def joined(self, other: Batch) -> Batch:
        """The tally of both."""
        values = np.concatenate([self.values, other.values])
        order = np.argsort(values, kind="stable")  # which merges what is ascending already
        ascending = values[order]
        starts = np.flatnonzero(np.append([True] * (ascending.size > 0), ascending[1:] != ascending[:-1]))
        counts = np.concatenate([self.counts, other.counts])[order]
        return Batch(ascending[starts], np.add.reduceat(counts, starts) if starts.size else counts)

    @cached_property
    def moments(self) -> Moments:
        """Number, mean and sum of squares."""
        values, counts = self.values, self.counts
        total = float(counts.sum())
        mean = float((values * counts).sum()) / total
        inside = float(counts[(values > 0) & (values < 1)].sum())
        return Moments(total, mean, float(((values - mean) ** 2 * counts).sum()), inside)


@dataclass(frozen=True, slots=True)
class Moments:
    """How many outcomes there were, their mean, the sum of squares about it, and how many lay inside (0, 1)."""

    total: float = 0.0
    mean: float = 0.0
    squares: float = 0.0
    inside: float = 0.0

    def joined(self, more: Moments) -> Moments:
        """Those of both (Chan, Golub & LeVeque 1983)."""
        total = self.total + more.total
        if not total:
            return self
        step = more.mean - self.mean
        return Moments(
            total,
            self.mean + step * more.total / total,
            self.squares + more.squares + step**2 * self.total * more.total / total,
            self.inside + more.inside,
        )


NOTHING = Moments()


@dataclass(frozen=True, slots=True, eq=False)
class Outcomes:
    """All outcomes so far, in whatever order: their tally, of at most ``limit`` values, and their own moments."""

    tally: Batch = field(default_factory=lambda: Batch(np.empty(0), np.empty(0)))
    moments: Moments = field(default_factory=Moments)
    limit: int | None = ALL_FEW

    def update(self, batch: Batch) -> Outcomes:
        """The outcomes with one more batch."""
        return self._with(self.tally.joined(batch if self.limit is None else batch.few), batch.moments)

    def merge(self, later: Outcomes) -> Outcomes:
        """The outcomes of both."""
        return self._with(self.tally.joined(later.tally), later.moments)

    def _with(self, tally: Batch, more: Moments) -> Outcomes:
        kept = tally if self.limit is None else tally.shortened(self.limit)
        return replace(self, tally=kept, moments=self.moments.joined(more))

    @property
    def law(self) -> tuple[FloatArray, FloatArray]:
        """Values, and how often each came: the measured law."""
        return self.tally.values, self.tally.counts / max(1.0, self.moments.total)
