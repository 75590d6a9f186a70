"""Mitsuba 3, a renderer whose samplers take equally many samples of every pixel, and two-stage plans built on it.

Mitsuba (3.9.1) decides nothing: ``src/render/integrator.cpp`` gives each pixel ``sample_count`` samples under a box
filter, and their mean is unbiased. The samplers (``src/samplers``) place them: ``independent`` at random, the others
one in each stratum. With ``pilot`` the adapter decides, as an adaptive renderer would: a pixel is refined when its
pilot saw two values. Beside the values a pilot renders the number j of the value seen and j², whole numbers that
single precision adds without rounding: the n samples are all equal exactly where n Σ j² = (Σ j)².

In scalar variants every pixel of every render takes its random numbers from one generator, PCG32, at a 32-bit
position: ``seed * width * height`` plus its place in the frame, modulo 2^32. `Streams` deals them out so that no two
stages, replicates or pixels share one. There are 2^seed_bits replicates; a larger seed counts modulo that. Generators 17
or 23 positions apart agree a little: some pairs of pixels of one render are correlated by up to 5 %. Stages and replicates
are scrambled, so that what is left between them differs in size and sign from one to the next.

Positions in the frame are single precision: about once in 2^22 / x samples, a sample of column or row x lands on an
edge of its pixel and sees what begins there, which `Mitsuba.range` therefore includes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from importlib import import_module
from importlib.metadata import version
from itertools import pairwise
from math import gcd
from operator import mul
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truemean.adapters.frames import (
    Floats,
    Number,
    Point,
    SinglePrecisionRenderer,
    by_channel,
    layers,
    read_count,
    untested,
)
from truemean.adapters.registry import read_number
from truemean.errors import InputError, MissingExtra, UnknownName
from truemean.subject import PixelLike

__all__ = ["Mitsuba", "Streams", "triangles"]

TESTED = ("3.9.1",)
SAMPLERS = ("independent", "stratified", "multijitter", "orthogonal", "ldsampler")
BLOCK = 8  # pixels on a side of a block, which one thread renders; Mitsuba's own choice depends on the machine
EXACT = 2**24  # single precision adds whole numbers up to here without rounding
Light = tuple[float, ...]


class Mitsuba(SinglePrecisionRenderer):
    """A render of Mitsuba is one replicate of every pixel of a scene, in grey or in colour.

    ``sampler``, ``sample_count`` and ``variant`` are Mitsuba's. The variant is one that ends in ``_rgb``: for small
    frames scalar_rgb is the fastest; llvm_ad_rgb needs a libLLVM, of which 19 works and 15 ends the whole process.
    ``pilot`` is a number of samples before them: where it is mixed, ``sample_count`` more are drawn. With ``pooled`` 1
    the estimate is the mean of all; with 0 the pilot is discarded, and where it is not mixed as many fresh samples
    follow. Later stages are rendered whole, and each pixel uses and counts the samples that it asked for.
    MissingExtra without mitsuba, UnknownName or InputError for options that Mitsuba does not have.
    """

    name = "mitsuba"
    package: ClassVar[str] = "mitsuba"
    predicts: Callable[[PixelLike], dict[str, Any]] | None = None

    def __init__(
        self,
        scene: Any = "tile",
        sampler: str = "independent",
        sample_count: Number = 4,
        variant: str = "scalar_rgb",
        # Of a two-stage plan.
        pilot: Number | None = None,
        pooled: Number = 1,
    ) -> None:
        try:
            mi = import_module("mitsuba")
        except ImportError as error:
            raise MissingExtra(f"mitsuba can't be imported ({error}): pip install 'truemean[mitsuba]'") from error
        super().__init__(scene)
        self.notes = untested("mitsuba", version("mitsuba"), TESTED)
        if sampler not in SAMPLERS:
            raise UnknownName("sampler of mitsuba", str(sampler), SAMPLERS)
        if variant not in (variants := [each for each in mi.variants() if each.endswith("_rgb")]):
            raise UnknownName("variant of mitsuba that renders plain RGB", str(variant), variants)
        self.pooled = read_number(pooled)
        if self.pooled not in (0, 1):
            raise InputError(f"pooled={pooled!r}: 1 pools the pilot with what follows, 0 discards it")
        if pilot is None and not self.pooled:
            raise InputError(f"pooled={pooled!r} discards the pilot of a two-stage plan: give pilot too")
        self.sampler = sampler
        self.streams = Streams(self.scene.width, self.scene.height, 1 if pilot is None else 2)
        self.seed_bits = self.streams.bits
        with _variant(mi, variant):
            self.sample_count = _drawn(mi, sampler, "sample_count", sample_count)
            self.pilot = 0 if pilot is None else _drawn(mi, sampler, "pilot", pilot)
            self._build(mi)
        if sampler != "independent" and pilot is None:
            self.predicts = self._true_mean

    def _build(self, mi: Any) -> None:
        """The views that are rendered: of the values, and of their numbers."""
        sheets = layers(self.scene.to_dict(), "mitsuba")
        values: list[Any] = [value for value, _ in sheets]
        numbers = {value: float(number) for number, value in enumerate(sorted(set(values)))}
        kinds = [(numbers[value], numbers[value] ** 2) for value in values]
        if self.pilot * max(square for _, square in kinds) > EXACT / 8:  # means are rounded once more
            raise InputError(
                f"pilot={self.pilot} on a scene of {len(numbers)} values: single precision can't tell which of so many "
                "samples differ, give fewer"
            )
        self._colour = isinstance(values[0], tuple)
        self._channels: Any = slice(None) if self._colour else 0
        frame = self.scene.width, self.scene.height
        outlines = [outline for _, outline in sheets]
        seen = values if self._colour else [(value, *kind) for value, kind in zip(values, kinds, strict=True)]
        self._values = _View.of(mi, frame, self.sampler, outlines, seen)
        if self._colour and self.pilot:
            self._kinds = _View.of(mi, frame, self.sampler, outlines, [(0.0, *kind) for kind in kinds])
        if not all(float(part).is_integer() for value in values for part in np.atleast_1d(value)):
            scale = min(float(X.scale) for X in self.pixels().values())
            sums = max(self.pilot, self.sample_count) * float(np.max(values))
            self.rounding = max(self.rounding, sums / EXACT / scale)

    @property
    def declares(self) -> tuple[str, dict[str, int]] | None:
        """The plan whose law every pixel has; None where samples are placed in strata."""
        if self.sampler != "independent":
            return None
        if not self.pilot:
            return "fixed", {"n": self.sample_count}
        if self.pooled:
            return "two-stage-pooled", {"n": self.pilot, "m": self.sample_count, "eps": 0}
        return "discard-pilot", {"p": self.pilot, "n1": self.pilot, "n2": self.sample_count, "eps": 0}

    def frames(self, seeds: NDArray[np.int64]) -> tuple[Any, Any]:
        """Renders of many seeds ``[seeds, height, width]``, in colour with an axis of 3 more, and samples drawn."""
        starts = [self.streams.starts(seeds, stage).tolist() for stage in range(self.streams.stages)]
        if self.pilot:
            means, counts = zip(*map(self._two_stages, *starts), strict=True)
            return np.stack(means), np.stack(counts)
        images = np.stack([self._values.render(start, self.sample_count) for start in starts[0]])
        return images[..., self._channels], np.full(images.shape[:3], self.sample_count)

    def _two_stages(self, first: int, second: int) -> tuple[Floats, NDArray[np.int64]]:
        """One frame of the two-stage plan, and the samples that each pixel asked for."""
        n, m = self.pilot, self.sample_count
        pilot = self._values.render(first, n)
        kinds = self._kinds.render(first, n) if self._colour else pilot
        _, total, squares = np.rint(kinds * n).transpose(2, 0, 1)
        mixed = n * squares != total**2
        refined = self._values.render(second, m) if mixed.any() else pilot
        if self.pooled:
            pooled = (n * pilot + m * refined) / (n + m)
            means, counts = np.where(mixed[..., None], pooled, pilot), np.where(mixed, n + m, n)
        else:
            fresh = self._values.render(second, n)
            means, counts = np.where(mixed[..., None], refined, fresh), np.where(mixed, n + m, 2 * n)
        return means[..., self._channels], counts

    def _true_mean(self, pixel: PixelLike) -> dict[str, Any]:
        """What is known of any unbiased sampler: its mean and its cost."""
        mean = [sum(map(mul, channel, pixel.weights), Fraction(0)) for channel in by_channel(pixel.values)]
        return {"mean": tuple(mean) if self._colour else mean[0], "cost": self.sample_count}


@dataclass(frozen=True, slots=True)
class Streams:
    """Where in PCG32 the renders of ``width`` x ``height`` pixels begin, each replicate having so many ``stages``.

    Mitsuba seeds pixel p of block b at ``seed * width * height + b * BLOCK² + p`` modulo 2^32. A seed that begins at
    a multiple of the places which a render takes exists for every multiple; they are dealt out in a scrambled order.

    >>> streams = Streams(8, 8, stages=2)
    >>> streams.bits
    25
    >>> streams.starts([0, 1, 2**25], stage=0)
    array([       0, 43736321,        0], dtype=uint32)
    """

    width: int
    height: int
    stages: int = 1

    @property
    def places(self) -> int:
        """How many places one render takes: those of whole blocks."""
        return -(-self.width // BLOCK) * -(-self.height // BLOCK) * BLOCK**2

    @property
    def bits(self) -> int:
        """The number of bits of a replicate's seed; InputError for a frame so large that there is none."""
        bits = (2**32 // self.places // self.stages).bit_length() - 1
        if bits < 1:
            raise InputError(
                f"a frame of {self.width} x {self.height} pixels takes all seeds of Mitsuba: give a smaller scene"
            )
        return bits

    def starts(self, seeds: ArrayLike, stage: int) -> NDArray[np.uint32]:
        """Mitsuba's seed for ``stage`` of each replicate."""
        bits = self.bits + self.stages - 1
        mask = np.uint64(2**bits - 1)
        number = (np.asarray(seeds).astype(np.uint64) * np.uint64(self.stages) + np.uint64(stage)) & mask
        # Each step is a bijection of 0..2^bits-1: multiplying by an odd number, folding the top down.
        for factor in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB):
            number = (number * np.uint64(factor)) & mask
            number ^= number >> np.uint64(bits // 2 + 1)
        pixels = self.width * self.height
        common = gcd(pixels, 2**32)
        inverse = pow(pixels // common, -1, 2**32)
        return (number * np.uint64(self.places // common * inverse % 2**32)).astype(np.uint32)


@dataclass(frozen=True, slots=True)
class _View:
    """A scene of Mitsuba and what looks at it."""

    integrator: Any
    scene: Any
    sensor: Any

    def render(self, seed: int, count: int) -> Floats:
        """The mean of ``count`` samples a pixel, ``[height, width, 3]``."""
        image = self.integrator.render(self.scene, self.sensor, seed=seed, spp=count)
        return np.asarray(image.numpy(), dtype=np.float64)

    @classmethod
    def of(
        cls, mi: Any, frame: tuple[int, int], sampler: str, outlines: Sequence[Sequence[Point]], lights: Sequence[Light]
    ) -> _View:
        """Sheets one unit apart, the last one nearest to the camera; one unit is one pixel, x to the right, y upwards."""
        width, height = frame
        x, y, z = width / 2, height / 2, float(len(outlines))
        to_world = [[-x, 0, 0, x], [0, x, 0, -y], [0, 0, -1, z], [0, 0, 0, 1]]
        sensor = {
            "type": "orthographic",
            "near_clip": 0.5,
            "far_clip": z + 1,
            "to_world": mi.ScalarTransform4f(to_world),
            "film": {
                "type": "hdrfilm",
                "width": width,
                "height": height,
                "rfilter": {"type": "box"},
                "pixel_format": "rgb",
                "component_format": "float32",
            },
            "sampler": {"type": sampler, "sample_count": 4},
        }
        sheets = {
            f"sheet{depth}": _sheet(mi, outline, depth, light)
            for depth, (outline, light) in enumerate(zip(outlines, lights, strict=True))
        }
        integrator = {"type": "path", "max_depth": 1, "block_size": BLOCK}
        robust = {"embree_use_robust_intersections": True}  # no ray slips through between two triangles
        scene = mi.load_dict({"type": "scene", "integrator": integrator, "sensor": sensor, **robust, **sheets})
        return cls(scene.integrator(), scene, scene.sensors()[0])


def _sheet(mi: Any, outline: Sequence[Point], depth: int, light: Light) -> Any:
    """A polygon that glows towards the camera."""
    faces = triangles(outline)
    properties = mi.Properties()
    properties["emitter"] = mi.load_dict({"type": "area", "radiance": {"type": "rgb", "value": list(light)}})
    properties["face_normals"] = True
    mesh = mi.Mesh("sheet", len(outline), len(faces), properties)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = np.array([(x, -y, depth) for x, y in outline], np.float32).ravel()
    parameters["faces"] = np.array(faces, np.uint32)[:, ::-1].ravel()  # emitters are one-sided, and y is mirrored
    parameters.update()
    return mesh


def triangles(outline: Sequence[Point]) -> list[tuple[int, int, int]]:
    """A simple polygon cut into triangles of its vertices by number, in the sense in which x turns to y.

    Ears are cut off, decided in exact arithmetic. InputError for a polygon that has none because it touches itself.

    >>> triangles([(0, 0), (4, 0), (4, 4), (2, 1)])
    [(3, 0, 1), (3, 1, 2)]
    """
    scale = max(Fraction(number).denominator for point in outline for number in point)
    exact = [(int(Fraction(x) * scale), int(Fraction(y) * scale)) for x, y in outline]

    def turn(a: int, b: int, c: int) -> int:
        (ax, ay), (bx, by), (cx, cy) = exact[a], exact[b], exact[c]
        return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)

    ring = list(range(len(exact)))
    if sum(turn(ring[0], b, c) for b, c in pairwise(ring)) < 0:
        ring.reverse()
    cut = []
    while len(ring) > 2:
        for i in range(len(ring)):
            a, b, c = ear = ring[i - 1], ring[i], ring[(i + 1) % len(ring)]
            if turn(*ear) > 0 and not any(
                turn(a, b, p) >= 0 and turn(b, c, p) >= 0 and turn(c, a, p) >= 0 for p in ring if p not in ear
            ):
                break
        else:
            raise InputError(f"a polygon of {len(outline)} vertices touches itself to 16 digits: move them apart")
        cut.append(ear)
        del ring[i]
    return cut


def _drawn(mi: Any, sampler: str, name: str, count: Number) -> int:
    """A number of samples, if the sampler draws as many; InputError naming the number that it would draw."""
    number = read_count(name, count)
    if number > EXACT:
        raise InputError(f"{name}={count!r} is more than single precision counts: give {EXACT} at most")
    level = mi.log_level()
    mi.set_log_level(mi.LogLevel.Error)
    try:
        drawn = mi.load_dict({"type": sampler, "sample_count": number}).sample_count()
    finally:
        mi.set_log_level(level)
    if drawn != number:
        raise InputError(f"{name}={count!r}: sampler {sampler} draws {drawn} in its place, give a number it keeps")
    return number


@contextmanager
def _variant(mi: Any, variant: str) -> Iterator[None]:
    """Mitsuba in one variant, and afterwards in that of before, if any; MissingExtra where it can't start."""
    before = mi.variant()
    try:
        mi.set_variant(variant)
    except ImportError as error:
        raise MissingExtra(
            f"variant={variant!r} of mitsuba can't start ({error}): install what it runs on, or give variant=scalar_rgb"
        ) from error
    try:
        yield
    finally:
        if before is not None:
            mi.set_variant(before)
