"""What evidence will do on one case, from the law of its outcomes: when it passes a level, and how surely.

Evidence grows by the logarithm of what the best bet wins, KL_inf nats per replicate in the mean (Honda &
Takemura 2010). When it first passes a level is about inverse Gaussian (Wald 1947; Folks & Chhikara 1978).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from truemean.conformance.declared import Declared
from truemean.conformance.evidence import Batch, FloatArray
from truemean.conformance.evidence.bets import LARGEST
from truemean.conformance.openings import DECLARED, SUSPECTED, Levels, scaled_law
from truemean.conformance.target import Target
from truemean.oracle.exact import short_text

__all__ = ["Outlook", "Unplanned", "first_passage", "outlook_of"]

FEW = 512  # outcomes of a law; more are shared between the points of a grid

Laws = tuple[FloatArray, FloatArray]  # outcomes and their probabilities, a row each
Cost = tuple[float, float]
# Nats that learning the bet costs, without noise and for noise of one Gaussian's worth. That of BIASED, which has
# to learn the sign too, is fitted to medians of runs with 15 laws at levels 1e-2 and 2e-4; that of CONFORMS is less
# what that costs, and matters only where the declared law's bet is overtaken.
BIASED_COST: Cost = (1.4, 2.0)
CONFORMS_COST: Cost = (0.6, 1.2)


def first_passage(n: Any, drift: FloatArray, variance: FloatArray, barrier: FloatArray) -> FloatArray:
    """P(a Brownian motion with ``drift`` and ``variance`` per step passes ``barrier`` within ``n`` steps).

    0 where it does not drift upwards, 1 where the drift is infinite.

    >>> first_passage(100, np.array([0.05, 0.05, -1.0]), np.array([0.1, 0.0, 1.0]), np.array([4.6, 4.6, 4.6])).round(3)
    array([0.67, 1.  , 0.  ])
    """
    from scipy.special import erfcx, ndtr

    n = np.asarray(n, dtype=float)
    up = (drift > 0) & np.isfinite(drift)
    g = np.where(up, drift, 1.0)
    deviation = np.sqrt(n * np.maximum(np.where(up, variance, 1.0), 1e-12 * g**2))
    short, far = (n * g - barrier) / deviation, (n * g + barrier) / deviation
    passed = np.clip(ndtr(short) + erfcx(far / math.sqrt(2)) / 2 * np.exp(-(short**2) / 2), 0.0, 1.0)
    return np.where(up, passed, np.where(drift > 0, 1.0, 0.0))


def _best_bets(gains: FloatArray, masses: FloatArray) -> FloatArray:
    """The fastest growing bet on each law, a row; 0 where none grows."""
    low, high = np.zeros(len(gains)), np.full(len(gains), LARGEST)
    for _ in range(40):
        middle = (low + high) / 2
        rising = (masses * gains / (1 + middle[:, None] * gains)).sum(axis=1) > 0
        low, high = np.where(rising, middle, low), np.where(rising, high, middle)
    return np.where((masses * gains).sum(axis=1) > 0, low, 0.0)


def _passed(
    n: Any, barrier: float, gains: FloatArray, masses: FloatArray, bets: FloatArray, cost: Cost = (0.0, 0.0)
) -> FloatArray:
    """P(evidence of these bets passes ``barrier`` within ``n``), learning them at a ``cost``."""
    logs = np.log1p(bets[:, None] * gains)
    drift = (masses * logs).sum(axis=1)
    variance = (masses * (logs - drift[:, None]) ** 2).sum(axis=1)
    noise = np.minimum(1.0, variance / (2 * np.where(drift > 0, drift, 1.0)))
    return first_passage(n, drift, variance, barrier + cost[0] + cost[1] * noise)


class Unplanned(Exception):
    """Why nothing can be said of a pixel."""


@dataclass(frozen=True, slots=True, eq=False)
class Outlook:
    """What evidence will do on one case: the declared outcomes y in [0, 1] with their probabilities."""

    target: Target
    levels: Levels
    bias: Fraction
    values: FloatArray
    masses: FloatArray

    def room(self, sign: int) -> float:
        """The largest bias of this sign that the range allows."""
        low, high = self.target.range or (self.target.true_mean,) * 2
        return float(high - self.target.true_mean if sign > 0 else self.target.true_mean - low)

    def laws(self, biases: FloatArray) -> Laws:
        """Outcomes and probabilities ``[biases, values]`` of laws with these biases: the law itself, tilted.

        Where the mean lies beyond what tilting reaches, all outcomes move towards that end of the range.
        """
        wanted = np.clip(self.target.scaled(self.target.true_mean) + biases / float(self.target.width), 0.0, 1.0)
        mean, spread = float(self.values @ self.masses), np.ptp(self.values) or 1.0
        x, x_wanted = (self.values - mean) / spread, (wanted - mean) / spread
        low, high = np.full(wanted.size, -4e3), np.full(wanted.size, 4e3)
        masses = np.tile(self.masses, (wanted.size, 1))
        for _ in range(40):
            middle = (low + high) / 2
            logs = np.log(self.masses) + middle[:, None] * x
            masses = np.exp(logs - logs.max(axis=1, keepdims=True))
            masses /= masses.sum(axis=1, keepdims=True)
            below = masses @ x < x_wanted
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        reached = (np.ptp(self.values) > 0) & (np.abs(masses @ x - x_wanted) <= 1e-9)
        end = np.where(wanted > mean, 1.0, 0.0)
        moved = ~reached & (end != mean)
        part = np.where(moved, (wanted - mean) / np.where(moved, end - mean, 1.0), 0.0)
        values = self.values + part[:, None] * (end[:, None] - self.values)
        return values, np.where(reached[:, None], masses, self.masses)

    def biased(self, biases: FloatArray, n: Any) -> FloatArray:
        """P(BIASED within ``n`` replicates) for laws with these biases; 0 where it would be wrong."""
        level, margin = self.levels.biased, float(self.target.tolerance + self.target.slack)
        suspected = SUSPECTED if abs(self.bias) > margin else 0.0
        laws, found = self.laws(biases), np.zeros(biases.size)
        for sign in (1, -1):
            placed = suspected if sign * self.bias > 0 else 0.0
            passed = self._passed(n, level, sign, np.array([margin]), laws, (placed, 1 - suspected), BIASED_COST)
            found = np.maximum(found, passed)
        return found

    def conforms(self, biases: FloatArray, n: Any, tolerances: Any = None) -> FloatArray:
        """P(CONFORMS within ``n`` replicates), by default at the case's own tolerance."""
        asked = np.atleast_1d(float(self.target.tolerance) if tolerances is None else tolerances)
        level, slack = self.levels.conforms, float(self.target.slack)
        laws, shown, money = self.laws(biases), np.ones(biases.size), (DECLARED, 1 - DECLARED)
        for sign in (1, -1):
            passed = self._passed(n, level, sign, slack - asked, laws, money, CONFORMS_COST)
            certain = asked >= self.room(-sign)
            shown = shown * np.where(certain, 1.0, np.where(asked > slack, passed, 0.0))
        return shown

    def _passed(
        self, n: Any, level: float, sign: int, margins: FloatArray, laws: Laws, money: Cost, cost: Cost
    ) -> FloatArray:
        """P(a bias beyond sign * ``margins`` is shown at ``level`` within ``n`` replicates).

        ``money`` is the share put on the bet that suits the declared law, and on bets that are learned.
        """
        values, masses = laws
        centre = self.target.scaled(self.target.true_mean)
        edges = (centre if sign > 0 else 1 - centre) + margins / float(self.target.width)
        safe = np.where(edges > 0, edges, 1.0)[:, None]
        gains, declared = ((y if sign > 0 else 1 - y) / safe - 1 for y in (values, self.values))
        placed, learned = money
        found = _passed(n, -math.log(level * learned), gains, masses, _best_bets(gains, masses), cost)
        if placed:
            bets = _best_bets(declared, self.masses[None, :])
            found = np.maximum(found, _passed(n, -math.log(level * placed), gains, masses, bets))
        return np.where(edges > 0, found, 1.0)


