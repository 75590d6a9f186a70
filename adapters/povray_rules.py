"""What POV-Ray's rules make of a scene, exactly, under a uniform and independent jitter; `povray` says what the rules are."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from functools import cached_property
from itertools import combinations, product
from operator import add, mul
from typing import Any, NamedTuple

import numpy as np

from truemean.adapters.answers import Answers, Odds, odds_of
from truemean.adapters.exhaustive import by_sequences
from truemean.adapters.frames import Floats, SceneSubject
from truemean.adapters.registry import resolve
from truemean.errors import TooManyPaths

__all__ = ["Centre", "Law", "Method1", "Method2", "Value", "peak"]

CLIPPING = "truemean.oracle.clipping"
ENCODED = 1 / 2.5  # the power that POV-Ray's Antialias_Gamma stands for
HALF = Fraction(1, 2)
PATHS = 2**18  # of method 2, on a grid of 1 x 1; each takes longer the finer the grid
Value = Any  # a Fraction, or a tuple of three
Law = Mapping[Value, Fraction]
Amount = tuple[Any, ...]  # of the channels
Place = tuple[int, int]


class Centre:
    """Method 0, one sample at the centre, and what all rules share: exact values, seen from anywhere.

    In pixels, ``margin`` is how far a copy of the scene reaches beyond its frame, ``reach`` how far samples leave their pixel.
    """

    margin = reach = Fraction(0)

    def __init__(self, subject: SceneSubject, depth: int, threshold: float, jitter: float) -> None:
        scene = subject.scene
        self.pixels, self.places = subject.frame_pixels, subject.places
        self.frame = scene.width, scene.height
        self.depth, self.jitter, self.threshold = depth, Fraction(jitter), np.float32(threshold)
        self.values = [scene.background, *(polygon.value for polygon in scene.polygons)]
        self.colour = isinstance(scene.background, tuple)
        self.peak = peak(scene)
        box, edges = resolve(f"{CLIPPING}:Box"), resolve(f"{CLIPPING}:edges_of")
        self._differ: dict[tuple[Value, Value], bool] = {}
        self._box, whole = box, box(*map(Fraction, (0, 0, *self.frame)))
        self._window = resolve(f"{CLIPPING}:Window")(whole, tuple(edges(p.vertices for p in scene.polygons)))

    def at(self, x: Fraction, y: Fraction) -> Value:
        """The value seen at a position; beyond the frame and its margin, the background."""
        inside = all(-self.margin <= n < end + self.margin for n, end in zip((x, y), self.frame, strict=True))
        return self.values[self._window.topmost(x, y) if inside else 0]

    def near(self, x: Fraction, y: Fraction, side: Fraction) -> Law:
        """The chances of the values at a position that is uniform in a square around (x, y)."""
        if not side:
            return {self.at(x, y): Fraction(1)}
        window = self._window.clip(self._box(x - side / 2, y - side / 2, x + side / 2, y + side / 2))
        return _law((self.values[layer], area / side**2) for layer, area in window.areas().items())

    def reached(self, x: int, y: int) -> list[tuple[Fraction, ...]]:
        """By channel, the values in reach of the samples of a pixel."""
        seen = self.near(x + HALF, y + HALF, 1 + 2 * self.reach)
        return list(zip(*map(_parts, seen), strict=True))

    def centre(self, x: int, y: int) -> Value:
        """The value at the centre of a pixel."""
        return self.at(x + HALF, y + HALF)

    def differ(self, one: Value, other: Value) -> bool:
        """Whether POV-Ray finds two colours to differ."""
        if (one, other) not in self._differ:
            a, b = (np.array(self.shown(value), dtype=float) for value in (one, other))
            self._differ[one, other] = bool(self._apart(a, b))
        return self._differ[one, other]

    def shown(self, value: Value) -> tuple[Any, ...]:
        """Red, green and blue as they are rendered."""
        return tuple(part / self.peak for part in (value if self.colour else (value,) * 3))

    def _apart(self, one: Floats, other: Floats) -> Any:
        """The same for arrays ``[..., 3]``."""
        return np.abs(one**ENCODED - other**ENCODED).sum(axis=-1) >= self.threshold

    def predicts(self, x: int, y: int) -> dict[str, Any]:
        """Law and cost of a pixel."""
        return {"law": {self.centre(x, y): Fraction(1)}, "cost": 1}

    def costs(self, copies: Floats) -> Floats:
        """Samples ``[copies, height, width]`` of rendered copies ``[copies, height, width, 3]``."""
        return np.ones(copies.shape[:3])


class Method1(Centre):
    """Method 1: a pixel is supersampled where it differs from a neighbour, in reading order."""

    def __init__(self, subject: SceneSubject, depth: int, threshold: float, jitter: float) -> None:
        super().__init__(subject, depth, threshold, jitter)
        self._laws: dict[Place, Law] = {}

    def predicts(self, x: int, y: int) -> dict[str, Any]:
        """Supersampled for certain, never, or with the chance of the values that its neighbours may have.

        Numbers are None where two neighbours that it is compared with depend on the same third pixel.
        """
        chance = self.chance(x, y)
        if chance is None:
            return {"law": None, "cost": None}
        return {"law": self._mixed(x, y, chance), "cost": 1 + chance * self.depth**2}

    def chance(self, x: int, y: int) -> Fraction | None:
        """The chance that a pixel is supersampled, None where it is not worked out."""
        return Fraction(1) if self._differs_later(x, y) else self._own[x, y]

    def _differs_later(self, x: int, y: int) -> bool:
        """Whether the right or the lower pixel, when its turn comes, has this one supersampled."""
        here = self.centre(x, y)
        return any(self.differ(here, self.centre(*place)) for place in ((x + 1, y), (x, y + 1)))

    @cached_property
    def _own(self) -> dict[Place, Fraction | None]:
        """The chance that a pixel is supersampled at its own turn, None where it is not worked out."""
        own: dict[Place, Fraction | None] = {}
        for y, x in product(range(self.frame[1]), range(self.frame[0])):
            here = self.centre(x, y)
            left, above = (x - 1, y, own.get((x - 1, y))), (x, y - 1, own.get((x, y - 1)))
            if self.differ(self.centre(x, y - 1), self.centre(x + 1, y - 1)):
                above = x, y - 1, Fraction(1)
            apart = not (self._open(*left) and self._open(*above))
            own[x, y] = _either(self._chance(here, *left), self._chance(here, *above), independent=apart)
        return own

    def _open(self, x: int, y: int, chance: Fraction | None) -> bool:
        """Whether a value depends on more than the samples of its own pixel."""
        return not self._still(x, y) and chance not in (0, 1)

    def _still(self, x: int, y: int) -> bool:
        return (x, y) not in self.pixels or len(self.pixels[x, y].values) == 1

    def _chance(self, here: Value, x: int, y: int, chance: Fraction | None) -> Fraction | None:
        """The chance that ``here`` differs from a pixel that has been supersampled with a ``chance``."""
        if chance is None and not self._still(x, y):
            values = {*self._mixed(x, y, Fraction(0)), *self._mixed(x, y, Fraction(1))}
            differ = {self.differ(here, value) for value in values}
            return None if len(differ) > 1 else Fraction(differ.pop())
        law = self._mixed(x, y, Fraction(0) if chance is None else chance)
        return sum((p for value, p in law.items() if self.differ(here, value)), Fraction(0))

    def _mixed(self, x: int, y: int, chance: Fraction) -> Law:
        """The law of a pixel that is supersampled with a ``chance``."""
        here = self.centre(x, y)
        if self._still(x, y) or not chance:
            return {here: Fraction(1)}
        return _law([(here, 1 - chance), *((v, p * chance) for v, p in self._supersampled(x, y).items())])

    def _supersampled(self, x: int, y: int) -> Law:
        """The law of a pixel that is supersampled: that of the oracle's plan centre-and-grid, one cell after the other."""
        if (x, y) not in self._laws:
            geometry = self.pixels[x, y] if self.jitter == 1 else _Cells(self, x, y)
            law: Law = {self.centre(x, y): Fraction(1)}
            for cell in geometry.grid(self.depth):
                law = _law((_added(a, b), p * q) for a, p in law.items() for b, q in cell.law.items())
            share = Fraction(1, self.depth**2 + 1)
            self._laws[x, y] = {_scaled(value, share): p for value, p in law.items()}
        return self._laws[x, y]

    def costs(self, copies: Floats) -> Floats:
        """The decisions are taken again, from the values that were rendered."""
        height, width = copies.shape[1:3]
        rows, columns = range(-1, height + 1), range(-1, width + 1)
        centres = np.array([[self.shown(self.centre(x, y)) for x in columns] for y in rows], dtype=float)
        right, below = self._apart(centres[:, :-1], centres[:, 1:]), self._apart(centres[:-1], centres[1:])
        values = np.pad(copies, ((0, 0), (1, 0), (1, 0), (0, 0)))
        own = np.zeros(values.shape[:3], dtype=bool)
        for y, x in product(range(1, height + 1), range(1, width + 1)):
            left = np.where(own[:, y, x - 1, None], values[:, y, x - 1], centres[y, x - 1])
            top = np.where((own[:, y - 1, x] | right[y - 1, x])[:, None], values[:, y - 1, x], centres[y - 1, x])
            here = centres[y, x]
            own[:, y, x] = self._apart(left, here) | self._apart(top, here)
        own[:, 0] = own[:, :, 0] = False
        found: Floats = 1.0 + self.depth**2 * (own | right[:-1, :] | below[:, :-1])[:, 1:, 1:]
        return found


