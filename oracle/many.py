"""Many pixels: those of equal values are derived once and evaluated for all their weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truemean.errors import InputError
from truemean.oracle.derivation import derive
from truemean.oracle.pixel import Pixel, Value

__all__ = ["Many", "derive_many"]


@dataclass(frozen=True, slots=True)
class Many:
    """Results of `derive_many`: float64 arrays ``[pixels]`` or ``[pixels, channels]``."""

    groups: tuple[tuple[NDArray[np.int64], Any], ...]
    pixels: int

    @property
    def bias(self) -> NDArray[np.float64]:
        """E[xi] - I by pixel."""
        return self._gathered("bias")

    @property
    def expectation(self) -> NDArray[np.float64]:
        """E[xi] by pixel."""
        return self._gathered("expectation")

    @property
    def variance(self) -> NDArray[np.float64]:
        """E[(xi - E[xi])^2] by pixel."""
        return self._gathered("variance")

    @property
    def mse(self) -> NDArray[np.float64]:
        """E[(xi - I)^2] by pixel."""
        return self._gathered("mse")

    @property
    def cost(self) -> NDArray[np.float64]:
        """E[number of samples drawn] by pixel."""
        return self._gathered("cost")

    def _gathered(self, name: str) -> NDArray[np.float64]:
        parts = [np.stack(v, axis=-1) if isinstance(v := getattr(d, name), tuple) else v for _, d in self.groups]
        found = np.empty((self.pixels, *np.shape(parts[0])[1:]))
        for (places, _), part in zip(self.groups, parts, strict=True):
            found[places] = part
        return found


def derive_many(plan: Any, pixels: Sequence[Pixel], **params: Any) -> Many:
    """What a plan is worth on each of many pixels, in float64; one derivation per set of values.

    Raises PlanError for a plan that reads weights (its decisions then differ from pixel to pixel).

    >>> from truemean.oracle.plans import catalogue
    >>> derive_many(catalogue["kirk-arvo"], [Pixel.two("1/8"), Pixel.two("3/4")], n=4).bias.round(6)
    array([-0.073059,  0.076172])
    """
    if not pixels:
        raise InputError("pixels=[] is empty: give at least one pixel")
    if len({pixel.channels for pixel in pixels}) > 1:
        raise InputError("the pixels mix scalars and colours, or colours of different lengths: derive them apart")
    places: dict[frozenset[Value], list[int]] = {}
    for place, pixel in enumerate(pixels):
        places.setdefault(frozenset(pixel.values), []).append(place)
    groups = []
    for members in places.values():
        first = pixels[members[0]]
        weights = np.array([[float(pixels[place].law[value]) for place in members] for value in first.values])
        groups.append((np.array(members), derive(plan, Pixel(first.law), **params).at(weights)))
    return Many(tuple(groups), len(pixels))
