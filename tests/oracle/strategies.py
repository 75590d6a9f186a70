"""Hypothesis strategies: small nasty pixels, and random plans written as little syntax trees."""

from __future__ import annotations

import operator
from collections.abc import Sized
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from hypothesis import strategies as st

from truemean.oracle.pixel import Pixel

# -- pixels ----------------------------------------------------------------------------------------

SPACED = (0, 1, 2, 3)
IRREGULAR = (Fraction(-5, 3), Fraction(-1), Fraction(0), Fraction(2, 7), Fraction(1), Fraction(9, 4))


def laws(values: Any, most: int) -> st.SearchStrategy[Pixel]:
    """Pixels of at most ``most`` of the given values; weights may be 0."""

    def build(pairs: list[tuple[Any, int]]) -> Pixel:
        total = sum(weight for _, weight in pairs)
        return Pixel({value: Fraction(weight, total) for value, weight in pairs})

    pairs = st.tuples(st.sampled_from(values), st.sampled_from((1, 2, 5, 0)))
    some = st.lists(pairs, min_size=1, max_size=most, unique_by=lambda pair: pair[0])
    return some.filter(lambda pairs: any(weight for _, weight in pairs)).map(build)


def pixels(most: int = 3, nonnegative: bool = False) -> st.SearchStrategy[Pixel]:
    """Scalar pixels: equally spaced values, or irregular rationals of both signs."""
    irregular = tuple(v for v in IRREGULAR if v >= 0) if nonnegative else IRREGULAR
    return laws(SPACED, most) | laws(irregular, most)


def colours(most: int = 3) -> st.SearchStrategy[Pixel]:
    """Pixels whose values are pairs, so that two channels move together or apart."""
    tones = (Fraction(0), Fraction(1, 3), Fraction(1))
    return laws(tuple((a, b) for a in tones for b in tones), most)


def parted(most: int = 2) -> st.SearchStrategy[Pixel]:
    """Pixels of two regions, R and rest, with laws of their own."""

    def build(area: Fraction, R: Pixel, rest: Pixel) -> Pixel:
        return Pixel.from_regions({"R": (area, R), "rest": (1 - area, rest)})

    return st.builds(build, st.sampled_from((Fraction(1, 4), Fraction(2, 3))), pixels(most), pixels(most))


# -- plans -----------------------------------------------------------------------------------------


@dataclass
class Scope:
    """What a random plan has at hand: its samples, and quantities computed before they grew."""

    X: Any
    samples: list[Any]
    saved: list[Any]
    colour: bool


@dataclass(frozen=True)
class Const:
    value: Fraction

    def __call__(self, scope: Scope) -> Any:
        return self.value


