"""The pixel of a scene as a function on the unit square, and the estimators that integrate it.

The value at (x, y), x to the right and y downwards, is that of the topmost polygon there, so its integral is the
pixel's true mean. Integrators come from outside graphics; the vertices are their floats.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truemean.adapters.frames import Floats, Point, SceneSubject, layers
from truemean.errors import InputError
from truemean.subject import PixelLike

__all__ = ["Integrand", "SceneIntegrator", "integrand", "true_mean"]

Side = tuple[float, float, float, float]


class SceneIntegrator(SceneSubject):
    """An estimator that integrates one pixel of a scene at a time: `integrate` is what an integrator adds.

    ``scene`` is a shipped one by name, a scene file, or a scene, with numbers from 0 up as values; InputError for
    others. Estimates and costs of the last batch are kept, so that costs need no second integration.
    """

    magnification = Fraction(1)

    def __init__(self, scene: Any) -> None:
        super().__init__(scene)
        self._last: tuple[int, bytes, Floats, Floats] | None = None
        self._numbers: list[tuple[float, list[Point]]] = []
        for value, outline in layers(self.scene.to_dict(), self.name):
            if isinstance(value, tuple):
                raise InputError(f"value {value} of scene is no radiance: {self.name} scenes have numbers from 0 up")
            self._numbers.append((value, outline))

    def integrate(self, function: Integrand, seeds: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """Estimates of the integral over the unit square ``[seeds]``, and samples drawn ``[seeds]``."""
        raise NotImplementedError

    def run(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Estimates of one pixel ``[seeds]``; Unsupported when the scene has none of its law."""
        return self._integrated(pixel, seeds)[0]

    def costs(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Samples drawn ``[seeds]``."""
        return self._integrated(pixel, seeds)[1]

    def range(self, pixel: PixelLike) -> tuple[Fraction, Fraction]:
        """From the least to the greatest value; from 0 to ``magnification`` times the greatest where a grid adapts."""
        values = [value for value in pixel.values if isinstance(value, Fraction)]
        if self.magnification == 1:
            return min(values), max(values)
        return Fraction(0), self.magnification * max(values)

    def _magnify(self, times: Fraction) -> None:
        """A grid that adapts gives samples weights, by which an estimate may exceed the largest value."""
        self.magnification = times
        if times > 1:
            self.notes += (
                f"estimates may reach {float(times):.4g} times a pixel's largest value, by weights of samples",
            )

    def _integrated(self, pixel: PixelLike, seeds: ArrayLike) -> tuple[Floats, Floats]:
        numbers = np.asarray(seeds, dtype=np.int64)
        column = self._column(pixel)
        if self._last is None or self._last[:2] != (column, numbers.tobytes()):
            function = integrand(self._numbers, *self.places[column])
            self._last = column, numbers.tobytes(), *self.integrate(function, numbers)
        return self._last[2:]


@dataclass(frozen=True, slots=True)
class Integrand:
    """A pixel's ``background``, and each polygon over it, the last in front, as its value and its sides.

    A side is (top, bottom, x at the top, x per y): a place is inside where an odd number of sides of its row
    are right of it.

    >>> half = integrand([(0.0, []), (1.0, [(3, 0), (4, 0), (4, 2), (3, 2)]), (0.25, [(3, 0), (5, 2), (3, 2)])], 3, 1)
    >>> half(np.array([[0.1, 0.5], [0.9, 0.5]])), half.at_one()(0.9, 0.5), half.at_one()(0.99, 0.01)
    (array([0.25, 0.25]), 0.25, 0.25)
    """

    background: float
    polygons: tuple[tuple[float, tuple[Side, ...]], ...]

    def __call__(self, points: Floats) -> Floats:
        """Values at ``points`` ``[n, 2]``."""
        x, y = points[:, 0], points[:, 1]
        found = np.full(len(points), self.background)
        for value, sides in self.polygons:
            inside = np.zeros(len(points), dtype=bool)
            for top, bottom, start, slope in sides:
                inside ^= (top <= y) & (y < bottom) & (x < start + (y - top) * slope)
            found[inside] = value
        return found

    def at_one(self) -> Callable[[float, float], float]:
        """The same as a function of one place, in plain Python: faster there."""
        background, front_first = self.background, self.polygons[::-1]

        def at(x: float, y: float) -> float:
            for value, sides in front_first:
                inside = False
                for top, bottom, start, slope in sides:
                    if top <= y < bottom and x < start + (y - top) * slope:
                        inside = not inside
                if inside:
                    return value
            return background

        return at


def integrand(numbers: list[tuple[float, list[Point]]], column: int, row: int) -> Integrand:
    """The pixel in ``column`` and ``row``, of layers as `truemean.adapters.frames.layers` gives them."""
    polygons = []
    for value, outline in numbers[1:]:
        local = [(x - column, y - row) for x, y in [*outline, outline[0]]]
        sides = tuple(_side(*sorted(ends, key=lambda end: end[1])) for ends in pairwise(local) if _matters(*ends))
        if sides:
            polygons.append((value, sides))
    return Integrand(numbers[0][0], tuple(polygons))


def true_mean(pixel: PixelLike) -> Fraction:
    """The sum of values times weights, of a pixel of numbers."""
    parts = zip(pixel.values, pixel.weights, strict=True)
    return sum((value * weight for value, weight in parts if isinstance(value, Fraction)), Fraction(0))


def _matters(start: Point, end: Point) -> bool:
    """Whether a side is level with some of the unit square, and right of some of it."""
    (x1, y1), (x2, y2) = start, end
    return y1 != y2 and min(y1, y2) < 1 and max(y1, y2) > 0 and max(x1, x2) > 0


def _side(upper: Point, lower: Point) -> Side:
    (x1, y1), (x2, y2) = upper, lower
    return y1, y2, x1, (x2 - x1) / (y2 - y1)
