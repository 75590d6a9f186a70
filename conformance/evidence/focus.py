"""Bets that learn their size from past outcomes: the focused process, and plug-in bets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from truemean.conformance.evidence.bets import LARGEST
from truemean.conformance.evidence.outcomes import NOTHING, Batch, FloatArray, Moments
from truemean.conformance.evidence.sides import Bounded

__all__ = ["Focus", "KnownDistance", "Learned", "PlugIn", "Rule"]

RATIO = 1.6  # between neighbouring nodes
FURTHEST = 30.0  # a node of this bet acts as if the range were so many times tighter
LOST = -1e9  # the logarithm of a score that is gone
NEAREST = 1 / (1 - LOST)  # a share of a whole bet that is as good as nothing
FAR = 0.2  # outcomes at the far end, imagined before any came: how a whole bet is hedged


@dataclass(frozen=True, slots=True, eq=False)
class Nodes:
    """The bets of a focused process, those of all its sides in one row, and what never changes about them."""

    of_side: NDArray[np.intp]
    bets: FloatArray
    sizes: FloatArray  # logarithms of the bets
    most: FloatArray  # the largest and the least size that is plausible
    least: FloatArray
    extra: FloatArray  # what the largest safe bet is favoured by
    beyond: NDArray[np.bool_]  # bets that no money is put on
    noise: tuple[float, ...]  # the largest variance, by side
    reach: tuple[float, ...]  # the square of the way to the far end

    @classmethod
    def of(cls, sides: Sequence[Bounded], level: float, budget: int) -> Nodes:
        """The bets that may become useful within ``budget`` outcomes, at ``level`` for each side."""
        means = [_inside(side.mean) for side in sides]
        bets: list[FloatArray] = [np.zeros(0)]
        window = []
        for m in means:
            natural = math.sqrt(m / (1 - m))
            most = min(1.0, natural)
            least = min(0.5 * most, 1.5 * natural * math.sqrt(-2 * math.log(level) / budget))
            first = -math.ceil(-math.log(least) / math.log(RATIO)) - 2
            last = math.ceil(math.log(FURTHEST) / math.log(RATIO))
            bets.append(np.asarray(LARGEST * RATIO ** np.arange(first, last + 1), dtype=np.float64))
            window.append((math.log(most), math.log(least)))
        of_side = np.repeat(np.arange(len(means)), [some.size for some in bets[1:]])
        row = np.concatenate(bets)
        bounds = np.array(window).reshape(-1, 2)[of_side]
        return cls(
            of_side,
            row,
            np.log(row),
            bounds[:, 0],
            bounds[:, 1],
            np.where((row > LARGEST * 0.99) & (row < LARGEST * 1.01), 0.7, 0.0),
            row > LARGEST * 1.01,
            tuple(m * (1 - m) for m in means),
            tuple(max(m, 1 - m) ** 2 for m in means),
        )

    def plausible(self, seen: Moments) -> FloatArray:
        """The logarithm of how plausible each bet is, from the variance so far."""
        narrower = [
            0.5 * math.log(min(noise, (reach + seen.squares) / (seen.total + 1)) / noise)
            for noise, reach in zip(self.noise, self.reach, strict=True)
        ]
        size = self.sizes + np.array(narrower)[self.of_side]
        # Outcomes that are all 0 or 1 give no reason to think that the range is tighter.
        tighter = math.log(seen.inside / seen.total) if seen.inside else LOST
        logs: FloatArray = self.extra - np.maximum(0.0, size - self.most) - 6 * np.maximum(0.0, self.least - size)
        return logs + self.beyond * tighter


@dataclass(frozen=True, slots=True, eq=False)
class Focus:
    """Evidence against one or two sides that moves its money to the bets that would have won so far.

    Each node is a bet and a score: what that bet alone would have won on all past outcomes. Before each
    look money is shared out by score, corrected by how plausible a bet of that size is at the variance seen
    so far. Nodes beyond the largest safe bet only score; their money is put on one safe bet close to it.
    Shares are frozen before the outcomes come, hence it is an e-process for every law; both sides share one
    budget. It depends on the order of batches: blend it with a `Mixture`, whose share bounds what an
    unlucky order can cost.
    """

    sides: tuple[Bounded, ...]
    nodes: Nodes
    scores: FloatArray
    slopes: FloatArray
    moments: Moments = NOTHING
    log_evidence: float = 0.0
    peak: float = 0.0

    @classmethod
    def open(cls, sides: Sequence[Bounded], level: float, budget: int) -> Focus:
        """No outcomes seen; ``level`` and ``budget`` only say how small a bet may become useful."""
        kept = tuple(replace(side, mean=max(side.mean, 1e-12)) for side in sides if side.mean < 1)
        nodes = Nodes.of(kept, level / len(sides), budget)
        return cls(kept, nodes, np.zeros_like(nodes.bets), np.zeros(len(kept)))

    def update(self, batch: Batch) -> Focus:
        if not self.sides:
            return self
        few, nodes = batch.few, self.nodes
        gains = np.array([side.gains(few.values) for side in self.sides])
        # What each node's bet makes of the batch, as a score, and with real money.
        scored = _won(gains[nodes.of_side] * nodes.bets[:, None], few.counts)
        real = _won(gains * self._caps()[:, None], few.counts)
        won = np.where(nodes.beyond, real[nodes.of_side], scored)
        # Money was shared out before the batch.
        shares = nodes.plausible(self.moments) + self.scores
        now = self.log_evidence + float(np.logaddexp.reduce(shares + won) - np.logaddexp.reduce(shares))
        # The slope of a side's score at a whole bet says how far from 1 the safe bet should be.
        slopes = np.vecdot(1 - 1 / np.maximum(1 + gains, NEAREST), few.counts)
        return self._with(scored, slopes, batch.moments, now)

    def merge(self, later: Focus) -> Focus:
        return self._with(later.scores, later.slopes, later.moments, self.log_evidence + later.log_evidence)

    def _with(self, scored: FloatArray, slopes: FloatArray, more: Moments, now: float) -> Focus:
        scores = np.maximum(self.scores + scored, LOST)
        seen = self.moments.joined(more)
        return Focus(self.sides, self.nodes, scores, self.slopes + slopes, seen, now, max(self.peak, now))

    def _caps(self) -> FloatArray:
        """The safe bet of the nodes beyond it, one a side."""
        slopes = np.maximum(self.slopes, 0.0)
        return np.minimum(LARGEST, slopes / (slopes + FAR))

    @property
    def lean(self) -> int:
        """The side whose nodes have the larger score, 0 where no side can be left."""
        if not self.sides:
            return 0
        scores = self.nodes.plausible(self.moments) + self.scores
        by_side = [np.logaddexp.reduce(scores[self.nodes.of_side == i]) for i in range(len(self.sides))]
        return self.sides[int(np.argmax(by_side))].sign


def _won(gains: FloatArray, counts: FloatArray) -> FloatArray:
    """The logarithm of what each bet, a row of its gains, makes of the outcomes; LOST where it loses all."""
    gains += 1
    alive = gains > 0
    if alive.all():
        np.log(gains, out=gains)
    else:
        np.log(gains, out=gains, where=alive)
        gains[~alive] = LOST
    won: FloatArray = np.vecdot(gains, counts)
    return won


class Rule(Protocol):
    """How a bet follows from the moments of the past, and what it wins on the outcomes of one look."""

    def won(self, side: Bounded, past: Moments, few: Batch) -> float: ...


class _Fraction:
    """A bet that is a fraction of the largest safe one, of the side's mean and the moments oriented as it is."""

    __slots__ = ()

    def fraction(self, mean: float, oriented: Moments) -> float:
        raise NotImplementedError

    def won(self, side: Bounded, past: Moments, few: Batch) -> float:
        oriented = past if side.sign > 0 else Moments(past.total, 1 - past.mean, past.squares, past.inside)
        bet = LARGEST if side.mean <= 0 else 0.0
        if 0 < side.mean < 1:
            bet = min(max(self.fraction(side.mean, oriented), 0.0), LARGEST)
        return float(np.vecdot(side.log_factors(np.array([bet]), few.values)[0], few.counts)) if bet else 0.0


