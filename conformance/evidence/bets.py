"""Bets: chosen before the run, from what is declared, never from its data."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from truemean.conformance.evidence.outcomes import FloatArray

__all__ = ["LARGEST", "Bets", "best_fraction", "growth", "hybrid", "scales", "universal", "variance_fraction"]

LARGEST = 0.99


@dataclass(frozen=True, slots=True, eq=False)
class Bets:
    """Constant bets, and the logarithm of the money put on each; as a rule fractions of the largest safe bet."""

    fractions: FloatArray
    log_weights: FloatArray

    @classmethod
    def equal(cls, fractions: ArrayLike) -> Bets:
        """The same money on each."""
        bets = np.asarray(fractions, dtype=float)
        return cls(bets, np.full(bets.size, -math.log(bets.size)))

    def favouring(self, fraction: float, weight: float) -> Bets:
        """These bets with ``weight`` of the money moved to one more bet; a bet of 0 changes nothing."""
        if fraction <= 0:
            return self
        return Bets(
            np.append(self.fractions, min(fraction, LARGEST)),
            np.append(self.log_weights + math.log1p(-weight), math.log(weight)),
        )


def hybrid(mean: float, level: float, budget: int) -> Bets:
    """The bets against E[y] <= ``mean``: some for rare outcomes, for noise, for small bias.

    0.4 of the money on the largest bet, 0.4 on eight arcsine nodes, 0.2 on a geometric grid down to
    the bet that ``budget`` replicates need to reach ``level``.

    >>> hybrid(0.5, 0.01, 100_000).fractions.size
    12
    """
    m = min(max(mean, 1e-12), 1 - 1e-12)
    least = min(0.1, math.sqrt(-2 * math.log(level) * m / ((1 - m) * budget)))
    steps = max(0, math.ceil(math.log(0.1 / (1.7 * least), 3)))
    grid = 0.1 * 3.0 ** -np.arange(steps + 1)
    weights = np.repeat([0.4, 0.4 / 8, 0.2 / grid.size], [1, 8, grid.size])
    return Bets(np.concatenate([[LARGEST], _arcsine(8), grid]), np.log(weights))


def universal() -> Bets:
    """Cover's universal portfolio (Cover & Ordentlich 1996), its prior at 64 nodes: never far from the best bet."""
    return Bets.equal(np.minimum(_arcsine(64), LARGEST))


def scales(level: float, budget: int) -> Bets:
    """Bets for outcomes of variance 1: a geometric grid from 2 to what ``budget`` replicates need."""
    least = math.sqrt(-2 * math.log(level) / budget) / 1.5
    return Bets.equal(2.0 ** np.arange(1, min(0, math.floor(math.log2(least))), -1))


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
    return min(LARGEST, max(0.0, mean * distance / (variance + distance**2))) if distance else 0.0


def growth(values: FloatArray, probabilities: FloatArray, mean: float) -> float:
    """KL_inf: nats of evidence against E[y] <= ``mean`` per replicate, at the best bet for this law.

    >>> round(growth(np.array([0.0, 1.0]), np.array([0.4, 0.6]), 0.5), 6)
    0.020136
    """
    if mean <= 0:
        return math.inf
    return float(np.log1p(best_fraction(values, probabilities, mean) * (values / mean - 1)) @ probabilities)


def _arcsine(nodes: int) -> FloatArray:
    return np.asarray(np.sin((2 * np.arange(nodes) + 1) * np.pi / (4 * nodes)) ** 2)
