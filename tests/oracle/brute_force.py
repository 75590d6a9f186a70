"""The engine's twin: the same plan source, run on every sequence of outcomes of every draw.

Nothing is shared with the engine but the pixel and the errors; there are no levels, no tables
and no floats, so it is slow and easily believed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from tests.oracle.brute_numbers import Num, NumPyMixin, Truth, Vec, lift, number, wrap

from truemean.errors import PlanError
from truemean.oracle.pixel import Pixel

Plan = Callable[..., Any]


class Outcome(NamedTuple):
    """One sequence of outcomes: its probability, the estimate, samples drawn, oracle calls."""

    probability: Fraction
    estimate: Any
    cost: int
    oracle_calls: int


@dataclass(frozen=True)
class Law:
    """Everything that can happen when the plan runs on the pixel."""

    pixel: Pixel
    outcomes: tuple[Outcome, ...]

    @property
    def expectation(self) -> Any:
        return self._average(lambda estimate, mean: estimate)

    @property
    def bias(self) -> Any:
        return self._average(lambda estimate, mean: estimate - mean)

    @property
    def variance(self) -> Any:
        return _zip(lambda mse, bias: mse - bias**2, self.mse, self.bias)

    @property
    def mse(self) -> Any:
        return self._average(lambda estimate, mean: (estimate - mean) ** 2)

    @property
    def cost(self) -> Fraction:
        return sum((o.probability * o.cost for o in self.outcomes), Fraction(0))

    @property
    def oracle_calls(self) -> Fraction:
        return sum((o.probability * o.oracle_calls for o in self.outcomes), Fraction(0))

    @property
    def distribution(self) -> dict[Any, Fraction]:
        law: dict[Any, Fraction] = {}
        for o in self.outcomes:
            law[o.estimate] = law.get(o.estimate, Fraction(0)) + o.probability
        return law

    def assert_equals(self, derivation: Any) -> None:
        """Every result of the engine is this law's, to the last digit."""
        for name in ("expectation", "bias", "variance", "mse", "cost", "oracle_calls"):
            assert getattr(derivation, name) == getattr(self, name), name
        assert derivation.distribution() == self.distribution

    def _average(self, function: Callable[[Any, Any], Any]) -> Any:
        total: Any = _zip(lambda mean: Fraction(0), self.pixel.mean)
        for o in self.outcomes:
            term = _zip(function, o.estimate, self.pixel.mean)
            total = _zip(lambda t, x, p=o.probability: t + p * x, total, term)
        return total


def brute(plan: Plan, pixel: Pixel, undefined: str | None = None, **params: Any) -> Law:
    """Run ``plan`` once for every sequence of outcomes, depth first."""
    choices = Choices()
    outcomes = []
    function = getattr(plan, "__wrapped__", plan)
    while True:
        world = World(choices)
        outer, Num.lenient = Num.lenient, undefined == "nan"
        try:
            estimate = _estimate(function(Twin(pixel, world), **params), pixel)
        finally:
            Num.lenient = outer
        outcomes.append(Outcome(choices.probability(), estimate, world.cost, world.oracle_calls))
        if not choices.advance():
            return Law(pixel, tuple(outcomes))


@dataclass
class Choices:
    """A string of choices, replayed, then prolonged by first options, then advanced like a counter."""

    digits: list[tuple[int, Sequence[Fraction]]] = field(default_factory=list)
    position: int = 0

    def choose(self, probabilities: Sequence[Fraction]) -> int:
        """The next digit: an index of positive probability."""
        if self.position == len(self.digits):
            self.digits.append((_next_positive(probabilities, 0), probabilities))
        self.position += 1
        return self.digits[self.position - 1][0]

    def probability(self) -> Fraction:
        product = Fraction(1)
        for index, probabilities in self.digits:
            product *= probabilities[index]
        return product

    def advance(self) -> bool:
        """Go on to the next string; False after the last one."""
        self.position = 0
        while self.digits:
            index, probabilities = self.digits.pop()
            index = _next_positive(probabilities, index + 1)
            if index < len(probabilities):
                self.digits.append((index, probabilities))
                return True
        return False


