"""Exact coverage: which layer is seen in which part of a box, in rational numbers only.

Layer 0 is the background, layer i the i-th polygon, and a higher layer hides a lower one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain, combinations, pairwise

__all__ = ["Box", "Edge", "Point", "Window", "edges_of", "self_contact"]

Point = tuple[Fraction, Fraction]


@dataclass(frozen=True, slots=True)
class Box:
    """An axis-parallel rectangle, y downwards."""

    left: Fraction
    top: Fraction
    right: Fraction
    bottom: Fraction

    @property
    def area(self) -> Fraction:
        """Width times height."""
        return (self.right - self.left) * (self.bottom - self.top)

    def point(self, x: Fraction, y: Fraction) -> Point:
        """The position that lies at the fractions ``x`` and ``y`` of its width and height."""
        return self.left + x * (self.right - self.left), self.top + y * (self.bottom - self.top)

    def grid(self, n: int) -> tuple[Box, ...]:
        """The ``n`` x ``n`` equal boxes that it is cut into, row by row."""
        lines = [self.point(Fraction(i, n), Fraction(i, n)) for i in range(n + 1)]
        return tuple(
            Box(left, top, right, bottom)
            for (_, top), (_, bottom) in pairwise(lines)
            for (left, _), (right, _) in pairwise(lines)
        )


@dataclass(frozen=True, slots=True)
class Edge:
    """A part of the boundary of a layer, from its upper end to its lower one; never horizontal."""

    layer: int
    top: Point
    bottom: Point

    def x(self, y: Fraction) -> Fraction:
        """Where it crosses the horizontal line at ``y``."""
        (x0, y0), (x1, y1) = self.top, self.bottom
        return x0 if x0 == x1 else x0 + (x1 - x0) * (y - y0) / (y1 - y0)

    def within(self, top: Fraction, bottom: Fraction) -> Edge | None:
        """Its part between two horizontal lines, None if there is none."""
        upper, lower = max(self.top[1], top), min(self.bottom[1], bottom)
        return Edge(self.layer, (self.x(upper), upper), (self.x(lower), lower)) if upper < lower else None

    def crossing(self, other: Edge) -> Fraction | None:
        """The y at which two edges change sides, None if they don't."""
        upper, lower = max(self.top[1], other.top[1]), min(self.bottom[1], other.bottom[1])
        if upper >= lower:
            return None
        before, after = self.x(upper) - other.x(upper), self.x(lower) - other.x(lower)
        return upper + (lower - upper) * before / (before - after) if before * after < 0 else None


@dataclass(frozen=True, slots=True)
class Window:
    """A box and the edges that decide which layer is seen in it."""

    box: Box
    edges: tuple[Edge, ...]

    def clip(self, box: Box) -> Window:
        """The window of a smaller box; edges to its left are kept, for they tell inside from outside."""
        parts = (edge.within(box.top, box.bottom) for edge in self.edges)
        return Window(box, tuple(p for p in parts if p and min(p.top[0], p.bottom[0]) < box.right))

    def topmost(self, x: Fraction, y: Fraction) -> int:
        """The topmost layer at a position of the box.

        A layer is there when an odd number of its edges lie to the left of the position or on it; an edge has
        its upper end but not its lower one. So a polygon owns its left and upper boundary only, and two
        polygons with a common side neither share a position of it nor leave one out.
        """
        inside: set[int] = set()
        for edge in self.edges:
            if edge.top[1] <= y < edge.bottom[1] and edge.x(y) <= x:
                inside ^= {edge.layer}
        return max(inside, default=0)

    def areas(self) -> dict[int, Fraction]:
        """Area of the box in which each layer is seen, lowest layer first; unseen layers are left out."""
        areas: dict[int, Fraction] = {}
        # Cut the box into slabs in which no edge ends or crosses another edge or a side of the box.
        for top, bottom in pairwise(self._cuts()):
            # Cut the slab at its edges into trapezoids: area is height times width at middle height.
            y = (top + bottom) / 2
            inner = (edge.x(y) for edge in self.edges if edge.top[1] < y < edge.bottom[1])
            xs = sorted({self.box.left, self.box.right, *(x for x in inner if self.box.left < x < self.box.right)})
            for left, right in pairwise(xs):
                layer = self.topmost((left + right) / 2, y)
                areas[layer] = areas.get(layer, Fraction(0)) + (right - left) * (bottom - top)
        return dict(sorted(areas.items()))

    def _cuts(self) -> list[Fraction]:
        box = self.box
        sides = [Edge(0, (x, box.top), (x, box.bottom)) for x in (box.left, box.right)]
        seen = [edge for edge in self.edges if max(edge.top[0], edge.bottom[0]) > box.left]
        crossings = (a.crossing(b) for a, b in combinations(seen + sides, 2))
        ends = chain.from_iterable((edge.top[1], edge.bottom[1]) for edge in self.edges)
        return sorted({box.top, box.bottom, *ends, *(y for y in crossings if y is not None)})


def edges_of(polygons: Iterable[Sequence[Point]]) -> Iterator[Edge]:
    """The edges of polygons given from back to front; the i-th polygon, counted from 1, is layer i."""
    for layer, vertices in enumerate(polygons, start=1):
        for a, b in _sides(vertices):
            if a[1] != b[1]:
                yield Edge(layer, *sorted((a, b), key=lambda vertex: vertex[1]))


def self_contact(vertices: Sequence[Point]) -> tuple[int, int] | None:
    """Two sides of a polygon that meet elsewhere than at a common end, None if it is simple.

    Side i joins vertex i to the next one. Vertices must be distinct.

    >>> bow_tie = [(0, 0), (2, 2), (2, 0), (0, 2)]
    >>> self_contact([(Fraction(x), Fraction(y)) for x, y in bow_tie])
    (0, 2)
    """
    sides = list(_sides(vertices))
    for (i, (a, b)), (j, (c, d)) in combinations(enumerate(sides), 2):
        if b == c or d == a:
            corner, end, other = (b, a, d) if b == c else (a, b, c)
            folded = _turn(corner, end, other) == 0 and _dot(corner, end, other) > 0
        else:
            folded = _meet(a, b, c, d)
        if folded:
            return i, j
    return None


def _sides(vertices: Sequence[Point]) -> Iterator[tuple[Point, Point]]:
    return pairwise((*vertices, vertices[0]))


def _turn(a: Point, b: Point, c: Point) -> Fraction:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _dot(a: Point, b: Point, c: Point) -> Fraction:
    return (b[0] - a[0]) * (c[0] - a[0]) + (b[1] - a[1]) * (c[1] - a[1])


def _meet(a: Point, b: Point, c: Point, d: Point) -> bool:
    apart = any(max(a[k], b[k]) < min(c[k], d[k]) or max(c[k], d[k]) < min(a[k], b[k]) for k in (0, 1))
    return not apart and _turn(a, b, c) * _turn(a, b, d) <= 0 and _turn(c, d, a) * _turn(c, d, b) <= 0
