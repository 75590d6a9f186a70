"""raysect, a ray tracer whose camera samples adaptively, as an estimator of the pixels of a scene.

How its `MonoAdaptiveSampler2D` decides (raysect 0.9.1, ``optical/observer/sampler2d.pyx``): in each pass
a pixel gets ``pixel_samples`` more samples if it has fewer than ``max(min_samples, most / ratio)``, ``most``
being the number in the most sampled pixel, or if its standard error over its mean exceeds
``max(cutoff, percentile)``, the percentile of that quotient in the frame at ``1 - fraction``. The quotient is
0 where the mean is <= 0 or the samples are all equal: such a pixel is never looked at again. All samples are
pooled, so with ``cutoff`` 0 and the other terms out of play each pixel of a black and white scene has the
law of one two-stage plan, which `Raysect.declares`. Meshes are single precision: a vertex that is no such
number moves by some 1e-7 of the width.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from fractions import Fraction
from importlib import import_module
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truemean.adapters.registry import LOAD_SCENE, read_number, resolve
from truemean.errors import InputError, MissingExtra, SubjectError, Unsupported
from truemean.subject import PixelLike

__all__ = ["Raysect"]

Floats = NDArray[np.float64]
Number = int | float | str


class Raysect:
    """A frame of raysect is one replicate of every pixel of a scene, its seed the replicate's seed.

    ``scene`` is a shipped one by name, a scene file, or a scene. ``min_samples`` (with ``cutoff``, ``ratio``
    and ``fraction``) makes the camera adaptive: their meaning is raysect's, their defaults let no pixel
    depend on another, where raysect's own are ratio=10 and fraction=0.2. ``pixel_samples`` are drawn in a
    pass, of which there are ``passes``: 1, or 4 when adaptive.
    MissingExtra without raysect, InputError for options that raysect refuses.
    """

    name = "raysect"
    rounding = 1e-6

    def __init__(
        self,
        scene: Any = "tile",
        pixel_samples: Number = 4,
        passes: Number | None = None,
        min_samples: Number | None = None,
        cutoff: Number = 0,
        ratio: Number = 1e9,
        fraction: Number = 1,
    ) -> None:
        try:
            import_module("raysect.optical")
        except ImportError as error:
            raise MissingExtra(f"raysect can't be imported ({error}): pip install 'truemean[raysect]'") from error
        self.scene = scene if hasattr(scene, "to_dict") else resolve(LOAD_SCENE)(scene)
        self.versions = {"raysect": version("raysect")}
        default_passes = 1 if min_samples is None else 4
        self.passes = _read_count("passes", default_passes if passes is None else passes)
        self.options: dict[str, Any] = {
            "pixel_samples": _read_count("pixel_samples", pixel_samples),
            "min_samples": None if min_samples is None else _read_count("min_samples", min_samples),
            "cutoff": read_number(cutoff),
            "ratio": read_number(ratio),
            "fraction": read_number(fraction),
        }
        if min_samples is None and [self.options[name] for name in ("cutoff", "ratio", "fraction")] != [0, 1e9, 1]:
            raise InputError(
                f"cutoff={cutoff!r}, ratio={ratio!r}, fraction={fraction!r} steer the adaptive sampler: give min_samples too"
            )
        self._pipeline, self._camera = _camera(self.scene.to_dict(), **self.options)
        self._frame_pixels = self.scene.pixels()
        self._places = _places(self._frame_pixels)
        own = [self._frame_pixels[place] for place in self._places]
        self._columns: dict[Any, int] = {_law(X): i for i, X in enumerate(own)} | {id(X): i for i, X in enumerate(own)}
        self._last: tuple[bytes, tuple[Floats, Floats]] | None = None

    @property
    def declares(self) -> tuple[str, dict[str, int]] | None:
        """The plan whose law every pixel of the frame has, None when the options or the scene leave it open."""
        batch, least = self.options["pixel_samples"], self.options["min_samples"]
        most = batch * self.passes
        pilot = most if least is None else batch * math.ceil(least / batch)
        if pilot >= most:
            return "fixed", {"n": most}
        populations = [set(X.values) for X in self._frame_pixels.values()]
        percentile_is_zero = self.options["fraction"] == 1 and any(len(values) == 1 for values in populations)
        topped_up = most / self.options["ratio"] > pilot
        black_and_white = all(values <= {0, 1} for values in populations)
        if self.options["cutoff"] == 0 and percentile_is_zero and not topped_up and black_and_white:
            return "two-stage-pooled", {"n": pilot, "m": most - pilot, "eps": 0}
        return None

    def pixels(self) -> dict[str, Any]:
        """The partly covered pixels, and the first of each constant value as a control, by ``scene#x,y``."""
        return {f"{self.scene.name}#{x},{y}": self._frame_pixels[x, y] for x, y in self._places}

    def run(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Estimates of one pixel ``[seeds]``; Unsupported when the scene has none of its law."""
        return self.run_many([pixel], seeds)[:, 0]

    def run_many(self, pixels: Sequence[PixelLike], seeds: ArrayLike) -> Floats:
        """Estimates ``[seeds, pixels]``, one frame a seed."""
        columns = [self._column(pixel) for pixel in pixels]
        return self._frames(seeds)[0][:, columns]

    def costs(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Samples drawn in the pixel ``[seeds]``, as raysect counts them."""
        column = self._column(pixel)
        return self._frames(seeds)[1][:, column]

    def self_check(self, frames: int = 16) -> None:
        """SubjectError unless a seed repeats its frame, seeds differ, and the control pixels are exact."""
        seeds = np.arange(frames)
        estimates = self._render(seeds)[0]
        if not np.array_equal(estimates, self._render(seeds)[0]):
            raise SubjectError(f"raysect rendered other frames when seeds 0 to {frames - 1} were used again")
        pixels = self.pixels()
        for (name, X), column in zip(pixels.items(), estimates.T, strict=True):
            if len(X.values) == 1 and np.abs(column - float(X.values[0])).max() > self.rounding:
                seen = f"{column.min()} to {column.max()}"
                raise SubjectError(f"raysect gives {seen} in pixel {name}, which is {X.values[0]} all over")
        equal_by_chance = math.prod(float(max(X.weights)) ** (frames - 1) for X in pixels.values())  # at most
        if equal_by_chance < 1e-9 and (estimates == estimates[0]).all():
            raise SubjectError(f"raysect rendered {frames} equal frames: seeds 0 to {frames - 1} change nothing")

    def _column(self, pixel: PixelLike) -> int:
        column = self._columns.get(id(pixel), self._columns.get(_law(pixel)))
        if column is None:
            raise Unsupported(f"no pixel of scene {self.scene.name!r} is {pixel!r}: raysect renders the scene's own")
        return column

    def _frames(self, seeds: ArrayLike) -> tuple[Floats, Floats]:
        """`_render`, which keeps the last batch: its costs and other pixels need no second rendering."""
        numbers = np.asarray(seeds, dtype=np.int64)
        if self._last is None or self._last[0] != numbers.tobytes():
            self._last = numbers.tobytes(), self._render(numbers)
        return self._last[1]

    def _render(self, seeds: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """Estimates and sample counts ``[seeds, own pixels]``; Python's random numbers go on as if unused."""
        places = tuple(np.array(self._places).T)
        state = random.getstate()
        try:
            frames = [self._observe(int(seed), places) for seed in seeds]
        finally:
            random.setstate(state)
        means, counts = np.reshape(frames, (len(frames), 2, len(self._places))).swapaxes(0, 1)
        return means, counts

    def _observe(self, seed: int, places: tuple[NDArray[np.int64], ...]) -> tuple[Any, Any]:
        """One frame: raysect's random numbers, and Python's for the order of the pixels, come from the seed."""
        from raysect.core.math.random import seed as seed_rays

        seed_rays(seed + 1)  # by 0 raysect means the system's entropy
        random.seed(seed)
        for done in range(self.passes):
            self._pipeline.accumulate = done > 0
            self._camera.observe()
            if self._camera.render_complete:
                break
        return self._pipeline.frame.mean[places], self._pipeline.frame.samples[places]


def _places(pixels: Mapping[tuple[int, int], Any]) -> list[tuple[int, int]]:
    """Where to look: the pixels of mixed values, column by column, then the first of each constant value."""
    constant = {X.values: place for place, X in reversed(list(pixels.items())) if len(X.values) == 1}
    return sorted(place for place, X in pixels.items() if len(X.values) > 1) + [constant[v] for v in sorted(constant)]


def _read_count(name: str, value: Number) -> int:
    count = read_number(value)
    if not (isinstance(count, int) and count >= 1):
        raise InputError(f"{name}={value!r} is no count: give a whole number from 1 up")
    return count


def _law(pixel: PixelLike) -> frozenset[tuple[Any, Fraction]]:
    return frozenset(zip(pixel.values, pixel.weights, strict=True))


def _camera(scene: dict[str, Any], pixel_samples: Any, min_samples: Any, **adaptive: Any) -> tuple[Any, Any]:
    """Pipeline and camera, looking at the scene from the front; one unit is one pixel, x to the left, y upwards."""
    from raysect.core import translate
    from raysect.core.workflow import SerialEngine
    from raysect.optical.observer import (
        FullFrameSampler2D,
        MonoAdaptiveSampler2D,
        OrthographicCamera,
        RadiancePipeline2D,
    )

    width, height = scene["width"], scene["height"]
    pipeline = RadiancePipeline2D(display_progress=False)
    try:
        if min_samples is None:
            sampler = FullFrameSampler2D()
        else:
            sampler = MonoAdaptiveSampler2D(pipeline, min_samples=min_samples, **adaptive)
        camera = OrthographicCamera((width, height), width=width, pipelines=[pipeline], frame_sampler=sampler)
        camera.pixel_samples = pixel_samples
    except (TypeError, ValueError, OverflowError) as error:
        given = {"pixel_samples": pixel_samples, "min_samples": min_samples, **adaptive}
        raise InputError(f"raysect refuses {', '.join(f'{k}={v!r}' for k, v in given.items())}: {error}") from None
    camera.parent, camera.transform = _world(scene), translate(0, 0, -2)
    camera.max_wavelength, camera.min_wavelength = 501.0, 500.0  # 1 nm, so that radiance 1 is read as 1
    camera.spectral_bins = camera.spectral_rays = 1
    camera.render_engine, camera.quiet = SerialEngine(), True
    return pipeline, camera


def _world(scene: dict[str, Any]) -> Any:
    """The polygons as glowing prisms, the last one nearest to the camera, before the background."""
    from raysect.optical import ConstantSF, World
    from raysect.optical.material import UniformSurfaceEmitter
    from raysect.primitive import Mesh

    width, height = scene["width"], scene["height"]
    sheet = [(-1, -1), (width + 1, -1), (width + 1, height + 1), (-1, height + 1)]
    layers = [(scene["background"], sheet), *((p["value"], p["vertices"]) for p in scene["polygons"])]
    world = World()
    for depth, (value, vertices) in enumerate(reversed(layers)):
        if isinstance(value, list) or Fraction(value) < 0:
            raise InputError(f"value {value} of scene is no radiance: raysect scenes have numbers from 0 up")
        outline = [(width / 2 - float(Fraction(x)), height / 2 - float(Fraction(y))) for x, y in vertices]
        material = UniformSurfaceEmitter(ConstantSF(float(Fraction(value))))
        Mesh(*_prism(np.array(outline), 2 * depth), smoothing=False, parent=world, material=material)
    return world


def _prism(outline: Floats, front: float) -> tuple[Floats, NDArray[np.int32]]:
    """Vertices and triangles of a closed prism of thickness 1: a flat mesh would leak rays."""
    from raysect.core.math.polygon import triangulate2d

    x, y = outline.T
    twice_area = x @ np.roll(y, -1) - y @ np.roll(x, -1)
    clockwise = outline[::-1].copy() if twice_area > 0 else outline
    count = len(clockwise)
    vertices = [np.column_stack([clockwise, np.full(count, z)]) for z in (front, front + 1.0)]
    faces = triangulate2d(clockwise)
    here = np.arange(count)
    there = np.roll(here, -1)
    sides = [np.column_stack([here, here + count, there]), np.column_stack([there, here + count, there + count])]
    return np.concatenate(vertices), np.concatenate([faces, faces[:, ::-1] + count, *sides]).astype(np.int32)
