"""What is asked of an estimator on one channel of one pixel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from truemean.conformance.evidence import FloatArray

__all__ = ["Target"]


@dataclass(frozen=True)
class Target:
    """What is asked of one channel of a pixel: E[ξ] within ``tolerance`` of the true mean I.

    Outcomes lie in [low, high], up to a ``slack`` for rounding, and are scaled to y in [0, 1].
    """

    pixel: str
    channel: int | None
    true_mean: Fraction
    tolerance: Fraction
    low: Fraction
    high: Fraction
    slack: Fraction

    @cached_property
    def width(self) -> Fraction:
        return (self.high - self.low) or Fraction(1)

    def scaled(self, value: Fraction) -> float:
        """``value`` as y: 0 at ``low``, 1 at ``high``."""
        return float((value - self.low) / self.width)

    def outcomes(self, estimates: FloatArray) -> FloatArray:
        """Estimates as y in [0, 1], clipped."""
        low, high = float(self.low), float(self.high)
        y: FloatArray = (np.clip(estimates, low, high) - low) / float(self.width)
        return np.clip(y, 0.0, 1.0)

    def fault(self, estimates: FloatArray, seeds: NDArray[np.int64]) -> str | None:
        """What is wrong with the first estimate that can't be one; None when all lie in the range."""
        low, high = float(self.low - self.slack), float(self.high + self.slack)
        bad = np.flatnonzero(~((estimates >= low) & (estimates <= high)))
        if not bad.size:
            return None
        value, seed = float(estimates[bad[0]]), int(seeds[bad[0]])
        if math.isnan(value):
            return f"returned NaN for seed {seed}"
        return (
            f"returned {value!r} for seed {seed}, outside its range [{float(self.low)!r}, {float(self.high)!r}]: "
            f"if that is right, declare the range of the estimates"
        )

    def edge(self, sign: int, margin: Fraction) -> float:
        """The mean of y (``sign`` 1) or of 1 - y (-1) where E[ξ] = I + sign * margin."""
        y = (self.true_mean + sign * margin - self.low) / self.width
        return float(y if sign > 0 else 1 - y)
