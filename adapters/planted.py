"""Unbiased estimators in plain NumPy, and their biased twins: each has faults to plant by name.

``python:truemean.adapters.planted:TwoStage`` conforms,
``python:truemean.adapters.planted:TwoStage?fault=pilot-kept`` is biased.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from numbers import Real
from types import MappingProxyType
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from truemean.adapters.reference import (
    Floats,
    KirkArvoUnbiased,
    check_parameters,
    draw,
    is_easy,
    pick,
    second_stage_mean,
    uniforms,
)
from truemean.errors import InputError, UnknownName
from truemean.subject import PixelLike, Value

__all__ = [
    "FAULTS",
    "SUBJECTS",
    "FixedMean",
    "ImportanceSampling",
    "RussianRoulette",
    "TwoStage",
    "UnbiasedEstimateMean",
]

Range = tuple[tuple[Fraction, ...], tuple[Fraction, ...]]

BYTES, STRATA = 256, 100

FAULTS: Mapping[str, str] = MappingProxyType(
    {
        "pilot-kept": "the samples that decide are pooled with those they ask for: most adaptive anti-aliasing",
        "off-by-one-weight": "n samples are divided by n + 1: a running mean whose count starts too high",
        "clamp": "each sample is clamped to [0, 1] before the mean: clamps against fireflies, 8 bit buffers",
        "modulo-bias": "a stratum is chosen by a random byte modulo their number: rand() % k, noise textures of 8 bits",
        "float32-accumulation": "samples are summed in single precision, as in most frame buffers: low bits are lost",
        "missing-renormalisation": "samples are not divided by the probability they were drawn or kept with",
        "truncated-path": "a path ends at a largest depth and nothing makes up for its tail: max_depth of path tracers",
    }
)
"""The faults: name -> where it is met in practice."""


@dataclass(frozen=True, slots=True)
class FixedMean:
    """The mean of ``n`` samples, unbiased: no decision is made.

    Raises InputError for ``n`` below 1, UnknownName for a fault it doesn't have.

    >>> from truemean.oracle.pixel import Pixel
    >>> FixedMean(n=4).run(Pixel.two("1/2"), np.array([1, 2, 3]))
    array([0.75, 0.25, 0.75])
    >>> FixedMean(n=4, fault="off-by-one-weight").run(Pixel.two("1/2"), np.array([1, 2, 3]))
    array([0.6, 0.2, 0.6])
    """

    n: int = 8
    fault: str = ""

    faults: ClassVar = ("off-by-one-weight", "clamp", "modulo-bias", "float32-accumulation")

    def __post_init__(self) -> None:
        check_parameters(n=self.n)
        _check_fault(self)

    @property
    def declares(self) -> tuple[str, dict[str, float]]:
        """The plan of the catalogue that this code follows, or should."""
        return "fixed", {"n": self.n}

    def run(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Estimates ``[seeds]`` or ``[seeds, channels]``."""
        samples = draw(pixel, seeds, 0, self.n)
        if self.fault == "clamp":
            samples = samples.clip(0, 1)
        if self.fault == "modulo-bias":
            values, weights = pixel.arrays()
            samples = pick(values, weights, _places_by_modulo(seeds, self.n))
        if self.fault == "float32-accumulation":
            total = samples.cumsum(axis=1, dtype=np.float32)[:, -1]
            return np.asarray(total / np.float32(self.n), dtype=np.float64)
        return np.asarray(samples.sum(axis=1) / (self.n + (self.fault == "off-by-one-weight")))

    def costs(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Samples drawn ``[seeds]``."""
        return np.full(np.shape(seeds), float(self.n))

    def range(self, pixel: PixelLike) -> Range:
        """Bounds of every estimate by channel: of what one sample adds, and of the rounding of float32."""
        colours = [_colour(value) for value in pixel.values]
        if self.fault == "clamp":
            colours = [tuple(min(max(v, Fraction(0)), Fraction(1)) for v in colour) for colour in colours]
        if self.fault == "off-by-one-weight":
            colours = [_times(Fraction(self.n, self.n + 1), colour) for colour in colours]
        if self.fault == "float32-accumulation":
            # n + 1 roundings of one part in 2^24 each: Higham 2002, Lemma 3.1.
            error = Fraction(self.n + 1, 2**24 - self.n - 1)
            colours = [_times(factor, colour) for colour in colours for factor in (1 - error, 1 + error)]
        return _hull(colours)


@dataclass(frozen=True, slots=True)
class TwoStage:
    """Kirk & Arvo 1991, section 4: a pilot of ``p`` decides between ``n1`` and ``n2`` fresh samples and is discarded.

    Raises InputError for sizes below 1 or ``eps`` below 0, UnknownName for a fault it doesn't have.

    >>> from truemean.oracle.pixel import Pixel
    >>> TwoStage(p=1, n1=2).run(Pixel.two("1/2"), np.array([1, 2, 3]))
    array([0.5, 0.5, 1. ])
    """

    p: int = 4
    n1: int = 4
    n2: int = 16
    eps: float = 0
    fault: str = ""

    faults: ClassVar = ("pilot-kept",)

    def __post_init__(self) -> None:
        check_parameters(self.eps, p=self.p, n1=self.n1, n2=self.n2)
        _check_fault(self)

    @property
    def declares(self) -> tuple[str, dict[str, float]]:
        """The plan of the catalogue that this code follows, or should."""
        return "discard-pilot", {"p": self.p, "n1": self.n1, "n2": self.n2, "eps": self.eps}

    def run(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Estimates ``[seeds]`` or ``[seeds, channels]``."""
        pilot = draw(pixel, seeds, 0, self.p)
        fresh = draw(pixel, seeds, self.p, max(self.n1, self.n2))
        if self.fault == "pilot-kept":
            return _pooled_mean(pilot, fresh, self.n1, self.n2, self.eps)
        return second_stage_mean(pilot, fresh, self.n1, self.n2, self.eps)

    def costs(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Samples drawn ``[seeds]``."""
        easy = is_easy(draw(pixel, seeds, 0, self.p), self.eps)
        return self.p + np.where(easy, float(self.n1), float(self.n2))


@dataclass(frozen=True, slots=True)
class UnbiasedEstimateMean(KirkArvoUnbiased):
    """Kirk & Arvo 1991, Fig. 2, as in `KirkArvoUnbiased`; its fault counts the samples of R for the rest too.

    Raises InputError for sizes below 1, ``eps`` below 0 or ``area`` outside (0, 1), UnknownName for a fault
    it doesn't have.

    >>> from truemean.oracle.pixel import Pixel
    >>> UnbiasedEstimateMean(p=2, n1=2, n2=2).run(Pixel.two("1/2"), np.array([1, 2, 3]))
    array([0.625, 0.375, 0.625])
    >>> UnbiasedEstimateMean(p=2, n1=2, n2=2, fault="pilot-kept").run(Pixel.two("1/2"), np.array([1, 2, 3]))
    array([0.8125, 0.1875, 0.8125])
    """

    fault: str = ""

    faults: ClassVar = ("pilot-kept",)

    def __post_init__(self) -> None:
        KirkArvoUnbiased.__post_init__(self)
        _check_fault(self)

    def run(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Estimates ``[seeds]`` or ``[seeds, channels]``."""
        if not self.fault:
            return KirkArvoUnbiased.run(self, pixel, seeds)
        pilot = draw(pixel, seeds, 0, self.p)
        rest = draw(pixel, seeds, self.p, max(self.n1, self.n2))
        rest_mean = _pooled_mean(pilot, rest, self.n1, self.n2, self.eps)
        return np.asarray(pilot.mean(axis=1) * self.area + rest_mean * (1 - self.area))


@dataclass(frozen=True, slots=True)
class ImportanceSampling:
    """The mean of ``n`` samples weighted by omega / q, where q is half omega and half even over the values.

    No weight exceeds 2. Raises InputError for ``n`` below 1, UnknownName for a fault it doesn't have.

    >>> from truemean.oracle.pixel import Pixel
    >>> ImportanceSampling(n=2).run(Pixel.two("1/4"), np.array([1, 2, 3]))
    array([0.66666667, 0.        , 0.66666667])
    """

    n: int = 8
    fault: str = ""

    faults: ClassVar = ("missing-renormalisation",)

    def __post_init__(self) -> None:
        check_parameters(n=self.n)
        _check_fault(self)

    def run(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Estimates ``[seeds]`` or ``[seeds, channels]``."""
        values, omega = pixel.arrays()
        q = (omega + 1 / len(omega)) / 2
        if not self.fault:
            values = ((omega / q) * values.T).T
        return np.asarray(pick(values, q, uniforms(seeds, 0, self.n)).mean(axis=1))

    def costs(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Samples drawn ``[seeds]``."""
        return np.full(np.shape(seeds), float(self.n))

    def range(self, pixel: PixelLike) -> Range:
        """Bounds of every estimate by channel: those of one weighted sample."""
        q = [(omega + Fraction(1, len(pixel.weights))) / 2 for omega in pixel.weights]
        ratios = [Fraction(1) if self.fault else omega / q_i for omega, q_i in zip(pixel.weights, q, strict=True)]
        return _hull(_times(w, _colour(value)) for w, value in zip(ratios, pixel.values, strict=True))


@dataclass(frozen=True, slots=True)
class RussianRoulette:
    """The light of a path: at each bounce a sample, times (1 - albedo) albedo^bounce, and an end by roulette.

    A path goes on with probability ``survival``, and its throughput is divided by it (Arvo & Kirk 1990).
    ``albedo < survival`` bounds the estimate. ``depth`` is where the fault truncated-path ends every path.
    Raises InputError for numbers outside these bounds, UnknownName for a fault it doesn't have.

    >>> from truemean.oracle.pixel import Pixel
    >>> RussianRoulette().run(Pixel({1: 1}), np.array([1, 2, 3]))
    array([1.46098156, 1.4122085 , 0.5       ])
    """

    albedo: float = 0.5
    survival: float = 0.75
    depth: int = 3
    fault: str = ""

    faults: ClassVar = ("truncated-path", "missing-renormalisation")

    def __post_init__(self) -> None:
        check_parameters(depth=self.depth)
        numbers = isinstance(self.albedo, Real) and isinstance(self.survival, Real)
        if not (numbers and 0 < self.albedo < self.survival < 1):
            raise InputError(
                f"albedo={self.albedo!r} and survival={self.survival!r} give no bounded path that ends: "
                "choose 0 < albedo < survival < 1"
            )
        _check_fault(self)

    def run(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Estimates ``[seeds]`` or ``[seeds, channels]``."""
        values, weights = pixel.arrays()
        seeds = np.asarray(seeds)
        light = np.zeros((len(seeds), *values.shape[1:]))
        alive, throughput, bounce = np.arange(len(seeds)), 1 - self.albedo, 0
        while alive.size and not (self.fault == "truncated-path" and bounce == self.depth):
            u = uniforms(seeds[alive], 2 * bounce, 2)
            light[alive] += throughput * pick(values, weights, u[:, 0])
            alive = alive[u[:, 1] < self.survival]
            throughput *= self._factor
            bounce += 1
        return light

    @property
    def _factor(self) -> float:
        """What a bounce multiplies the throughput with."""
        return self.albedo if self.fault == "missing-renormalisation" else self.albedo / self.survival

    def range(self, pixel: PixelLike) -> Range:
        """Bounds of every estimate by channel: a path of one bounce, and one that never ends."""
        first = 1 - Fraction(self.albedo)
        weights = (first, first / (1 - Fraction(self._factor)))
        return _hull(_times(weight, _colour(value)) for weight in weights for value in pixel.values)


SUBJECTS = (FixedMean, TwoStage, UnbiasedEstimateMean, ImportanceSampling, RussianRoulette)
"""Every subject that a fault can be planted in; ``faults`` of each names them."""


def _check_fault(subject: FixedMean | TwoStage | UnbiasedEstimateMean | ImportanceSampling | RussianRoulette) -> None:
    """UnknownName unless the subject has the fault asked for, or none is."""
    if subject.fault != "" and subject.fault not in subject.faults:
        known = [f"{name} ({FAULTS[name]})" for name in subject.faults]
        raise UnknownName(f"fault of {type(subject).__name__}", str(subject.fault), known)


def _pooled_mean(pilot: Floats, fresh: Floats, n1: int, n2: int, eps: float) -> Floats:
    """The mean of the pilot and of the samples that it asked for."""
    p = pilot.shape[1]
    return second_stage_mean(pilot, np.concatenate([pilot, fresh], axis=1), p + n1, p + n2, eps)


def _places_by_modulo(seeds: ArrayLike, count: int) -> Floats:
    """Places in [0, 1): a stratum of `STRATA`, chosen by a random byte modulo their number, and a place in it."""
    u = uniforms(seeds, 0, 2 * count)
    stratum = np.floor(u[:, :count] * BYTES) % STRATA
    return np.asarray((stratum + u[:, count:]) / STRATA)


def _colour(value: Value) -> tuple[Fraction, ...]:
    return value if isinstance(value, tuple) else (value,)


def _times(factor: Fraction, colour: tuple[Fraction, ...]) -> tuple[Fraction, ...]:
    return tuple(factor * v for v in colour)


def _hull(colours: Iterable[tuple[Fraction, ...]]) -> Range:
    """The least and the largest value by channel."""
    channels = list(zip(*colours, strict=True))
    return tuple(map(min, channels)), tuple(map(max, channels))
