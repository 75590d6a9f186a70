"""The same plan over sampled rows: replicates of the estimate, by counter-based random numbers.

A row is then one replicate, and what it draws depends only on who it is, on where in the plan
the draw is, and on the number of the draw: never on how many other replicates there are.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truemean.errors import InputError, InputTypeError, PlanError
from truemean.oracle.columns import Ints, NotRational
from truemean.oracle.enclose import enclosures
from truemean.oracle.evaluate import Evaluator, leaves
from truemean.oracle.exact import is_symbolic
from truemean.oracle.exploration import Exploration
from truemean.oracle.features import Level
from truemean.oracle.law import Law
from truemean.oracle.loops import Loop
from truemean.oracle.observing import Observer, Span
from truemean.oracle.pixel import Pixel
from truemean.oracle.plan import Plan, as_plan
from truemean.oracle.plans import find_plan
from truemean.oracle.quantity import Node, Quantity
from truemean.oracle.random import uniforms
from truemean.oracle.rings import Ring
from truemean.oracle.rows import Block, Entry, Rows
from truemean.oracle.sample import Sample
from truemean.oracle.tables import Table

__all__ = ["Interval", "PlanEstimator", "Sampled", "sampled", "simulate"]

_CHUNK = 1 << 16
_ROWS = 1 << 60


class DrawnTable(Table):
    """The draws of every replicate, atom by atom; -1 where a sample is shorter."""

    def __init__(self, law: Law, sequence: Ints, sizes: Ints) -> None:
        self.law, self.level, self.sizes = law, Level({"sequence"}), sizes
        self.states = {"sequence": sequence}

    def mass(self, ring: Ring) -> Any:
        raise AssertionError("replicates have no probabilities")

    def state(self, feature: str) -> Ints:
        """Sums straight from the draws; everything else by way of the counts."""
        if feature not in self.states and feature.startswith("sum"):
            e = self.law.lattice(int(feature.split(":")[1])).e
            self.states[feature] = np.append(e, 0)[self.states["sequence"]].sum(axis=1)
        return super().state(feature)


class Sampler(Observer):
    """Draws instead of tables: every look at a sample gives each replicate its own draws."""

    everybody = Sample(None, Law([(Fraction(0),)], [Fraction(1)]), ("replicates",), "replicates", [], False)  # type: ignore[arg-type]  # of no path

    def __init__(self, observer: Observer, identity: NDArray[np.uint64], stream: int) -> None:
        super().__init__(observer.tables, observer.check_budget, observer.lenient)
        self.identity, self.stream = identity, stream

    def start(self) -> Rows:
        """One row per replicate."""
        runs = len(self.identity)
        everybody = np.arange(runs)
        table = DrawnTable(self.everybody.law, np.zeros((runs, 0), dtype=np.int8), np.zeros(runs, dtype=np.int64))
        return Rows((Block((Entry(self.everybody, 0, 0, table, everybody),), runs),))

    def require(self, rows: Rows, asked: Any, why: Node | None = None) -> tuple[Rows, Block]:
        rows, _ = super().require(rows, asked, why)
        return rows, rows.blocks[0]

    def observe(self, rows: Rows, sample: Sample, features: set[str], spans: list[Span], why: Node | None) -> Rows:
        for number in range(rows.covered(sample), max(end for _, end in spans)):
            if sample.loop is not None and number < sample.loop.parts:
                rows = rows if number else self._loop(rows, sample, sample.loop)
                continue
            size = sample.segments[number].size
            if isinstance(size, Quantity):
                rows, block = self.require(rows, leaves(size), size)
                sizes = self.sizes(block, size, sample)
            else:
                sizes = np.full(rows.blocks[0].size, size)
            rows = self._drawn(rows, sample, number, sizes)
        return rows

    def _drawn(self, rows: Rows, sample: Sample, number: int, sizes: Ints) -> Rows:
        """Attach one segment: draws for the replicates of this path only."""
        if sample.chances is not None:
            rows, _ = self.require(rows, leaves(*sample.chances))
            columns = self.chances(rows.blocks[0], sample)
            cumulated = np.cumsum([c.floats() for c in columns], axis=0)
            draws = (self._uniforms(rows, sample, number, 1) >= cumulated[:-1].T).sum(axis=1)[:, None]
        else:
            bounds = np.cumsum(np.array(sample.law.weights, dtype=float))[:-1]
            draws = np.searchsorted(
                bounds, self._uniforms(rows, sample, number, int(sizes.max(initial=0))), side="right"
            )
        block = rows.blocks[0]
        draws = np.where(np.arange(draws.shape[1]) < sizes[:, None], draws, -1)
        table = DrawnTable(sample.law, draws, sizes)
        entry = Entry(sample, number, number + 1, table, np.arange(block.size))
        return Rows((Block((*block.entries, entry), block.size),))

    def _loop(self, rows: Rows, sample: Sample, loop: Loop) -> Rows:
        """Grow every replicate's sample until its own stop."""
        block = rows.blocks[0]
        parts, law = loop.parts, sample.law
        bounds = np.cumsum(np.array(law.weights, dtype=float))[:-1]
        draws = np.searchsorted(bounds, self._uniforms(rows, sample, 0, loop.most), side="right")
        sizes = np.full(block.size, loop.most)
        growing = np.arange(block.size)
        for n in range(loop.start, loop.most, loop.step):
            tables = [self._cut(law, draws[growing, part:n:parts]) for part in range(parts)]
            index = np.arange(len(growing))
            entries = tuple(Entry(loop.view, part, part + 1, t, index) for part, t in enumerate(tables))
            stops = Evaluator(Block(entries, len(growing)), self.lenient).holds(loop.asked)
            sizes[growing[stops]] = n
            growing = growing[~stops]
        kept = np.where(np.arange(loop.most) < sizes[:, None], draws, -1)
        found = [self._cut(law, kept[:, part::parts]) for part in range(parts)]
        entries = tuple(Entry(sample, part, part + 1, t, np.arange(block.size)) for part, t in enumerate(found))
        return Rows((Block((*block.entries, *entries), block.size),))

    @staticmethod
    def _cut(law: Law, draws: Ints) -> DrawnTable:
        return DrawnTable(law, draws, (draws >= 0).sum(axis=1))

    def _uniforms(self, rows: Rows, sample: Sample, number: int, draws: int) -> NDArray[np.float64]:
        point, ordinal = sample.label
        words = repr((self.stream, point.prefix, ordinal, number)).encode()
        key = int.from_bytes(hashlib.blake2b(words, digest_size=8).digest(), "little")
        replicates = rows.blocks[0].entries[0].index
        return uniforms(self.identity[replicates], draws, key)


