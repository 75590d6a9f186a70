"""Outcomes as evidence sees them: tallies of distinct values, one look at a time and all together."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from truemean.errors import InputError

__all__ = ["NOTHING", "Batch", "FloatArray", "Moments", "Outcomes", "Sums"]

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

    def against(self, sign: int) -> Batch:
        """What constant bets against a side of this sign are settled by: the outcomes themselves, where they are known."""
        return self

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


@dataclass(frozen=True)
class Sums(Batch):
    """One look at outcomes in [0, 1] of which only sums are known, group by group: ``numbers``, means and mean squares.

    No single outcome is known, so to whoever asks for `values` it says nothing. What a bounded bet wins has a positive
    third derivative in the outcome, so that of all outcomes of a group's mean and mean square those at 0 and at a single
    point win it least (the lower principal representation, Karlin & Studden 1966). A larger mean square
    makes them win less, so it may be a bound from above; ``slack`` is by how much it may be too small.

    >>> coins = Sums(numbers=np.array([50.0]), means=np.array([0.8]), mean_squares=np.array([0.8]))
    >>> coins.against(1).values, coins.against(1).counts
    (array([0., 1.]), array([10., 40.]))
    """

    values: FloatArray = field(init=False, repr=False, default_factory=lambda: np.empty(0))
    counts: FloatArray = field(init=False, repr=False, default_factory=lambda: np.empty(0))
    numbers: FloatArray
    means: FloatArray
    mean_squares: FloatArray
    slack: FloatArray | float = 0.0

    def against(self, sign: int) -> Batch:
        """The outcomes of these sums that win the bets against a side of this sign least."""
        mean = self.means if sign > 0 else 1 - self.means
        square = self.mean_squares if sign > 0 else 1 - 2 * self.means + self.mean_squares
        square = np.clip(square + self.slack, mean**2, mean)
        far = square > 0
        share = np.divide(mean**2, square, where=far, out=np.zeros_like(mean))
        top = np.divide(square, mean, where=far, out=np.zeros_like(mean))
        y, counts = np.append(top, 0.0), np.append(self.numbers * share, (self.numbers * (1 - share)).sum())
        kept = counts > 0
        return Batch(np.empty(0), np.empty(0)).joined(Batch((y if sign > 0 else 1 - y)[kept], counts[kept]))

    @cached_property
    def moments(self) -> Moments:
        """Number, mean and sum of squares, as they are; how many outcomes lay inside is not known, and said to be 0."""
        total = float(self.numbers.sum())
        mean = float(self.numbers @ self.means) / total
        squares = self.mean_squares - self.means**2 + (self.means - mean) ** 2
        return Moments(total, mean, max(0.0, float(self.numbers @ squares)))


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
    """All outcomes so far, in whatever order: their tally, of at most ``limit`` values, and their own moments.

    ``below`` is the tally against a side of sign -1, where it is another than that against one of sign 1.
    """

    tally: Batch = field(default_factory=lambda: Batch(np.empty(0), np.empty(0)))
    moments: Moments = field(default_factory=Moments)
    limit: int | None = ALL_FEW
    below: Batch | None = None

    def update(self, batch: Batch) -> Outcomes:
        """The outcomes with one more batch."""
        above, below = (batch.against(sign) if self.limit is None else batch.against(sign).few for sign in (1, -1))
        return self._with(above, None if below is above else below, batch.moments)

    def merge(self, later: Outcomes) -> Outcomes:
        """The outcomes of both."""
        return self._with(later.tally, later.below, later.moments)

    def _with(self, above: Batch, below: Batch | None, more: Moments) -> Outcomes:
        one = below is None and self.below is None
        low = None if one else self._joined(self.against(-1), above if below is None else below)
        return replace(self, tally=self._joined(self.tally, above), below=low, moments=self.moments.joined(more))

    def _joined(self, tally: Batch, more: Batch) -> Batch:
        both = tally.joined(more)
        return both if self.limit is None else both.shortened(self.limit)

    def against(self, sign: int) -> Batch:
        """The tally that constant bets against a side of this sign are settled by."""
        return self.tally if sign > 0 or self.below is None else self.below

    @property
    def law(self) -> tuple[FloatArray, FloatArray]:
        """Values, and how often each came: the measured law."""
        return self.law_against(1)

    def law_against(self, sign: int) -> tuple[FloatArray, FloatArray]:
        """The measured law, by the tally against a side of this sign."""
        tally = self.against(sign)
        return tally.values, tally.counts / max(1.0, self.moments.total)
