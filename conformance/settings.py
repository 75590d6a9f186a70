"""The arguments of a judgement, read once: what is judged, on which pixels, and how strictly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from fractions import Fraction
from numbers import Integral
from typing import Any

import numpy as np

from truemean.conformance.declared import Declaration
from truemean.conformance.pixels import standard_pixels
from truemean.conformance.replicates import attribute, blaming
from truemean.conformance.target import Target
from truemean.conformance.trial import Levels
from truemean.errors import InputError, InputTypeError
from truemean.oracle.exact import exact_number
from truemean.oracle.pixel import Pixel

__all__ = ["Chosen", "Settings", "read_pixels"]

ROUNDING = Fraction(1, 10**9)
ULPS = 4


@dataclass(frozen=True, slots=True)
class Chosen:
    """A pixel to judge on: its name, what the estimator is given, and its exact law."""

    name: str
    given: Any
    pixel: Pixel

    @property
    def channels(self) -> int:
        """How many cases it makes."""
        return self.pixel.channels or 1


@dataclass(frozen=True, slots=True)
class Settings:
    """Tolerance, error rates, budget and seed, checked; ``range`` is that of all pixels, or None."""

    tolerance: Any
    alpha: float
    beta: float
    budget: int
    seed: int
    declaration: Declaration | None
    range: Any
    timeout: float | None

    def __post_init__(self) -> None:
        for name in ("alpha", "beta"):
            level = getattr(self, name)
            if not (isinstance(level, int | float) and 0 < level < 1):
                raise InputError(f"{name}={level!r} must lie strictly between 0 and 1, such as 0.01")
        for name, least in (("budget", 1), ("seed", 0)):
            count = getattr(self, name)
            if not isinstance(count, Integral) or isinstance(count, bool) or count < least:
                raise InputError(f"{name}={count!r} must be a whole number >= {least}")
        if self.timeout is not None and not (isinstance(self.timeout, int | float) and self.timeout > 0):
            raise InputError(f"timeout={self.timeout!r} must be a positive number of seconds, or None")

    def arguments(self) -> dict[str, Any]:
        """The arguments as they are reported."""
        plain = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "declaration"}
        tolerance = self.tolerance if isinstance(self.tolerance, str) else exact_number(self.tolerance)
        plan = self.declaration and {"plan": self.declaration.name, "params": self.declaration.params}
        return plain | {"tolerance": tolerance, "declares": plan}

    @property
    def alpha_biased(self) -> float:
        """The part of alpha that BIASED may use over the whole run; a declared plan takes the other half."""
        return self.alpha if self.declaration is None else self.alpha / 2

    def levels(self, cases: int) -> Levels:
        """The error rates of one case of so many: each part of alpha is shared by them all."""
        return Levels(self.alpha_biased / cases, self.alpha / 2 / cases, self.beta, self.budget)

    def tolerance_on(self, pixel: Pixel) -> Fraction:
        """The tolerance as a number: a percentage is of the pixel's scale."""
        text = self.tolerance.strip() if isinstance(self.tolerance, str) else ""
        if text.endswith("%"):
            tolerance: Fraction = exact_number(text[:-1], "tolerance") / 100 * pixel.scale
        else:
            tolerance = exact_number(self.tolerance, "tolerance")
        if tolerance < 0:
            raise InputError(
                f"tolerance={self.tolerance!r} is negative: give a number >= 0 or a percentage such as '1%'"
            )
        return tolerance

    def targets(self, subject: Any, chosen: Chosen) -> tuple[Target, ...]:
        """What is asked of each channel of a pixel."""
        pixel = chosen.pixel
        colours = [value if isinstance(value, tuple) else (value,) for value in pixel.values]
        means = pixel.mean if isinstance(pixel.mean, tuple) else (pixel.mean,)
        bounds = self._bounds(subject, chosen, len(means))
        rounding = exact_number(attribute(subject, "rounding") or ROUNDING, "rounding") * pixel.scale
        targets = []
        for channel, (column, mean) in enumerate(zip(zip(*colours, strict=True), means, strict=True)):
            low, high = bounds[channel] if bounds else (min(column), max(column))
            slack = max(rounding, ULPS * Fraction(float(np.spacing(float(max(abs(low), abs(high)))))))
            number = None if pixel.channels is None else channel
            targets.append(Target(chosen.name, number, mean, self.tolerance_on(pixel), low, high, slack))
        return tuple(targets)

    def _bounds(self, subject: Any, chosen: Chosen, channels: int) -> list[tuple[Fraction, Fraction]] | None:
        """The declared range by channel; None where none is declared."""
        bounds = _declared_range(subject, chosen.given) if self.range is None else self.range
        if bounds is None:
            return None
        try:
            low, high = (np.broadcast_to(np.asarray(end, dtype=object), channels) for end in bounds)
        except (TypeError, ValueError):
            raise InputTypeError(f"range={bounds!r}: write (lo, hi), each a number or one number per channel") from None
        pairs = [(exact_number(lo, "range"), exact_number(hi, "range")) for lo, hi in zip(low, high, strict=True)]
        if any(lo > hi for lo, hi in pairs):
            raise InputError(f"range={bounds!r} is empty: write (lo, hi) with lo <= hi")
        return pairs


def _declared_range(subject: Any, given: Any) -> Any:
    own = attribute(subject, "range")
    with blaming("range(pixel)"):
        return own and own(given)


def read_pixels(subject: Any, pixels: Any) -> list[Chosen]:
    """The pixels given, or those that the subject brings, or else the standard ones."""
    if pixels is None:
        own = attribute(subject, "pixels")
        with blaming("pixels()"):
            pixels = standard_pixels() if own is None else own()
    if isinstance(pixels, Pixel):
        pixels = {repr(pixels): pixels}
    if not isinstance(pixels, Mapping) or not pixels:
        raise InputTypeError(f"pixels={pixels!r}: give a mapping name -> Pixel, such as standard_pixels()")
    return [Chosen(str(name), given, _exact(str(name), given)) for name, given in pixels.items()]


def _exact(name: str, given: Any) -> Pixel:
    try:
        pixel = given if isinstance(given, Pixel) else Pixel(dict(zip(given.values, given.weights, strict=True)))
        pixel.arrays()
    except OverflowError:
        raise InputError(
            f"pixels[{name!r}] has a value beyond the floats that an estimator returns: scale it"
        ) from None
    except (AttributeError, TypeError) as why:
        raise InputTypeError(f"pixels[{name!r}]={given!r} (type={type(given).__name__}) is no Pixel: {why}") from why
    return pixel
