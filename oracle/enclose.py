"""Irrational expressions by row: enclosures in ball arithmetic, and comparisons that still are exact.

A comparison of roots ends even on a tie: below its separation bound an algebraic number is zero
(Burnikel, Funke, Mehlhorn, Schirra & Schmitt 2009).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
from flint import arb, ctx, fmpq

from truemean.errors import NoClosedForm, UndecidedTie
from truemean.oracle.columns import Column, NotRational, Surd, symbolic
from truemean.oracle.quantity import Node, Quantity
from truemean.oracle.wording import text

if TYPE_CHECKING:
    from truemean.oracle.evaluate import Evaluator

__all__ = ["enclosures", "precision", "signs"]

_MOST_BITS = 10_000


def signs(evaluator: Evaluator, left: Node, right: Node) -> tuple[Any, Any]:
    """``(sign of left - right, undefined)`` by row."""
    from truemean.oracle.evaluate import row_text

    difference = Quantity("-", left, right)
    rows = evaluator.block.size
    found, undefined = np.zeros(rows, dtype=np.int64), np.zeros(rows, dtype=bool)
    open_rows = list(range(rows))
    enclosures(evaluator, difference, bits := 64)  # complains first of what is no number
    separation = _separation(evaluator, difference)
    while open_rows:
        balls = enclosures(evaluator, difference, bits)
        threshold = arb(2) ** -separation if separation is not None else None
        still = []
        for row in open_rows:
            ball = balls[row]
            if not ball.is_finite() and bits >= 256:
                undefined[row] = True
            elif ball > 0 or ball < 0:
                found[row] = 1 if ball > 0 else -1
            elif threshold is None or not abs(ball) < threshold:
                still.append(row)
        open_rows = still
        if open_rows and bits >= max(_MOST_BITS, 2 * (separation or 0)):
            raise UndecidedTie(
                f"{text(left)} and {text(right)} agree to {bits} bits where {row_text(evaluator.block, open_rows[0])}; "
                f"compare something rational instead"
            )
        bits *= 2
    return found, undefined


def enclosures(evaluator: Evaluator, node: Node, bits: int) -> list[arb]:
    """A ball around the value of a quantity on every row, computed with ``bits`` bits."""
    with precision(bits):
        balls = _Enclosing(evaluator).balls(node)
        return balls if len(balls) == evaluator.block.size else balls * evaluator.block.size


@contextmanager
def precision(bits: int) -> Iterator[None]:
    """Compute with so many bits, and with as many as before afterwards."""
    before, ctx.prec = ctx.prec, bits
    try:
        yield
    finally:
        ctx.prec = before


class _Enclosing:
    def __init__(self, evaluator: Evaluator) -> None:
        self.evaluator = evaluator

    def balls(self, node: Node) -> list[arb]:
        try:
            return _from_value(self.evaluator.value(node))
        except NotRational:
            pass
        if node.op == "where":
            mask = self.evaluator.holds(node.args[0])
            yes, no = self._spread(node.args[1]), self._spread(node.args[2])
            return [a if m else b for m, a, b in zip(mask, yes, no, strict=True)]
        operation = _BALLS.get(node.op)
        if operation is None:
            raise NotRational(text(node))
        lists = [self._spread(a) for a in node.args]
        return [operation(*row) for row in zip(*lists, strict=True)]

    def _spread(self, node: Node) -> list[arb]:
        balls = self.balls(node)
        return balls * self.evaluator.block.size if len(balls) == 1 else balls


def _from_value(value: Column | Surd) -> list[arb]:
    if isinstance(value, Column):
        if symbolic(value.num):
            raise NoClosedForm(f"{value.num[0]} is under several roots or in a function: make its symbols numbers")
        return [arb(fmpq(int(a), int(b))) if b else arb("nan") for a, b in zip(*_parts(value), strict=True)]
    rational, factor, radicand = (_from_value(c) for c in (value.rational, value.factor, value.radicand))
    rows = max(map(len, (rational, factor, radicand)))
    wide = [x * rows if len(x) == 1 else x for x in (rational, factor, radicand)]
    return [a + b * c.sqrt() for a, b, c in zip(*wide, strict=True)]


def _parts(column: Column) -> tuple[list[int], list[int]]:
    rows = len(column)
    return np.broadcast_to(column.num, rows).tolist(), np.broadcast_to(column.den, rows).tolist()


def _round(x: arb) -> arb:
    return (x + arb(fmpq(1, 2))).floor()


_BALLS: dict[str, Callable[..., arb]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "**": lambda a, b: a**b,
    "abs": abs,
    "min": lambda a, b: a.min(b),
    "max": lambda a, b: a.max(b),
    "sqrt": lambda a: a.sqrt() if a < 0 or a > 0 else a.nonnegative_part().sqrt(),
    "exp": lambda a: a.exp(),
    "log": lambda a: a.log(),
    "floor": lambda a: a.floor(),
    "ceil": lambda a: a.ceil(),
    "round": _round,
}


# -- separation bounds -------------------------------------------------------------------------------


def _separation(evaluator: Evaluator, node: Node) -> int | None:
    """Bits b such that the value, if not 0, is at least 2^-b on every row; None if transcendental."""
    roots: set[int] = set()
    bounds = _bound(evaluator, node, roots)
    if bounds is None or len(roots) > 12:
        return None
    upper, lower = bounds
    bits = ((1 << len(roots)) - 1) * upper + lower + 2
    return int(bits) if bits <= _MOST_BITS * 4 else None


def _bound(evaluator: Evaluator, node: Node, roots: set[int]) -> tuple[Fraction, Fraction] | None:
    """log2 of the (u, l) bounds of an expression with square roots."""
    try:
        value = evaluator.value(node)
    except NotRational:
        value = None
    if isinstance(value, Column):
        return _bits(value.num), _bits(value.den)
    if isinstance(value, Surd):
        roots.add(node.key)
        a, b, c = ((_bits(x.num), _bits(x.den)) for x in (value.rational, value.factor, value.radicand))
        half = ((c[0] + c[1]) / 2, c[1])
        return _sum_bound(a, (b[0] + half[0], b[1] + half[1]))
    parts = [_bound(evaluator, a, roots) for a in node.args if isinstance(a, Quantity)]
    if any(p is None for p in parts):
        return None
    known = [p for p in parts if p is not None]
    if node.op in ("+", "-"):
        return _sum_bound(*known)
    if node.op == "*":
        return known[0][0] + known[1][0], known[0][1] + known[1][1]
    if node.op == "/":
        return known[0][0] + known[1][1], known[0][1] + known[1][0]
    if node.op == "sqrt":
        roots.add(node.key)
        return (known[0][0] + known[0][1]) / 2, known[0][1]
    if node.op in ("min", "max", "abs", "where"):
        return max(k[0] for k in known), max(k[1] for k in known)
    return None


def _sum_bound(a: tuple[Fraction, Fraction], b: tuple[Fraction, Fraction]) -> tuple[Fraction, Fraction]:
    return max(a[0] + b[1], b[0] + a[1]) + 1, a[1] + b[1]


def _bits(array: Any) -> Fraction:
    return Fraction(max((abs(int(x)).bit_length() for x in array), default=0))
