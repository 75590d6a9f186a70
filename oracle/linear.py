"""An estimate read as a linear form in means and sums of samples, as far as it is one."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from fractions import Fraction

from truemean.oracle.assumptions import possible_signs
from truemean.oracle.law import Law
from truemean.oracle.quantity import Decision, Node, Quantity, constant, quantity
from truemean.oracle.symbols import Ratio

__all__ = ["ZERO", "Linear", "Truth", "added_up", "least", "linear", "per_draw", "plus", "times"]

ZERO, ONE = constant(0), constant(1)
Truth = tuple[Law, int]


@dataclass(frozen=True, slots=True)
class Linear:
    """``rest + sum coefficient * mean or sum of a sample + sum coefficient * true mean``."""

    samples: tuple[tuple[Quantity, Quantity], ...] = ()
    truths: tuple[tuple[Truth, Quantity], ...] = ()
    rest: Quantity = field(default_factory=lambda: ZERO)

    def plus(self, other: Linear) -> Linear:
        """The sum of two forms."""
        return Linear(self.samples + other.samples, self.truths + other.truths, plus(self.rest, other.rest))

    def times(self, factor: Quantity) -> Linear:
        """The form times something known on each row."""
        return Linear(
            tuple((leaf, times(c, factor)) for leaf, c in self.samples),
            tuple((truth, times(c, factor)) for truth, c in self.truths),
            times(self.rest, factor),
        )


def linear(node: Quantity) -> Linear:
    """Read an expression as a linear form; what is not linear becomes part of the rest."""
    op, args = node.op, node.args
    if op in ("mean", "sum"):
        return Linear(samples=((node, ONE),))
    if op == "true mean":
        return Linear(truths=(((args[0], args[1]), ONE),))
    if not _has_means(node):
        return Linear(rest=node)
    if op == "+":
        return linear(args[0]).plus(linear(args[1]))
    if op == "-":
        return linear(args[0]).plus(linear(args[1]).times(constant(-1)))
    if op == "*" and not _has_means(args[0], truths=False):
        return linear(args[1]).times(args[0])
    if op == "*" and not _has_means(args[1], truths=False):
        return linear(args[0]).times(args[1])
    if op == "/" and not _has_means(args[1], truths=False):
        return linear(args[0]).times(Quantity("/", ONE, args[1]))
    if op == "where" and (_linear_inside(args[1]) or _linear_inside(args[2])):
        yes = linear(args[1]).times(Quantity("where", args[0], ONE, ZERO))
        return yes.plus(linear(args[2]).times(Quantity("where", args[0], ZERO, ONE)))
    return Linear(rest=node)


def _linear_inside(node: Quantity) -> bool:
    form = linear(node)
    return bool(form.samples or form.truths)


def _has_means(node: Node, truths: bool = True) -> bool:
    if node.op in ("mean", "sum") or (truths and node.op == "true mean"):
        return True
    if node.op in ("stat", "flat", "const"):
        return False
    return any(_has_means(a, truths) for a in node.args if isinstance(a, Node))


def plus(a: Quantity, b: Quantity) -> Quantity:
    """A + b, constants folded."""
    if a.op == b.op == "const":
        return constant(a.args[0] + b.args[0])
    if a.op == "const" and a.args[0] == 0:
        return b
    return a if b.op == "const" and b.args[0] == 0 else Quantity("+", a, b)


def times(a: Quantity, b: Quantity) -> Quantity:
    """A * b, constants folded."""
    if a.op == b.op == "const":
        return constant(a.args[0] * b.args[0])
    for x, y in ((a, b), (b, a)):
        if x.op == "const" and x.args[0] in (0, 1):
            return y if x.args[0] else ZERO
    return Quantity("*", a, b)


def per_draw(leaf: Quantity, coefficient: Quantity) -> Quantity:
    """The coefficient of each draw; 0 where that of the mean is: an empty sample may stand with coefficient 0."""
    if leaf.op == "sum":
        return coefficient
    size = quantity(leaf.args[0].size_of(*leaf.args[1]))
    if coefficient.op == "const" and not coefficient.args[0]:
        return ZERO
    if coefficient.op == size.op == "const":
        return constant(coefficient.args[0] / size.args[0])
    if coefficient.op == "const" or least(size) >= 1:
        return Quantity("/", coefficient, size)
    return Quantity("where", Decision("==", coefficient, ZERO), ZERO, Quantity("/", coefficient, size))


def added_up(nodes: Iterable[Quantity]) -> Quantity:
    """The sum of nodes, constants folded."""
    total = ZERO
    for node in nodes:
        total = plus(total, node)
    return total


def least(node: Node) -> Fraction | float:
    """A lower bound of a size that needs no rows; -inf where it may be no integer."""
    op, args = node.op, node.args
    if op == "const" and isinstance(args[0], Ratio):
        return 1 if possible_signs(args[0]) == {1} else -math.inf
    if op == "const":
        return Fraction(args[0]) if args[0].denominator == 1 else -math.inf
    if op in ("where", "min", "max", "+"):
        first, second = (least(a) for a in args[-2:])
        if op == "+":
            return first + second
        return max(first, second) if op == "max" else min(first, second)
    if op in ("floor", "ceil", "round"):
        inner = least(args[0])
        return inner if inner == -math.inf else math.floor(inner)
    return 0 if op == "stat" and args[2] == "size" else -math.inf
