"""The pixel X: a finite population of values I_1..I_k with weights omega_1..omega_k."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, MutableMapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from truemean.errors import InputError, InputTypeError, NeedsScene, PlanError
from truemean.oracle.exact import exact_fraction, exact_number, exact_weight, short_text
from truemean.oracle.law import Law

__all__ = ["Geometry", "Pixel", "Value"]

Value = Fraction | tuple[Fraction, ...]


class Geometry(Protocol):
    """Where a pixel lies in a scene: what quadrants and point samples need."""

    def quadrants(self) -> tuple[Pixel, ...]:
        """The four quarters as pixels of area 1/4: top left, top right, bottom left, bottom right."""
        ...

    def at(self, x: Fraction, y: Fraction) -> Value:
        """The value seen at a position, ``x`` and ``y`` in [0, 1), ``y`` downwards."""
        ...


@dataclass(frozen=True, eq=False)
class Pixel:
    """A finite population: values with weights that sum to 1 (Kirk & Arvo 1991, section 3).

    ``law`` maps value (a number, or a tuple of numbers for colours) to weight (int, Fraction,
    ``"p/q"`` or decimal string). Raises InputError for weights that are negative or don't sum
    to 1, InputTypeError for a float weight.

    >>> X = Pixel({0: "7/8", 1: "1/8"})
    >>> X.mean, X.variance
    (Fraction(1, 8), Fraction(7, 64))
    """

    law: Mapping[Any, Any]
    area: Fraction = Fraction(1)
    regions: Mapping[str, Pixel] = field(default_factory=lambda: MappingProxyType({}))
    geometry: Geometry | None = None

    def __post_init__(self) -> None:
        merged = _read_law(self.law)
        object.__setattr__(self, "law", MappingProxyType(merged))
        object.__setattr__(self, "area", exact_weight(self.area, "area"))
        if isinstance(self.regions, MutableMapping):
            object.__setattr__(self, "regions", MappingProxyType(dict(self.regions)))

    # -- other ways to make one ---------------------------------------------------------------

    @classmethod
    def two(cls, weight: Any) -> Pixel:
        """Values 0 and 1, ``weight`` being that of 1: the paper's two-intensity pixel.

        >>> Pixel.two("1/8").weights
        (Fraction(7, 8), Fraction(1, 8))
        """
        white = exact_weight(weight, "weight of 1")
        if white > 1:
            raise InputError(f"weight of 1={weight!r} is more than 1: give the coverage of the value 1")
        return cls({0: 1 - white, 1: white})

    @classmethod
    def from_regions(cls, regions: Mapping[str, tuple[Any, Pixel]], geometry: Geometry | None = None) -> Pixel:
        """A pixel made of disjoint parts, ``name -> (area, part)``; areas sum to 1.

        >>> X = Pixel.from_regions({"R": ("1/4", Pixel.two(1)), "rest": ("3/4", Pixel.two(0))})
        >>> X.mean, X.regions["R"].area
        (Fraction(1, 4), Fraction(1, 4))
        """
        parts = {}
        for name, pair in regions.items():
            if not (isinstance(pair, tuple) and len(pair) == 2 and isinstance(pair[1], Pixel)):
                raise InputTypeError(f"region {name!r}={pair!r}: write ('area', Pixel(...))")
            parts[name] = pair[1].with_area(exact_weight(pair[0], f"area of region {name!r}"))
        total = sum((p.area for p in parts.values()), Fraction(0))
        if total != 1:
            raise InputError(f"the areas of regions {', '.join(map(repr, parts))} sum to {total}, not to 1")
        law: dict[Any, Fraction] = {}
        for part in parts.values():
            for value, weight in part.law.items():
                law[value] = law.get(value, Fraction(0)) + part.area * weight
        return cls(law, regions=parts, geometry=geometry)

    def with_area(self, area: Any) -> Pixel:
        """The same population as a part of the given area of a larger one."""
        return Pixel(self.law, exact_weight(area, "area"), self.regions, self.geometry)

    # -- the population ----------------------------------------------------------------------

    @cached_property
    def values(self) -> tuple[Value, ...]:
        """I_1..I_k in declared order, equal ones merged."""
        return tuple(self.law)

    @cached_property
    def weights(self) -> tuple[Fraction, ...]:
        """omega_1..omega_k, in the order of ``values``."""
        return tuple(self.law.values())

    @property
    def channels(self) -> int | None:
        """Number of channels of a colour, None for scalar values."""
        first = self.values[0]
        return len(first) if isinstance(first, tuple) else None

    @cached_property
    def mean(self) -> Value:
        """The true mean I (Eq. 1), by channel for colours."""
        mean: Value = self._by_channel(lambda values: _dot(self.weights, values))
        return mean

    @cached_property
    def variance(self) -> Value:
        """Sum of omega_i (I_i - I)^2, by channel for colours."""

        def channel(values: tuple[Fraction, ...]) -> Fraction:
            mean = _dot(self.weights, values)
            return _dot(self.weights, tuple((v - mean) ** 2 for v in values))

        variance: Value = self._by_channel(channel)
        return variance

    @cached_property
    def scale(self) -> Fraction:
        """Largest value minus smallest, over all channels; 1 for a constant pixel."""
        flat = [v for value in self.values for v in (value if isinstance(value, tuple) else (value,))]
        return (max(flat) - min(flat)) or Fraction(1)

    @cached_property
    def one_draw(self) -> Law:
        """The law of one draw, as the engine uses it."""
        return Law([v if isinstance(v, tuple) else (v,) for v in self.values], self.weights)

    def arrays(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """``(values [k] or [k, channels], weights [k])`` in float64."""
        return np.array(self.values, dtype=float), np.array(self.weights, dtype=float)

    # -- its parts ---------------------------------------------------------------------------

    def split(self, area: Any) -> tuple[Pixel, Pixel]:
        """Two scattered parts of areas ``area`` and ``1 - area``, each with X's own law.

        >>> R, rest = Pixel.two("1/8").split("1/4")
        >>> R.area, rest.area, R.mean == rest.mean
        (Fraction(1, 4), Fraction(3, 4), True)
        """
        part = exact_fraction(area, "area")
        return self.with_area(part), self.with_area(1 - part)

    def quadrants(self) -> tuple[Pixel, ...]:
        """The four quarters of a pixel of a scene, each of area 1/4; NeedsScene without geometry."""
        return self._placed("quadrants()").quadrants()

    def at(self, x: Any, y: Any) -> Value:
        """The value seen at a position of the pixel, ``x`` and ``y`` in [0, 1), ``y`` downwards."""
        return self._placed("at()").at(exact_number(x, "x"), exact_number(y, "y"))

    def draw(self, n: Any) -> Any:
        """Only plans draw, while they are derived or simulated: PlanError."""
        raise PlanError(f"X.draw({n!r}) outside a derivation: call derive(plan, X) or simulate(plan, X)")

    def __repr__(self) -> str:
        law = ", ".join(f"{_text(value)}: {short_text(weight)}" for value, weight in self.law.items())
        return f"Pixel({{{law}}})"

    def _placed(self, asked: str) -> Geometry:
        if self.geometry is None:
            raise NeedsScene(f"{asked} needs a scene: {self!r} has no geometry; take a pixel of a scene file")
        return self.geometry

    def _by_channel(self, function: Any) -> Any:
        if self.channels is None:
            return function(self.values)
        return tuple(function(column) for column in zip(*self.values, strict=True))


def _read_law(law: Mapping[Any, Any]) -> dict[Value, Fraction]:
    if not isinstance(law, Mapping):
        raise InputTypeError(f"expected a mapping value -> weight but got {law!r} (type={type(law).__name__})")
    merged: dict[Value, Fraction] = {}
    for raw, weight in law.items():
        value = _read_value(raw)
        merged[value] = merged.get(value, Fraction(0)) + exact_weight(weight, f"weight of {_text(value)}")
    if not merged:
        raise InputError("a pixel needs at least one value: write Pixel({0: '7/8', 1: '1/8'})")
    if len({len(v) if isinstance(v, tuple) else 0 for v in merged}) > 1:
        raise InputError(
            f"values {', '.join(map(_text, merged))} mix scalars and colours, or colours of different lengths"
        )
    total = sum(merged.values())
    if total != 1:
        way_out = f"add the missing {1 - total}" if total < 1 else f"take away {total - 1}"
        raise InputError(
            f"weights {', '.join(map(str, merged.values()))} sum to {total}, not to 1: {way_out}, or scale them"
        )
    return merged


def _read_value(raw: Any) -> Value:
    if isinstance(raw, tuple):
        if not raw:
            raise InputError("value=() has no channels: a colour is a tuple of numbers such as (1, 0, 0)")
        return tuple(exact_number(channel, "value") for channel in raw)
    return exact_number(raw, "value")


def _dot(weights: Iterable[Fraction], values: Iterable[Fraction]) -> Fraction:
    return sum((w * v for w, v in zip(weights, values, strict=True)), Fraction(0))


def _text(value: Value) -> str:
    return f"({', '.join(map(short_text, value))})" if isinstance(value, tuple) else short_text(value)
