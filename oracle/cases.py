"""What an estimate is, case by case: rational functions of sample means and whatever else enters it.

Means, true means, areas and statistics are independent indeterminates, so that an identity of two
formulas is one for every pixel. `np.where` makes cases, told apart in one order, so that equal
formulas are equal objects.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

from truemean.oracle.assumptions import read
from truemean.oracle.evaluate import Evaluator, leaves
from truemean.oracle.exact import is_symbolic
from truemean.oracle.quantity import Decision, Node, Quantity, constant, quantity
from truemean.oracle.rows import Block
from truemean.oracle.stand_in import NoProof, fixed_value, function_key, is_fixed
from truemean.oracle.symbols import Generator, Ratio
from truemean.oracle.walk import Tree
from truemean.oracle.wording import text

__all__ = ["Formulas", "Split", "conditions", "each", "ratios", "restricted", "used_generators"]

_MOST_TERMS, _MOST_CONDITIONS, _MOST_POWER, _MOST_OPTIONS = 1_000, 6, 8, 7
_ARITHMETIC: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
}
_NEGATED = {">": "<=", "<": ">="}


@dataclass(frozen=True, slots=True)
class Split:
    """One formula where a condition holds, another where it does not; conditions ascend inwards."""

    condition: int
    yes: Any
    no: Any


def each(operation: Callable[..., Any], *formulas: Any) -> Any:
    """An operation in every case; None, what is undefined, stays so."""
    split = [f.condition for f in formulas if isinstance(f, Split)]
    if not split:
        return _defined(operation, formulas)
    first = min(split)
    yes, no = (each(operation, *(_side(f, first, side) for f in formulas)) for side in (True, False))
    return yes if yes == no else Split(first, yes, no)


def ratios(formula: Any) -> Iterator[Any]:
    """The formula in every case."""
    if isinstance(formula, Split):
        yield from ratios(formula.yes)
        yield from ratios(formula.no)
    else:
        yield formula


def conditions(formula: Any) -> set[int]:
    """The conditions that a formula depends on."""
    if not isinstance(formula, Split):
        return set()
    return {formula.condition} | conditions(formula.yes) | conditions(formula.no)


def restricted(formula: Any, condition: int, side: bool) -> Any:
    """The formula where an answer is known."""
    if not isinstance(formula, Split) or formula.condition > condition:
        return formula
    if formula.condition == condition:
        return _side(formula, condition, side)
    yes, no = (restricted(f, condition, side) for f in (formula.yes, formula.no))
    return yes if yes == no else Split(formula.condition, yes, no)


def _side(formula: Any, condition: int, side: bool) -> Any:
    if isinstance(formula, Split) and formula.condition == condition:
        return formula.yes if side else formula.no
    return formula


def _defined(operation: Callable[..., Any], numbers: tuple[Any, ...]) -> Any:
    if any(number is None for number in numbers):
        return None
    try:
        found = operation(*numbers)
    except ZeroDivisionError:
        return None
    if isinstance(found, Ratio) and max(map(len, found.lifted())) > _MOST_TERMS:
        raise NoProof("the estimate is too long a formula")
    return found


class Formulas:
    """The expressions of a plan as formulas, and the draws that each looks at."""

    def __init__(self, tree: Tree) -> None:
        self.tree, self.field = tree, tree.field
        self.words: dict[int, str] = {}  # of generators
        self.tests: dict[int, tuple[int, int]] = {}  # conditions on a choice alone: which, and the option
        self._looks: dict[int, frozenset[int]] = {}  # generators and conditions: what they look at
        self._of_condition: dict[int, Decision] = {}
        self._numbers: dict[Any, int] = {}
        self._met: dict[int, tuple[Node, int]] = {}
        self._values: dict[int, Any] = {}
        self._reads: dict[int, frozenset[int]] = {}
        self._behind: dict[int, frozenset[int]] = {}

    # -- what is looked at ---------------------------------------------------------------------

    def behind(self, drawn: int) -> frozenset[int]:
        """A draw and all that its size, chances or parameters look at in turn."""
        if drawn not in self._behind:
            found, open_draws = {drawn}, [drawn]
            while open_draws:
                number = open_draws.pop()
                nodes = [*self.tree.draws[number].looks, *self.tree.stops.get(number, ())]
                new = {d for node in nodes for d in _draws_in(node)} - found
                found |= new
                open_draws += new
            self._behind[drawn] = frozenset(found)
        return self._behind[drawn]

    def reads(self, node: Node) -> frozenset[int]:
        """The draws that an expression looks at, directly or behind what it looks at."""
        number = self.number(node)
        if number not in self._reads:
            self._reads[number] = frozenset().union(*map(self.behind, _draws_in(node)))
        return self._reads[number]

    def looks_at(self, formula: Any) -> frozenset[int]:
        """The draws that the value of a formula depends on."""
        found = {d for c in conditions(formula) for d in self.reads(self._of_condition[c])}
        used = {i for ratio in ratios(formula) if ratio is not None for i in used_generators(ratio)}
        return frozenset(found).union(*(self._looks.get(i, ()) for i in used))

    # -- generators ----------------------------------------------------------------------------

    def mean(self, drawn: int) -> Ratio:
        """The sample mean of some draws."""
        name = self.tree.draws[drawn].name
        return self._generator(("mean", drawn), f"mean({name})", self.behind(drawn))

    def true_mean(self, region: int) -> Ratio:
        """The true mean of a region."""
        name = self.tree.regions[region].law.name
        return self._generator(("true mean", region), f"true mean of {name}" if region else "true mean")

    def place(self, generator: Ratio) -> int:
        """The number of a generator."""
        (found,) = used_generators(generator)
        return found

    def _generator(self, key: Any, words: str, looks: frozenset[int] = frozenset()) -> Ratio:
        found = self.field.generator(key, Generator(words, "opaque"))
        number = self.field.place(key) or 0
        self.words[number], self._looks[number] = words, looks
        return found

    def number(self, node: Node) -> int:
        """The number of an expression: the same for the same one, and for no other."""
        if id(node) not in self._met:
            parts = [self.number(a) if isinstance(a, Node) else self._part(a, node) for a in node.args]
            if node.op in ("stat", "mean", "sum", "flat"):
                parts[:2] = [_stretches(node)]
            self._met[id(node)] = (node, self._numbers.setdefault((node.op, *parts), len(self._numbers)))
        return self._met[id(node)][1]

    def _part(self, argument: Any, node: Node) -> Any:
        if argument == "weighted":
            return "weighted", id(node)
        if hasattr(argument, "function"):
            return function_key(argument.function), argument.ordered
        return type(argument), argument

    # -- formulas ------------------------------------------------------------------------------

    def value(self, node: Any) -> Any:
        """A quantity as a formula; long ones from the inside out."""
        waiting = [node]
        while waiting:
            top = waiting[-1]
            parts = [a for a in top.args if isinstance(a, Quantity)] if top.op in (*_ARITHMETIC, "where") else []
            parts = [a for a in parts if self.number(a) not in self._values]
            waiting += parts
            if not parts:
                self._values[self.number(waiting.pop())] = found = self._value(top)
                if len(conditions(found)) > _MOST_CONDITIONS:
                    raise NoProof(f"the estimate depends on more than {_MOST_CONDITIONS} conditions of np.where")
        return self._values[self.number(node)]

    def _value(self, node: Any) -> Any:
        op, args = node.op, node.args
        if op == "const":
            return self.field.number(args[0])
        if op in ("mean", "sum"):
            return self._average(node)
        if op == "true mean":
            return self.true_mean(args[0].region)
        if op in _ARITHMETIC:
            return each(_ARITHMETIC[op], *(self._values[self.number(a)] for a in args))
        if op == "**" and (power := fixed_value(args[1])) is not None and abs(power) in range(_MOST_POWER + 1):
            return each(lambda base: base ** int(power), self.value(args[0]))
        if op == "where":
            sides = (self._values[self.number(a)] for a in args[1:])
            return each(lambda c, a, b: a if c else b, self.truth(args[0]), *sides)
        return self._generator(("node", self.number(node)), text(node), self.reads(node))

    def _average(self, node: Node) -> Any:
        """A mean or sum by the draws that were made at once: the mean of all is weighted by their numbers."""
        drawn, sizes = _stretches(node), [s.size for s in _segments(node)]
        if self.tree.draws[drawn[0]].kind == "choice":
            return self._chosen(node, drawn[0])
        if node.op == "mean" and len(drawn) == 1:
            return self.mean(drawn[0])
        counts = [self.value(quantity(size)) for size in sizes]
        total = self.field.number(0)
        for count, number in zip(counts, drawn, strict=True):
            total = each(lambda t, n, m: t + n * m, total, count, self.mean(number))
        if node.op == "sum":
            return total
        return each(lambda t, *ns: t / sum(ns[1:], ns[0]), total, *counts)

    def _chosen(self, node: Node, drawn: int) -> Any:
        """What was picked, case by case."""
        options = len(self.tree.draws[drawn].looks)
        if options > _MOST_OPTIONS:
            raise NoProof(f"{self.tree.draws[drawn].name} has more than {_MOST_OPTIONS} options")
        found: Any = self.field.number(options - 1)
        for option in range(options - 1):
            holds = self.truth(Decision("==", node, constant(option)))
            found = each(lambda c, a, b: a if c else b, holds, self.field.number(option), found)
        return found

    def truth(self, node: Any) -> Any:
        """A decision by cases, True or False in each."""
        op, args = node.op, node.args
        if op == "truth":
            return bool(args[0])
        if op == "not":
            return each(operator.not_, self.truth(args[0]))
        if op in ("and", "or"):
            both = {"and": operator.and_, "or": operator.or_}[op]
            return each(both, self.truth(args[0]), self.truth(args[1]))
        if op == "!=" or (op in _NEGATED and not self.tree.lenient):
            return each(operator.not_, self.truth(Decision(_NEGATED.get(op, "=="), *args)))
        if is_fixed(node):
            return bool(Evaluator(Block((), 1), self.tree.lenient).holds(node)[0])
        number = self.number(node)
        self._of_condition[number] = node
        test = self.tree.choice_asked(node)
        if test is not None:
            self.tests[number] = test
        return Split(number, yes=True, no=False)

    # -- areas ---------------------------------------------------------------------------------

    def spread(self, ratio: Ratio) -> Ratio:
        """The true mean of a region's last part is what the others leave of the region: so areas are compared."""
        if not used_generators(ratio) & self._last.keys():
            return ratio
        num, den = map(self._evaluated, ratio.lifted())
        spread: Ratio = num / den
        return spread

    def _evaluated(self, polynomial: Any) -> Ratio:
        field, total = self.field, self.field.number(0)
        for powers, coefficient in polynomial.to_dict().items():
            factors = [self._last.get(i) or Ratio(field, field.context.gen(i)) for i, e in enumerate(powers) if e]
            term = field.number(int(coefficient))
            for factor, power in zip(factors, filter(None, powers), strict=True):
                term *= factor ** int(power)
            total += term
        return total

    @cached_property
    def _last(self) -> dict[int, Ratio]:
        """The true means of last parts, by their generators, in terms of those of all other regions."""
        found: dict[int, Ratio] = {}
        for (whole, _), parts in self.tree.partitions.items():
            *others, last = (self.true_mean(part.number) for part in parts)
            *areas, rest = (self._area(part.area) for part in parts)
            left = self.true_mean(whole)
            left = found.get(self.place(left), left)
            for area, mean in zip(areas, others, strict=True):
                left -= area * mean
            found[self.place(last)] = left / rest
        return found

    def _area(self, area: Any) -> Any:
        if isinstance(area, Quantity):
            return self.value(area)
        return read(self.field, area) if is_symbolic(area) else self.field.number(area)

    # -- words ---------------------------------------------------------------------------------

    def say(self, formula: Any) -> str:
        """A formula in words."""
        if isinstance(formula, Split):
            yes, no = self.say(formula.yes), self.say(formula.no)
            return f"{yes} where {text(self._of_condition[formula.condition])}, else {no}"
        if formula is None:
            return "undefined"
        num, den = formula.lifted()
        scale = Fraction(1, int(den.leading_coefficient())) if den.is_constant() else Fraction(1)
        above = self._polynomial(num, scale)
        return above if den.is_constant() else f"({above}) / ({self._polynomial(den, Fraction(1))})"

    def _polynomial(self, polynomial: Any, scale: Fraction) -> str:
        terms = []
        for powers, coefficient in polynomial.to_dict().items():
            names = [self.words.get(i) or str(self.field.generators[i].expression) for i, e in enumerate(powers) if e]
            factors = [f"{n}^{e}" if e > 1 else n for n, e in zip(names, filter(None, powers), strict=True)]
            number = scale * int(coefficient)
            terms.append(" * ".join(factors if factors and number == 1 else [str(number), *factors]))
        return " + ".join(terms) or "0"


def used_generators(ratio: Ratio) -> set[int]:
    """The generators in a Ratio."""
    return {i for part in ratio.lifted() for i, degree in enumerate(part.degrees()) if degree > 0}


def _segments(node: Node) -> Any:
    sample, (first, last) = node.args[:2]
    return sample.segments[first:last]


def _stretches(node: Node) -> tuple[int, ...]:
    return tuple(segment.drawn for segment in _segments(node))


def _draws_in(node: Node) -> set[int]:
    return {number for leaf in leaves(node) for number in _stretches(leaf)}
