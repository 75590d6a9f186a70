"""Paths: a plan is called once for every sequence of decisions, not once for every outcome.

``bool(decision)`` splits the rows of the path, goes on with one part and leaves the other for a
later call, which replays the recorded answers without any work on rows. One repair mechanism
serves all surprises: a path that asks more of a sample than was observed notes the need and is
run again.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from numbers import Rational
from typing import TYPE_CHECKING, Any

import numpy as np

from truemean.errors import InputError, InputTypeError, NoClosedForm, NotDeterministic, PlanError, TruemeanError
from truemean.oracle.assumptions import possible_signs, read, read_size
from truemean.oracle.evaluate import Evaluator, check_closed, leaves
from truemean.oracle.exact import exact_number, is_symbolic, short_text
from truemean.oracle.features import Level
from truemean.oracle.float64 import Float64
from truemean.oracle.importance import proposal_law
from truemean.oracle.law import Law
from truemean.oracle.pixel import Pixel
from truemean.oracle.population import Population
from truemean.oracle.quantity import CURRENT, Decision, Node, Quantity, Vector, constant, quantity
from truemean.oracle.rings import Exact
from truemean.oracle.rows import Block, Rows
from truemean.oracle.sample import Sample, Segment
from truemean.oracle.symbols import Ratio
from truemean.oracle.tables import Table
from truemean.oracle.wording import text

if TYPE_CHECKING:
    from truemean.oracle.exploration import Exploration

__all__ = ["Path", "Pending", "Point"]

_MOST_DECISIONS = 1_200
_MOST_VALUES = 64


class Point:
    """A place in the tree of paths: the decision asked there, and where its two answers lead."""

    __slots__ = ("asked", "prefix", "sides", "value", "words")

    def __init__(self, prefix: tuple[bool, ...]) -> None:
        self.prefix = prefix
        self.asked: Decision | None = None
        self.words = ("", "")
        self.sides: dict[bool, Point] = {}
        self.value: Fraction | None = None


@dataclass(frozen=True, slots=True)
class Pending:
    """A path not yet run: its answers so far, and its rows (None: to be worked out again)."""

    prefix: tuple[bool, ...]
    rows: Rows | None


class Path:
    """One run of a plan: answers its decisions, keeps its samples, and holds the rows it is about."""

    def __init__(self, exploration: Exploration, task: Pending) -> None:
        self.exploration, self.task = exploration, task
        self.observer = exploration.observer
        self.rows = exploration.start
        self.taken: list[tuple[Point, bool]] = []
        self.forks: list[Pending] = []
        self.samples: list[Sample] = []
        self.draws, self.oracle_calls = 0, Fraction(0)
        self.result: tuple[Quantity, ...] = ()
        self._point, self._ordinal = exploration.root, 0
        self._working = task.rows is None
        if not task.prefix and task.rows is not None:
            self.rows, self._working = task.rows, True

    # -- running -----------------------------------------------------------------------------

    def run(self) -> None:
        """Call the plan; the path then has its result."""
        X = Population(self, self.exploration.pixel)
        token = CURRENT.set(self)
        try:
            self.result = _estimate(self.exploration.function(X, **self.exploration.params), self.exploration.pixel)
        except TruemeanError:
            raise
        except RecursionError:
            raise PlanError("the plan calls itself without end: give the recursion a case that stops") from None
        except Exception as error:
            _check_symbols(error, self.exploration.params)
            chance = self.rows.probability(Exact())
            place = (
                f"on the path {self.text()}, which has probability {short_text(chance)}" if self.taken else "at once"
            )
            error.add_note(f"in a plan, {place}")
            raise
        finally:
            CURRENT.reset(token)
        self._check_own(*self.result)

    def verify(self) -> None:
        """Run once more by recorded answers only: the same estimate must come back."""
        again = Path(self.exploration, Pending(tuple(side for _, side in self.taken), Rows()))
        again.run()
        first, second = ([len(p.taken), len(p.samples), *(r.key for r in p.result)] for p in (self, again))
        if first != second:
            raise NotDeterministic(
                f"the plan returned {_tuple_text(self.result)}, then {_tuple_text(again.result)} on the same path "
                f"({self.text()}): make its own choices with X.coin or X.pick"
            )

    def text(self) -> str:
        """The decisions of the path in words."""
        return ", ".join(self.decisions)

    @property
    def decisions(self) -> list[str]:
        """What was decided, in order; comparisons of constants are not decisions."""
        return [words for point, side in self.taken if (words := point.words[side])]

    # -- decisions ---------------------------------------------------------------------------

    def decide(self, decision: Decision) -> bool:
        """The answer: the recorded one while replaying, else a split of the rows."""
        depth, prefix, point = len(self.taken), self.task.prefix, self._point
        if point.asked is None:
            point.asked = decision
            if leaves(decision):
                point.words = (text(decision, False), text(decision))
        elif point.asked.key != decision.key:
            raise NotDeterministic(
                f"the plan decided {point.asked!r}, then {decision!r} at the same place: "
                f"make its own choices with X.coin or X.pick"
            )
        if depth < len(prefix):
            side = prefix[depth]
            if self._working:
                self.rows = self._split(decision)[0 if side else 1] or self.rows
            elif depth + 1 == len(prefix):
                self.rows, self._working = self.task.rows or self.rows, True
        else:
            side = self._fork(decision)
        self.taken.append((point, side))
        if len(self.taken) > _MOST_DECISIONS:
            alive = self.rows.probability(Float64()).value
            raise PlanError(
                f"more than {_MOST_DECISIONS:,} decisions on one path, with probability {alive:.3g} still alive: "
                f"bound the loop, or use X.draw_until"
            )
        if side not in point.sides:
            point.sides[side] = Point((*point.prefix, side))
        self._point, self._ordinal = point.sides[side], 0
        return side

    def _fork(self, decision: Decision) -> bool:
        yes, no = self._split(decision)
        if yes is not None and no is not None:
            self.forks.append(Pending((*(side for _, side in self.taken), False), no))
        self.rows = yes or no or self.rows
        return yes is not None

    def _split(self, decision: Decision) -> tuple[Rows | None, Rows | None]:
        self._check_own(decision)
        rows, block = self.observer.require(self.rows, leaves(decision), decision)
        return rows.split(block, Evaluator(block, self.exploration.lenient).holds(decision))

    def enumerate(self, asked: Quantity, whole: bool = True) -> Any:
        """One value of a quantity, by a chain of decisions over its distinct values."""
        while True:
            if self._point.asked is None:
                self._point.value = self._smallest(asked, whole)
            value = self._point.value
            if value is None:
                raise NotDeterministic(f"the plan asked for a value of {asked!r} where it had taken a decision before")
            if self.decide(Decision("==", asked, constant(value))):
                return int(value) if whole else value

    def _smallest(self, asked: Quantity, whole: bool) -> Any:
        _, block = self.observer.require(self.rows, leaves(asked), asked)
        values = set(Evaluator(block, self.exploration.lenient).column(asked).fractions())
        if any(isinstance(v, Ratio) for v in values):
            raise NoClosedForm(
                f"{asked!r} has values with symbols in them, so it is no one number: make these concrete"
            )
        if len(values) > _MOST_VALUES:
            raise PlanError(f"{asked!r} has {len(values)} values, too many for one path each: X.draw takes a quantity")
        smallest = min(values)
        if whole and smallest.denominator != 1:
            raise PlanError(f"int({asked!r}) would cut off {short_text(smallest)}: use np.floor or round first")
        return smallest

    def symbol(self, expression: Any) -> Ratio:
        """A formula that the plan computes with."""
        return read(self.exploration.field, expression)

    # -- what a population asks --------------------------------------------------------------

    def check_alive(self, sample: Sample) -> None:
        """A sample belongs to one path; kept beyond it, it means nothing."""
        if CURRENT.get() is not self:
            raise PlanError(f"{sample.name} was drawn in an earlier run of the plan: don't keep samples outside it")

    def _check_own(self, *nodes: Node) -> None:
        for leaf in leaves(*nodes):
            if leaf.args[0].path is not self:
                raise PlanError(
                    f"{leaf!r} is of an earlier run of the plan: don't keep samples or quantities outside it"
                )

    def segment(self, law: Law, n: Any, least: int) -> Segment:
        """Some draws: their number checked, or a quantity kept for later."""

        def tables(size: Any, wanted: Level, asked: str) -> Table:
            return self.exploration.table(law, size, wanted, asked)

        return Segment(self._size(n, least), tables)

    def _size(self, n: Any, least: int) -> Any:
        """A number of draws: an integer, a formula in symbols, or a quantity that differs by row."""
        if isinstance(n, Quantity) and (fixed := _constant(n)) is not None:
            n = fixed
        if not is_symbolic(n) and not isinstance(n, Ratio):
            return _size(n, least)
        size = read_size(self.exploration.field, n)
        if size.is_constant:
            return _size(size.constant, least)
        signs = possible_signs(size - least)
        if signs == {-1}:
            raise InputError(f"n={size} is less than {least} whatever its symbols: give at least {least} draws")
        if -1 in signs:
            self.exploration.field.require(f"{size} >= {least}")
        return size

    def sample(self, law: Law, segments: list[Segment], colour: bool, name: str | None = None) -> Sample:
        """A new sample, known by its place in the tree of paths."""
        if CURRENT.get() is not self:
            raise PlanError(
                f"a draw of {law.name} outside the run of the plan (or inside a stop rule): draw in the plan"
            )
        label = (self._point, self._ordinal)
        self._ordinal += 1
        number = 1 + sum(1 for s in self.samples if s.law.drawn)
        sample = Sample(self, law, label, name or f"S{number}", segments, colour)
        self.samples.append(sample)
        return sample

    def choice(self, weights: list[Quantity], name: str, normalise: bool) -> Quantity:
        """A choice of the estimator itself: a sample of size 1 that costs nothing."""
        if not weights:
            raise InputError(f"{name} has nothing to pick from: give at least one weight")
        fixed = [number for w in weights if (number := _constant(w)) is not None]
        for number in fixed:
            if isinstance(number, Ratio):
                raise NoClosedForm(f"{name} has a probability with a symbol in it, {number}: make it a number")
        if len(fixed) == len(weights):
            chances, total = None, sum(fixed, Fraction(0))
            if min(fixed) < 0 or not total or (not normalise and total != 1):
                raise InputError(f"{name}: probabilities {', '.join(map(str, fixed))} must lie between 0 and 1")
            probabilities = [number / total for number in fixed]
        else:
            chances, probabilities = weights, [Fraction(1, len(weights))] * len(weights)
        key = (name, tuple(probabilities))
        if key not in self.exploration.laws:
            atoms = [(Fraction(i),) for i in range(len(weights))]
            self.exploration.laws[key] = Law(atoms, probabilities, name, cost=Fraction(0))
        law = self.exploration.laws[key]
        sample = self.sample(law, [self.segment(law, 1, 1)], False, name)
        sample.chances = chances
        return Quantity("sum", sample, (0, 1), 0)

    def loop(self, law: Law, colour: bool, stop: Any, start: int, step: int, most: int, parts: int) -> Sample:
        """A sample that grows until ``stop`` holds: one forward recursion instead of a path per size."""
        from truemean.oracle.loops import Loop, sized_segment

        sizes = {"start": start, "step": step, "most": most, "parts": parts}
        loop = Loop.declare(self, law, colour, stop, *(_size(n, 1, name) for name, n in sizes.items()))
        sample = self.sample(law, [], colour)
        sample.segments += [sized_segment(sample, part) for part in range(loop.parts)]
        sample.loop = loop
        if loop.parts > 1:
            self.observer.apart.add(sample.label)
        return sample

    def sub_estimate(self, pixel: Pixel, law: Law, plan: Any, params: dict[str, Any], name: str) -> Sample:
        """A sample of size 1 from the law of another plan's estimate."""
        from truemean.oracle.sub_estimate import sub_law

        check_closed(law, f"a sub-estimate of {name}")
        fixed = {k: self.enumerate(v, whole=False) if isinstance(v, Quantity) else v for k, v in params.items()}
        sub = sub_law(self.exploration, plan, pixel, fixed)
        return self.sample(sub, [self.segment(sub, 1, 1)], sub.channels > 1 or bool(pixel.channels), sub.name)

    def proposal(self, pixel: Pixel, proposal: Any) -> Law:
        """The law of a proposal; the same one on every path."""
        law = proposal_law(pixel, proposal, self.symbol)
        return self.exploration.laws.setdefault(("proposal", pixel.values, pixel.weights, law.weights), law)

    def law_of(self, pixel: Pixel) -> Law:
        """The law of a pixel."""
        return self.exploration.law_of(pixel)

    def spend(self, draws: int = 0, oracle_calls: Fraction = Fraction(0)) -> None:
        """Costs that are no draws of a sample."""
        self.draws += draws
        self.oracle_calls += oracle_calls

    @property
    def cost(self) -> Quantity:
        """The number of draws on this path, as an expression."""
        total = constant(self.draws)
        for sample in self.samples:
            if sample.law.cost:
                total = total + sample.law.cost * quantity(sample.size)
        return total

    @property
    def calls(self) -> Fraction:
        """Oracle calls on this path, those of sub-estimates at their mean."""
        return self.oracle_calls + sum((s.law.oracle_calls for s in self.samples), Fraction(0))


