"""What is asked of an estimator on one channel of one pixel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from truemean.conformance.evidence import Bounded, FloatArray, Heavy, Sums

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

    def sums(self, sums: FloatArray) -> Sums:
        """Counts, means and mean squares of estimates, ``[3, groups]``, as those of y; there must be a range."""
        mean, square, slack = self._moments(sums)
        y = np.clip(mean, 0.0, 1.0)
        return Sums(sums[0], y, np.clip(square, y**2, y), slack)

    def _moments(self, sums: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Mean and mean square of y, and how far off the latter is if each estimate is a slack off."""
        origin, width = float(self.origin), float(self.width)
        _, mean, square = sums
        slack = 2 * float(self.slack) * (np.sqrt(np.maximum(square, 0.0)) + abs(origin)) / width**2
        return (mean - origin) / width, (square - 2 * origin * mean + origin**2) / width**2, slack

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

    def fault_of_sums(self, sums: FloatArray, seeds: NDArray[np.int64]) -> str | None:
        """What is wrong with the first counts, means and mean squares that no estimates in the range can have."""
        if fault := self.fault(sums[1], seeds):
            return fault
        mean, square, slack = self._moments(sums)
        room = slack + 4 * float(self.slack / self.width)
        right = (sums[0] >= 1) & np.isfinite(sums).all(axis=0) & (square >= mean**2 - room) & (square <= mean + room)
        if right.all():
            return None
        first = int(np.argmin(right))
        count, value, squared = sums[:, first].tolist()
        return (
            f"returned {count:g} estimates of mean {value!r} and mean square {squared!r} for seed {int(seeds[first])}, "
            f"which none in the range [{self.ends[0]!r}, {self.ends[1]!r}] have: "
            f"if they are right, declare the range of the estimates"
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
