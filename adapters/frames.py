"""What every estimator of a scene's own pixels has in common, and every renderer: its frame is one replicate of each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from functools import cached_property
from importlib.metadata import version
from itertools import product
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truemean.adapters.registry import LOAD_SCENE, read_number, resolve
from truemean.errors import InputError, Unsupported
from truemean.subject import PixelLike, Value

__all__ = [
    "SceneRenderer",
    "SceneSubject",
    "SinglePrecisionRenderer",
    "by_channel",
    "layers",
    "places_to_look",
    "read_count",
    "untested",
]

REACH = Fraction(1, 2**20)  # of the frame's size: beyond every error of single precision in a position

Floats = NDArray[np.float64]
Number = int | float | str
Point = tuple[float, float]


class SceneSubject:
    """An estimator that brings the pixels of one scene: a shipped one by name, a scene file, or a scene."""

    name: str
    notes: tuple[str, ...] = ()
    package: ClassVar[str] = ""

    def __init__(self, scene: Any) -> None:
        self.scene = scene if hasattr(scene, "to_dict") else resolve(LOAD_SCENE)(scene)
        self.frame_pixels: dict[tuple[int, int], Any] = self.scene.pixels()
        self.places = places_to_look(self.frame_pixels)
        own = [self.frame_pixels[place] for place in self.places]
        self._columns: dict[Any, int] = {_law(X): i for i, X in enumerate(own)} | {id(X): i for i, X in enumerate(own)}

    @property
    def versions(self) -> dict[str, str]:
        """The version of what renders."""
        return {self.package: version(self.package)}

    def pixels(self) -> dict[str, Any]:
        """The partly covered pixels, and the first of each constant value as a control, by ``scene#x,y``."""
        return {f"{self.scene.name}#{x},{y}": self.frame_pixels[x, y] for x, y in self.places}

    def _column(self, pixel: PixelLike) -> int:
        """Which of ``places`` the pixel is at, or one of equal law; Unsupported when there is none."""
        column = self._columns.get(id(pixel), self._columns.get(_law(pixel)))
        if column is None:
            raise Unsupported(
                f"no pixel of scene {self.scene.name!r} is {pixel!r}: {self.name} renders the scene's own"
            )
        return column