@dataclass(frozen=True)
class Stat:
    """A statistic of a sample as it is now."""

    name: str
    sample: int

    def __call__(self, scope: Scope) -> Any:
        sample = scope.samples[self.sample % len(scope.samples)]
        if self.name == "size":
            return sample.size
        if self.name == "middle" and not scope.colour:
            return sample.statistic(lambda values: values[len(values) // 2])
        if self.name == "middle":
            return (sample.min() + sample.max()) / 2
        return getattr(sample, self.name)()


@dataclass(frozen=True)
class Saved:
    """A quantity computed earlier; the true mean where nothing was saved."""

    index: int

    def __call__(self, scope: Scope) -> Any:
        return scope.saved[self.index % len(scope.saved)] if scope.saved else scope.X.mean


BINARY: dict[str, Any] = {"+": operator.add, "-": operator.sub, "*": operator.mul, "min": np.minimum, "max": np.maximum}
RELATIONS = {"<=": operator.le, "<": operator.lt, ">": operator.gt, ">=": operator.ge, "==": operator.eq}


@dataclass(frozen=True)
class Binary:
    name: str
    left: Any
    right: Any

    def __call__(self, scope: Scope) -> Any:
        return BINARY[self.name](self.left(scope), self.right(scope))


@dataclass(frozen=True)
class Relation:
    name: str
    left: Any
    right: Any

    def __call__(self, scope: Scope) -> Any:
        return RELATIONS[self.name](self.left(scope), self.right(scope))


@dataclass(frozen=True)
class Coin:
    p: Any

    def __call__(self, scope: Scope) -> Any:
        p = self.p(scope)
        return scope.X.coin(np.clip(p[0] if scope.colour and not isinstance(p, Fraction) else p, 0, 1))


@dataclass(frozen=True)
class Where:
    condition: Any
    yes: Any
    no: Any

    def __call__(self, scope: Scope) -> Any:
        condition = self.condition(scope)
        if isinstance(condition, bool):  # a comparison of constants, which NumPy would take for its own
            return (self.yes if condition else self.no)(scope)
        return np.where(condition, self.yes(scope), self.no(scope))


@dataclass(frozen=True)
class Return:
    estimate: Any

    def __call__(self, scope: Scope) -> Any:
        return self.estimate(scope) + (0 * scope.X.mean if scope.colour else 0)


@dataclass(frozen=True)
class Save:
    quantity: Any
    then: Any

    def __call__(self, scope: Scope) -> Any:
        scope.saved.append(self.quantity(scope))
        return self.then(scope)


@dataclass(frozen=True)
class Grow:
    sample: int
    m: Any
    then: Any

    def __call__(self, scope: Scope) -> Any:
        scope.samples[self.sample % len(scope.samples)].more(self.m(scope))
        return self.then(scope)


@dataclass(frozen=True)
class Draw:
    n: Any
    then: Any

    def __call__(self, scope: Scope) -> Any:
        scope.samples.append(scope.X.draw(self.n(scope)))
        return self.then(scope)


@dataclass(frozen=True)
class Fork:
    decision: Any
    yes: Any
    no: Any

    def __call__(self, scope: Scope) -> Any:
        decision = self.decision(scope)
        if not isinstance(decision, bool):
            decision = decision.all()
        return self.yes(scope) if decision else self.no(scope)


@dataclass(frozen=True)
class Size:
    """A number of draws: fixed, or one of two by row."""

    small: int
    large: int
    decision: Any

    def __call__(self, scope: Scope) -> Any:
        if self.small == self.large:
            return self.small
        decision = self.decision(scope)
        if isinstance(decision, bool):
            return self.large if decision else self.small
        return np.where(decision.all(), self.large, self.small)


@dataclass(frozen=True)
class RandomPlan:
    """A first sample of n draws, then whatever the tree says."""

    n: int
    body: Any

    def __call__(self, X: Any) -> Any:
        return self.body(Scope(X, [X.draw(self.n)], [], isinstance(X.values[0], Sized)))


EXACT = ("mean", "mean", "sum", "min", "max", "range", "variance", "size", "middle")
consts = st.sampled_from([Fraction(v) for v in ("0", "1", "-1", "1/2", "2/3", "1/4")]).map(Const)
indices = st.integers(0, 1)


def quantities(names: tuple[str, ...]) -> st.SearchStrategy[Any]:
    leaves = st.builds(Stat, st.sampled_from(names), indices) | consts | st.builds(Saved, indices)
    pairs = st.builds(Binary, st.sampled_from(sorted(BINARY)), leaves, leaves)
    return leaves | pairs | st.builds(Binary, st.sampled_from(("+", "-", "*")), pairs, leaves)


def decisions(names: tuple[str, ...] = (*EXACT, "std_error")) -> st.SearchStrategy[Any]:
    relations = st.builds(Relation, st.sampled_from(sorted(RELATIONS)), quantities(names), quantities(names))
    coins = st.builds(Coin, consts | st.builds(Stat, st.sampled_from(("mean", "range")), indices))
    return relations | relations | relations | st.builds(Stat, st.just("all_equal"), indices) | coins


def estimates() -> st.SearchStrategy[Any]:
    chosen = st.builds(Where, decisions(EXACT), quantities(EXACT), quantities(EXACT))
    return quantities(EXACT) | chosen


def sizes(small: int, large: int) -> st.SearchStrategy[Size]:
    fixed = st.builds(Size, st.just(large), st.just(large), st.none())
    return fixed | st.builds(Size, st.just(small), st.just(large), decisions(EXACT))


@st.composite
def bodies(draw: st.DrawFn, draws: int, forks: int) -> Any:
    """A tree that spends at most ``draws`` more draws and ``forks`` decisions on any path."""
    kind = draw(st.sampled_from(("return", "save", "grow", "draw", "fork", "fork")))
    if kind == "fork" and forks:
        below = bodies(draws, forks - 1)
        return Fork(draw(decisions()), draw(below), draw(below))
    if kind == "grow" and draws >= 1:
        m = draw(st.integers(1, min(draws, 2)))
        return Grow(draw(indices), draw(sizes(0, m)), draw(bodies(draws - m, forks)))
    if kind == "draw" and draws >= 2:
        return Draw(draw(sizes(1, 2)), draw(bodies(draws - 2, forks)))
    if kind == "save":
        return Save(draw(quantities(EXACT)), draw(bodies(draws, forks)))
    return Return(draw(estimates()))


def plans(draws: int = 5, forks: int = 3) -> st.SearchStrategy[RandomPlan]:
    """Plans of at most ``draws`` draws and ``forks`` decisions on a path."""
    return st.sampled_from((2, 3)).flatmap(lambda n: st.builds(RandomPlan, st.just(n), bodies(draws - n, forks)))
