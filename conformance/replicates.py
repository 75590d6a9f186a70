"""Running an estimator: fresh seeds, and outputs that are what an estimator must return."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truemean.errors import InputError, NeedsScene, SubjectError, Unsupported, raised

__all__ = ["Few", "Seeds", "attribute", "blaming", "gives_sums", "run", "run_sums"]

FloatArray = NDArray[np.float64]
SUMS = ("counts", "means", "mean squares")
COLOURS = ": return [seeds, channels], e.g. values.mean(axis=0) per draw, or raise Unsupported to skip colour pixels"


@dataclass(frozen=True, slots=True)
class Seeds:
    """The seeds of one of ``streams`` disjoint streams: a permutation of 0..2^bits-1 that ``seed`` picks.

    >>> first, second = (Seeds(seed=7, bits=53, stream=s, streams=2).take(0, 3) for s in (0, 1))
    >>> len({*first.tolist(), *second.tolist()})
    6
    """

    seed: int
    bits: int
    stream: int
    streams: int

    def __post_init__(self) -> None:
        if not (isinstance(self.bits, int) and 1 <= self.bits <= 63):
            raise InputError(f"seed_bits={self.bits!r} must be a whole number from 1 to 63")

    @property
    def spent(self) -> str:
        """Why no replicate can be drawn any more."""
        return f"no fresh seed of {self.bits} bits is left"

    @property
    def capacity(self) -> int:
        """How many seeds there are before one would have to be used twice."""
        return ((1 << self.bits) - self.stream - 1) // self.streams + 1

    def take(self, start: int, stop: int) -> NDArray[np.int64]:
        """Seeds number ``start`` to ``stop - 1`` of this stream; InputError when there are not so many."""
        if stop > self.capacity:
            raise InputError(f"seed_bits={self.bits} gives {self.capacity} seeds a pixel, {stop} asked: lower budget=")
        index = np.arange(start, stop, dtype=np.uint64) * np.uint64(self.streams) + np.uint64(self.stream)
        mask, shift = np.uint64((1 << self.bits) - 1), np.uint64(max(1, self.bits // 2))
        # Each step is a bijection of 0..2^bits-1: adding, multiplying by an odd number, folding the top down.
        for key in np.random.SeedSequence(self.seed).generate_state(4, np.uint64):
            index = ((index + key) * (key | np.uint64(1))) & mask
            index ^= index >> shift
        return index.astype(np.int64)


@dataclass(frozen=True, slots=True)
class Few:
    """The seeds of an estimator that has so many replicates and no more: 0..number-1, in an order that ``seed`` picks.

    >>> sorted(Few(seed=7, number=3).take(0, 3).tolist())
    [0, 1, 2]
    """

    seed: int
    number: int
    what: str = "replicates"

    def __post_init__(self) -> None:
        if not (isinstance(self.number, int) and self.number >= 1):
            raise InputError(f"replicates={self.number!r} must be a whole number from 1 up")

    @property
    def spent(self) -> str:
        """Why no replicate can be drawn any more."""
        return f"all {self.number} {self.what} are used"

    @property
    def capacity(self) -> int:
        """How many seeds there are."""
        return self.number

    def take(self, start: int, stop: int) -> NDArray[np.int64]:
        """Seeds number ``start`` to ``stop - 1``."""
        return np.random.default_rng(self.seed).permutation(self.number)[start:stop]


@contextmanager
def blaming(what: str, *allowed: type[Exception]) -> Iterator[None]:
    """Whatever the subject raises meanwhile is a SubjectError: ``what`` crashed; declining stays Unsupported."""
    passed: tuple[type[Exception], ...] = (SubjectError, *allowed)
    try:
        yield
    except passed:
        raise
    except (Unsupported, NeedsScene) as declined:
        raise Unsupported(str(declined)) from declined
    except (Exception, SystemExit) as crash:
        raise SubjectError(f"{what} crashed with {raised(crash)}") from crash


def attribute(subject: Any, name: str) -> Any:
    """What the subject says of itself under ``name``; None where it says nothing, SubjectError where that crashes."""
    with blaming(name):
        return getattr(subject, name, None)


def run(
    subject: Any, pixels: Sequence[Any], channels: int | None, seeds: NDArray[np.int64]
) -> tuple[FloatArray, list[float] | None]:
    """Estimates ``[pixels, channels or 1, seeds]`` and, where the subject tells, the total cost per pixel.

    Raises Unsupported where the subject declines, SubjectError where it crashes or returns no estimates.
    """
    together = len(pixels) > 1
    with blaming("run_many(pixels, seeds)" if together else "run(pixel, seeds)"):
        raw = subject.run_many(pixels, seeds) if together else subject.run(pixels[0], seeds)
    spent = _spent(subject, pixels, seeds)
    shape = (seeds.size, *([len(pixels)] if together else []), *([channels] if channels else []))
    return _by_case(raw, shape, len(pixels), channels), spent


def gives_sums(subject: Any) -> bool:
    """Whether only the sums of many replicates are known, one a seed."""
    return attribute(subject, "sums") is not None


def run_sums(
    subject: Any, pixels: Sequence[Any], channels: int | None, seeds: NDArray[np.int64]
) -> tuple[FloatArray, list[float] | None]:
    """Counts, means and mean squares ``[pixels, channels or 1, 3, seeds]``; otherwise as `run`."""
    with blaming("sums(pixels, seeds)"):
        parts = tuple(subject.sums(pixels, seeds))
    if len(parts) != len(SUMS):
        raise SubjectError(f"sums(pixels, seeds) returned {len(parts)} arrays, expected {', '.join(SUMS)}")
    spent = _spent(subject, pixels, seeds)
    shape = (seeds.size, len(pixels), *([channels] if channels else []))
    return np.stack([_by_case(part, shape, len(pixels), channels) for part in parts], axis=-2), spent


def _spent(subject: Any, pixels: Sequence[Any], seeds: NDArray[np.int64]) -> list[float] | None:
    """The total cost per pixel, where the subject tells."""
    costs = attribute(subject, "costs")
    with blaming("costs(pixel, seeds)"):
        told = [costs(pixel, seeds) for pixel in pixels] if costs else [None]
        return None if any(each is None for each in told) else [_total(each, seeds) for each in told]


def _by_case(raw: Any, shape: tuple[int, ...], pixels: int, channels: int | None) -> FloatArray:
    """What was returned, ``[pixels, channels or 1, seeds]``; SubjectError unless it has this shape."""
    outputs = _as_floats(raw)
    if outputs.shape != shape:
        raise SubjectError(
            f"returned {type(raw).__name__} of shape {outputs.shape} for {shape[0]} seeds, expected {shape}"
            + (COLOURS if channels and outputs.shape == shape[:-1] else "")
        )
    return np.moveaxis(outputs.reshape(shape[0], pixels, channels or 1), 0, -1)


def _total(costs: Any, seeds: NDArray[np.int64]) -> float:
    numbers = np.asarray(costs, dtype=float)
    if numbers.shape != seeds.shape or not (np.isfinite(numbers) & (numbers >= 0)).all():
        raise SubjectError(
            f"costs(pixel, seeds) gave {numbers.ravel()[:3]} of shape {numbers.shape} for {seeds.size} seeds: "
            "return a number from 0 up for each"
        )
    return float(numbers.sum())


def _as_floats(raw: Any) -> FloatArray:
    try:
        array = np.asarray(raw)
        floats: FloatArray | None = array.astype(float) if array.dtype.kind in "biufO" else None
    except (TypeError, ValueError):
        floats = None
    if floats is None:
        raise SubjectError(f"returned {repr(raw)[:80]} (type={type(raw).__name__}), not an array of real numbers")
    return floats
