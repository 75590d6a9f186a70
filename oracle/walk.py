"""The rowless walk: a plan called once per sequence of decisions, on a pixel that stands for any.

Nothing here has values, so a branch that no small pixel reaches is seen too: every decision on
something random or unknown is taken both ways. What is drawn is numbered by where it is drawn in
the tree of paths, hence it is the same on all paths below.
"""

from __future__ import annotations

import operator
from collections.abc import Mapping
from dis import opmap
from fractions import Fraction
from itertools import product
from numbers import Rational
from types import CodeType
from typing import Any, cast

import numpy as np

from truemean.errors import InputError, PlanError, raised
from truemean.oracle.assumptions import read
from truemean.oracle.evaluate import Evaluator, leaves
from truemean.oracle.exact import is_symbolic, short_text
from truemean.oracle.law import Law
from truemean.oracle.paths import Path
from truemean.oracle.plan import Plan, as_plan
from truemean.oracle.quantity import CURRENT, Decision, Node, Quantity, Vector, constant, decision, quantity
from truemean.oracle.rows import Block
from truemean.oracle.sample import Sample, Segment
from truemean.oracle.stand_in import (
    FACTS,
    AnyLaw,
    Drawn,
    NoProof,
    Place,
    Region,
    StandIn,
    Stretch,
    Test,
    Watched,
    checked_size,
    fixed_value,
    is_fixed,
    no_tables,
)
from truemean.oracle.symbols import Field, Ratio
from truemean.oracle.wording import text

__all__ = ["Trail", "Tree"]

_MOST_PATHS, _MOST_DECISIONS, _MOST_ANSWERS = 256, 64, 10_000
_MOST_VALUES = 16
_EXCEPT = opmap["POP_EXCEPT"]
_UNSTEADY = "the plan does not do the same again: X.coin and X.pick make its own choices"
_OPERATIONS: dict[str, Any] = {"+": operator.add, "-": operator.sub, "*": operator.mul, "min": min, "max": max}


