"""The standard pixels: small populations, each of which stresses one thing, and files of a reader's own.

A pixel file is JSON::

    {"schema": "truemean-pixels/1", "name": "mine", "version": 1,
     "pixels": {"thin": {"law": [[0, "63/64"], [1, "1/64"]], "stresses": "optional: one line"}}}

``law`` lists values with their weights. A value is a number or ``[red, green, blue]``, of one kind throughout
a pixel. Every number is taken as written: an integer, a decimal or a string ``"p/q"``. The JSON Schema of it
is ``vectors/pixels.schema.json``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

from truemean.errors import InputError, SceneError, UnknownName
from truemean.oracle.exact import exact_weight, short_text
from truemean.oracle.pixel import Pixel, Value
from truemean.oracle.reading import check_keys, placed, read_json, read_list, read_number, read_value, read_whole
from truemean.oracle.scene import SCHEMA as SCENE_SCHEMA
from truemean.oracle.scene import load_scene

__all__ = ["SETS", "PixelSet", "StandardPixel", "load_pixels", "pixel_by_name", "standard_pixels"]

SCHEMA = "truemean-pixels/1"
VECTORS = Path(__file__).parent / "vectors"
NAME = re.compile(r"[^\s:*=]+")
SCENES = {  # version 1 of the set of that name
    "isolated-pixel": "a small bright feature in a dark image",
    "slanted-edge": "an edge a few degrees off the vertical",
    "checker": "a checker board out of step with the pixels",
    "wedge": "a wedge that narrows to a point",
}


@dataclass(frozen=True, slots=True)
class StandardPixel:
    """A pixel and one line on what it stresses."""

    pixel: Pixel
    stresses: str = ""


@dataclass(frozen=True, eq=False)
class PixelSet(Mapping[str, StandardPixel]):
    """Pixels by name, in the order of their file; a set whose pixels change gets another version.

    >>> SETS["hard"].version, SETS["hard"]["negative"].pixel.mean
    (1, Fraction(1, 4))
    """

    name: str
    version: int
    members: Mapping[str, StandardPixel]

    def __getitem__(self, name: str) -> StandardPixel:
        return self.members[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.members)

    def __len__(self) -> int:
        return len(self.members)

    def pixels(self) -> dict[str, Pixel]:
        """The pixels X alone, name -> Pixel."""
        return {name: standard.pixel for name, standard in self.items()}

    @classmethod
    def from_dict(cls, data: Any) -> PixelSet:
        """The set that plain data describe, in the form of a pixel file; SceneError names the place of a fault."""
        if isinstance(data, Mapping) and data.get("schema") == SCENE_SCHEMA:
            raise SceneError(f"schema={SCENE_SCHEMA!r} is a scene: its pixels are written FILE#x,y, such as tile#4,0")
        check_keys(data, "file", ("schema", "name", "version", "pixels"), ("$schema",))
        if data["schema"] != SCHEMA:
            raise SceneError(f"schema={data['schema']!r:.80} can't be read: write {SCHEMA!r}")
        described = data["pixels"]
        if not isinstance(described, Mapping) or not described:
            raise SceneError(f'pixels={described!r:.80} holds no pixel: write {{"name": {{"law": [[value, weight]]}}}}')
        members = {_read_name(name, "name of a pixel"): _read_pixel(raw, name) for name, raw in described.items()}
        version = read_whole(data["version"], "version", ", such as 1")
        return cls(_read_name(data["name"], "name"), version, MappingProxyType(members))


@dataclass(frozen=True, eq=False)
class _Sets(Mapping[str, PixelSet]):
    """The sets that come with truemean, each read when first looked at."""

    names: tuple[str, ...]

    def __getitem__(self, name: str) -> PixelSet:
        if name not in self.names:
            raise UnknownName("set of pixels", str(name), self.names)
        return _shipped_set(name)

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)


SETS: Mapping[str, PixelSet] = _Sets(("standard", "hard", "scenes"))


def standard_pixels(name: str = "standard") -> dict[str, Pixel]:
    """The pixels X of a set, ``"standard"``, ``"hard"`` or ``"scenes"``: name -> Pixel; UnknownName for any other.

    >>> standard_pixels("hard")["rare-bright"].mean
    Fraction(1, 1)
    """
    return SETS[name].pixels()


def load_pixels(path: str | Path) -> dict[str, Pixel]:
    """The pixels X of a file of one's own, name -> Pixel, for `judge`.

    SceneError names the file, the pixel, the place in it, the value there and the way out.

    >>> list(load_pixels(VECTORS / "hard.json"))[:3]
    ['offset', 'rare-bright', 'nearly-equal']
    """
    return _load_set(path).pixels()


def pixel_by_name(name: str) -> Pixel:
    """The pixel X called ``"set:name"`` or ``"FILE.json:name"``; UnknownName or InputError for any other.

    >>> pixel_by_name("standard:thin").mean, pixel_by_name("scenes:wedge#7,0").mean
    (Fraction(1, 64), Fraction(7, 7296))
    """
    file, of_file, short = name.partition(".json:")
    if of_file:
        where, pixels = f"{file}.json", load_pixels(f"{file}.json")
    else:
        where, colon, short = name.partition(":")
        if not colon:
            raise InputError(f"pixel={name!r} names no set: write 'standard:{name}' or 'hard:{name}'")
        pixels = standard_pixels(where)
    if short not in pixels:
        raise UnknownName(f"pixel of {where!r}" if of_file else f"pixel of the set {where!r}", short, pixels)
    return pixels[short]


@cache
def _shipped_set(name: str) -> PixelSet:
    return _scene_pixels() if name == "scenes" else _load_set(VECTORS / f"{name}.json")


def _scene_pixels() -> PixelSet:
    """The pixels of the geometric scenes that an edge crosses, the first of each law."""
    members: dict[str, StandardPixel] = {}
    for name, line in SCENES.items():
        shown = load_scene(name)
        laws: set[Any] = set()
        for (x, y), X in shown.pixels().items():
            law = frozenset(X.law.items())
            if len(law) > 1 and law not in laws:
                laws.add(law)
                stresses = f"{line}: it covers {short_text(1 - X.law[shown.background])}"
                members[f"{name}#{x},{y}"] = StandardPixel(X, stresses)
    return PixelSet("scenes", 1, MappingProxyType(members))


def _load_set(path: str | Path) -> PixelSet:
    example = VECTORS / "standard.json"
    data = read_json(Path(path), example, missing=f"give a pixel file such as {example}")
    with placed(path):
        return PixelSet.from_dict(data)


def _read_name(raw: Any, where: str) -> str:
    if not isinstance(raw, str) or not NAME.fullmatch(raw):
        raise SceneError(f"{where}={raw!r:.80} can't be a name: write a text without blanks, ':', '*' and '='")
    return raw


def _read_pixel(raw: Any, name: str) -> StandardPixel:
    with placed(f"pixel {name!r}"):
        check_keys(raw, "description", ("law",), ("stresses",))
        stresses = raw.get("stresses", "")
        if not isinstance(stresses, str) or not stresses.isprintable():
            raise SceneError(
                f"stresses={stresses!r:.80} is not one line: write what the pixel stresses, or leave it out"
            )
        return StandardPixel(Pixel(_read_law(raw["law"])), stresses)


def _read_law(raw: Any) -> dict[Value, Fraction]:
    law: dict[Value, Fraction] = {}
    for i, pair in enumerate(read_list(raw, "law", "a list of pairs [value, weight]")):
        written, weight = read_list(pair, f"law[{i}]", "a pair: write [value, weight]", 2)
        value, place = read_value(written, f"law[{i}][0]"), f"law[{i}][1]"
        first = next(iter(law), value)
        if isinstance(value, tuple) != isinstance(first, tuple):
            raise SceneError(
                f"law[{i}][0]={written!r:.80} beside law[0][0]={raw[0][0]!r:.80}: "
                "use numbers throughout or [red, green, blue] throughout"
            )
        law[value] = law.get(value, Fraction(0)) + exact_weight(read_number(weight, place), place)
    if not law:
        raise SceneError(f"law={raw!r} holds no value: write [[value, weight], ...], the weights summing to 1")
    return law
