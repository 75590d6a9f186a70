"""Kirk & Arvo's Figs. 1 and 2 as plain NumPy code: subjects to judge, written without the engine.

``python:truemean.adapters.reference:KirkArvo?n=8`` is Fig. 1,
``python:truemean.adapters.reference:KirkArvoUnbiased`` is Fig. 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truemean.errors import InputError
from truemean.subject import PixelLike

__all__ = [
    "KirkArvo",
    "KirkArvoUnbiased",
    "check_parameters",
    "draw",
    "is_easy",
    "pick",
    "second_stage_mean",
    "uniforms",
]

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class KirkArvo:
    """EstimateMean of Fig. 1: the mean of ``n`` samples where their range is at most ``eps``, else the true mean.

    >>> from truemean.oracle.pixel import Pixel
    >>> KirkArvo(n=4).run(Pixel.two("1/8"), np.array([1, 2, 3]))
    array([0.   , 0.125, 0.125])
    """

    n: int = 4
    eps: float = 0

    def __post_init__(self) -> None:
        check_parameters(self.eps, n=self.n)

    @property
    def declares(self) -> tuple[str, dict[str, float]]:
        """The plan of the catalogue that this code follows."""
        return "kirk-arvo", {"n": self.n, "eps": self.eps}

    def run(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Estimates ``[seeds]`` or ``[seeds, channels]``."""
        samples = draw(pixel, seeds, 0, self.n)
        easy = is_easy(samples, self.eps)
        return np.asarray(np.where(_as(easy, samples), samples.mean(axis=1), _true_mean(pixel)))

    def costs(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Samples drawn ``[seeds]``, the true mean not counted."""
        return np.full(np.shape(seeds), float(self.n))


@dataclass(frozen=True, slots=True)
class KirkArvoUnbiased:
    """UnbiasedEstimateMean of Fig. 2, the region R being a scattered part of the pixel, ``area`` = |R|.

    ``p`` samples of R decide whether ``n1`` or ``n2`` are drawn from the rest, and estimate R in any case.

    >>> from truemean.oracle.pixel import Pixel
    >>> KirkArvoUnbiased(p=2, n1=2, n2=4).costs(Pixel.two("1/2"), np.array([1, 2, 3, 4]))
    array([4., 4., 4., 6.])
    """

    area: float = 0.25
    p: int = 4
    n1: int = 4
    n2: int = 16
    eps: float = 0

    def __post_init__(self) -> None:
        check_parameters(self.eps, p=self.p, n1=self.n1, n2=self.n2)
        if not (isinstance(self.area, Real) and 0 < self.area < 1):
            raise InputError(f"area={self.area!r} of the region R must lie strictly between 0 and 1")

    @property
    def declares(self) -> tuple[str, dict[str, float]]:
        """The plan of the catalogue that this code follows."""
        params = {"area": self.area, "p": self.p, "n1": self.n1, "n2": self.n2, "eps": self.eps}
        return "kirk-arvo-unbiased", params

    def run(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Estimates ``[seeds]`` or ``[seeds, channels]``."""
        pilot = draw(pixel, seeds, 0, self.p)
        rest = draw(pixel, seeds, self.p, max(self.n1, self.n2))
        rest_mean = second_stage_mean(pilot, rest, self.n1, self.n2, self.eps)
        return np.asarray(pilot.mean(axis=1) * self.area + rest_mean * (1 - self.area))

    def costs(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Samples drawn ``[seeds]``."""
        easy = is_easy(draw(pixel, seeds, 0, self.p), self.eps)
        return self.p + np.where(easy, float(self.n1), float(self.n2))


def uniforms(seeds: ArrayLike, first: int, count: int) -> Floats:
    """Numbers in [0, 1) ``[seeds, count]``: draws ``first``, ``first + 1``, ... of the stream of each seed.

    A hash of (seed, draw): SplitMix64 (Steele, Lea & Flood 2014), started at the hashed seed, so that a
    replicate does not depend on the batch it is in.

    >>> bool((uniforms([7, 8], 0, 3)[1] == uniforms([8], 0, 3)[0]).all())
    True
    """
    gamma = np.uint64(0x9E3779B97F4A7C15)
    start = _mix(np.asarray(seeds, dtype=np.int64).astype(np.uint64) * gamma)
    steps = np.arange(first + 1, first + count + 1, dtype=np.uint64) * gamma
    return np.asarray((_mix(start[:, None] + steps) >> np.uint64(11)) * 2.0**-53)


def _mix(z: NDArray[np.uint64]) -> NDArray[np.uint64]:
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(z ^ (z >> np.uint64(31)))


def draw(pixel: PixelLike, seeds: ArrayLike, first: int, count: int) -> Floats:
    """Samples of X, ``[seeds, count]`` or ``[seeds, count, channels]``: draws ``first``, ``first + 1``, ... of each seed.

    >>> from truemean.oracle.pixel import Pixel
    >>> draw(Pixel.two("1/2"), [1, 2], 0, 3)
    array([[1., 1., 0.],
           [0., 0., 1.]])
    """
    values, weights = pixel.arrays()
    return pick(values, weights, uniforms(seeds, first, count))


def pick(values: Floats, weights: Floats, u: Floats) -> Floats:
    """The value at each place ``u`` of [0, 1), where the values lie side by side, as wide as their weights.

    >>> pick(np.array([5.0, 7.0]), np.array([0.75, 0.25]), np.array([0.5, 0.75]))
    array([5., 7.])
    """
    return np.asarray(values[np.searchsorted(weights.cumsum()[:-1], u, side="right")])


def is_easy(samples: Floats, eps: float) -> NDArray[np.bool_]:
    """Variation(S) <= eps in every channel, ``[seeds]``.

    >>> is_easy(np.array([[1.0, 1.0], [0.0, 1.0]]), 0)
    array([ True, False])
    """
    by_channel = np.ptp(samples, axis=1).reshape(len(samples), -1)
    return np.asarray((by_channel <= eps).all(axis=1))


def second_stage_mean(pilot: Floats, samples: Floats, n1: int, n2: int, eps: float) -> Floats:
    """The mean of the first ``n1`` samples where the pilot is easy, of the first ``n2`` where it is not.

    >>> second_stage_mean(np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[0.0, 1.0]] * 2), 1, 2, 0)
    array([0. , 0.5])
    """
    easy = _as(is_easy(pilot, eps), pilot)
    return np.asarray(np.where(easy, samples[:, :n1].mean(axis=1), samples[:, :n2].mean(axis=1)))


def _as(by_seed: NDArray[np.bool_], samples: Floats) -> NDArray[np.bool_]:
    """One flag a seed, shaped to broadcast over channels where the samples have them."""
    return by_seed.reshape(-1, *[1] * (samples.ndim - 2))


def _true_mean(pixel: PixelLike) -> Floats:
    values, weights = pixel.arrays()
    return np.asarray(weights @ values)


def check_parameters(eps: float = 0, **sizes: int) -> None:
    """InputError unless ``eps`` bounds a range and each of the ``sizes`` is a sample size.

    >>> check_parameters(eps=0.5, n=4)
    """
    if not (isinstance(eps, Real) and eps >= 0):
        raise InputError(f"eps={eps!r} is no bound on a range: give a number from 0 up")
    for name, size in sizes.items():
        if not (isinstance(size, int) and size >= 1):
            raise InputError(f"{name}={size!r} is no sample size: give a whole number from 1 up")