def _constant(node: Quantity) -> Any:
    if leaves(node):
        return None
    return Evaluator(Block((), 1)).column(node).fractions()[0]


def _size(n: Any, least: int, name: str = "n") -> int | Quantity:
    if type(n) is int and n >= least:
        return n
    if isinstance(n, bool):
        raise InputTypeError(f"{name}={n!r} is a truth value: give an integer of at least {least}")
    if isinstance(n, Quantity):
        fixed = _constant(n)
        if fixed is None:
            return n
        n = fixed
    number = exact_number(n, name)
    if number.denominator != 1 or number < least:
        raise InputError(f"{name}={short_text(number)} is not a sample size: give an integer of at least {least}")
    return int(number)


def _check_symbols(error: Exception, params: dict[str, Any]) -> None:
    """PlanError for what Python could not do with a symbol."""
    symbols = [f"{name}={value}" for name, value in params.items() if is_symbolic(value)]
    if symbols and isinstance(error, TypeError):
        raise PlanError(
            f"the plan needs a number where it has a symbol ({', '.join(symbols)}): {error}; make it concrete, "
            f"or use X.draw(n) instead of a loop over range(n)"
        ) from error


def _estimate(result: Any, pixel: Pixel) -> tuple[Quantity, ...]:
    """The estimate by channel; PlanError if it is none."""
    if isinstance(result, Vector | tuple) and pixel.channels == len(result):
        return tuple(_number(part) for part in result)
    if pixel.channels is None:
        return (_number(result),)
    raise PlanError(
        f"the plan returned {result!r} (type={type(result).__name__}) for a pixel of {pixel.channels} channels: "
        f"return a vector such as S.mean(), or a tuple of as many numbers"
    )


def _number(part: Any) -> Quantity:
    if isinstance(part, Quantity):
        return part
    if is_symbolic(part) or (
        isinstance(part, Rational | float | np.integer | np.floating | Ratio) and not isinstance(part, bool)
    ):
        return quantity(part)
    raise PlanError(f"the plan returned {part!r} (type={type(part).__name__}): return a number or a quantity")


def _tuple_text(result: tuple[Quantity, ...]) -> str:
    return ", ".join(map(text, result))
