"""Exact clipping against an independent method: Sutherland-Hodgman with inclusion and exclusion."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from itertools import combinations, permutations
from math import lcm

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from truemean.oracle.clipping import Box, Point, Window, edges_of, self_contact

Outline = Sequence[Point]


def points(*pairs: tuple[object, object]) -> tuple[Point, ...]:
    return tuple((Fraction(str(x)), Fraction(str(y))) for x, y in pairs)


def box(left: object, top: object, right: object, bottom: object) -> Box:
    return Box(*(Fraction(str(side)) for side in (left, top, right, bottom)))


def window(frame: Box, *polygons: Outline) -> Window:
    return Window(frame, tuple(edges_of(polygons))).clip(frame)


# -- the independent method -------------------------------------------------------------------


def turn(a: Point, b: Point, c: Point) -> Fraction:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def signed_area(outline: Outline) -> Fraction:
    pairs = zip(outline, [*outline[1:], *outline[:1]], strict=True)
    return sum((a[0] * b[1] - b[0] * a[1] for a, b in pairs), Fraction(0)) / 2


def common(subject: Outline, convex: Outline) -> list[Point]:
    """The part of a convex outline inside another of positive orientation, half-plane by half-plane."""
    part = list(subject)
    for a, b in zip(convex, [*convex[1:], *convex[:1]], strict=True):
        kept: list[Point] = []
        for p, q in zip(part, [*part[1:], *part[:1]], strict=True):
            dp, dq = turn(a, b, p), turn(a, b, q)
            if dp >= 0:
                kept.append(p)
            if dp * dq < 0:
                t = dp / (dp - dq)
                kept.append((p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])))
        part = kept
    return part


def corners(frame: Box) -> list[Point]:
    return [(frame.left, frame.top), (frame.right, frame.top), (frame.right, frame.bottom), (frame.left, frame.bottom)]


def seen_areas(frame: Box, convex: Sequence[Outline]) -> dict[int, Fraction]:
    """Area of each layer minus that under the layers in front, by inclusion and exclusion."""
    layers = [corners(frame), *convex]
    areas = {}
    for i, layer in enumerate(layers):
        front = layers[i + 1 :]
        total = Fraction(0)
        for size in range(len(front) + 1):
            for chosen in combinations(front, size):
                part = common(layer, corners(frame))
                for other in chosen:
                    part = common(part, other)
                total += (-1) ** size * signed_area(part)
        areas[i] = total
    return {i: area for i, area in areas.items() if area}


# -- strategies -------------------------------------------------------------------------------

numbers = st.builds(Fraction, st.integers(-12, 24), st.sampled_from([1, 2, 3, 5, 8]))
boxes = st.builds(
    lambda left, top, width, height: Box(left, top, left + width, top + height),
    *(st.builds(Fraction, st.integers(0, 6), st.sampled_from([1, 2])) for _ in range(2)),
    *(st.builds(Fraction, st.integers(1, 6), st.sampled_from([1, 2, 3])) for _ in range(2)),
)


def hull(cloud: Sequence[Point]) -> list[Point]:
    ordered = sorted(set(cloud))
    chains: list[list[Point]] = []
    for sweep in (ordered, ordered[::-1]):
        chain: list[Point] = []
        for p in sweep:
            while len(chain) > 1 and turn(chain[-2], chain[-1], p) <= 0:
                chain.pop()
            chain.append(p)
        chains.append(chain[:-1])
    return chains[0] + chains[1]


convex_polygons = (
    st.lists(st.tuples(numbers, numbers), min_size=3, max_size=7).map(hull).filter(lambda outline: len(outline) > 2)
)
intervals = st.sets(
    st.sampled_from([Fraction(p, q) for q in (1, 2, 3, 4) for p in range(q + 1)]), min_size=2, max_size=2
)
rectangles = st.tuples(intervals, intervals).map(
    lambda sides: Box(min(sides[0]), min(sides[1]), max(sides[0]), max(sides[1]))
)
DIRECTIONS = points((3, 0), (2, 2), (0, 3), (-2, 2), (-3, 0), (-2, -2), (0, -3), (2, -2))
stars = st.tuples(st.tuples(numbers, numbers), st.lists(st.integers(1, 9), min_size=8, max_size=8))


def star_outline(star: tuple[Point, list[int]]) -> list[Point]:
    (x, y), radii = star
    return [(x + r * dx / 3, y + r * dy / 3) for r, (dx, dy) in zip(radii, DIRECTIONS, strict=True)]


# -- areas ------------------------------------------------------------------------------------


@given(boxes, st.lists(convex_polygons, max_size=3))
def test_overlapping_convex_polygons_cover_what_inclusion_and_exclusion_says(
    frame: Box, polygons: list[list[Point]]
) -> None:
    assert window(frame, *polygons).areas() == seen_areas(frame, polygons)


@given(boxes, stars)
def test_a_concave_star_covers_the_sum_of_its_triangles(frame: Box, star: tuple[Point, list[int]]) -> None:
    outline = star_outline(star)
    triangles = [[star[0], a, b] for a, b in zip(outline, outline[1:] + outline[:1], strict=True)]
    expected = sum((signed_area(common(t, corners(frame))) for t in triangles), Fraction(0))
    assert window(frame, outline).areas().get(1, 0) == expected
    assert self_contact(outline) is None


@given(boxes, st.lists(stars.map(star_outline), max_size=3), st.lists(st.integers(0, 3), max_size=3))
def test_nested_clipping_changes_nothing(frame: Box, outlines: list[list[Point]], path: list[int]) -> None:
    nested = window(frame, *outlines)
    for quadrant in path:
        frame = frame.grid(2)[quadrant]
        nested = nested.clip(frame)
    assert nested.areas() == window(frame, *outlines).areas()
    assert sum(nested.areas().values()) == frame.area
    quarters = [nested.clip(quarter).areas() for quarter in frame.grid(2)]
    for layer in range(len(outlines) + 1):
        assert sum(quarter.get(layer, 0) for quarter in quarters) == nested.areas().get(layer, 0)


@pytest.mark.parametrize(
    ("polygons", "expected"),
    [
        ([], {0: 16}),
        ([points((0, 0), (4, 0), (4, 4), (0, 4))], {1: 16}),
        ([points((-9, -9), (9, -9), (9, 9), (-9, 9))], {1: 16}),
        ([points((5, 0), (7, 0), (7, 4))], {0: 16}),
        ([points((-3, 0), (0, 0), (0, 4), (-3, 4))], {0: 16}),
        ([points((0, 0), (4, 0), (4, 1), (1, 1), (1, 4), (0, 4))], {0: 9, 1: 7}),
        ([points((0, 0), (4, 4), (0, 4)), points((0, 0), (4, 0), (4, 4))], {1: 8, 2: 8}),
        ([points((1, 1), (2, 1), (2, 2)), points((0, 0), (3, 0), (3, 3), (0, 3))], {0: 7, 2: 9}),
        ([points((0, 0), (3, 0), (3, 3), (0, 3)), points((1, 1), (2, 1), (2, 2))], {0: 7, 1: "17/2", 2: "1/2"}),
        ([points((0, 0), (4, 4), (4, 0)), points((0, 4), (4, 0), (4, 4))], {0: 4, 1: 4, 2: 8}),
        ([points((0, 1), ("1/3", 0), ("1/3", 1))], {0: "95/6", 1: "1/6"}),
    ],
    ids=["empty", "exact", "around", "right", "left", "L", "shared side", "hidden", "in front", "crossing", "thirds"],
)
def test_areas_known_by_hand(polygons: list[Outline], expected: dict[int, object]) -> None:
    assert window(box(0, 0, 4, 4), *polygons).areas() == {i: Fraction(str(area)) for i, area in expected.items()}


def test_numbers_stay_rational_at_any_size() -> None:
    """A sliver of area 1e-60 beside an edge of slope 1e-30 is neither lost nor rounded."""
    tiny = Fraction(1, 10**30)
    sliver = [(Fraction(0), Fraction(0)), (Fraction(1), Fraction(0)), (Fraction(1), 2 * tiny)]
    mask = [(tiny, Fraction(0)), (Fraction(2), Fraction(0)), (Fraction(2), Fraction(1)), (tiny, Fraction(1))]
    assert window(box(0, 0, 1, 1), sliver, mask).areas() == {0: tiny - tiny**3, 1: tiny**3, 2: 1 - tiny}


# -- positions --------------------------------------------------------------------------------


@given(boxes, st.lists(convex_polygons, min_size=1, max_size=3), st.integers(0, 12), st.integers(0, 12))
def test_a_position_shows_the_topmost_polygon_around_it(
    frame: Box, polygons: list[list[Point]], i: int, j: int
) -> None:
    x, y = frame.point(Fraction(i, 13), Fraction(j, 13))
    around = []
    for layer, outline in enumerate(polygons, start=1):
        turns = [turn(a, b, (x, y)) for a, b in zip(outline, outline[1:] + outline[:1], strict=True)]
        assume(min(turns) != 0)
        if min(turns) > 0:
            around.append(layer)
    assert window(frame, *polygons).topmost(x, y) == max(around, default=0)


@given(st.lists(rectangles, min_size=1, max_size=3))
def test_positions_of_a_fine_grid_count_the_areas_of_rectangles(drawn: list[Box]) -> None:
    """Half-open boundaries: as many grid positions as the area says, sides on the grid included."""
    pixel = window(box(0, 0, 1, 1), *(corners(rectangle) for rectangle in drawn))
    steps = lcm(*(side.denominator for r in drawn for side in (r.left, r.top, r.right, r.bottom)))
    counted: dict[int, Fraction] = {}
    for i in range(steps):
        for j in range(steps):
            layer = pixel.topmost(Fraction(i, steps), Fraction(j, steps))
            counted[layer] = counted.get(layer, Fraction(0)) + Fraction(1, steps**2)
    assert counted == pixel.areas()


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_polygons_with_common_sides_share_no_position(order: tuple[int, ...]) -> None:
    """Three triangles that tile a square: every position belongs to the same one in any order."""
    square = points((0, 0), (6, 0), (6, 6), (0, 6))
    tiles = [points((0, 0), (6, 0), (2, 2)), points((6, 0), (6, 6), (0, 6), (2, 2)), points((0, 0), (2, 2), (0, 6))]
    here, shuffled = (
        window(box(0, 0, 6, 6), square, *tiles),
        window(box(0, 0, 6, 6), square, *(tiles[i] for i in order)),
    )
    for i in range(36):
        for j in range(36):
            x, y = Fraction(i, 6), Fraction(j, 6)
            assert order[shuffled.topmost(x, y) - 2] == here.topmost(x, y) - 2


def test_a_polygon_owns_its_left_and_upper_boundary_only() -> None:
    square = window(box(0, 0, 4, 4), points((1, 1), (3, 1), (3, 3), (1, 3)))
    owned = {(x, y): square.topmost(Fraction(x), Fraction(y)) for x in (1, 2, 3) for y in (1, 2, 3)}
    assert {position for position, layer in owned.items() if layer} == {(1, 1), (2, 1), (1, 2), (2, 2)}


# -- simple or not ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("vertices", "contact"),
    [
        (points((0, 0), (1, 0), (0, 1)), None),
        (points((0, 0), (1, 0), (2, 0), (0, 1)), None),
        (points((0, 0), (4, 0), (4, 4), (2, 1), (0, 4)), None),
        (points((0, 0), (1, 0), (2, 0)), (0, 2)),
        (points((0, 0), (2, 0), (1, 0), (1, 1)), (0, 1)),
        (points((0, 0), (2, 2), (2, 0), (0, 2)), (0, 2)),
        (points((0, 0), (4, 0), (4, 4), (2, 0), (0, 4)), (0, 2)),
        (points((0, 0), (4, 0), (4, 1), (2, 0), (3, 0), (0, 4)), (0, 2)),
    ],
    ids=["triangle", "straight angle", "concave", "flat", "folded", "bow tie", "vertex on a side", "side on a side"],
)
def test_a_simple_polygon_does_not_meet_itself(vertices: Outline, contact: tuple[int, int] | None) -> None:
    assert self_contact(vertices) == contact
