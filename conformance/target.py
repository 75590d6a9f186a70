"""What is asked of an estimator on one channel of one pixel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from truemean.conformance.evidence import Bounded, FloatArray, Heavy

__all__ = ["Target"]

INFINITY = 1e6  # standard deviations: as far as an interval is looked for without a range


@dataclass(frozen=True)
class Target:
    """What is asked of one channel of a pixel: E[ξ] within ``tolerance`` of the true mean I.

    Outcomes lie in ``range``, up to a ``slack`` for rounding, and are scaled to y in [0, 1]. Without a
    range (None) their standard deviation is at most ``deviation``, and y counts in it from I.
    """

    pixel: str
    channel: int | None
    true_mean: Fraction
    tolerance: Fraction
    range: tuple[Fraction, Fraction] | None
    slack: Fraction
    deviation: Fraction | None = None

    @property
    def case(self) -> str:
        """The pixel's name, with the channel on a colour pixel."""
        return self.pixel if self.channel is None else f"{self.pixel}[{self.channel}]"

    @cached_property
    def origin(self) -> Fraction:
        """Where y = 0."""
        return self.true_mean if self.range is None else self.range[0]

    @cached_property
    def width(self) -> Fraction:
        """The length of 1 in y."""
        if self.range is None:
            return self.deviation or Fraction(1)
        return (self.range[1] - self.range[0]) or Fraction(1)

    @property
    def ends(self) -> tuple[float, float]:
        """The range in floats, infinite where there is none."""
        return (-math.inf, math.inf) if self.range is None else (float(self.range[0]), float(self.range[1]))

    def scaled(self, value: Fraction) -> float:
        """``value`` as y."""
        return float((value - self.origin) / self.width)

    def outcomes(self, estimates: FloatArray) -> FloatArray:
        """Estimates as y, clipped to the range."""
        y: FloatArray = (np.clip(estimates, *self.ends) - float(self.origin)) / float(self.width)
        return y if self.range is None else np.clip(y, 0.0, 1.0)

    def fault(self, estimates: FloatArray, seeds: NDArray[np.int64]) -> str | None:
        """What is wrong with the first estimate that can't be one; None when all lie in the range."""
        low, high = (end + sign * float(self.slack) for end, sign in zip(self.ends, (-1, 1), strict=True))
        bad = np.flatnonzero(~((estimates >= low) & (estimates <= high) & np.isfinite(estimates)))
        if not bad.size:
            return None
        value, seed = float(estimates[bad[0]]), int(seeds[bad[0]])
        if math.isnan(value) or self.range is None:
            return f"returned {'NaN' if math.isnan(value) else value} for seed {seed}"
        return (
            f"returned {value!r} for seed {seed}, outside its range [{self.ends[0]!r}, {self.ends[1]!r}]: "
            f"if that is right, declare the range of the estimates"
        )

    def side(self, sign: int, margin: Fraction) -> Bounded | Heavy:
        """The hypothesis E[ξ] <= I + ``margin`` (``sign`` 1), or >= I - ``margin`` (-1)."""
        edge = (self.true_mean + sign * margin - self.origin) / self.width
        return Heavy(sign, float(edge)) if self.range is None else Bounded.at(sign, edge)

    def side_at(self, sign: int, y: float) -> Bounded | Heavy:
        """The hypothesis E[y] <= ``y`` (``sign`` 1), or >= (-1)."""
        return Heavy(sign, y) if self.range is None else Bounded.at(sign, y)

    def limit(self, sign: int) -> float:
        """As low (``sign`` 1) or high (-1) as a mean of y may be."""
        if self.range is None:
            return -sign * INFINITY
        return 0.0 if sign > 0 else 1.0