@dataclass
class World:
    """One run: its choices and what it has spent."""

    choices: Choices
    cost: int = 0
    oracle_calls: int = 0


class Twin:
    """The pixel, or a part of it, as a plan sees it in one run."""

    def __init__(self, pixel: Pixel, world: World, proposal: Pixel | None = None) -> None:
        self._pixel, self._world, self._source = pixel, world, proposal or pixel
        self.area = pixel.area
        self.mean, self.variance = wrap(pixel.mean), wrap(pixel.variance)
        self.scale = number(pixel.scale)
        self.values = tuple(wrap(v) for v in pixel.values)
        self.weights = tuple(number(w) for w in pixel.weights)

    @property
    def regions(self) -> Mapping[str, Twin]:
        return {name: Twin(part, self._world) for name, part in self._pixel.regions.items()}

    def split(self, area: Any) -> tuple[Twin, ...]:
        return tuple(Twin(part, self._world) for part in self._pixel.split(area))

    def quadrants(self) -> tuple[Twin, ...]:
        return tuple(Twin(part, self._world) for part in self._pixel.quadrants())

    def grid(self, n: int) -> tuple[Twin, ...]:
        return tuple(Twin(part, self._world) for part in self._pixel.grid(n))

    def at(self, x: Any, y: Any) -> Any:
        self._world.cost += 1
        return wrap(self._pixel.at(x, y))

    def from_(self, proposal: Any) -> Twin:
        return Twin(self._pixel, self._world, proposal if isinstance(proposal, Pixel) else Pixel(proposal))

    def draw(self, n: Any) -> Sample:
        ratios = {v: self._pixel.law[v] / w for v, w in self._source.law.items() if w}
        return Sample(self._source, self._world, n, ratios)

    def draw_until(self, stop: Callable[..., Any], start: int, step: int, most: int, parts: int = 1) -> Sample:
        sample = self.draw(start)
        while len(sample) < most and not stop(*sample.parts(parts)):
            sample.more(min(step, most - len(sample)))
        return sample

    def true_mean(self) -> Any:
        self._world.oracle_calls += 1
        return self.mean

    def coin(self, p: Any) -> Truth:
        heads = number(p).rational()
        return Truth(self._world.choices.choose((1 - heads, heads)))

    def pick(self, weights: Sequence[Any]) -> Num:
        exact = [number(w).rational() for w in weights]
        return Num(self._world.choices.choose([w / sum(exact) for w in exact]))

    def estimate(self, plan: Plan, **params: Any) -> Any:
        law = _nested(plan, self._pixel, params)
        outcome = law[self._world.choices.choose([o.probability for o in law])]
        self._world.cost += outcome.cost
        self._world.oracle_calls += outcome.oracle_calls
        return wrap(outcome.estimate)


