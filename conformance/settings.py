"""The arguments of a judgement, read once: what is judged, on which pixels, and how strictly."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from fractions import Fraction
from numbers import Integral
from typing import Any

import numpy as np

from truemean.conformance.declared import Declaration, Declared, derive_declared, read_prediction
from truemean.conformance.evidence import METHODS
from truemean.conformance.openings import Levels
from truemean.conformance.pixels import standard_pixels
from truemean.conformance.replicates import attribute, blaming
from truemean.conformance.target import Target
from truemean.errors import InputError, InputTypeError, UnknownName
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
    """Tolerance, error rates, budget, seed, ..., checked; ``range`` and ``variance`` are those of all pixels, or None."""

    tolerance: Any
    alpha: float = 1e-2
    beta: float = 1e-2
    budget: int = 100_000
    seed: int = 0
    declaration: Declaration | None = None
    range: Any = None
    timeout: float | None = None
    variance: Any = None
    method: str = "focus"
    suspects: tuple[Declaration, ...] = field(default_factory=tuple)
    independent: bool = False

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise UnknownName("method", str(self.method), METHODS)
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
        plain = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("declaration", "suspects")}
        plan = self.declaration and {"plan": self.declaration.name, "params": self.declaration.params}
        suspects = tuple({"plan": suspect.name, "params": suspect.params} for suspect in self.suspects)
        return plain | {"tolerance": _shown(self.tolerance), "declares": plan, "suspects": suspects}

    def for_sums(self) -> Settings:
        """These settings where only sums of replicates are known: constant bets alone can be settled by them.

        The default method gives way to the mixture; InputError for another whose bets learn.
        """
        if self.method == "focus":
            return replace(self, method="mixture")
        if not METHODS[self.method].constant:
            fitting = ", ".join(name for name, method in METHODS.items() if method.constant)
            raise InputError(
                f"method={self.method!r} needs single estimates, and of these only sums are known: take one of {fitting}"
            )
        return self

    def declares(self, subject: Any) -> bool:
        """Whether anything is declared that the estimates are compared with."""
        return self.declaration is not None or attribute(subject, "predicts") is not None

    def alpha_biased(self, subject: Any) -> float:
        """The part of alpha that naming cases BIASED may use over the whole run, and combined evidence as well.

        Half of alpha goes to what is declared, if anything. The average of all evidence is there before any
        case can be named, so that both share one level; the evidence of independent pixels needs its own half.
        """
        part = self.alpha / 2 if self.declares(subject) else self.alpha
        return part / 2 if self.independent else part

    def levels(self, subject: Any, cases: int) -> Levels:
        """The error rates of one case of so many: each part of alpha is shared by them all."""
        return Levels(self.alpha_biased(subject) / cases, self.alpha / 2 / cases, self.beta, self.budget)

    def tolerance_on(self, name: str, pixel: Pixel) -> Fraction:
        """The tolerance on a pixel as a number: a percentage is of the pixel's scale."""
        given = self.tolerance
        if isinstance(given, Mapping):
            if name not in given and "*" not in given:
                raise InputError(
                    f"tolerance={_shown(given)} has none for pixel {name!r}: add it, or '*' for all others"
                )
            given = given.get(name, given.get("*"))
        text = given.strip() if isinstance(given, str) else ""
        if text.endswith("%"):
            tolerance: Fraction = exact_number(text[:-1], "tolerance") / 100 * pixel.scale
        else:
            tolerance = exact_number(given, "tolerance")
        if tolerance < 0:
            raise InputError(f"tolerance={given!r} is negative: give a number >= 0 or a percentage such as '1%'")
        return tolerance

    def check_tolerances(self, names: Sequence[str]) -> None:
        """UnknownName for a tolerance of a pixel that is not judged."""
        for name in self.tolerance if isinstance(self.tolerance, Mapping) else ():
            if name not in names and name != "*":
                raise UnknownName("pixel with a tolerance", str(name), names)

    def declared(self, subject: Any, chosen: Chosen) -> tuple[Declared, ...] | None:
        """What is declared of each channel of a pixel: by a plan, or else by the subject's own ``predicts(pixel)``."""
        if self.declaration is not None:
            return derive_declared(self.declaration, chosen.pixel)
        own = attribute(subject, "predicts")
        if own is None:
            return None
        with blaming("predicts(pixel)"):
            predicted = own(chosen.given)
        return read_prediction(predicted, chosen.pixel)

    def targets(self, subject: Any, chosen: Chosen) -> tuple[Target, ...]:
        """What is asked of each channel of a pixel."""
        pixel = chosen.pixel
        colours = [value if isinstance(value, tuple) else (value,) for value in pixel.values]
        means = pixel.mean if isinstance(pixel.mean, tuple) else (pixel.mean,)
        bounds = self._bounds(subject, chosen, len(means))
        rounding = exact_number(attribute(subject, "rounding") or ROUNDING, "rounding") * pixel.scale
        targets = []
        for channel, (column, mean) in enumerate(zip(zip(*colours, strict=True), means, strict=True)):
            ends = bounds[channel] if bounds else (min(column), max(column))
            largest = max(abs(end) for end in ends or (mean,))
            slack = max(rounding, ULPS * Fraction(float(np.spacing(float(largest)))))
            number = None if pixel.channels is None else channel
            deviation = None if ends else self._deviation(subject, chosen, channel)
            if ends and not ends[0] - slack <= mean <= ends[1] + slack:
                raise InputError(
                    f"range=({ends[0]}, {ends[1]}) of pixel {chosen.name!r} does not contain its true mean {mean}: "
                    "declare the range of the estimates, lo <= I <= hi"
                )
            tolerance = self.tolerance_on(chosen.name, pixel)
            targets.append(Target(chosen.name, number, mean, tolerance, ends, slack, deviation))
        return tuple(targets)

    def _bounds(self, subject: Any, chosen: Chosen, channels: int) -> list[tuple[Fraction, Fraction] | None] | None:
        """The declared range by channel, None for an infinite one; None where none is declared."""
        bounds = _own(subject, "range", chosen.given) if self.range is None else self.range
        if bounds is None:
            return None
        try:
            low, high = (np.broadcast_to(np.asarray(end, dtype=object), channels) for end in bounds)
        except (TypeError, ValueError):
            raise InputTypeError(f"range={bounds!r}: write (lo, hi), each a number or one number per channel") from None
        pairs = [_read_range(lo, hi) for lo, hi in zip(low, high, strict=True)]
        if any(pair and pair[0] > pair[1] for pair in pairs):
            raise InputError(f"range={bounds!r} is empty: write (lo, hi) with lo <= hi")
        return pairs

    def _deviation(self, subject: Any, chosen: Chosen, channel: int) -> Fraction:
        """The bound on the standard deviation of estimates without a range, rounded up."""
        bound = _own(subject, "variance", chosen.given) if self.variance is None else self.variance
        if bound is None:
            raise InputError(
                f"the estimates of pixel {chosen.name!r} have no finite range, and no number of replicates bounds the "
                "mean of those: declare a bound on their variance, variance=v, or a range (lo, hi)"
            )
        by_channel = list(bound) if isinstance(bound, tuple | list) else [bound] * chosen.channels
        if len(by_channel) != chosen.channels:
            raise InputError(
                f"variance={bound!r}: pixel {chosen.name!r} has {chosen.channels} channels, give one or as many"
            )
        variance = exact_number(by_channel[channel], "variance")
        if variance <= 0:
            raise InputError(f"variance={bound!r} is no bound: give a number > 0")
        return Fraction(math.nextafter(math.sqrt(variance), math.inf))


def _shown(tolerance: Any) -> Any:
    if isinstance(tolerance, Mapping):
        return {str(name): _shown(part) for name, part in tolerance.items()}
    return tolerance if isinstance(tolerance, str) else exact_number(tolerance, "tolerance")


def _read_range(low: Any, high: Any) -> tuple[Fraction, Fraction] | None:
    if any(_infinite(end) for end in (low, high)):
        return None
    return exact_number(low, "range"), exact_number(high, "range")


def _infinite(end: Any) -> bool:
    if isinstance(end, str):
        return end.strip().lstrip("+-") in ("inf", "infinity")
    return isinstance(end, float) and math.isinf(end)


def _own(subject: Any, name: str, given: Any) -> Any:
    own = attribute(subject, name)
    with blaming(f"{name}(pixel)"):
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
