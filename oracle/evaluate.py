"""Expressions evaluated on the joint rows of a block: exact columns, and decisions that never err."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from truemean.errors import PlanError, UndefinedValue
from truemean.oracle.columns import Column, NotRational, Surd, negation, symbolic, truths
from truemean.oracle.exact import short_text
from truemean.oracle.law import Law
from truemean.oracle.quantity import Decision, Node, Quantity
from truemean.oracle.rows import Block
from truemean.oracle.statistics import Observed, flat, statistic
from truemean.oracle.symbols import HOLDS
from truemean.oracle.wording import text

__all__ = ["Evaluator", "check_closed", "leaves", "row_text"]

Value = Column | Surd


def leaves(*nodes: Node) -> list[Node]:
    """The statistics that expressions look at, each once, in the order met."""
    found: dict[int, Node] = {}
    seen: set[int] = set()

    def visit(node: Node) -> Iterator[Node]:
        if id(node) in seen:
            return
        seen.add(id(node))
        if node.op in ("stat", "mean", "sum", "flat"):
            yield node
        else:
            for argument in node.args:
                if isinstance(argument, Node):
                    yield from visit(argument)

    for node in nodes:
        for leaf in visit(node):
            found.setdefault(leaf.key, leaf)
    return list(found.values())


class Evaluator:
    """Values of quantities and truths of decisions on every joint row of a block.

    ``lenient`` is the policy for 0/0 in comparisons: False raises, True makes them not hold, as in C.
    """

    def __init__(self, block: Block, lenient: bool = False) -> None:
        self.block, self.lenient = block, lenient
        self._known: dict[int, tuple[Node, Any]] = {}

    def value(self, node: Node) -> Value:
        """A quantity on every row; raises NotRational where columns can't hold it."""
        found: Value = self._once(node, self._value)
        return found

    def column(self, node: Node) -> Column:
        """A rational quantity by row (one entry if it is constant); undefined entries raise."""
        value = self.value(node)
        if not isinstance(value, Column):
            raise NotRational(text(node))
        self._complain(value.undefined, node)
        return value

    def holds(self, decision: Node) -> Any:
        """A decision on every row: booleans, or 0/1 Ratios where a symbol decides it."""
        return np.broadcast_to(self._once(decision, self._holds), (self.block.size,))

    def _once(self, node: Node, function: Callable[[Any], Any]) -> Any:
        if id(node) not in self._known:
            self._known[id(node)] = (node, function(node))
        return self._known[id(node)][1]

    # -- quantities --------------------------------------------------------------------------

    def _value(self, node: Quantity) -> Value:
        op, args = node.op, node.args
        if op == "const":
            return Column.constant(args[0])
        if op == "true mean":
            check_closed(args[0], "the true mean beside a sample or in a decision")
            return Column.constant(args[0].mean(args[1]))
        if op in ("stat", "mean", "sum"):
            return statistic(node, self._observed(node))
        if op == "where":
            return self._where(node)
        if op == "**":
            return self._power(node)
        operation = _OPERATIONS.get(op)
        if operation is None:
            raise NotRational(text(node))
        return operation(*(self.value(a) for a in args))

    def _observed(self, leaf: Node) -> Observed:
        first, last = leaf.args[1]
        return Observed([e for e in self.block.entries_of(leaf.args[0]) if first <= e.first and e.last <= last])

    def _where(self, node: Quantity) -> Value:
        condition, yes, no = node.args
        mask = self.holds(condition)
        if not symbolic(mask) and (mask.all() or not mask.any()):
            return self.value(yes if mask.all() else no)
        a, b = self.value(yes), self.value(no)
        if isinstance(a, Column) and isinstance(b, Column):
            return a.where(mask, b)
        raise NotRational(text(node))

    def _power(self, node: Quantity) -> Value:
        base, exponent = node.args
        power = self.value(exponent)
        if not isinstance(power, Column) or len(power) > 1 or int(power.den[0]) not in (1, 2):
            raise NotRational(text(node))
        value = self.value(base)
        if int(power.den[0]) == 2:
            value = _root(value)
        result: Value = Column.constant(1)
        for _ in range(abs(int(power.num[0]))):
            result = _times(result, value)
        return _over(Column.constant(1), result) if power.num[0] < 0 else result

    # -- decisions ---------------------------------------------------------------------------

    def _holds(self, node: Decision) -> Any:
        op, args = node.op, node.args
        if op == "truth":
            return np.array([args[0]])
        if op == "flat":
            holds, undefined = flat(node, self._observed(node))
            return self._decided(holds, undefined, node, otherwise=args[5] == "!=")
        if op == "not":
            return negation(self.holds(args[0]))
        if op in ("and", "or"):
            left, right = self.holds(args[0]), self.holds(args[1])
            if symbolic(left) or symbolic(right):
                both = left * right
                return truths(both if op == "and" else left + right - both)
            return left & right if op == "and" else left | right
        holds, undefined = self._compared(node)
        return self._decided(holds, undefined, node, otherwise=op == "!=")

    def _compared(self, node: Decision) -> tuple[Any, Any]:
        """``(holds, undefined)`` of a comparison."""
        left, right = node.args
        try:
            difference = _plus(self.value(left), _minus(self.value(right)))
            return difference.holds(node.op), difference.undefined
        except NotRational:
            from truemean.oracle.enclose import signs

            found, undefined = signs(self, left, right)
            return HOLDS[node.op](found), undefined

    def _decided(self, holds: Any, undefined: Any, node: Node, otherwise: bool) -> Any:
        if not self.lenient:
            self._complain(undefined, node)
        if not undefined.any():
            return holds
        return (
            truths(np.where(undefined, otherwise, holds)) if symbolic(holds) else np.where(undefined, otherwise, holds)
        )

    def _complain(self, undefined: Any, node: Node) -> None:
        if undefined.any():
            row = int(np.broadcast_to(undefined, (self.block.size,)).argmax())
            raise UndefinedValue(
                f"{text(node)} is undefined (0/0) where {row_text(self.block, row)}; give the statistic "
                f"an undefined= value, guard it with np.where, or declare @plan(undefined='nan')"
            )


