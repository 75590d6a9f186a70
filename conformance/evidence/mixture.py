"""The static mixture: constant bets, so that the order of outcomes does not matter."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from truemean.conformance.evidence.bets import Bets
from truemean.conformance.evidence.outcomes import Batch, FloatArray, Outcomes
from truemean.conformance.evidence.sides import Side

__all__ = ["Mixture", "edge_of"]

STEPS, SPARE = 48, 3  # halvings of a bracket, beyond which no digit counts, and as many more to be bold


@dataclass(frozen=True, slots=True, eq=False)
class Mixture:
    """Evidence against one side from constant bets: the same after the same outcomes in any order and any batches.

    >>> from truemean.conformance.evidence import Bounded, hybrid
    >>> coin = Mixture.open(Bounded(1, 0.5), hybrid(0.5, 0.01, 1000))
    >>> heads = coin.update(Batch(np.array([0.0, 1.0]), np.array([10.0, 40.0])))
    >>> heads.log_evidence > math.log(100), coin.log_evidence
    (True, 0.0)
    """

    side: Side
    bets: Bets
    log_wealths: FloatArray
    log_evidence: float = 0.0
    peak: float = 0.0

    @classmethod
    def open(cls, side: Side, bets: Bets) -> Mixture:
        """No outcomes seen: evidence 1, logarithm 0."""
        return cls(side, bets, np.zeros_like(bets.fractions))

    @property
    def lean(self) -> int:
        return self.side.sign

    def update(self, batch: Batch) -> Mixture:
        tally = batch.against(self.side.sign).few if self.side.concave else batch
        won = np.vecdot(self.side.log_factors(self.bets.fractions, tally.values), tally.counts)
        return self._with(self.log_wealths + won)

    def merge(self, later: Mixture) -> Mixture:
        return self._with(self.log_wealths + later.log_wealths)

    def _with(self, log_wealths: FloatArray) -> Mixture:
        now = float(np.logaddexp.reduce(self.bets.log_weights + log_wealths))
        return Mixture(self.side, self.bets, log_wealths, now, max(self.peak, now))


def edge_of(outcomes: Outcomes, side_at: Callable[[float], Side], bets: Bets, level: float, limit: float) -> float:
    """The end of a confidence sequence: the edge nearest the mean of the outcomes that is rejected at ``level``.

    ``side_at(edge)`` is the hypothesis there, rejected more the further out it lies; ``limit`` is an edge
    beyond which none is looked for. The static mixture is monotone in the edge, so there is one; it is found by
    the ITP method (Oliveira & Takahashi 2020), at most three steps slower than bisection, for the root of the evidence.

    >>> from truemean.conformance.evidence import Bounded, hybrid
    >>> coin = Outcomes().update(Batch(np.array([0.0, 1.0]), np.array([500.0, 500.0])))
    >>> 0.4 < edge_of(coin, lambda m: Bounded(1, m), hybrid(0.5, 0.01, 1000), 0.01, 0.0) < 0.5
    True
    """
    asked, mean = math.sqrt(-math.log(level)), outcomes.moments.mean

    def beyond(part: float) -> float:
        """At least 0 where the edge, this part of the way from the limit to the mean, is rejected."""
        side = side_at(limit + part * (mean - limit))
        tally = outcomes.against(side.sign)
        wealths = np.vecdot(side.log_factors(bets.fractions, tally.values), tally.counts)
        return math.sqrt(max(0.0, float(np.logaddexp.reduce(bets.log_weights + wealths)))) - asked

    out, near, far, close = 0.0, 1.0, math.inf, -asked
    for step in range(STEPS + SPARE):
        if near - out <= 2.0**-STEPS * 2:
            break
        middle, guess = (out + near) / 2, (out + near) / 2
        if math.isfinite(far):
            # Interpolated, moved on towards the middle, and kept where bisection may still end in time.
            line = out + (near - out) * far / (far - close)
            nudge = math.copysign(min(max(0.2 * (near - out) ** 2, 2.0**-STEPS), abs(middle - line)), middle - line)
            slack = 2.0 ** (SPARE - step - 1) - (near - out) / 2
            guess = min(max(line + nudge, middle - slack), middle + slack)
        value = beyond(guess)
        out, near, far, close = (guess, near, value, close) if value >= 0 else (out, guess, far, value)
    return limit + out * (mean - limit)
