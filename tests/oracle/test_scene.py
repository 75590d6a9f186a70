"""Scenes: the shipped ones, pixels with regions and positions, the file format and its errors."""

from __future__ import annotations

import json
from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from truemean.errors import SceneError
from truemean.oracle.clipping import Box, Point, Window
from truemean.oracle.pixel import Pixel
from truemean.oracle.scene import Scene, load_scene, shipped_scenes

HALF = Fraction(1, 2)


def described(**changes: Any) -> dict[str, Any]:
    """A scene of one white triangle in 2x1 pixels, with changes."""
    triangle = {"value": 1, "vertices": [[0, 0], [2, 0], [0, "1/2"]]}
    return {"schema": "truemean-scene/1", "width": 2, "height": 1, "background": 0, "polygons": [triangle], **changes}


def polygon(vertices: Any, value: Any = 1) -> dict[str, Any]:
    return described(polygons=[{"value": value, "vertices": vertices}])


def grey(X: Pixel) -> Fraction:
    assert isinstance(X.mean, Fraction)
    return X.mean


def area(vertices: Sequence[Point]) -> Fraction:
    turns = (a[0] * b[1] - b[0] * a[1] for a, b in pairwise((*vertices, vertices[0])))
    return abs(sum(turns, Fraction(0))) / 2


# -- shipped scenes ---------------------------------------------------------------------------


def test_the_tile_is_covered_as_its_description_says() -> None:
    pixels = load_scene("tile").pixels()
    assert list(pixels) == [(x, y) for y in range(8) for x in range(8)]
    for (x, row), X in pixels.items():
        ramp = Fraction(2 * row + 1, 16)
        assert X.mean == {1: 1 - ramp, 2: 1, 3: 1, 4: ramp}.get(x, 0)
        assert X.values == ((0, 1) if x in (1, 4) else (X.mean,))


def test_fig5_shows_an_edge_and_a_thin_polygon_with_roping() -> None:
    scene = load_scene("fig5")
    assert (scene.width, scene.height) == (32, 32)
    pixels = scene.pixels()
    edge, thin = scene.polygons
    assert sum(grey(X) for X in pixels.values()) == area(edge.vertices) + area(thin.vertices)
    upper = [grey(X) for (_, y), X in pixels.items() if y < 16]
    lower = [grey(X) for (_, y), X in pixels.items() if y >= 16]
    assert 0 < max(upper) < 1
    assert sum(1 for mean in upper if mean) > 28
    assert {0, 1} < set(lower)
    assert len({mean for mean in lower if 0 < mean < 1}) > 28
    assert "paper doesn't give the vertices" in scene.comment


@pytest.mark.parametrize("name", shipped_scenes())
def test_a_shipped_scene_is_its_file_again(name: str) -> None:
    scene = load_scene(name)
    assert load_scene(shipped_scenes()[name]).pixels().keys() == scene.pixels().keys()
    assert scene.to_dict() == json.loads(shipped_scenes()[name].read_text(encoding="utf-8"))


# -- pixels -----------------------------------------------------------------------------------

coordinates = st.builds(Fraction, st.integers(-4, 12), st.sampled_from([1, 2, 3, 5]))
triangles = st.lists(st.tuples(coordinates, coordinates), min_size=3, max_size=3, unique=True).filter(
    lambda triangle: area(triangle) > 0
)


@given(st.lists(st.tuples(triangles, st.integers(0, 2)), max_size=3), st.lists(st.integers(0, 3), max_size=3))
def test_a_pixel_is_the_mixture_of_its_quadrants_at_every_depth(
    drawn: list[tuple[list[Point], int]], path: list[int]
) -> None:
    polygons = [{"value": value, "vertices": [list(map(str, vertex)) for vertex in t]} for t, value in drawn]
    scene = Scene.from_dict(described(polygons=polygons))
    X = scene.pixel(1, 0)
    for quadrant in path:
        X = X.quadrants()[quadrant]
    whole = Pixel.from_regions({name: (part.area, part) for name, part in X.regions.items()})
    assert list(X.regions) == ["top left", "top right", "bottom left", "bottom right"]
    assert tuple(X.regions.values()) == X.quadrants()
    assert [part.area for part in X.quadrants()] == [Fraction(1, 4)] * 4
    assert dict(whole.law) == dict(X.law)