def check_closed(law: Law, asked: str) -> None:
    """Refuse what reads weights while these are left open."""
    if law.open:
        raise PlanError(f"the plan reads {asked}, so it has no result at other weights: derive it for each pixel")


def row_text(block: Block, row: int) -> str:
    """What a joint row is, in words."""
    parts = []
    for e in block.entries:
        r, law, name = int(e.index[row]), e.table.law, e.sample.name
        values = [", ".join(map(short_text, v)) for v in law.values]
        if e.table.sizes[r] == 0:
            parts.append(f"{name} is empty")
        elif e.table.knows("counts"):
            counts = e.table.state("counts")[r]
            parts.append(f"{name} drew " + ", ".join(f"{c} x {v}" for v, c in zip(values, counts, strict=True) if c))
        elif e.table.knows("extremes"):
            low, high = (int(e.table.state(x)[r]) for x in ("lowest", "highest"))
            parts.append(f"{name} lies between {values[low]} and {values[high]}")
        elif e.table.knows("flat"):
            atom = int(e.table.state("flat")[r])
            parts.append(f"{name} is mixed" if atom < 0 else f"all of {name} is {values[atom]}")
        elif e.table.knows("sum:0"):
            parts.append(f"{name} sums to {e.table.sums(0)[np.array([r])].fractions()[0]}")
        else:
            parts.append(f"{name} has {e.table.sizes[r]} draws")
    return " and ".join(parts) or "nothing was drawn"


# -- operations ------------------------------------------------------------------------------------


def _plus(a: Value, b: Value) -> Value:
    if isinstance(a, Column):
        return a + b if isinstance(b, Column) else b + a
    return a + b


def _minus(a: Value) -> Value:
    return -a


def _times(a: Value, b: Value) -> Value:
    if isinstance(a, Column):
        return a * b if isinstance(b, Column) else b * a
    return a * b


def _over(a: Value, b: Value) -> Value:
    if isinstance(b, Surd):
        return _times(a, b.inverse())
    return a / b if isinstance(a, Column) else a * (Column.constant(1) / b)


def _root(a: Value) -> Value:
    if isinstance(a, Surd):
        raise NotRational("a root of a root")
    return Surd.root(a)


def _absolute(a: Value) -> Value:
    return _extreme(a, _minus(a), -1)


def _extreme(a: Value, b: Value, sign: int) -> Value:
    """The smaller (sign 1) or larger (sign -1) of two; undefined where either is."""
    difference = _plus(a, _minus(b))
    if not (isinstance(a, Column) and isinstance(b, Column) and isinstance(difference, Column)):
        raise NotRational("an extreme of roots")
    chosen = a.where(difference.holds("<=" if sign > 0 else ">="), b)
    return Column(chosen.num, np.where(difference.undefined, 0, chosen.den))


def _integer(name: str) -> Callable[[Value], Value]:
    def operation(a: Value) -> Value:
        if isinstance(a, Surd):
            raise NotRational(f"{name} of a root")
        rounded: Value = getattr(a, name)()
        return rounded

    return operation


_OPERATIONS: dict[str, Callable[..., Value]] = {
    "+": _plus,
    "-": lambda a, b: _plus(a, _minus(b)),
    "*": _times,
    "/": _over,
    "abs": _absolute,
    "min": lambda a, b: _extreme(a, b, 1),
    "max": lambda a, b: _extreme(a, b, -1),
    "sqrt": _root,
    "floor": _integer("floor"),
    "ceil": _integer("ceil"),
    "round": _integer("round"),
}
