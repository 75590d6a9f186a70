"""Other evidence to choose or to compare with: likelihood ratios, empirical Bernstein, and tests at fixed N."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from truemean.conformance.evidence.bets import LARGEST
from truemean.conformance.evidence.outcomes import NOTHING, Batch, Moments, Outcomes
from truemean.conformance.evidence.sides import Bounded

__all__ = ["EmpiricalBernstein", "FixedSample", "LikelihoodRatio"]


@dataclass(frozen=True, slots=True, eq=False)
class LikelihoodRatio:
    """Evidence against one side by KL_inf: the best bet in hindsight, less what not knowing it can cost.

    That cost, log(sqrt(pi) G(n+1) / G(n+1/2)), bounds the regret of Cover's universal portfolio (Cover &
    Ordentlich 1996), so this never exceeds an e-process. It does not depend on the order of outcomes.
    """

    side: Bounded
    outcomes: Outcomes = field(default_factory=Outcomes)
    log_evidence: float = 0.0
    peak: float = 0.0

    @property
    def lean(self) -> int:
        return self.side.sign

    def update(self, batch: Batch) -> LikelihoodRatio:
        return self._with(self.outcomes.update(batch))

    def merge(self, later: LikelihoodRatio) -> LikelihoodRatio:
        return self._with(self.outcomes.merge(later.outcomes))

    def _with(self, outcomes: Outcomes) -> LikelihoodRatio:
        gains, counts = self.side.gains(outcomes.tally.values), outcomes.tally.counts
        low, high = 0.0, LARGEST
        for _ in range(40):
            middle = (low + high) / 2
            with np.errstate(invalid="ignore"):
                rising = np.nan_to_num(gains / (1 + middle * gains), nan=1 / middle) @ counts > 0
            low, high = (middle, high) if rising else (low, middle)
        n = outcomes.moments.total
        regret = 0.5 * math.log(math.pi) + math.lgamma(n + 1) - math.lgamma(n + 0.5)
        now = float(np.log1p(low * gains) @ counts) - regret if low else -regret
        return replace(self, outcomes=outcomes, log_evidence=now, peak=max(self.peak, now))


@dataclass(frozen=True, slots=True)
class EmpiricalBernstein:
    """A rule that bounds what its bet wins by the empirical Bernstein bound: valid, and slow.

    The bound is that of Howard et al. 2021, the bet of each look that of Waudby-Smith & Ramdas 2024.
    """

    level: float

    def won(self, side: Bounded, past: Moments, few: Batch) -> float:
        centre, variance = (0.5 + past.total * past.mean) / (past.total + 1), (0.25 + past.squares) / (past.total + 1)
        bet = min(0.5, math.sqrt(-2 * math.log(self.level) / (variance * (past.total + 1) * math.log(past.total + 2))))
        psi = -math.log1p(-bet) - bet
        excess = side.oriented(few.values) - side.mean
        return float((bet * excess - psi * (few.values - centre) ** 2) @ few.counts)


@dataclass(frozen=True, slots=True, eq=False)
class FixedSample:
    """-log p of a t test against one or two sides (Welch's against a reference without noise, Jung et al. 2020).

    No e-process: p is right once, at a number of outcomes fixed beforehand, and if their mean is about
    Gaussian. Looked at again and again, or where an estimator rarely fires, it raises false alarms.
    ``floor`` is the least variance believed, 1e-4 in the tests of Mitsuba 3; with it the test is a z test.
    """

    sides: tuple[Bounded, ...]
    floor: float = 0.0
    moments: Moments = NOTHING
    log_evidence: float = 0.0
    peak: float = 0.0
    lean: int = 0

    @classmethod
    def open(cls, sides: Sequence[Bounded], floor: float = 0.0) -> FixedSample:
        """No outcomes seen."""
        return cls(tuple(sides), floor)

    def update(self, batch: Batch) -> FixedSample:
        return self._with(self.moments.joined(batch.moments))

    def merge(self, later: FixedSample) -> FixedSample:
        return self._with(self.moments.joined(later.moments))

    def _with(self, moments: Moments) -> FixedSample:
        from scipy.special import log_ndtr, stdtr

        n = moments.total
        if n < 2:
            return replace(self, moments=moments)
        variance = max(self.floor, moments.squares / (n - 1))
        now, lean = 0.0, self.lean
        for side in self.sides:
            excess = (moments.mean if side.sign > 0 else 1 - moments.mean) - side.mean
            if excess <= 0:
                continue
            t = excess / math.sqrt(variance / n) if variance else math.inf
            tail = float(log_ndtr(-t)) if self.floor else math.log(max(float(stdtr(n - 1, -t)), 1e-300))
            if -tail - math.log(len(self.sides)) > now:
                now, lean = -tail - math.log(len(self.sides)), side.sign
        return replace(self, moments=moments, log_evidence=now, peak=max(self.peak, now), lean=lean)