class SceneRenderer(SceneSubject):
    """An estimator of the pixels of one scene, which renders frames: `frame` or `frames` is what a renderer adds.

    ``scene`` is a shipped one by name, a scene file, or a scene. Estimates and costs of the last batch are kept,
    so that costs and other pixels need no second rendering.
    """

    rounding = 1e-6

    def __init__(self, scene: Any) -> None:
        super().__init__(scene)
        self._last: tuple[bytes, Floats, Floats] | None = None

    def frame(self, seed: int) -> tuple[Any, Any]:
        """One frame: estimates ``[height, width]`` or ``[height, width, channels]``, and samples drawn ``[height, width]``."""
        raise NotImplementedError

    def frames(self, seeds: NDArray[np.int64]) -> tuple[Any, Any]:
        """Frames of many seeds, ``[seeds, height, width, ...]`` each."""
        means, counts = zip(*map(self.frame, map(int, seeds)), strict=True)
        return np.stack(means), np.stack(counts)

    def run(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Estimates of one pixel ``[seeds]``; Unsupported when the scene has none of its law."""
        return self.run_many([pixel], seeds)[:, 0]

    def run_many(self, pixels: Sequence[PixelLike], seeds: ArrayLike) -> Floats:
        """Estimates ``[seeds, pixels]`` or ``[seeds, pixels, channels]``, one frame a seed."""
        columns = [self._column(pixel) for pixel in pixels]
        return self._rendered(seeds)[0][:, columns]

    def costs(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Samples drawn in the pixel ``[seeds]``."""
        column = self._column(pixel)
        return self._rendered(seeds)[1][:, column]

    def _rendered(self, seeds: ArrayLike) -> tuple[Floats, Floats]:
        """Estimates and costs ``[seeds, places]`` of the places that are looked at."""
        numbers = np.asarray(seeds, dtype=np.int64)
        if self._last is None or self._last[0] != numbers.tobytes():
            columns, rows = np.array(self.places).T
            means, counts = self.frames(numbers)
            self._last = numbers.tobytes(), means[:, rows, columns], counts[:, rows, columns]
        return self._last[1:]


class SinglePrecisionRenderer(SceneRenderer):
    """A renderer with positions in single precision: a sample may fall on the far edge of its pixel, or a little beyond."""

    def range(self, pixel: PixelLike) -> tuple[list[Fraction], list[Fraction]]:
        """The least and the largest value, by channel, in reach of the samples of ``pixel``."""
        channels = by_channel(self.in_reach(self.places[self._column(pixel)]))
        return [min(channel) for channel in channels], [max(channel) for channel in channels]

    def in_reach(self, place: tuple[int, int]) -> set[Value]:
        """The values in a pixel or on its edge."""
        return {value for scene in self._nudged for value in scene.pixel(*place).values}

    @cached_property
    def _nudged(self) -> list[Any]:
        """The scene, moved a little towards each of its corners."""
        plain, step = self.scene.to_dict(), REACH * max(self.scene.width, self.scene.height)
        return [
            type(self.scene).from_dict(plain | {"polygons": [_moved(each, shift) for each in plain["polygons"]]})
            for shift in product((-step, step), repeat=2)
        ]


def places_to_look(pixels: Mapping[tuple[int, int], Any]) -> list[tuple[int, int]]:
    """Where to look: the pixels of mixed values, column by column, then the first of each constant value."""
    constant = {X.values: place for place, X in reversed(list(pixels.items())) if len(X.values) == 1}
    return sorted(place for place, X in pixels.items() if len(X.values) > 1) + [constant[v] for v in sorted(constant)]


def layers(scene: Mapping[str, Any], what: str) -> list[tuple[float | tuple[float, ...], list[Point]]]:
    """Value and vertices of each layer of a scene, the background first, as a sheet that reaches beyond the frame.

    InputError for a negative value, of which ``what`` makes no light.
    """
    width, height = scene["width"], scene["height"]
    sheet = [(-1, -1), (width + 1, -1), (width + 1, height + 1), (-1, height + 1)]
    everything = [(scene["background"], sheet), *((p["value"], p["vertices"]) for p in scene["polygons"])]
    return [(_light(value, what), [(_real(x), _real(y)) for x, y in outline]) for value, outline in everything]


def by_channel(values: Iterable[Value]) -> list[tuple[Fraction, ...]]:
    """Values, each a number or a colour, as the numbers in each channel.

    >>> by_channel([(Fraction(0), Fraction(1)), (Fraction(2), Fraction(3))])
    [(Fraction(0, 1), Fraction(2, 1)), (Fraction(1, 1), Fraction(3, 1))]
    """
    return list(zip(*(value if isinstance(value, tuple) else (value,) for value in values), strict=True))


def read_count(name: str, value: Number) -> int:
    """A whole number from 1 up; InputError for any other.

    >>> read_count("passes", "4")
    4
    """
    count = read_number(value)
    if not (isinstance(count, int) and count >= 1):
        raise InputError(f"{name}={value!r} is no count: give a whole number from 1 up")
    return count


def untested(package: str, found: str, tested: Iterable[str]) -> tuple[str, ...]:
    """A note where the version found is none of those tested.

    >>> untested("povray", "3.8.0", ("3.7.0.10",))
    ('povray 3.8.0 is untested, its rules may have changed; tested: 3.7.0.10',)
    >>> untested("povray", "3.7.0.10", ("3.7.0.10",))
    ()
    """
    known = tuple(tested)
    if found in known:
        return ()
    return (f"{package} {found} is untested, its rules may have changed; tested: {', '.join(known)}",)


def _moved(polygon: Mapping[str, Any], shift: tuple[Fraction, ...]) -> dict[str, Any]:
    vertices = [[str(Fraction(a) + d) for a, d in zip(vertex, shift, strict=True)] for vertex in polygon["vertices"]]
    return {**polygon, "vertices": vertices}


def _light(value: Any, what: str) -> float | tuple[float, ...]:
    parts = value if isinstance(value, list) else [value]
    if any(Fraction(part) < 0 for part in parts):
        raise InputError(f"value {value} of scene is no radiance: {what} scenes have numbers from 0 up")
    return tuple(map(_real, parts)) if isinstance(value, list) else _real(value)


def _real(number: Any) -> float:
    return float(Fraction(number))


def _law(pixel: PixelLike) -> frozenset[tuple[Any, Fraction]]:
    return frozenset(zip(pixel.values, pixel.weights, strict=True))