def simulate(plan: Any, X: Pixel, *, runs: int = 100_000, seed: int = 0, **params: Any) -> NDArray[np.float64]:
    """Replicates of the estimate, ``[runs]`` or ``[runs, channels]`` in float64.

    Replicate i depends on ``seed`` and i alone. Raises PlanError as `derive` does.

    >>> from truemean.oracle.plans import catalogue
    >>> simulate(catalogue["fixed"], Pixel.two("1/2"), runs=3, seed=1, n=2)
    array([1., 0., 0.])
    """
    if isinstance(runs, bool) or not isinstance(runs, int) or runs < 0:
        raise InputError(f"runs={runs!r}: give the number of replicates, an integer >= 0")
    if isinstance(seed, bool) or not isinstance(seed, int):
        raise InputError(f"seed={seed!r} is not an integer")
    if not isinstance(X, Pixel):
        raise InputTypeError(f"X={X!r} (type={type(X).__name__}) is not a Pixel: write Pixel({{0: '7/8', 1: '1/8'}})")
    return replicates(as_plan(plan), X, np.arange(runs, dtype=np.uint64), seed, params)[0]


def replicates(
    plan: Plan, pixel: Pixel, identity: NDArray[np.uint64], stream: int, params: dict[str, Any]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Estimates and costs of the replicates with the given identities, in chunks."""
    bound = plan.bind(params)
    symbols = pixel.symbols.union(*(v.free_symbols for v in bound.values() if is_symbolic(v)))
    if symbols:
        raise InputError(f"{', '.join(sorted(map(str, symbols)))} are symbols, which can't be drawn: give them numbers")
    found = [_chunk(plan, pixel, identity[i : i + _CHUNK], stream, bound) for i in range(0, len(identity), _CHUNK)]
    if not found:
        shape = (0,) if pixel.channels is None else (0, pixel.channels)
        return np.empty(shape), np.empty(0)
    return np.concatenate([estimates for estimates, _ in found]), np.concatenate([costs for _, costs in found])


def _chunk(plan: Plan, pixel: Pixel, identity: Any, stream: int, params: dict[str, Any]) -> tuple[Any, Any]:
    exploration = Exploration(plan.function, pixel, params, _ROWS, plan.undefined == "nan")
    sampler = Sampler(exploration.observer, identity, stream)
    exploration.observer, exploration.start = sampler, sampler.start()
    estimates = np.empty((len(identity), pixel.channels or 1))
    costs = np.empty(len(identity))
    for path in exploration.paths:
        _, block = sampler.require(path.rows, leaves(*path.result, path.cost))
        evaluator = Evaluator(block, exploration.lenient)
        who = block.entries[0].index
        for channel, estimate in enumerate(path.result):
            estimates[who, channel] = _floats(evaluator, estimate)
        costs[who] = _floats(evaluator, path.cost)
    return (estimates[:, 0] if pixel.channels is None else estimates), costs


def _floats(evaluator: Evaluator, node: Quantity) -> Any:
    try:
        return evaluator.column(node).floats()
    except NotRational:
        return np.array([float(ball.mid()) for ball in enclosures(evaluator, node, 64)])


class PlanEstimator:
    """A declared plan run as an estimator: ``plan:kirk-arvo?n=4`` on the command line.

    >>> PlanEstimator("fixed", n=1).run(Pixel.two(1), np.array([5, 6]))
    array([1., 1.])
    """

    def __init__(self, plan: str, **params: Any) -> None:
        self.plan = find_plan(plan)
        self.params = self.plan.bind(params)
        self.declares = (plan, self.params)
        self._last: tuple[Any, ...] = ()

    def run(self, pixel: Any, seeds: Any) -> NDArray[np.float64]:
        """One replicate per seed."""
        return self._replicates(pixel, seeds)[0]

    def costs(self, pixel: Any, seeds: Any) -> NDArray[np.float64]:
        """Samples drawn by each replicate."""
        return self._replicates(pixel, seeds)[1]

    def _replicates(self, pixel: Any, seeds: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        seeds = np.asarray(seeds)
        if not (self._last and self._last[0] is pixel and np.array_equal(self._last[1], seeds)):
            identity = seeds.astype(np.uint64)
            self._last = (pixel, seeds, replicates(self.plan, pixel, identity, 0, dict(self.params)))
        found: tuple[NDArray[np.float64], NDArray[np.float64]] = self._last[2]
        return found


# -- an interval where enumeration is too much -------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Interval:
    """Two ends that hold the exact value between them with the stated confidence."""

    lower: float
    upper: float
    confidence: float


@dataclass(frozen=True, slots=True)
class Sampled:
    """What sampled rows tell of a plan: intervals instead of numbers (empirical Bernstein)."""

    plan: Plan
    pixel: Pixel
    estimates: NDArray[np.float64]
    costs: NDArray[np.float64]
    confidence: float = 0.99

    @property
    def bias(self) -> Any:
        """E[xi] - I, by channel for colours."""
        mean = self.pixel.mean
        truths = [float(m) for m in (mean if isinstance(mean, tuple) else (mean,))]
        pairs = zip(self._intervals(), truths, strict=True)
        return self._by_channel([Interval(i.lower - t, i.upper - t, i.confidence) for i, t in pairs])

    @property
    def expectation(self) -> Any:
        """E[xi], by channel for colours."""
        return self._by_channel(self._intervals())

    def _intervals(self) -> list[Interval]:
        values, _ = self.pixel.arrays()
        columns = zip(self._columns(self.estimates), self._columns(values), strict=True)
        return [self._interval(x, float(v.min()), float(v.max())) for x, v in columns]

    @staticmethod
    def _columns(array: NDArray[np.float64]) -> NDArray[np.float64]:
        return array.reshape(len(array), -1).T

    def _by_channel(self, found: list[Interval]) -> Any:
        return tuple(found) if self.pixel.channels else found[0]

    def _interval(self, x: NDArray[np.float64], low: float, high: float) -> Interval:
        """Maurer & Pontil 2009, Theorem 4, both sides."""
        if x.min() < low or x.max() > high:
            raise PlanError(
                f"rows='sampled' needs estimates within the pixel's values [{low}, {high}], and one is outside: "
                f"clamp it with np.clip, or enumerate with a larger rows="
            )
        n, log = len(x), math.log(4 / (1 - self.confidence))
        half = math.sqrt(2 * x.var(ddof=1) * log / n) + 7 * (high - low) * log / (3 * (n - 1))
        return Interval(float(x.mean() - half), float(x.mean() + half), self.confidence)


def sampled(plan: Plan, pixel: Pixel, runs: int, seed: int, params: dict[str, Any]) -> Sampled:
    """`derive` with ``rows="sampled"``."""
    if isinstance(runs, bool) or not isinstance(runs, int) or runs < 2:
        raise InputError(f"runs={runs!r}: an interval needs at least 2 sampled rows")
    return Sampled(plan, pixel, *replicates(plan, pixel, np.arange(runs, dtype=np.uint64), seed, params))