class Trail:
    """One run of the plan: the answers that it is told to give, and those that it finds."""

    def __init__(self, tree: Tree, prefix: tuple[bool, ...] = ()) -> None:
        self.tree, self.prefix = tree, prefix
        self.taken: list[tuple[Place, bool]] = []
        self.forks: list[tuple[bool, ...]] = []
        self.samples = 0
        self.place, self._ordinal = tree.root, 0
        self._answers: dict[int, bool] = {}
        self._remaining: dict[int, tuple[int, ...]] = {}
        self._missing: Exception | None = None
        self.refusal: NoProof | None = None

    def run(self) -> None:
        """Call the plan; the place where it ends then has its estimate."""
        token = CURRENT.set(self)
        try:
            found = self._called()
            if not self.place.lacking:
                self._end(found)
        except RecursionError:
            raise NoProof("the plan calls itself without end, or too deep to be followed") from None
        finally:
            CURRENT.reset(token)

    def _called(self) -> Any:
        try:
            found = self.tree.function(StandIn(self, self.tree.regions[0]), **self.tree.params)
        except RecursionError:
            raise
        except Exception as error:
            if error is not self._missing:
                raise NoProof(f"{self.where()} the plan stops: {raised(error)}") from error
            self.place.lacking, found = True, None
        if self.refusal is not None:
            raise self.refusal
        return found

    def _end(self, found: Any) -> None:
        number = isinstance(found, Quantity | Rational | float | np.number) or is_symbolic(found)
        if not number or isinstance(found, bool):
            words = f"the plan returned {found!r} (type={type(found).__name__}): return a number or a quantity"
            if self.taken or isinstance(found, tuple | list | Vector):
                raise NoProof(f"{self.where()} {words}")
            raise PlanError(words)
        place = self.place
        try:
            estimate = quantity(found)
            self._check_own(estimate)
        except InputError as error:
            raise NoProof(f"{self.where()} {error}") from None
        if place.asked is not None or (place.estimate is not None and place.estimate.key != estimate.key):
            raise NoProof(f"{self.where()} {_UNSTEADY}")
        place.estimate = estimate

    def where(self) -> str:
        """The decisions so far, in words."""
        words = [p.words[side] for p, side in self.taken if p.asked is not None and p.asked.op != "fact"]
        return f"where {', '.join(words)}," if words else "at once"

    # -- decisions ---------------------------------------------------------------------------

    def decide(self, asked: Decision) -> bool:
        """The answer: known, told, or both in turn."""
        if asked.op in ("not", "!="):
            return not self.decide(asked.args[0] if asked.op == "not" else Decision("==", *asked.args))
        self._check_own(asked)
        if is_fixed(asked):
            return bool(Evaluator(Block((), 1), self.tree.lenient).holds(asked)[0])
        test = self._test(asked)
        if test is not None and (test.option not in test.remaining or len(test.remaining) == 1):
            return test.option in test.remaining
        if asked.key not in self._answers:
            side = self._fork(asked, test)
            if test is not None:
                others = tuple(o for o in test.remaining if o != test.option)
                self._remaining[test.choice] = (test.option,) if side else others
            if any(leaf.op == "stat" and leaf.args[2] in ("custom", "weighted") for leaf in leaves(asked)):
                return side  # a function may have another closure next time
            self._answers[asked.key] = side
        return self._answers[asked.key]

    def _fork(self, asked: Decision, test: Test | None) -> bool:
        place, depth = self.place, len(self.taken)
        if place.estimate is not None or (place.asked is not None and place.asked.key != asked.key):
            raise NoProof(f"{self.where()} {_UNSTEADY}")
        if depth == _MOST_DECISIONS:
            raise NoProof(f"the plan takes more than {_MOST_DECISIONS} decisions on one path")
        if place.asked is None:
            place.asked, place.test = asked, test
            place.words = FACTS[asked.args[0]] if asked.op == "fact" else (text(asked, side=False), text(asked))
        if depth >= len(self.prefix):
            self.forks.append((*(side for _, side in self.taken), False))
        side = self.prefix[depth] if depth < len(self.prefix) else True
        self.taken.append((place, side))
        self.place, self._ordinal = place.sides.setdefault(side, Place()), 0
        return side

    def _test(self, asked: Decision) -> Test | None:
        """The decision as one on a choice of the estimator and nothing else, with the options that remain."""
        found = self.tree.choice_asked(asked)
        if found is None:
            return None
        possible = [i for i, weight in enumerate(self.tree.draws[found[0]].looks) if fixed_value(weight) != 0]
        return Test(*found, self._remaining.get(found[0], tuple(possible)))

    def enumerate(self, asked: Quantity, whole: bool = True) -> Any:
        """One value of a quantity of few possible values, by a chain of decisions."""
        *most, last = sorted(self.values(asked))
        value = next((v for v in most if self.decide(Decision("==", asked, constant(v)))), last)
        if whole and value.denominator != 1:
            raise PlanError(f"int({asked!r}) would cut off {short_text(value)}: use np.floor or round first")
        return int(value) if whole else value

    def values(self, node: Quantity) -> set[Fraction]:
        """What a quantity can be, where its form shows it."""
        number, op, args = fixed_value(node), node.op, node.args
        if number is not None:
            return {number}
        found: set[Fraction] = set()
        if op == "where":
            found = self.values(args[1]) | self.values(args[2])
        elif op in _OPERATIONS:
            found = {_OPERATIONS[op](a, b) for a, b in product(self.values(args[0]), self.values(args[1]))}
        elif op == "sum" and (drawn := self.tree.draws[args[0].segments[0].drawn]).kind == "choice":
            found = set(map(Fraction, range(len(drawn.looks))))
        if not 0 < len(found) <= _MOST_VALUES:
            raise NoProof(f"the plan makes a plain number of {text(node)}")
        return found

    def symbol(self, expression: Any) -> Ratio:
        """A formula that the plan computes with."""
        return read(self.tree.field, expression)

    def fact(self, kind: str, world: int) -> bool:
        """Whether the pixel is of a kind: nothing random, and not known either."""
        return self.decide(Decision("fact", kind, world))

    def lacks(self, error: Exception) -> Exception:
        """An error of the pixel, not of the plan."""
        self._missing = error
        return error

    # -- what is drawn -----------------------------------------------------------------------

    def check_alive(self, sample: Sample) -> None:
        """A sample belongs to one path."""
        if CURRENT.get() is not self:
            raise PlanError(f"{sample.name} was drawn in an earlier run of the plan: don't keep it outside")

    def _check_own(self, node: Node) -> None:
        if any(leaf.args[0].path is not self for leaf in leaves(node)):
            raise PlanError(f"{node!r} is of an earlier run of the plan: don't keep samples or quantities outside it")

    def _drawn(self, name: str, kind: str, region: int, size: Any = 1, looks: tuple[Node, ...] = ()) -> int:
        """The number of something random by its place; the same when it is drawn again."""
        for node in looks:
            self._check_own(node)
        place, draws = self.place, self.tree.draws
        if self._ordinal == len(place.draws):
            place.draws.append(len(draws))
            draws.append(Drawn(len(draws), name, kind, region, size, looks))
        number = place.draws[self._ordinal]
        self._ordinal += 1
        if draws[number].shape != Drawn(number, name, kind, region, size, looks).shape:
            raise NoProof(f"{self.where()} {_UNSTEADY}")
        return number

    def stretch(self, law: Any, n: Any, least: int, name: str) -> Stretch:
        """Some draws, their number checked as far as it is known."""
        size = checked_size(n, least)
        drawn = self._drawn(name, "sample", law.region, size, (size,) if isinstance(size, Quantity) else ())
        return Stretch(size, no_tables, drawn)

    def sample(self, law: Law, segments: list[Segment], name: str) -> Watched:
        """A new sample, known by the number of its first draws."""
        if CURRENT.get() is not self:
            raise PlanError(f"a draw of {law.name} outside the run of the plan, or in a stop rule: draw in the plan")
        return Watched(cast("Path", self), law, cast("Stretch", segments[0]).drawn, name, segments, colour=False)

    def loop(self, law: Any, stop: Any, start: Any, step: Any, most: Any, parts: Any) -> Sample:
        """A sample that decides by itself when it stops, so that its mean is no sample mean."""
        start, step, most, parts = (checked_size(n, 1) for n in (start, step, most, parts))
        if not all(isinstance(n, int) for n in (start, step, most, parts)) or most < start or parts > 2:
            raise InputError(f"start={start}, step={step}, most={most}, parts={parts}: no such loop")
        self.samples += 1
        name = f"S{self.samples}"
        numbers = [self._drawn(name, "stopped", law.region) for _ in range(parts)]
        views = [self._stopped(law, name, [number]) for number in numbers]
        token = CURRENT.set(None)
        try:
            asked = decision(stop(*views))
        finally:
            CURRENT.reset(token)
        self._check_own(asked)
        self.tree.stops.update(dict.fromkeys(numbers, (asked,)))
        return self._stopped(law, name, numbers)

    def _stopped(self, law: Law, name: str, numbers: list[int]) -> Sample:
        sample = self.sample(law, [Stretch(1, no_tables, number) for number in numbers], name)
        for place, number in enumerate(numbers):
            size = Quantity("stat", sample, (place, place + 1), "size", 0, None)
            sample.segments[place] = Stretch(size, no_tables, number)
        return sample

    def estimate(self, region: Region, plan: Any, params: dict[str, Any]) -> Any:
        """A sub-estimate: as good as a sample mean if its plan is proved for all that its parameters can be."""
        declared = as_plan(plan)
        possible = [self.values(v) if isinstance(v, Quantity) else [v] for v in params.values()]
        refusal = self.refusal
        found = [self.tree.prove(declared, dict(zip(params, some, strict=True))) for some in product(*possible)]
        self.refusal = refusal  # those of the inner plan are none of this one
        kind = "estimate" if all(proof.proved for proof in found) else "opaque"
        name = f"estimate of {declared.name} on {region.law.name}"
        drawn = self._drawn(name, kind, region.number, 1, tuple(v for v in params.values() if isinstance(v, Quantity)))
        self.tree.inner[drawn] = next(p for p in found if p.proved == (kind == "estimate"))
        return self.sample(AnyLaw(name, cost=0), [Stretch(1, no_tables, drawn)], name).mean()

    def choice(self, weights: list[Quantity], name: str, normalise: bool) -> Quantity:
        """A choice of the estimator itself; its chances are what it looks at."""
        fixed = [fixed_value(w) for w in weights]
        known = [chance for chance in fixed if chance is not None]
        if not weights or (
            len(known) == len(fixed) and not (min(known) >= 0 and (sum(known) == 1 or (normalise and any(known))))
        ):
            raise InputError(f"{name}: probabilities {', '.join(map(text, weights))} must lie between 0 and 1")
        drawn = self._drawn(name, "choice", -1, 1, tuple(weights))
        sample = self.sample(AnyLaw(name, cost=0), [Stretch(1, no_tables, drawn)], name)
        return Quantity("sum", sample, (0, 1), 0)


