"""A pixel that stands for any, as the rowless walk shows it to a plan: to be drawn from, not to be looked into."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NoReturn, cast

from truemean.errors import InputError, InputTypeError, NeedsScene, UnknownName
from truemean.oracle.columns import NotRational
from truemean.oracle.evaluate import Evaluator
from truemean.oracle.exact import exact_count, exact_fraction, exact_number, is_symbolic, short_text
from truemean.oracle.law import Law
from truemean.oracle.population import Population
from truemean.oracle.quantity import CURRENT, Decision, Node, Quantity, constant, quantity
from truemean.oracle.rows import Block
from truemean.oracle.sample import Sample, Segment
from truemean.oracle.scene import QUARTERS
from truemean.oracle.symbols import Ratio
from truemean.oracle.wording import text

if TYPE_CHECKING:
    from truemean.oracle.walk import Trail

__all__ = [
    "FACTS",
    "AnyLaw",
    "Drawn",
    "NoProof",
    "Place",
    "Region",
    "StandIn",
    "Stretch",
    "Test",
    "Watched",
    "bounds",
    "checked_size",
    "fixed_value",
    "function_key",
    "is_fixed",
    "no_tables",
    "world",
]


class NoProof(BaseException):
    """The walk can't go on, so nothing is proved. Not an Exception, and noted: no plan catches it for good."""

    def __init__(self, words: str) -> None:
        super().__init__(words)
        running: Any = CURRENT.get()
        if hasattr(running, "refusal"):
            running.refusal = self


@dataclass(frozen=True, slots=True)
class Region:
    """A population that stands for any: the whole X, or one part of it with its share of the area."""

    number: int
    law: Law
    area: Any
    world: int  # the region that it shares scene and declared parts with


@dataclass(frozen=True, slots=True)
class Drawn:
    """Something random, by its place in the tree: draws of a region, a sub-estimate, a choice.

    ``kind`` is sample, estimate (of a plan proved unbiased), opaque (of one that is not), stopped
    (by `draw_until`) or choice; ``looks`` is what its size, chances or parameters are made of.
    """

    number: int
    name: str
    kind: str
    region: int
    size: Any = 1
    looks: tuple[Node, ...] = ()

    @property
    def shape(self) -> Any:
        """What must be the same whenever it is drawn again."""
        keys = [node.key for node in self.looks]
        return self.name, self.kind, self.region, self.size if isinstance(self.size, int) else self.size.key, keys


@dataclass(frozen=True, slots=True)
class Test:
    """A decision on a choice of the estimator alone: whether it is ``option``, of those that remain."""

    choice: int
    option: int
    remaining: tuple[int, ...]


class Place:
    """A place in the tree of paths: what is drawn there, and then the decision or the estimate."""

    __slots__ = ("asked", "draws", "estimate", "lacking", "sides", "test", "words")

    def __init__(self) -> None:
        self.draws: list[int] = []
        self.asked: Decision | None = None
        self.words = ("", "")
        self.test: Test | None = None
        self.sides: dict[bool, Place] = {}
        self.estimate: Quantity | None = None
        self.lacking = False  # the plan has no estimate here: it needs what such a pixel has not


class AnyLaw(Law):
    """The law of one draw from nobody knows what."""

    def __init__(self, name: str, region: int = -1, cost: int = 1) -> None:
        self.name, self.region, self.channels, self.ratios, self.open = name, region, 1, None, False
        self._cost, self._oracle_calls = Fraction(cost), Fraction(0)

    @property
    def values(self) -> NoReturn:
        raise NoProof(f"the plan reads the values of {self.name}")

    weights = values

    def lattice(self, column: int) -> NoReturn:
        raise NoProof(f"the plan reads the values of {self.name}")


@dataclass(frozen=True, slots=True)
class Stretch(Segment):
    """Draws made at once, with their number in the tree."""

    drawn: int = -1