class Sample(NumPyMixin):
    """Values drawn so far, in order; every statistic is computed from them on the spot."""

    def __init__(self, pixel: Pixel, world: World, n: Any, ratios: Any, values: Sequence[Any] = ()) -> None:
        self._pixel, self._world, self._ratios = pixel, world, ratios
        self._values = list(values)
        self.more(n)

    def more(self, m: Any) -> None:
        count = number(m).rational()
        if count.denominator != 1 or count < 0:
            raise PlanError(f"a sample of size {count}")
        for _ in range(int(count)):
            self._values.append(self._pixel.values[self._world.choices.choose(self._pixel.weights)])
        self._world.cost += int(count)

    def parts(self, count: int) -> list[Sample]:
        return [Sample(self._pixel, self._world, 0, self._ratios, self._values[i::count]) for i in range(count)]

    def __len__(self) -> int:
        return len(self._values)

    def __getitem__(self, index: int) -> Any:
        return wrap(self._values[index])

    @property
    def size(self) -> Num:
        return Num(len(self))

    def all_equal(self) -> Truth:
        return Truth(len(set(self._values)) <= 1)

    def sum(self) -> Any:
        return self._by_channel(lambda values: Num(sum(values, Fraction(0))))

    def mean(self, weight: Any = None) -> Any:
        if weight is None:
            return self.sum() / self.size
        return sum((self._factor(weight, v) * wrap(v) for v in self._values), self._zero()) / self.size

    def self_normalised_mean(self) -> Any:
        return self.mean(weight="ratio") * self.size / sum(self._ratios[v] for v in self._values)

    def _factor(self, weight: Any, value: Any) -> Any:
        if isinstance(weight, str):
            return self._ratios[value]
        return weight(value) if callable(weight) else weight[value]

    def _zero(self) -> Any:
        return wrap(self._pixel.mean) * 0

    def min(self) -> Any:
        return self._by_channel(lambda values: Num(min(values)))

    def max(self) -> Any:
        return self._by_channel(lambda values: Num(max(values)))

    def range(self) -> Any:
        return self.max() - self.min()

    def median(self) -> Any:
        middle = len(self) // 2, (len(self) - 1) // 2
        return self._by_channel(lambda values: Num(sum((sorted(values)[i] for i in middle), Fraction(0)) / 2))

    def contrast(self, undefined: Any = None) -> Any:
        return _declared(self.range() / (self.max() + self.min()), undefined)

    def squares(self) -> Any:
        """Sum of squared distances from the sample mean."""
        return sum(((wrap(v) - self.mean()) ** 2 for v in self._values), self._zero())

    def variance(self, undefined: Any = None) -> Any:
        return _declared(self.squares() / (self.size - 1), undefined)

    def std_error(self, undefined: Any = None) -> Any:
        return _declared(np.sqrt(self.variance() / self.size), undefined)

    def statistic(self, function: Callable[[tuple[Any, ...]], Any]) -> Any:
        return wrap(function(tuple(sorted(self._values))))

    def _by_channel(self, function: Callable[[Sequence[Fraction]], Num]) -> Any:
        if self._pixel.channels is None:
            return function(self._values)
        columns = zip(*self._values, strict=True) if self._values else [()] * self._pixel.channels
        return Vec([function(column) for column in columns])


def _declared(quantity: Any, undefined: Any) -> Any:
    if undefined is None:
        return quantity
    return lift(lambda q: number(undefined) if q.terms is None else q, quantity)


def _nested(plan: Plan, pixel: Pixel, params: dict[str, Any]) -> tuple[Outcome, ...]:
    """The law of a sub-estimate with equal outcomes merged; remembered, because every run asks again."""
    key = plan, id(pixel.geometry), repr((pixel, pixel.area, pixel.regions, params))
    if key not in _remembered:
        merged: dict[tuple[Any, ...], Fraction] = {}
        for probability, *rest in brute(plan, pixel, **params).outcomes:
            merged[tuple(rest)] = merged.get(tuple(rest), Fraction(0)) + probability
        _remembered[key] = tuple(Outcome(p, *rest) for rest, p in merged.items())
    return _remembered[key]


_remembered: dict[Any, tuple[Outcome, ...]] = {}


def _estimate(result: Any, pixel: Pixel) -> Any:
    if isinstance(result, Vec | tuple) and pixel.channels == len(result):
        return tuple(number(channel).rational() for channel in result)
    if isinstance(result, bool | Truth) or result is None or pixel.channels is not None:
        raise PlanError(f"a plan returns an estimate, not {result!r}")
    return number(result).rational()


def _next_positive(probabilities: Sequence[Fraction], index: int) -> int:
    while index < len(probabilities) and not probabilities[index]:
        index += 1
    return index


def _zip(function: Callable[..., Any], *args: Any) -> Any:
    if isinstance(args[0], tuple):
        return tuple(function(*channels) for channels in zip(*args, strict=True))
    return function(*args)