def outlook_of(target: Target, levels: Levels, declared: Declared) -> Outlook:
    """What evidence will do on a case whose law, or mean and variance, is declared; Unplanned where it can't be said."""
    if target.range is None:
        raise Unplanned("its estimates have no finite range: declare one, (lo, hi), to plan a run")
    if declared.bias is None or (declared.law is None and declared.variance is None):
        raise Unplanned(f"its law is unknown, and so are its bias and variance: {declared.note or 'predict them'}")
    values, masses = _two_outcomes(target, declared) if declared.law is None else _scaled(target, declared.law)
    return Outlook(target, levels, declared.bias, values, masses)


def _scaled(target: Target, known: Mapping[Fraction, Fraction]) -> Laws:
    """Outcomes y in [0, 1] and their probabilities, on a grid if there are too many."""
    law = {atom: mass for atom, mass in sorted(known.items()) if mass}
    (low, high), slack = target.ends, float(target.slack)
    for atom in law:
        if not low - slack <= atom <= high + slack:
            away = f"estimates of {short_text(atom)} lie outside the range [{low!r}, {high!r}]"
            raise Unplanned(f"{away}: declare the range of the estimates")
    values, masses = scaled_law(target, law)
    few = Batch(values[masses > 0], masses[masses > 0]).shortened(FEW)
    return few.values, few.counts


def _two_outcomes(target: Target, declared: Declared) -> Laws:
    """Two outcomes of the declared mean and variance, as equally likely as [0, 1] allows."""
    mean = target.scaled(target.true_mean + (declared.bias or 0))
    variance = float((declared.variance or 0) / target.width**2)
    if not 0 <= mean <= 1 or variance > mean * (1 - mean) * (1 + 1e-9):
        raise Unplanned("its mean and variance need estimates outside the range: declare the range of the estimates")
    if not variance:
        return np.array([mean]), np.array([1.0])
    upper = min(max(0.5, variance / (variance + (1 - mean) ** 2)), mean**2 / (variance + mean**2))
    odds = math.sqrt(upper / (1 - upper))
    values = mean + math.sqrt(variance) * np.array([-odds, 1 / odds])
    return np.clip(values, 0.0, 1.0), np.array([1 - upper, upper])
