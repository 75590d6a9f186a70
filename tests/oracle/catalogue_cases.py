"""Pixels and parameters on which every plan of the catalogue is tried."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import pytest

from truemean.oracle import Pixel
from truemean.oracle.scene import load_scene

COVERAGES = ("1/64", "1/8", "1/2", "7/8", "63/64")
FEW = {f"white on {w}": Pixel.two(w) for w in COVERAGES} | {
    "three tones": Pixel({0: "1/2", "1/2": "1/4", 1: "1/4"}),
    "signed": Pixel({"-5/3": "2/7", 0: "4/7", "9/4": "1/7"}),
    "rare bright": Pixel({0: "999/1000", 1000: "1/1000"}),
    "offset": Pixel({10**8: "7/8", 10**8 + 1: "1/8"}),
    "constant": Pixel({"3/8": 1}),
    "never drawn": Pixel({0: "3/4", 1: "1/4", 5: 0}),
    "colours": Pixel({(1, 0, 0): "1/2", (0, "1/3", 0): "1/4", ("1/5", "1/5", "1/5"): "1/4"}),
    "two regions": Pixel.from_regions({"R": ("1/4", Pixel.two("1/8")), "rest": ("3/4", Pixel.two("1/2"))}),
}
MANY = {"eight tones": Pixel({Fraction(i, 7): Fraction(8 - i, 36) for i in range(8)})}
PLACED = {f"{name} {place}": load_scene(name).pixel(*place) for name, place in (("fig5", (18, 10)), ("tile", (4, 0)))}

PARAMS: dict[str, list[dict[str, Any]]] = {
    "kirk-arvo": [{}, {"n": 1}, {"n": 2, "eps": "1/2"}, {"n": 9, "eps": 2}],
    "kirk-arvo-unbiased": [{}, {"area": "2/3", "p": 2, "n1": 1, "n2": 3, "eps": "1/2"}],
    "discard-pilot": [{}, {"p": 2, "n1": 1, "n2": 3, "eps": "1/2"}],
    "two-stage-pooled": [{}, {"n": 2, "m": 1, "eps": "1/2"}, {"n": 3, "m": 40}],
    "fixed": [{}, {"n": 1}, {"n": 100}],
    "sequential": [{"most": 12}, {"start": 2, "step": 3, "most": 9, "eps": "1/5"}],
    "hierarchical": [{}, {"n": 2, "depth": 1}, {"n": 3, "depth": 3, "eps": "1/2"}],
    "centre-first": [{}, {"n": 2}, {"n": 17}],
    "centre-and-grid": [{}, {"grid": 1}, {"grid": 5}],
}
OF_A_SCENE = ("hierarchical", "centre-first", "centre-and-grid")


def pixels_of(name: str) -> dict[str, Pixel]:
    """The pixels that a plan is tried on."""
    if name in OF_A_SCENE:
        return PLACED
    return FEW | PLACED if name == "sequential" else FEW | PLACED | MANY


def cases(wanted: Callable[[str, str, Pixel], bool]) -> list[Any]:
    """Plan, parameters and pixel of every case whose plan, name of the pixel and pixel are wanted."""
    return [
        pytest.param(name, params, pixel, id=f"{name}-{number}-{short}")
        for name, sets in PARAMS.items()
        for number, params in enumerate(sets)
        for short, pixel in pixels_of(name).items()
        if wanted(name, short, pixel)
    ]
