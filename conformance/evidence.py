"""Evidence that stays valid at every look: e-processes for the mean of outcomes in [0, 1].

An e-process against a hypothesis is money won by bets that are fair or worse under it: under the
hypothesis it starts at 1 and reaches 1/a, ever, with probability at most a (Ville). So one may
look after every batch, stop when one likes, and go on. Everything here is in logarithms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Bets",
    "EProcess",
    "Evidence",
    "Outcomes",
    "best_fraction",
    "growth",
    "hybrid",
    "lower_end",
    "variance_fraction",
]

FloatArray = NDArray[np.float64]
LARGEST = 0.99


class EProcess(Protocol):
    """What a verdict looks at: ``log_evidence`` now, and ``peak``, its maximum over the looks so far."""

    @property
    def log_evidence(self) -> float: ...

    @property
    def peak(self) -> float: ...

    def update(self, values: FloatArray, counts: FloatArray) -> Self:
        """The same process after ``counts[j]`` more outcomes ``values[j]``: one look."""
        ...


# -- bets: chosen before the run, never from its data ---------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Bets:
    """Constant bets c_k in (0, 1), as fractions of the largest safe bet, and the money put on each."""

    fractions: FloatArray
    log_weights: FloatArray

    def favouring(self, fraction: float, weight: float) -> Bets:
        """These bets with ``weight`` of the money moved to one more bet; a bet of 0 changes nothing."""
        if fraction <= 0:
            return self
        return Bets(
            np.append(self.fractions, min(fraction, LARGEST)),
            np.append(self.log_weights + math.log1p(-weight), math.log(weight)),
        )


def hybrid(mean: float, level: float, budget: int) -> Bets:
    """The default bets against E[y] <= ``mean``: some for rare outcomes, for noise, for small bias.

    0.4 of the money on the largest bet, 0.4 on eight arcsine nodes, 0.2 on a geometric grid down to
    the bet that ``budget`` replicates need to reach ``level``.

    >>> hybrid(0.5, 0.01, 100_000).fractions.size
    12
    """
    m = min(max(mean, 1e-12), 1 - 1e-12)
    least = min(0.1, math.sqrt(-2 * math.log(level) * m / ((1 - m) * budget)))
    steps = max(0, math.ceil(math.log(0.1 / (1.7 * least), 3)))
    arcsine = np.sin((2 * np.arange(8) + 1) * np.pi / 32) ** 2
    grid = 0.1 * 3.0 ** -np.arange(steps + 1)
    weights = np.repeat([0.4, 0.4 / 8, 0.2 / grid.size], [1, 8, grid.size])
    return Bets(np.concatenate([[LARGEST], arcsine, grid]), np.log(weights))


def best_fraction(values: FloatArray, probabilities: FloatArray, mean: float) -> float:
    """The bet of the fastest growing evidence against E[y] <= ``mean`` if y has this law; 0 if none grows.

    >>> round(best_fraction(np.array([0.0, 1.0]), np.array([0.4, 0.6]), 0.5), 6)
    0.2
    """
    gain = values / mean - 1
    low, high = 0.0, LARGEST
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if probabilities @ (gain / (1 + middle * gain)) > 0 else (low, middle)
    return low if probabilities @ gain > 0 else 0.0


def variance_fraction(distance: float, variance: float, mean: float) -> float:
    """The bet to make when only the variance is known and E[y] - ``mean`` is thought to be ``distance``."""
    return max(0.0, mean * distance / (variance + distance**2)) if distance else 0.0


def growth(values: FloatArray, probabilities: FloatArray, mean: float) -> float:
    """KL_inf: nats of evidence against E[y] <= ``mean`` per replicate, at the best bet for this law."""
    if mean <= 0:
        return math.inf
    best = np.array([best_fraction(values, probabilities, mean)])
    return float(_log_factors(best, values, mean)[0] @ probabilities)


# -- evidence: what the bets have won -------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """A one-sided e-process against E[y] <= ``mean``, for outcomes y in [0, 1] of any law.

    ``mean`` below 0 is a hypothesis that no outcome agrees with, 1 or more one that all agree with.

    >>> coin = Evidence.against(0.5, hybrid(0.5, 0.01, 1000))
    >>> heads = coin.update(np.array([0.0, 1.0]), np.array([10.0, 40.0]))
    >>> heads.log_evidence > math.log(100), coin.log_evidence
    (True, 0.0)
    """

    mean: float
    bets: Bets
    log_wealths: FloatArray
    log_evidence: float = 0.0
    peak: float = 0.0

    @classmethod
    def against(cls, mean: float, bets: Bets) -> Evidence:
        """No outcomes seen: evidence 1, logarithm 0."""
        return cls(mean, bets, np.zeros_like(bets.fractions))

    def update(self, values: FloatArray, counts: FloatArray) -> Evidence:
        """The evidence after ``counts[j]`` more outcomes ``values[j]``."""
        wealths = self.log_wealths + _log_factors(self.bets.fractions, values, self.mean) @ counts
        now = float(np.logaddexp.reduce(self.bets.log_weights + wealths))
        return replace(self, log_wealths=wealths, log_evidence=now, peak=max(self.peak, now))


def _log_factors(fractions: FloatArray, values: FloatArray, mean: float) -> FloatArray:
    """What one outcome multiplies the money on each bet by: log(1 + c (y / mean - 1)), ``[bets, values]``."""
    ratios = values / mean if mean > 0 else np.where(values > mean, np.inf, 0.0)
    return np.log1p(fractions[:, None] * (ratios - 1))


# -- outcomes: what intervals are made from -------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Outcomes:
    """Outcomes so far: distinct values in [0, 1] with counts, mean, and sum of squares about it.

    Beyond ``limit`` distinct values each is shared linearly between its two neighbours on a coarser
    grid. Logarithms are concave, so this can only understate the evidence, whatever the grid.
    """

    values: FloatArray = field(default_factory=lambda: np.empty(0))
    counts: FloatArray = field(default_factory=lambda: np.empty(0))
    total: int = 0
    mean: float = 0.0
    squares: float = 0.0
    limit: int = 4096

    def update(self, values: FloatArray, counts: FloatArray) -> Outcomes:
        """The outcomes with ``counts[j]`` more of ``values[j]``."""
        union, place = np.unique(np.concatenate([self.values, values]), return_inverse=True)
        tally: FloatArray = np.bincount(place, np.concatenate([self.counts, counts])).astype(float)
        if union.size > self.limit:
            grid = union[np.linspace(0, union.size - 1, self.limit // 2).astype(int)]
            union, tally = grid, _share(grid, union, tally)
        more = int(counts.sum())
        mean = float(values @ counts) / more
        squares = float((values - mean) ** 2 @ counts)
        total, step = self.total + more, mean - self.mean
        return Outcomes(
            union,
            tally,
            total,
            self.mean + step * more / total,
            self.squares + squares + step**2 * self.total * more / total,
            self.limit,
        )

    def mirrored(self) -> Outcomes:
        """The outcomes 1 - y."""
        return replace(self, values=1 - self.values, mean=1 - self.mean)


def _share(grid: FloatArray, values: FloatArray, counts: FloatArray) -> FloatArray:
    right = np.clip(np.searchsorted(grid, values), 1, grid.size - 1)
    part = counts * (values - grid[right - 1]) / (grid[right] - grid[right - 1])
    shares = np.bincount(right - 1, counts - part, grid.size) + np.bincount(right, part, grid.size)
    return shares.astype(float)


def lower_end(outcomes: Outcomes, bets: Bets, level: float) -> float:
    """The largest m such that E[y] <= m is rejected at ``level``: E[y] lies above, at every look.

    >>> coin = Outcomes().update(np.array([0.0, 1.0]), np.array([500.0, 500.0]))
    >>> 0.4 < lower_end(coin, hybrid(0.5, 0.01, 1000), 0.01) < 0.5
    True
    """
    low, high = 0.0, outcomes.mean
    for _ in range(54):
        middle = (low + high) / 2
        wealths = _log_factors(bets.fractions, outcomes.values, middle) @ outcomes.counts
        rejected = np.logaddexp.reduce(bets.log_weights + wealths) >= -math.log(level)
        low, high = (middle, high) if rejected else (low, middle)
    return low
