"""What evidence speaks against: that a mean lies on one side of an edge."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import ClassVar, Protocol

import numpy as np

from truemean.conformance.evidence.outcomes import FloatArray

__all__ = ["Bounded", "Gaussian", "Heavy", "Side", "Spread"]


class Side(Protocol):
    """A hypothesis, and what bets against it win.

    ``log_factors(bets, values)`` is what one outcome multiplies the money on each bet by, ``[bets, values]``:
    under the hypothesis its exponential has a mean of at most 1. ``concave``: they are, in the outcome.
    """

    @property
    def sign(self) -> int: ...

    @property
    def concave(self) -> bool: ...

    def log_factors(self, bets: FloatArray, values: FloatArray) -> FloatArray: ...


@dataclass(frozen=True, slots=True)
class Bounded:
    """E[y] <= ``mean`` for y in [0, 1]; with sign -1, E[1 - y] <= ``mean``.

    A bet is a fraction of the largest safe one. ``mean`` below 0 is a hypothesis that no outcome agrees
    with, 1 or more one that all agree with.
    """

    sign: int
    mean: float
    concave: ClassVar[bool] = True

    @classmethod
    def at(cls, sign: int, edge: Fraction | float) -> Bounded:
        """E[y] <= ``edge`` with sign 1, E[y] >= ``edge`` with sign -1."""
        return cls(sign, float(edge if sign > 0 else 1 - edge))

    def oriented(self, values: FloatArray) -> FloatArray:
        return values if self.sign > 0 else 1 - values

    def gains(self, values: FloatArray) -> FloatArray:
        """What a whole bet wins on each outcome."""
        y = self.oriented(values)
        return (y / self.mean if self.mean > 0 else np.where(y > self.mean, np.inf, 0.0)) - 1

    def log_factors(self, bets: FloatArray, values: FloatArray) -> FloatArray:
        return np.log(1 + bets[:, None] * self.gains(values))


@dataclass(frozen=True, slots=True)
class Spread:
    """E[(y - centre)^2] <= ``variance``: an estimator is no noisier than declared, whatever the range."""

    centre: float
    variance: float
    sign: int = 1
    concave: ClassVar[bool] = False

    def log_factors(self, bets: FloatArray, values: FloatArray) -> FloatArray:
        return np.log1p(bets[:, None] * ((values - self.centre) ** 2 / self.variance - 1))


@dataclass(frozen=True, slots=True)
class Heavy:
    """E[y] <= ``edge`` (>= with sign -1) for y of any range and a variance of at most 1.

    Catoni's influence function keeps a far outcome from deciding alone (Wang & Ramdas 2023). It rises
    with y, so a smaller mean only makes the bets worse.
    """

    sign: int
    edge: float
    concave: ClassVar[bool] = False

    def log_factors(self, bets: FloatArray, values: FloatArray) -> FloatArray:
        x = self.sign * bets[:, None] * (values - self.edge)
        return np.sign(x) * np.log1p(np.abs(x) + x**2 / 2) - np.log1p(bets[:, None] ** 2 / 2)


@dataclass(frozen=True, slots=True)
class Gaussian:
    """E[y] <= ``edge`` (>= with sign -1) for y in [0, 1], by Hoeffding's inequality: no variance is used."""

    sign: int
    edge: float
    concave: ClassVar[bool] = True

    def log_factors(self, bets: FloatArray, values: FloatArray) -> FloatArray:
        return self.sign * bets[:, None] * (values - self.edge) - bets[:, None] ** 2 / 8