class Watched(Sample):
    """A sample of which nothing is known but where it was drawn."""

    __slots__ = ()

    def more(self, m: Any) -> Sample:
        self.path.check_alive(self)
        trail = cast("Trail", self.path)
        self.segments.append(trail.stretch(self.law, m, 0, f"the growth of {self.name}"))
        return self

    def flat_test(self, leaf: Quantity, comparison: str) -> None:
        return None

    def _weighted(self, weight: Any) -> Any:
        return self._stat("weighted", 0)


class StandIn(Population):
    """A population as the walk shows it to a plan: to be drawn from and divided, not to be looked into."""

    def __init__(self, trail: Trail, region: Region) -> None:
        self._trail, self._region, self.name = trail, region, region.law.name
        self.area = region.area

    @property
    def values(self) -> NoReturn:
        raise NoProof(f"the plan reads {self.name}.values or the like")

    weights = variance = scale = values

    @property
    def mean(self) -> Any:
        return Quantity("true mean", self._region.law, 0)

    def true_mean(self) -> Any:
        return self.mean

    def draw(self, n: Any) -> Sample:
        trail = self._trail
        trail.samples += 1
        name = f"S{trail.samples}"
        return trail.sample(self._region.law, [trail.stretch(self._region.law, n, 1, name)], name)

    def draw_until(self, stop: Callable[..., Any], *, start: Any, step: Any = 1, most: Any, parts: int = 1) -> Sample:
        return self._trail.loop(self._region.law, stop, start, step, most, parts)

    def from_(self, proposal: Any) -> NoReturn:
        raise NoProof(f"the plan draws from a proposal instead of {self.name}")

    def at(self, x: Any, y: Any = None) -> NoReturn:
        raise NoProof(f"the plan looks at a position of {self.name}")

    # -- parts -------------------------------------------------------------------------------

    @property
    def regions(self) -> Mapping[str, Population]:
        trail, given = self._trail, self._trail.tree.declared
        if given is not None and not self._region.number:
            return _Declared(trail, self._parted("declared", given, own=True))
        if trail.fact("scene", self._region.world):
            return _Declared(trail, self._parted("quadrants", dict.fromkeys(QUARTERS, Fraction(1, 4))))
        if not trail.fact("regions", self._region.world):
            return _Declared(trail, {})
        area = Quantity("area", f"{self.name}.R")
        return _Declared(trail, self._parted("regions", {"R": area, "rest": 1 - area}, own=True))

    def split(self, area: Any) -> tuple[Population, Population]:
        part = exact_fraction(area, "area")
        names = {"R": part, f"{self.name} - R": 1 - part}
        first, second = self._parted(f"split {part}", names, prefix="").values()
        return first, second

    def quadrants(self) -> tuple[Population, ...]:
        return self.grid(2)

    def grid(self, n: Any) -> tuple[Population, ...]:
        side = exact_count(n, "n", "number of cells along a side")
        if not self._trail.fact("scene", self._region.world):
            raise self._trail.lacks(NeedsScene(f"grid({side}) needs a scene: the pixel has no geometry"))
        kind, names = ("quadrants", QUARTERS) if side == 2 else (f"grid {side}", map(str, range(side * side)))
        return tuple(self._parted(kind, dict.fromkeys(names, Fraction(1, side * side))).values())

    def _parted(
        self, kind: str, areas: Mapping[str, Any], prefix: str | None = None, own: bool = False
    ) -> dict[str, Population]:
        """Disjoint parts of the area, the same ones whenever it is parted in this way."""
        prefix = f"{self.name}." if prefix is None else prefix
        found = self._trail.tree.parted(self._region, kind, {f"{prefix}{n}": a for n, a in areas.items()}, own)
        return {name: StandIn(self._trail, region) for name, region in zip(areas, found, strict=True)}

    # -- estimates and choices -----------------------------------------------------------------

    def estimate(self, plan: Any, **params: Any) -> Any:
        return self._trail.estimate(self._region, plan, params)

    def coin(self, p: Any) -> Decision:
        heads = quantity(p)
        chosen = self._trail.choice([1 - heads, heads], f"X.coin({text(heads)})", normalise=False)
        return Decision("==", chosen, constant(1))

    def pick(self, weights: Sequence[Any]) -> Quantity:
        return self._trail.choice(
            [quantity(w) for w in weights], f"X.pick([{', '.join(map(str, weights))}])", normalise=True
        )


