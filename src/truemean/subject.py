"""What an estimator under test must offer, and what it is given: the only thing an adapter sees.

An estimator is any object with ``run(pixel, seeds)``; a bare function of the same two arguments
will do. One replicate per seed, and the same seed gives the same estimate.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from truemean.errors import InputTypeError

__all__ = ["Estimator", "PixelLike", "as_estimator"]

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
    seeds make no difference; ``costs(pixel, seeds)`` samples drawn per replicate;
    ``rounding`` slack of its outputs in units of the pixel's scale; ``seed_bits``; ``pixels()``
    a mapping of the pixels it brings; ``run_many(pixels, seeds) -> [seeds, pixels(, channels)]``
    for one render of many pixels; ``versions`` a mapping for the report.
    Raising `truemean.errors.Unsupported` skips a pixel.
    """

    def run(self, pixel: Any, seeds: NDArray[np.int64]) -> NDArray[np.float64]:
        """Estimates ``[len(seeds)]`` or ``[len(seeds), channels]``, one replicate per seed."""
        ...


class _Function:
    """A bare function, made an estimator; attributes set on the function stay visible."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self.name = getattr(function, "__name__", "function")

    def run(self, pixel: Any, seeds: NDArray[np.int64]) -> NDArray[np.float64]:
        return np.asarray(self.function(pixel, seeds))

    def __getattr__(self, name: str) -> Any:
        if name == "function":  # not there yet while unpickling
            raise AttributeError(name)
        return getattr(self.function, name)


def as_estimator(subject: Any) -> Any:
    """``subject`` itself if it has ``run``, a wrapper if it is a function; else InputTypeError.

    >>> as_estimator(lambda pixel, seeds: seeds * 0.5).run(None, np.array([2, 4]))
    array([1., 2.])
    """
    if callable(getattr(subject, "run", None)):
        return subject
    if callable(subject):
        return _Function(subject)
    raise InputTypeError(
        f"expected an estimator (an object with run(pixel, seeds), or a function of these two) "
        f"but got subject={subject!r} (type={type(subject).__name__})"
    )
