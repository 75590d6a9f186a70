"""Scenes of polygons with constant values, and their pixels as finite populations.

A scene file is JSON::

    {"schema": "truemean-scene/1", "width": 2, "height": 1, "background": 0,
     "polygons": [{"value": 1, "vertices": [["1/3", 0], [2, 0], [2, "0.5"]]}],
     "comment": "optional"}

x runs to the right and y downwards in units of pixels; pixel (x, y) is the square from (x, y) to
(x + 1, y + 1), under a box filter. A later polygon is in front of an earlier one. A value is a number or
``[red, green, blue]``, of one kind throughout. Every number is taken as written: an integer, a decimal or a
string ``"p/q"``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Any

from truemean.errors import SceneError, UnknownName
from truemean.oracle.clipping import Box, Point, Window, edges_of, self_contact
from truemean.oracle.pixel import Pixel, Value
from truemean.oracle.reading import check_keys, placed, read_json, read_list, read_number, read_value, read_whole

__all__ = ["Polygon", "Scene", "load_scene", "shipped_scenes"]

SCHEMA = "truemean-scene/1"
OF_PIXELS = " of pixels, such as 32"
QUARTERS = ("top left", "top right", "bottom left", "bottom right")


@dataclass(frozen=True, slots=True)
class Polygon:
    """A simple polygon of one value; it may be concave and may reach out of the image."""

    value: Value
    vertices: tuple[Point, ...]


@dataclass(frozen=True)
class Scene:
    """Polygons in front of each other over a background, seen as ``width`` x ``height`` square pixels.

    Made by `load_scene` or `Scene.from_dict`, which check it.

    >>> scene = load_scene("tile")
    >>> scene.pixel(4, 0)
    Pixel({0: 15/16, 1: 1/16})
    """

    name: str
    width: int
    height: int
    background: Value
    polygons: tuple[Polygon, ...]
    comment: str = ""

    @classmethod
    def from_dict(cls, data: Any, name: str = "scene") -> Scene:
        """The scene that plain data describe, in the form of a scene file; SceneError names the place of a fault."""
        check_keys(data, "scene", ("schema", "width", "height", "background", "polygons"), ("comment",))
        if data["schema"] != SCHEMA:
            raise SceneError(f"schema={data['schema']!r:.80} can't be read: write {SCHEMA!r}")
        background = read_value(data["background"], "background")
        polygons = read_list(data["polygons"], "polygons", "a list of polygons")
        return cls(
            name,
            read_whole(data["width"], "width", OF_PIXELS),
            read_whole(data["height"], "height", OF_PIXELS),
            background,
            tuple(_read_polygon(p, f"polygons[{i}]", background) for i, p in enumerate(polygons)),
            str(data.get("comment", "")),
        )

    def to_dict(self) -> dict[str, Any]:
        """The scene as plain data that JSON can hold: the inverse of `from_dict`, for adapters that build it."""
        return {
            "schema": SCHEMA,
            "width": self.width,
            "height": self.height,
            "background": _plain(self.background),
            "polygons": [
                {"value": _plain(p.value), "vertices": [_plain(vertex) for vertex in p.vertices]} for p in self.polygons
            ],
            "comment": self.comment,
        }

    def pixel(self, x: int, y: int) -> Pixel:
        """Pixel X in column ``x`` of row ``y``: the values seen in it with their exact coverages.

        It has geometry, and its regions are its four quadrants by name. SceneError outside the image.

        >>> X = load_scene("tile").pixel(4, 0)
        >>> X.regions["bottom left"].mean, X.at("0.01", "0.99")
        (Fraction(3, 16), Fraction(1, 1))
        """
        if x not in range(self.width) or y not in range(self.height):
            raise SceneError(
                f"pixel ({x}, {y}) is outside scene {self.name!r}: x is 0 to {self.width - 1}, y 0 to {self.height - 1}"
            )
        return self._place(self._window.clip(_square(x, y))).pixel()

    def pixels(self) -> dict[tuple[int, int], Pixel]:
        """All pixels by (column, row), row by row."""
        rows = (self._window.clip(Box(*map(Fraction, (0, y, self.width, y + 1)))) for y in range(self.height))
        return {
            (x, y): self._place(row.clip(_square(x, y))).pixel()
            for y, row in enumerate(rows)
            for x in range(self.width)
        }

    @cached_property
    def _window(self) -> Window:
        image = Box(*map(Fraction, (0, 0, self.width, self.height)))
        return Window(image, tuple(edges_of(p.vertices for p in self.polygons)))

    def _place(self, window: Window) -> _Place:
        return _Place(window, (self.background, *(p.value for p in self.polygons)))


@dataclass(frozen=True, eq=False)
class _Place:
    """Geometry of a pixel: its window on the scene, the value of each layer, and the grids asked for so far."""

    window: Window
    layers: tuple[Value, ...]
    grids: dict[int, tuple[Pixel, ...]] = field(default_factory=dict)

    def pixel(self, area: Fraction = Fraction(1)) -> Pixel:
        law: dict[Value, Fraction] = {}
        for layer, seen in self.window.areas().items():
            value = self.layers[layer]
            law[value] = law.get(value, Fraction(0)) + seen / self.window.box.area
        return Pixel(law, area, regions=_Quarters(self), geometry=self)

    def grid(self, n: int) -> tuple[Pixel, ...]:
        if n not in self.grids:
            places = (_Place(self.window.clip(box), self.layers) for box in self.window.box.grid(n))
            self.grids[n] = tuple(place.pixel(Fraction(1, n * n)) for place in places)
        return self.grids[n]

    def at(self, x: Fraction, y: Fraction) -> Value:
        for name, position in (("x", x), ("y", y)):
            if not 0 <= position < 1:
                raise SceneError(f"{name}={position} is outside the pixel: a position lies in [0, 1)")
        return self.layers[self.window.topmost(*self.window.box.point(x, y))]


@dataclass(frozen=True, slots=True, eq=False)
class _Quarters(Mapping[str, Pixel]):
    """The quadrants of a place as regions, clipped when first looked at."""

    place: _Place

    def __getitem__(self, name: str) -> Pixel:
        return dict(zip(QUARTERS, self.place.grid(2), strict=True))[name]

    def __iter__(self) -> Iterator[str]:
        return iter(QUARTERS)

    def __len__(self) -> int:
        return len(QUARTERS)


def shipped_scenes() -> dict[str, Path]:
    """The scenes that come with truemean, name -> file.

    >>> list(shipped_scenes())
    ['checker', 'fig5', 'isolated-pixel', 'slanted-edge', 'tile', 'wedge']
    """
    files = sorted(Path(__file__).parent.glob("scene_*.json"))
    return {file.stem.removeprefix("scene_"): file for file in files}


def load_scene(source: str | Path) -> Scene:
    """The scene in a JSON file, or the shipped one of that name.

    SceneError names the file, the place in it, the value there and the way out.

    >>> scene = load_scene("fig5")
    >>> scene.name, scene.width, scene.height
    ('fig5', 32, 32)
    """
    shipped = shipped_scenes()
    path = shipped[source] if isinstance(source, str) and source in shipped else Path(source)
    data = read_json(path, shipped["tile"], missing=str(UnknownName("scene", str(source), shipped)))
    with placed(path):
        return Scene.from_dict(data, str(source) if source in shipped else path.stem)


def _square(x: int, y: int) -> Box:
    return Box(*map(Fraction, (x, y, x + 1, y + 1)))


def _read_polygon(raw: Any, where: str, background: Value) -> Polygon:
    check_keys(raw, where, ("value", "vertices"))
    value = read_value(raw["value"], f"{where}.value")
    if isinstance(value, tuple) != isinstance(background, tuple):
        raise SceneError(
            f"{where}.value={raw['value']!r:.80} beside background={_plain(background)}: "
            "use numbers throughout or [red, green, blue] throughout"
        )
    return Polygon(value, _read_vertices(raw["vertices"], f"{where}.vertices"))


def _read_vertices(raw: Any, where: str) -> tuple[Point, ...]:
    listed = read_list(raw, where, "a list of vertices [x, y]")
    vertices = tuple(_read_vertex(vertex, f"{where}[{i}]") for i, vertex in enumerate(listed))
    if len(vertices) < 3:
        raise SceneError(f"{where}={raw!r:.80} are {len(vertices)}: a polygon needs at least 3")
    for i, vertex in enumerate(vertices):
        if vertex in vertices[:i]:
            raise SceneError(f"{where}[{i}]={_plain(vertex)} comes twice: list it once, the last side closes by itself")
    contact = self_contact(vertices)
    if contact:
        first, second = (f"{_plain(vertices[i])} to {_plain(vertices[(i + 1) % len(vertices)])}" for i in contact)
        raise SceneError(f"{where}: sides {first} and {second} meet: reorder the vertices or split the polygon")
    return vertices


def _read_vertex(raw: Any, where: str) -> Point:
    x, y = read_list(raw, where, "two numbers: write [x, y]", 2)
    return read_number(x, f"{where}[0]"), read_number(y, f"{where}[1]")


def _plain(number: Value) -> Any:
    if isinstance(number, tuple):
        return [_plain(part) for part in number]
    return int(number) if number.denominator == 1 else str(number)
