"""The whole law of an estimate: values by row, and convolution over independent blocks."""

from __future__ import annotations

import math
import operator
from fractions import Fraction
from typing import Any

from truemean.oracle.columns import Column, grouping, integers, quotient
from truemean.oracle.evaluate import Evaluator, leaves
from truemean.oracle.linear import linear, per_draw
from truemean.oracle.paths import Path
from truemean.oracle.quantity import Quantity, constant
from truemean.oracle.rings import Ring
from truemean.oracle.rows import Block, Rows, product
from truemean.oracle.symbols import Ratio

__all__ = ["joined_law", "observed"]

Key = tuple[Any, ...]
Observed = tuple[Rows, list[list[Quantity]]]


def joined_law(by_path: list[Observed], ring: Ring, lenient: bool, colour: bool) -> dict[Any, Any]:
    """``{value of xi: probability}`` over all paths, ascending."""
    law: dict[Any, Any] = {}
    for rows, values in by_path:
        for value, probability in _path_law(rows, values, ring, lenient).items():
            key = value if colour else value[0]
            law[key] = law[key] + probability if key in law else probability
    if any(isinstance(x, Ratio) for value in law for x in (value if colour else (value,))):
        return law
    return dict(sorted(law.items()))


def observed(path: Path) -> Observed:
    """Everything that the estimate is made of, observed: additive terms may stay in separate blocks."""
    rows, by_channel = path.rows, []
    for estimate in path.result:
        form = linear(estimate)
        terms = [per_draw(leaf, coefficient) * Quantity("sum", *leaf.args) for leaf, coefficient in form.samples]
        terms += [constant(law.mean(c)) * coefficient for (law, c), coefficient in form.truths]
        by_channel.append([*terms, form.rest])
    path.observer.keep_versions(path.rows, leaves(*path.result))
    for terms in by_channel:
        for term in terms:
            rows, _ = path.observer.require(rows, leaves(term), term)
    return rows, by_channel


def _path_law(rows: Rows, by_channel: list[list[Quantity]], ring: Ring, lenient: bool) -> dict[Any, Any]:
    """Integer keys over one denominator by channel: laws of blocks by value, then their convolution."""
    blocks = [*(b for b in rows.blocks if b.entries), Block((), 1)]
    evaluators = [Evaluator(block, lenient) for block in blocks]
    columns = [[_block_value(e, rows, terms) for terms in by_channel] for e in evaluators]
    units = [math.lcm(*(c[i].common()[1] for c in columns)) for i in range(len(by_channel))]
    law: dict[Key, Any] = {(0,) * len(units): 1}
    unit = 1
    for block, values in zip(blocks, columns, strict=True):
        if block.entries:
            block_law, scale = _block_law(
                block, [v * Column.constant(u) for v, u in zip(values, units, strict=True)], ring
            )
            law = _convolved(law, block_law)
            unit *= scale
        else:
            shift = [_whole((v * Column.constant(u)).fractions()[0]) for v, u in zip(values, units, strict=True)]
            law = {tuple(a + b for a, b in zip(k, shift, strict=True)): p for k, p in law.items()}
    for block in rows.blocks:
        if not block.entries:
            law = {key: p * block.mass(ring) for key, p in law.items()}
    return {tuple(map(quotient, key, units)): _number(p, unit) for key, p in law.items()}


def _block_value(evaluator: Evaluator, rows: Rows, terms: list[Quantity]) -> Column:
    """The sum of the terms that live in this block (those that read nothing live in the empty one)."""
    total = Column.constant(0)
    for term in terms:
        found = leaves(term)
        home = rows.of(found[0].args[0]) if found else None
        if home is evaluator.block or (home is None and not evaluator.block.entries):
            total = total + evaluator.column(term)
    return total.spread(evaluator.block.size)


def _block_law(block: Block, values: list[Column], ring: Ring) -> tuple[dict[Key, Any], int]:
    moments = [[e.table.moment(ring, 0, 0)[e.index]] for e in block.entries]
    mass = product(moments)[0]
    if block.factor is not None:
        mass = mass.scale(block.factor)
    keys = [integers(map(_whole, column.fractions())) for column in values]
    order, starts = grouping(keys)
    numbers, unit = mass[order].group(starts).numbers()
    first = order[starts]
    return dict(zip(zip(*(k[first].tolist() for k in keys), strict=True), numbers, strict=True)), unit


def _whole(value: Any) -> Any:
    return value if isinstance(value, Ratio) else int(value)


def _convolved(a: dict[Key, Any], b: dict[Key, Any]) -> dict[Key, Any]:
    law: dict[Key, Any] = {}
    for key_a, p in a.items():
        for key_b, q in b.items():
            key = tuple(map(operator.add, key_a, key_b))
            law[key] = law[key] + p * q if key in law else p * q
    return law


def _number(numerator: Any, unit: int) -> Any:
    return quotient(numerator, unit) if isinstance(numerator, int | Fraction | Ratio) else numerator
