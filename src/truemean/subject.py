"""What an estimator under test must offer, and what it is given: the only thing an adapter sees.

An estimator is any object with ``run(pixel, seeds)``; a bare function of the same two arguments, or of a pixel and
one ``seed``, will do. One replicate per seed, and the same seed gives the same estimate.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from truemean.errors import InputTypeError

__all__ = ["Costed", "Estimator", "Exact", "PixelLike", "PlainPixel", "Value", "argument_names", "as_estimator"]

Value = Fraction | tuple[Fraction, ...]


@runtime_checkable
class PixelLike(Protocol):
    """What an estimator may look at: the values, their weights, and both as float arrays."""

    @property
    def values(self) -> tuple[Value, ...]: ...

    @property
    def weights(self) -> tuple[Fraction, ...]: ...

    def arrays(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """``(values [k] or [k, channels], weights [k])`` in float64, for NumPy estimators."""
        ...


@runtime_checkable
class Estimator(Protocol):
    """An implementation under test.

    Optional attributes: ``range(pixel) -> (lo, hi)`` bounds of every output; ``variance(pixel)`` a bound on
    their variance, needed where that range is infinite; ``declares = (plan name or function, params)``, or
    ``predicts(pixel)`` a mapping with any of law, mean, variance and cost; ``deterministic = True`` where
    seeds make no difference; ``costs(pixel, seeds)`` samples drawn per replicate,
    or None;
    ``rounding`` slack of its outputs in units of the pixel's scale; ``seed_bits``, or ``replicates`` where there are
    so many and no more, its seeds being 0 to replicates - 1; ``exact(pixel)``, the `Exact` law of the code itself,
    TooManyPaths where that is too much; ``notes``, sentences for the report; ``pixels()``
    a mapping of the pixels it brings; ``run_many(pixels, seeds) -> [seeds, pixels(, channels)]``
    for one render of many pixels; ``sums(pixels, seeds) -> (counts, means, mean_squares)``, each of that shape, where a seed
    stands for many replicates of its own whose single values are gone (for a mean square a bound from above will do), `run`
    then giving their means; ``versions`` a mapping for the report.
    Raising `truemean.errors.Unsupported` skips a pixel.
    """

    def run(self, pixel: Any, seeds: NDArray[np.int64]) -> NDArray[np.float64]:
        """Estimates ``[len(seeds)]`` or ``[len(seeds), channels]``, one replicate per seed."""
        ...


class Costed(NamedTuple):
    """What a function may return in place of estimates alone: with them, the samples that each has drawn."""

    estimates: Any
    costs: Any


class _Function:
    """A bare function, made an estimator; attributes set on the function stay visible."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self.name = getattr(function, "__name__", "function")
        self._spent: tuple[Any, Any, Any] | None = None

    def run(self, pixel: Any, seeds: Any) -> NDArray[np.float64]:
        found = self._call(pixel, seeds)
        if isinstance(found, Costed):
            self._spent = pixel, np.array(seeds), np.asarray(found.costs)
            found = found.estimates
        return np.asarray(found)

    def _call(self, pixel: Any, seeds: Any) -> Any:
        return self.function(pixel, seeds)

    def costs(self, pixel: Any, seeds: Any) -> Any:
        """Samples drawn, where the function tells."""
        own = getattr(self.function, "costs", None)
        if own is not None:
            return own(pixel, seeds)
        spent = self._spent
        return spent[2] if spent and spent[0] is pixel and np.array_equal(spent[1], seeds) else None

    def __getattr__(self, name: str) -> Any:
        if name in ("function", "_spent"):  # not there yet while unpickling
            raise AttributeError(name)
        return getattr(self.function, name)


class _ScalarFunction(_Function):
    """A bare function of one seed."""

    def _call(self, pixel: Any, seeds: Any) -> Any:
        found = [self.function(pixel, int(seed)) for seed in seeds]
        if found and isinstance(found[0], Costed):
            return Costed(*map(np.array, zip(*found, strict=True)))
        return found


@dataclass(frozen=True, slots=True)
class PlainPixel:
    """A pixel of nothing but values and weights, which another process can be sent.

    >>> PlainPixel((Fraction(0), Fraction(1)), (Fraction(7, 8), Fraction(1, 8))).arrays()[1]
    array([0.875, 0.125])
    """

    values: tuple[Value, ...]
    weights: tuple[Fraction, ...]

    @classmethod
    def of(cls, pixel: PixelLike) -> PlainPixel:
        """What any pixel holds of these."""
        return cls(tuple(pixel.values), tuple(pixel.weights))

    def arrays(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """``(values [k] or [k, channels], weights [k])`` in float64."""
        return np.array(self.values, dtype=float), np.array(self.weights, dtype=float)


@dataclass(frozen=True, slots=True)
class Exact:
    """The law of an estimator, found by answering every request for a sample in every way.

    ``law`` maps each estimate, the exact value of the floats returned, to its probability; ``cost`` is the expected
    number of samples drawn, ``paths`` the number of runs that it took, ``how`` in which way they were enumerated.
    """

    law: Mapping[Value, Fraction]
    cost: Fraction
    paths: int
    how: str


def as_estimator(subject: Any) -> Any:
    """``subject`` itself if it has ``run``, a wrapper if it is a function; else InputTypeError.

    A function whose second argument is called ``seed`` is called once for each.

    >>> as_estimator(lambda pixel, seeds: seeds * 0.5).run(None, np.array([2, 4]))
    array([1., 2.])
    >>> as_estimator(lambda pixel, seed: seed * 0.5).run(None, np.array([2, 4]))
    array([1., 2.])
    """
    if callable(getattr(subject, "run", None)):
        return subject
    if not callable(subject):
        raise InputTypeError(
            f"expected an estimator (an object with run(pixel, seeds), or a function of these two) "
            f"but got subject={subject!r} (type={type(subject).__name__})"
        )
    names = argument_names(subject)
    if "draw" in names[:2]:
        raise InputTypeError(
            f"{getattr(subject, '__name__', subject)} asks for its samples: wrap it, truemean.adapters.asking(f)"
        )
    return _ScalarFunction(subject) if names[1:2] == ["seed"] else _Function(subject)


def argument_names(function: Callable[..., Any]) -> list[str]:
    """The names of the arguments of a function; none for compiled code that does not tell.

    >>> argument_names(as_estimator)
    ['subject']
    """
    try:
        return list(inspect.signature(function).parameters)
    except (TypeError, ValueError):
        return []