class _Declared(Mapping[str, Population]):
    def __init__(self, trail: Trail, parts: Mapping[str, Population]) -> None:
        self._trail, self._parts = trail, parts

    def __getitem__(self, key: str) -> Population:
        if key not in self._parts:
            known = self._parts or ["(the pixel has no regions)"]
            raise self._trail.lacks(UnknownName("region", key, known))
        return self._parts[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)


# -- what an expression shows by its form ----------------------------------------------------------


def is_fixed(node: Node) -> bool:
    """Whether an expression is made of numbers only, so that it is the same on every pixel."""
    if node.op == "const":
        return not isinstance(node.args[0], Ratio)
    if node.op in ("stat", "mean", "sum", "flat", "true mean", "area", "fact"):
        return False
    return all(is_fixed(a) for a in node.args if isinstance(a, Node))


def fixed_value(node: Any) -> Fraction | None:
    """The number that an expression is on every pixel; None if it depends."""
    if node.op == "const" or not is_fixed(node):
        return node.args[0] if isinstance(node.args[0], Fraction) else None
    try:
        return Fraction(Evaluator(Block((), 1)).column(node).fractions()[0])
    except NotRational:
        return None


def checked_size(n: Any, least: int) -> int | Quantity:
    """A sample size as `Population.draw` reads it."""
    if is_symbolic(n):
        return quantity(n)
    if isinstance(n, bool):
        raise InputTypeError(f"n={n!r} is a truth value: give an integer of at least {least}")
    if isinstance(n, Quantity):
        fixed = fixed_value(n)
        if fixed is None:
            return n
        n = fixed
    number = exact_number(n, "n")
    if number.denominator != 1 or number < least:
        raise InputError(f"n={short_text(number)} is not a sample size: give an integer of at least {least}")
    return int(number)


def no_tables(*asked: Any) -> NoReturn:
    """There are no rows here to make a table of."""
    raise NoProof(f"the plan looks at the rows of a sample at {asked}")


def bounds(node: Any) -> tuple[Any, Any]:
    """Numbers between which a quantity lies, as far as its form shows."""
    op, args = node.op, node.args
    if op == "const" and isinstance(args[0], Fraction):
        return args[0], args[0]
    if op in ("where", "min", "max", "+", "-"):
        (a, b), (c, d) = map(bounds, args[-2:])
        if op == "where":
            return min(a, c), max(b, d)
        if op in ("min", "max"):
            chosen = {"min": min, "max": max}[op]
            return chosen(a, c), chosen(b, d)
        return (a + c, b + d) if op == "+" else (a - d, b - c)
    return -math.inf, math.inf


def function_key(function: Any) -> Any:
    """A function by its code and what it closes over, as far as that is known by its value."""
    code = getattr(function, "__code__", None)
    if code is None:
        return id(function)
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    around = [*cells, *(function.__defaults__ or ()), getattr(function, "__self__", None)]
    around += [function.__globals__, function.__kwdefaults__]
    simple = int | str | Fraction | float | bool | None
    return code, *((type(x), x) if isinstance(x, simple) else id(x) for x in around)


FACTS = {
    "scene": ("the pixel is not of a scene", "the pixel is of a scene"),
    "regions": ("the pixel declares no regions", "the pixel declares regions R and rest"),
}


def world(path: tuple[tuple[Place, bool], ...]) -> set[str]:
    """What kind of pixel a path is about, as far as the plan asked."""
    facts: dict[int, dict[str, bool]] = {}
    for place, side in path:
        if place.asked is not None and place.asked.op == "fact":
            kind, region = place.asked.args
            facts.setdefault(region, {})[kind] = side
    found = set()
    for known in facts.values():
        parted = {None: "without a scene", True: "of two regions R and rest", False: "without declared regions"}
        found.add("of a scene" if known.get("scene") else parted[known.get("regions")])
    return found