@given(st.lists(st.tuples(triangles, st.integers(0, 2)), max_size=3), st.integers(1, 5))
def test_a_pixel_is_the_mixture_of_the_cells_of_every_grid(drawn: list[tuple[list[Point], int]], n: int) -> None:
    polygons = [{"value": value, "vertices": [list(map(str, vertex)) for vertex in t]} for t, value in drawn]
    X = Scene.from_dict(described(polygons=polygons)).pixel(1, 0)
    cells = X.grid(n)
    assert [cell.area for cell in cells] == [Fraction(1, n * n)] * n**2
    mixed = Pixel.from_regions({f"{i}": (cell.area, cell) for i, cell in enumerate(cells)})
    assert dict(mixed.law) == dict(X.law)
    assert X.grid(n) == cells
    assert X.grid(2) == X.quadrants()


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_the_cells_of_a_grid_come_row_by_row(n: int) -> None:
    squares = [
        {"value": 1 + i + n * j, "vertices": [[x, y], [x + side, y], [x + side, y + side], [x, y + side]]}
        for side in [Fraction(1, n)]
        for j in range(n)
        for i in range(n)
        for x, y in [(i * side, j * side)]
    ]
    X = Scene.from_dict(described(polygons=squares)).pixel(0, 0)
    assert [cell.values for cell in X.grid(n)] == [(i,) for i in range(1, n * n + 1)]
    fine = Scene.from_dict(described(polygons=squares)).pixel(0, 0).grid(2 * n)
    nested = [part.mean for cell in X.grid(n) for part in cell.grid(2)]
    assert sorted(cell.mean for cell in fine) == sorted(nested)


@given(st.lists(triangles, max_size=3), st.integers(0, 15), st.integers(0, 15))
def test_a_position_shows_the_same_value_in_a_pixel_and_in_its_quadrant(
    outlines: list[list[Point]], i: int, j: int
) -> None:
    polygons = [{"value": k, "vertices": t} for k, t in enumerate(outlines, start=1)]
    X = Scene.from_dict(described(polygons=polygons)).pixel(0, 0)
    x, y = Fraction(i, 16), Fraction(j, 16)
    quadrant = X.quadrants()[2 * (y >= HALF) + (x >= HALF)]
    assert X.at(x, y) == quadrant.at(2 * x % 1, 2 * y % 1)
    assert X.at(x, y) in {*X.values, *range(4)}


def test_quadrants_are_clipped_when_first_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    clipped: list[Box] = []
    clip = Window.clip

    def counting(window: Window, box: Box) -> Window:
        clipped.append(box)
        return clip(window, box)

    monkeypatch.setattr(Window, "clip", counting)
    part = load_scene("tile").pixel(4, 0).with_area(HALF)
    assert len(clipped) == 1
    assert part.regions["top left"].mean == Fraction(1, 16)
    assert part.quadrants()[2].mean == Fraction(3, 16)
    assert len(clipped) == 5


def test_equal_values_are_merged_and_hidden_ones_left_out() -> None:
    square = [[0, 0], [1, 0], [1, 1], [0, 1]]
    left, lower = [[0, 0], ["1/4", 0], ["1/4", 1], [0, 1]], [[0, "1/2"], [1, "1/2"], [1, 1], [0, 1]]
    layers = [(5, square), (7, square), (0, left), (3, lower)]
    scene = Scene.from_dict(described(polygons=[{"value": v, "vertices": o} for v, o in layers]))
    assert dict(scene.pixel(0, 0).law) == {7: Fraction(3, 8), 0: Fraction(1, 8), 3: HALF}
    assert list(scene.pixel(0, 0).values) == [7, 0, 3]
    assert dict(scene.pixel(1, 0).law) == {0: 1}


def test_colours_and_decimals_are_exact() -> None:
    text = json.dumps(polygon([[0, 0], [0.1, 0], [0.1, 1], [0, 1]], value=[1, 0, 0.3]) | {"background": [0, 0, 0]})
    scene = Scene.from_dict(json.loads(text, parse_float=str))
    assert dict(scene.pixel(0, 0).law) == {(0, 0, 0): Fraction(9, 10), (1, 0, Fraction(3, 10)): Fraction(1, 10)}


def test_plain_data_make_the_scene_again() -> None:
    scene = Scene.from_dict(described(background=["1/3", 0, 1], polygons=[]) | {"comment": "red"}, "mine")
    again = Scene.from_dict(json.loads(json.dumps(scene.to_dict())), "mine")
    assert again == scene
    assert again.comment == "red"


# -- files and errors -------------------------------------------------------------------------


def test_a_file_is_read_under_its_own_name(tmp_path: Path) -> None:
    file = tmp_path / "half.json"
    file.write_text(json.dumps(polygon([[0, 0], [1.5, 0], [1.5, 1], [0, 1]])), encoding="utf-8")
    scene = load_scene(str(file))
    assert scene.name == "half"
    assert scene.pixel(1, 0).mean == HALF


SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1]]
FAULTS: dict[str, tuple[Any, tuple[str, ...]]] = {
    "not JSON": ("{", ("is not JSON", "line 1", "scene_tile.json")),
    "deep": ("[" * 100_000, ("is not JSON", "scene_tile.json")),
    "no object": ([1], ("scene=[1]", "not an object", "width")),
    "missing key": ({"schema": "truemean-scene/1", "width": 2}, ("scene=", "no 'height'", "background")),
    "unknown key": (described(heigth=1), ("scene:", "'heigth'", "did you mean height")),
    "other schema": (described(schema="truemean-scene/9"), ("schema='truemean-scene/9'", "truemean-scene/1")),
    "size of text": (described(width="two"), ("width='two'", "positive whole number")),
    "no pixels": (described(height=0), ("height=0", "positive whole number")),
    "truth": (described(width=True), ("width=True", "positive whole number")),
    "NaN": (described(background=float("nan")), ("background='NaN'", "write an integer, 'p/q'")),
    "1/0": (described(background="1/0"), ("background='1/0'", "write an integer, 'p/q'")),
    "null": (described(background=None), ("background=None", "write an integer, 'p/q'")),
    "true": (polygon(SQUARE, True), ("polygons[0].value=True", "write an integer, 'p/q'")),
    "two channels": (described(background=[1, 0]), ("background=[1, 0]", "[red, green, blue]")),
    "bad channel": (described(background=[1, 0, "x"]), ("background[2]='x'", "write an integer, 'p/q'")),
    "mixed kinds": (polygon(SQUARE, [1, 0, 0]), ("polygons[0].value=[1, 0, 0]", "background=0", "throughout")),
    "no list": (described(polygons=7), ("polygons=7", "list of polygons")),
    "no polygon": (described(polygons=[7]), ("polygons[0]=7", "not an object", "vertices")),
    "polygon's key": (
        described(polygons=[{"value": 1, "vertexes": SQUARE}]),
        ("polygons[0]:", "'vertexes'", "did you mean vertices"),
    ),
    "no vertices": (polygon("abc"), ("polygons[0].vertices='abc'", "list of vertices")),
    "one number": (polygon([[0, 0], [1], [1, 1]]), ("polygons[0].vertices[1]=[1]", "[x, y]")),
    "three numbers": (polygon([[0, 0], [1, 2, 3], [1, 1]]), ("polygons[0].vertices[1]=[1, 2, 3]", "[x, y]")),
    "a vertex of text": (polygon([[0, 0], [1, "a"], [1, 1]]), ("polygons[0].vertices[1][1]='a'", "write an integer")),
    "two vertices": (polygon([[0, 0], [1, 1]]), ("polygons[0].vertices=[[0, 0], [1, 1]]", "at least 3")),
    "closed": (polygon([*SQUARE, [0, 0]]), ("polygons[0].vertices[4]=[0, 0]", "comes twice", "list it once")),
    "bow tie": (
        polygon([[0, 0], [1, 1], ["1/2", 0], [0, 1]]),
        ("polygons[0].vertices", "[0, 0] to [1, 1]", "['1/2', 0] to [0, 1]", "reorder"),
    ),
    "no area": (polygon([[0, 0], [1, 1], [2, 2]]), ("polygons[0].vertices", "[2, 2] to [0, 0]", "split")),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_an_unusable_file_is_named_with_place_value_and_way_out(fault: str, tmp_path: Path) -> None:
    content, fragments = FAULTS[fault]
    file = tmp_path / "scene.json"
    file.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    with pytest.raises(SceneError) as caught:
        load_scene(file)
    message = str(caught.value)
    assert message.startswith(f"{file}: ")
    assert [part for part in fragments if part not in message] == []
    assert "\n" not in message


def test_bytes_that_are_no_text_and_folders_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "scene.json"
    file.write_bytes(b"\xff\xfe\x00")
    for path in (file, tmp_path):
        with pytest.raises(SceneError, match=r"can't be read .*UTF-8"):
            load_scene(path)


def test_an_unknown_scene_is_answered_with_the_nearest_shipped_one() -> None:
    with pytest.raises(SceneError, match=r"no file is called 'fig55'; .*did you mean fig5\?"):
        load_scene("fig55")


def test_a_float_in_plain_data_is_refused() -> None:
    with pytest.raises(SceneError, match=r"polygons\[0\].vertices\[1\]\[0\]=0.1 is not an exact number"):
        Scene.from_dict(polygon([[0, 0], [0.1, 0], [0, 1]]))


@pytest.mark.parametrize(("x", "y"), [(-1, 0), (8, 0), (0, 8), (HALF, 0)])
def test_a_pixel_outside_the_image_is_refused(x: Any, y: Any) -> None:
    with pytest.raises(SceneError, match=rf"pixel \({x}, {y}\) .*'tile'.* x is 0 to 7, y 0 to 7"):
        load_scene("tile").pixel(x, y)


@pytest.mark.parametrize(("x", "y", "named"), [(1, 0, "x=1"), (0, "-1/2", "y=-1/2")])
def test_a_position_outside_the_pixel_is_refused(x: Any, y: Any, named: str) -> None:
    with pytest.raises(SceneError, match=f"{named} is outside the pixel"):
        load_scene("tile").pixel(4, 0).at(x, y)