@dataclass(frozen=True, slots=True)
class KnownDistance(_Fraction):
    """E[y] is thought to lie ``distance`` beyond the edge: only the variance is learned.

    While every outcome was 0 or 1 the variance is that of a coin of mean edge + distance.
    """

    distance: float

    def fraction(self, mean: float, oriented: Moments) -> float:
        n, d = oriented.total, self.distance
        if n < 2:
            return 0.0
        centre = mean + d
        variance = oriented.squares / (n - 1) if oriented.inside else centre * (1 - centre)
        hedge = FAR * mean / n
        return mean * (d - hedge) / (variance + d**2 + mean * hedge)


@dataclass(frozen=True, slots=True)
class Learned(_Fraction):
    """Mean and variance are learned: approximately the best bet so far (aGRAPA, Waudby-Smith & Ramdas 2024)."""

    def fraction(self, mean: float, oriented: Moments) -> float:
        n = oriented.total
        centre = (0.5 + n * oriented.mean) / (n + 1)
        variance = (0.25 + oriented.squares) / (n + 1)
        return mean * (centre - mean) / (variance + (centre - mean) ** 2)


@dataclass(frozen=True, slots=True, eq=False)
class PlugIn:
    """Evidence against one side from a single bet, chosen before each look by a rule from the past."""

    side: Bounded
    rule: Rule
    moments: Moments = NOTHING
    log_evidence: float = 0.0
    peak: float = 0.0

    @property
    def lean(self) -> int:
        return self.side.sign

    def update(self, batch: Batch) -> PlugIn:
        won = self.rule.won(self.side, self.moments, batch.few)
        return self._with(self.moments.joined(batch.moments), self.log_evidence + won)

    def merge(self, later: PlugIn) -> PlugIn:
        return self._with(self.moments.joined(later.moments), self.log_evidence + later.log_evidence)

    def _with(self, moments: Moments, now: float) -> PlugIn:
        return PlugIn(self.side, self.rule, moments, now, max(self.peak, now))


def _inside(mean: float) -> float:
    return min(max(mean, 1e-12), 1 - 1e-12)