class _Cell(NamedTuple):
    """A part of a pixel."""

    law: Law


class _Cells:
    """Where the samples of a pixel may be, jittered in the middle of their cells."""

    def __init__(self, rule: Centre, x: int, y: int) -> None:
        self._rule, self._x, self._y = rule, x, y

    def grid(self, n: int) -> list[_Cell]:
        """The parts of the n x n cells, row by row."""
        middles = [Fraction(2 * i + 1, 2 * n) for i in range(n)]
        side = self._rule.jitter / n
        return [_Cell(self._rule.near(self._x + x, self._y + y, side)) for y, x in product(middles, repeat=2)]


class Method2(Centre):
    """Method 2: corners, and quarters where they differ."""

    margin = Fraction(1, 4)

    def __init__(self, subject: SceneSubject, depth: int, threshold: float, jitter: float) -> None:
        super().__init__(subject, depth, threshold, jitter)
        self.reach = self.jitter / (2 ** (depth + 1) + 2) + Fraction(1, 2**12)  # and what begins right at the corners

    def predicts(self, x: int, y: int) -> dict[str, Any]:
        """By all values of its samples; where that is too much, of those that a decision looks at."""
        for linear in (False, True):
            try:
                found = by_sequences(_Square(self, x, y, linear=linear), Answers(odds_of([1])), PATHS // 4**self.depth)
            except TooManyPaths:
                continue
            ends: list[tuple[Any, Fraction]] = list(found.law.items())
            law = [(parts[:-1] if self.colour else parts[0], p) for parts, p in ends]
            cost = _mean((parts[-1], p) for parts, p in ends)
            return {"mean": _mean(law), "cost": cost} if linear else {"law": _law(law), "cost": cost}
        return {"mean": None, "cost": None}

    def costs(self, copies: Floats) -> Floats:
        """What the rule says, at the places that are looked at, without jitter."""
        counts = np.full(copies.shape[:3], np.nan)
        for x, y in [] if self.jitter else self.places:
            counts[:, y, x] = self.predicts(x, y)["cost"]
        return counts


class _Seen(NamedTuple):
    """What a sample may see: values, the same as amounts that can be added up fast, their odds, and the mean amount."""

    values: list[Value]
    amounts: list[Amount]
    odds: Odds
    mean: Amount


class _Square:
    """One pixel of method 2, run once for each sequence of answers to what its samples see."""

    def __init__(self, rule: Method2, x: int, y: int, *, linear: bool) -> None:
        self._rule, self._x, self._y, self._linear = rule, x, y, linear
        self._size = 2 ** (rule.depth - 1)
        self._unit = math.lcm(*(part.denominator for value in rule.values for part in _parts(value)))
        self._seen: dict[Place, _Seen] = {}
        self._samples: dict[Place, tuple[Value, Amount]] = {}

    def __call__(self, answers: Answers) -> tuple[Fraction | int, ...]:
        """The channels of the estimate, and how many samples it took."""
        answers.start()
        self._samples.clear()
        for i, j in product((0, self._size), repeat=2):
            self._take(answers, i, j)
        total = self._part(answers, 0, 0, self._size, self._rule.depth - 1)
        return *(Fraction(part) / (4**self._rule.depth * self._unit) for part in total), len(self._samples)

    def _part(self, answers: Answers, i: int, j: int, size: int, level: int) -> Amount:
        """The sum over a square with its corner at (i, j), in units of the finest grid; of 4 at the last level."""
        corners = [self._samples[place] for place in product((i, i + size), (j, j + size))]
        if not level or not any(self._rule.differ(a, b) for (a, _), (b, _) in combinations(corners, 2)):
            return tuple(4**level * sum(parts) for parts in zip(*(amount for _, amount in corners), strict=True))
        half = size // 2
        for a, b in ((0, half), (half, 0), (size, half), (half, size), (half, half)):
            self._take(answers, i + a, j + b, last=level == 1)
        quarters = [self._part(answers, a, b, half, level - 1) for a, b in product((i, i + half), (j, j + half))]
        return tuple(map(sum, zip(*quarters, strict=True)))

    def _take(self, answers: Answers, i: int, j: int, *, last: bool = False) -> None:
        """What a sample sees; of the last ones, at which no decision looks, the mean if that will do."""
        if (i, j) in self._samples:
            return
        if (i, j) not in self._seen:
            self._seen[i, j] = self._look(i, j)
        seen = self._seen[i, j]
        if last and self._linear:
            self._samples[i, j] = None, seen.mean
        else:
            place = answers.ask(seen.odds) if len(seen.values) > 1 else 0
            self._samples[i, j] = seen.values[place], seen.amounts[place]

    def _look(self, i: int, j: int) -> _Seen:
        side = Fraction(0) if {i, j} <= {0, self._size} else self._rule.jitter / (2**self._rule.depth + 1)
        law = self._rule.near(self._x + Fraction(i, self._size), self._y + Fraction(j, self._size), side)
        amounts = [tuple(int(part * self._unit) for part in _parts(value)) for value in law]
        return _Seen(list(law), amounts, odds_of(list(law.values())), _mean(zip(amounts, law.values(), strict=True)))


def peak(scene: Any) -> Fraction:
    """What is rendered as 1: the largest value of a scene where that is above 1."""
    values = [scene.background, *(polygon.value for polygon in scene.polygons)]
    return max(Fraction(1), *(part for value in values for part in _parts(value)))


def _parts(value: Value) -> tuple[Fraction, ...]:
    return value if isinstance(value, tuple) else (value,)


def _either(one: Fraction | None, other: Fraction | None, *, independent: bool) -> Fraction | None:
    """The chance of one or the other; None where it is not known."""
    if 1 in (one, other):
        return Fraction(1)
    if 0 in (one, other):
        return other if one == 0 else one
    return None if one is None or other is None or not independent else 1 - (1 - one) * (1 - other)


def _law(chances: Iterable[tuple[Value, Fraction]]) -> Law:
    """Chances of equal values together, those of chance 0 left out."""
    law: dict[Value, Fraction] = {}
    for value, chance in chances:
        if chance:
            law[value] = law.get(value, Fraction(0)) + chance
    return law


def _mean(law: Iterable[tuple[Value, Fraction]]) -> Value:
    """The mean of values with chances, by channel."""
    values, chances = zip(*law, strict=True)
    if not isinstance(values[0], tuple):
        return _dot(values, chances)
    return tuple(_dot(channel, chances) for channel in zip(*values, strict=True))


def _added(one: Value, other: Value) -> Value:
    return tuple(map(add, one, other)) if isinstance(one, tuple) else one + other


def _scaled(value: Value, factor: Fraction) -> Value:
    return tuple(part * factor for part in value) if isinstance(value, tuple) else value * factor


def _dot(values: Sequence[Any], chances: Sequence[Fraction]) -> Fraction:
    return Fraction(sum(map(mul, values, chances)))