class Tree:
    """All paths of a plan, with whatever is drawn on them."""

    def __init__(self, plan: Plan, params: dict[str, Any], declared: Mapping[str, Any] | None, prove: Any) -> None:
        self.function, self.lenient, self.params = plan.function, plan.undefined == "nan", params
        self.declared, self.prove = declared, prove
        self.field, self.root = Field(), Place()
        self.draws: list[Drawn] = []
        self.stops: dict[int, tuple[Decision, ...]] = {}
        self.inner: dict[int, Any] = {}
        self.regions = [Region(0, AnyLaw("X", 0), Quantity("area", "X"), 0)]
        self.partitions: dict[tuple[int, str], list[Region]] = {}
        self.paths = 0

    def walk(self) -> None:
        """Run every path, each a second time to see that it is the same again."""
        if _catches(getattr(self.function, "__code__", None)):
            raise NoProof("the plan catches errors, which may depend on the pixel")
        pending: list[tuple[bool, ...]] = [()]
        answers = 0
        while pending:
            trail = Trail(self, pending.pop())
            trail.run()
            again = Trail(self, tuple(side for _, side in trail.taken))
            again.run()
            if again.place is not trail.place or again.samples != trail.samples:
                raise NoProof(f"{trail.where()} {_UNSTEADY}")
            pending += trail.forks
            self.paths += 1
            answers += len(trail.taken)
            if self.paths + len(pending) > _MOST_PATHS or answers > _MOST_ANSWERS:
                raise NoProof(f"the plan takes too many decisions: more than {_MOST_PATHS} paths, or long ones")

    def choice_asked(self, asked: Node) -> tuple[int, int] | None:
        """The choice, and the option, that a decision asks for if it asks nothing else."""
        if asked.op != "==" or asked.args[0].op != "sum" or not is_fixed(asked.args[1]):
            return None
        drawn = self.draws[asked.args[0].args[0].segments[0].drawn]
        option = fixed_value(asked.args[1])
        whole = option is not None and option.denominator == 1
        return (drawn.number, int(option or 0) if whole else -1) if drawn.kind == "choice" else None

    def parted(self, whole: Region, kind: str, areas: Mapping[str, Any], own: bool) -> list[Region]:
        """The parts of a region under a way to part it."""
        key = (whole.number, kind)
        if key not in self.partitions:
            self.partitions[key] = []
            for name, area in areas.items():
                number = len(self.regions)
                self.regions.append(Region(number, AnyLaw(name, number), area, number if own else whole.world))
                self.partitions[key].append(self.regions[-1])
        return self.partitions[key]


def _catches(code: Any) -> bool:
    """Whether a function has an ``except`` in it."""
    return isinstance(code, CodeType) and (_EXCEPT in code.co_code[::2] or any(map(_catches, code.co_consts)))
