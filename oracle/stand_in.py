"""A pixel that stands for any, as the rowless walk shows it to a plan: to be drawn from, not to be looked into."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NoReturn, cast

from truemean.errors import NeedsScene, UnknownName
from truemean.oracle.exact import exact_fraction
from truemean.oracle.law import Law
from truemean.oracle.population import Population
from truemean.oracle.quantity import CURRENT, Decision, Node, Quantity, constant, quantity
from truemean.oracle.sample import Sample, Segment
from truemean.oracle.scene import QUARTERS
from truemean.oracle.wording import text

if TYPE_CHECKING:
    from truemean.oracle.walk import Trail

__all__ = ["AnyLaw", "Drawn", "NoProof", "Region", "StandIn", "Stretch", "Watched"]


class NoProof(BaseException):
    """The walk can't go on, so nothing is proved. Not an Exception, and noted: no plan catches it for good."""

    def __init__(self, words: str) -> None:
        super().__init__(words)
        running = CURRENT.get()
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
        return self._trail.loop(self._region.law, stop, parts)

    def from_(self, proposal: Any) -> NoReturn:
        raise NoProof(f"the plan draws from a proposal instead of {self.name}")

    def at(self, x: Any, y: Any = None) -> NoReturn:
        raise NoProof(f"the plan looks at a position of {self.name}")

    # -- parts -------------------------------------------------------------------------------

    @property
    def regions(self) -> Mapping[str, Population]:
        trail, given = self._trail, self._trail.tree.declared
        if given is not None and not self._region.number:
            return _Declared(self, self._parted("declared", given, own=True))
        if trail.fact("scene", self._region.world):
            return _Declared(self, self._parted("quadrants", dict.fromkeys(QUARTERS, Fraction(1, 4))))
        if not trail.fact("regions", self._region.world):
            return _Declared(self, {})
        area = Quantity("area", f"{self.name}.R")
        return _Declared(self, self._parted("regions", {"R": area, "rest": 1 - area}, own=True))

    def split(self, area: Any) -> tuple[Population, Population]:
        part = exact_fraction(area, "area")
        names = {"R": part, f"{self.name} - R": 1 - part}
        first, second = self._parted(f"split {part}", names, prefix="").values()
        return first, second

    def quadrants(self) -> tuple[Population, ...]:
        if not self._trail.fact("scene", self._region.world):
            raise self._trail.lacks(NeedsScene("quadrants() needs a scene: the pixel has no geometry"))
        return tuple(self._parted("quadrants", dict.fromkeys(QUARTERS, Fraction(1, 4))).values())

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
        return self._trail.choice([quantity(w) for w in weights], f"X.pick({list(weights)})", normalise=True)


class _Declared(Mapping[str, Population]):
    def __init__(self, whole: StandIn, parts: Mapping[str, Population]) -> None:
        self._whole, self._parts = whole, parts

    def __getitem__(self, key: str) -> Population:
        if key not in self._parts:
            known = self._parts or ["(the pixel has no regions)"]
            raise self._whole._trail.lacks(UnknownName("region", key, known))
        return self._parts[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)
