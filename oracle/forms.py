"""The estimate of one path as a linear form in sums of draws, and its moments in any ring.

Given the rows, an estimate is ``b + sum of a_j (sum of the draws of S_j)`` with a and b known on
each row. Tables hold centred sums, so the bias needs no difference of nearly equal numbers, and a
sample that nobody looked at adds exactly zero to it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from truemean.errors import NotExact
from truemean.oracle.columns import Column, NotRational
from truemean.oracle.enclose import enclosures
from truemean.oracle.evaluate import Evaluator, leaves
from truemean.oracle.features import total
from truemean.oracle.law import Law
from truemean.oracle.observing import Replay
from truemean.oracle.paths import Path
from truemean.oracle.population import Sample
from truemean.oracle.quantity import Decision, Node, Quantity, constant, quantity, text
from truemean.oracle.rings import Batch, Ring
from truemean.oracle.rows import Block, Entry, Rows, product

__all__ = ["Form", "Part", "prepare"]

ZERO, ONE = constant(0), constant(1)
Truth = tuple[Law, int]


@dataclass(slots=True)
class Linear:
    """``rest + sum coefficient * mean or sum of a sample + sum coefficient * true mean``."""

    samples: list[tuple[Quantity, Quantity]] = field(default_factory=list)
    truths: list[tuple[Truth, Quantity]] = field(default_factory=list)
    rest: Quantity = field(default_factory=lambda: ZERO)

    def plus(self, other: Linear) -> Linear:
        """The sum of two forms."""
        return Linear(self.samples + other.samples, self.truths + other.truths, _plus(self.rest, other.rest))

    def times(self, factor: Quantity) -> Linear:
        """The form times something known on each row."""
        return Linear(
            [(leaf, _times(c, factor)) for leaf, c in self.samples],
            [(truth, _times(c, factor)) for truth, c in self.truths],
            _times(self.rest, factor),
        )


def linear(node: Quantity) -> Linear:
    """Read an expression as a linear form; what is not linear becomes part of the rest."""
    op, args = node.op, node.args
    if op in ("mean", "sum"):
        return Linear(samples=[(node, ONE)])
    if op == "true mean":
        return Linear(truths=[((args[0], args[1]), ONE)])
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


def _plus(a: Quantity, b: Quantity) -> Quantity:
    if a.op == b.op == "const":
        return constant(a.args[0] + b.args[0])
    if a.op == "const" and a.args[0] == 0:
        return b
    return a if b.op == "const" and b.args[0] == 0 else Quantity("+", a, b)


def _times(a: Quantity, b: Quantity) -> Quantity:
    if a.op == b.op == "const":
        return constant(a.args[0] * b.args[0])
    for x, y in ((a, b), (b, a)):
        if x.op == "const" and x.args[0] in (0, 1):
            return y if x.args[0] else ZERO
    return Quantity("*", a, b)


# -- from expression to form -----------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Unseen:
    """Draws that no decision looked at: their coefficient and number, by row or constant."""

    law: Law
    column: int
    factor: Column
    size: Column


@dataclass(frozen=True, slots=True)
class Part:
    """What one block contributes: coefficients of its entries, of unseen draws, and the rest."""

    block: Block
    factors: tuple[tuple[Entry, int, Column], ...]
    unseen: tuple[Unseen, ...]
    truths: tuple[tuple[Truth, Column], ...]
    rest: Column

    @property
    def trivial(self) -> bool:
        """Whether it adds nothing to the mean."""
        return not self.factors and self.rest.is_zero and all(c.is_zero for _, c in self.truths)


@dataclass(frozen=True, slots=True)
class Form:
    """The estimate of a path, minus the true mean if centred, as parts of independent blocks."""

    rows: Rows
    parts: tuple[Part, ...]
    slack: Fraction

    def moments(self, ring: Ring, order: int) -> list[Any]:
        """``[P, E[value; path], E[value^2; path]]`` up to an order, in the ring's numbers."""
        found = [_part_moments(part, ring, order) for part in self.parts]
        others = [b for b in self.rows.blocks if not any(b is p.block for p in self.parts)]
        return product([*found, *([b.mass(ring)] + [_zero(ring)] * order for b in others)])

    def mean(self, ring: Ring) -> Any:
        """E[value; path]; zero without any work where every part adds nothing."""
        return _zero(ring) if all(p.trivial for p in self.parts) else self.moments(ring, 1)[1]


@dataclass(slots=True)
class _Draft:
    """A form while its blocks are still being joined."""

    path: Path
    rows: Rows
    factors: list[tuple[Sample, int, int, Quantity]] = field(default_factory=list)
    unseen: list[tuple[Law, int, Quantity, Quantity]] = field(default_factory=list)
    truths: list[tuple[Truth, Quantity]] = field(default_factory=list)
    rest: list[Quantity] = field(default_factory=list)
    checks: list[Quantity] = field(default_factory=list)

    def join(self, nodes: Iterable[Node], sample: Sample | None = None) -> None:
        """Bring what the nodes read, and a sample already observed, into one block."""
        asked = leaves(*nodes)
        self.rows, _ = self.path.observer.require(self.rows, asked)
        if sample is not None and asked:
            self.rows, _ = self.rows.joined([sample, *(leaf.args[0] for leaf in asked)])


def prepare(path: Path, estimate: Quantity, truth: Truth | None, order: int, approximate: bool = False) -> Form:
    """The form of an estimate on the rows of a path, observed as far as its moments need.

    ``truth`` is subtracted if given. Order 1 leaves alone what only the variance needs. Raises
    Replay where a sample was observed too coarsely, NotExact for irrational coefficients unless
    ``approximate`` allows enclosing them.
    """
    form = linear(estimate)
    if truth is not None:
        form.truths.append((truth, constant(-1)))
    keep_versions(path, [estimate])
    rows = path.rows
    while (draft := _drafted(path, rows, form, order)).rows is not rows:
        rows = draft.rows  # what coefficients read has been observed: read the samples' terms anew
    return _finished(draft, approximate)


def keep_versions(path: Path, nodes: list[Quantity]) -> None:
    """Make sure that no version of a sample that an estimate mentions is merged away."""
    spans: dict[Any, tuple[Sample, list[tuple[int, int]]]] = {}
    for leaf in leaves(*nodes):
        spans.setdefault(leaf.args[0].label, (leaf.args[0], []))[1].append(leaf.args[1])
    for sample, found in spans.values():
        path.observer.keep_versions(path.rows, sample, found)


def _drafted(path: Path, rows: Rows, form: Linear, order: int) -> _Draft:
    """Coefficients of everything in the form, and the blocks that they read joined."""
    draft = _Draft(path, rows, truths=list(form.truths), rest=[form.rest])
    for group in _by_sample(form.samples):
        _draft_sample(draft, group, order)
    for sample, _, _, factor in draft.factors:
        draft.join([factor], sample)
    for _, _, factor, size in draft.unseen:
        draft.join([factor, size])
    for _, coefficient in _added(draft.truths):
        draft.join([coefficient])
    for node in (*draft.rest, *draft.checks):
        draft.join([node])
    return draft


def _by_sample(terms: list[tuple[Quantity, Quantity]]) -> list[list[tuple[Quantity, Quantity]]]:
    groups: dict[Any, list[tuple[Quantity, Quantity]]] = {}
    for leaf, coefficient in terms:
        groups.setdefault(leaf.args[0].label, []).append((leaf, coefficient))
    return list(groups.values())


def _draft_sample(draft: _Draft, terms: list[tuple[Quantity, Quantity]], order: int) -> None:
    """Turn terms in one sample into coefficients of the sums of its segments."""
    sample: Sample = terms[0][0].args[0]
    if len({leaf.args[2] for leaf, _ in terms}) > 1:
        draft.rest += [_times(leaf, coefficient) for leaf, coefficient in terms]
        return
    if sample.chances is not None or sample.loop is not None:
        draft.join([leaf for leaf, _ in terms])
    column = terms[0][0].args[2]
    entries = draft.rows.entries_of(sample)
    factors: list[tuple[tuple[int, int], Quantity]] = []
    if any(not e.table.has_moments(column) for e in entries):
        draft.path.observer.needs[sample.label].add(total(column))
        raise Replay(sample.label)
    for leaf, coefficient in terms:
        span = leaf.args[1]
        draft.path.observer.keep_versions(draft.rows, sample, [span])
        size = quantity(sample.size_of(*span))
        whole = coefficient if leaf.op == "mean" else _times(coefficient, size)
        draft.truths.append(((sample.law, column), whole))
        factors.append((span, per_draw(leaf, coefficient)))
        if leaf.op == "mean" and least(size) < 1:
            draft.checks.append(factors[-1][1])
    covered = entries[-1].last if entries else 0
    for e in entries:
        draft.factors.append((sample, e.first, column, _sum(f for s, f in factors if s[0] <= e.first < s[1])))
    if order > 1:
        for number, segment in enumerate(sample.segments[covered:], covered):
            factor = _sum(f for s, f in factors if s[0] <= number < s[1])
            draft.unseen.append((sample.law, column, factor, quantity(segment.size)))


def per_draw(leaf: Quantity, coefficient: Quantity) -> Quantity:
    """The coefficient of each draw; 0 where that of the mean is: an empty sample may stand with coefficient 0."""
    if leaf.op == "sum":
        return coefficient
    size = quantity(leaf.args[0].size_of(*leaf.args[1]))
    if coefficient.op == "const":
        if not coefficient.args[0]:
            return ZERO
        return constant(coefficient.args[0] / size.args[0]) if size.op == "const" else Quantity("/", coefficient, size)
    return Quantity("where", Decision("==", coefficient, ZERO), ZERO, Quantity("/", coefficient, size))


def least(node: Node) -> Fraction | float:
    """A lower bound of a quantity that needs no rows."""
    op, args = node.op, node.args
    if op == "const":
        return args[0]  # type: ignore[no-any-return]
    if op in ("where", "min", "max", "+"):
        parts = [least(a) for a in args[-2:]]
        return {"where": min, "min": min, "max": max, "+": lambda p: p[0] + p[1]}[op](parts)
    if op in ("floor", "ceil", "round"):
        inner = least(args[0])
        return inner if inner == -math.inf else math.floor(inner)
    return 0 if op == "stat" and args[2] == "size" else -math.inf


def _sum(nodes: Iterable[Quantity]) -> Quantity:
    total = ZERO
    for node in nodes:
        total = _plus(total, node)
    return total


def _added(truths: list[tuple[Truth, Quantity]]) -> list[tuple[Truth, Quantity]]:
    """Coefficients of equal true means added up, so that 1 - 1 is nothing at all."""
    totals: dict[Truth, Quantity] = {}
    for truth, coefficient in truths:
        totals[truth] = _plus(totals.get(truth, ZERO), coefficient)
    return [(t, c) for t, c in totals.items() if not (c.op == "const" and c.args[0] == 0)]


def _finished(draft: _Draft, approximate: bool) -> Form:
    """Evaluate every coefficient on the block that its samples have ended in."""
    constants = Block((), 1)
    gathered: dict[int, dict[str, list[Any]]] = {}
    blocks: dict[int, Block] = {}
    evaluators: dict[int, Evaluator] = {}
    slack = Fraction(0)

    def home(nodes: list[Node], sample: Sample | None = None) -> tuple[dict[str, list[Any]], Evaluator]:
        samples = [leaf.args[0] for leaf in leaves(*nodes)] + ([] if sample is None else [sample])
        block = draft.rows.of(samples[0]) if samples else None
        block = block or constants
        blocks[id(block)] = block
        evaluator = evaluators.setdefault(id(block), Evaluator(block, draft.path.exploration.lenient))
        return gathered.setdefault(id(block), {"factors": [], "unseen": [], "truths": [], "rest": []}), evaluator

    def column(evaluator: Evaluator, node: Quantity) -> Column:
        nonlocal slack
        try:
            return evaluator.column(node)
        except NotRational:
            if not approximate:
                raise NotExact(
                    f"the estimate needs {text(node)}, which is irrational: use arithmetic='float64'"
                ) from None
            found, radius = _midpoints(evaluator, node)
            slack += radius
            return found

    for sample, first, c, factor in draft.factors:
        place, evaluator = home([factor], sample)
        entry = next(e for e in evaluator.block.entries_of(sample) if e.first == first)
        value = column(evaluator, factor)
        if not value.is_zero:
            place["factors"].append((entry, c, value))
    for law, c, factor, size in draft.unseen:
        place, evaluator = home([factor, size])
        place["unseen"].append(Unseen(law, c, column(evaluator, factor), column(evaluator, size)))
    for truth, coefficient in _added(draft.truths):
        place, evaluator = home([coefficient])
        place["truths"].append((truth, column(evaluator, coefficient)))
    for node in draft.checks:
        column(home([node])[1], node)
    for node in draft.rest:
        place, evaluator = home([node])
        place["rest"].append(column(evaluator, node))
    parts = []
    for key, found in gathered.items():
        rest = sum(found["rest"][1:], found["rest"][0]) if found["rest"] else Column.constant(0)
        parts.append(Part(blocks[key], *(tuple(found[n]) for n in ("factors", "unseen", "truths")), rest))
    return Form(draft.rows, tuple(parts), slack)


def _midpoints(evaluator: Evaluator, node: Quantity, bits: int = 160) -> tuple[Column, Fraction]:
    """Irrational values by row as near rationals, and the largest distance."""
    balls = enclosures(evaluator, node, bits)
    middles, radius = [], Fraction(0)
    for ball in balls:
        if not ball.is_finite():
            raise NotExact(f"{text(node)} is not a number on some row: guard it with np.where or np.maximum")
        middle, distance = ball.mid().fmpq(), ball.rad().fmpq()
        middles.append(Fraction(int(middle.p), int(middle.q)))
        radius = max(radius, Fraction(int(distance.p), int(distance.q)))
    return Column.of(middles), radius


# -- moments of a part -----------------------------------------------------------------------------


def _part_moments(part: Part, ring: Ring, order: int) -> list[Any]:
    if not part.block.entries:
        return _constant_moments(part, ring, order)
    if len(part.block.entries) == 1 and part.block.factor is None and not isinstance(ring, Batch):
        return _weighed(part, ring, order)
    return _rowwise(part, ring, order)


def _shift(part: Part) -> Column:
    """b on each row: the rest and the true means, exactly."""
    shift = part.rest
    for (law, column), coefficient in part.truths:
        shift = shift + coefficient * Column.constant(law.mean(column))
    return shift


def _spread(part: Part) -> Column:
    """The variance that unseen draws add on each row."""
    total = Column.constant(0)
    for u in part.unseen:
        total = total + u.factor * u.factor * u.size * Column.constant(u.law.variance(u.column))
    return total


def _constant_moments(part: Part, ring: Ring, order: int) -> list[Any]:
    one = ring.number(Fraction(1))
    if isinstance(ring, Batch):
        shift = ring.number(part.rest.fractions()[0])
        for (law, column), coefficient in part.truths:
            shift = shift + float(coefficient.fractions()[0]) * ring.mean(law, column)
        spread = _zero(ring)
        for u in part.unseen:
            spread = spread + float((u.factor * u.factor * u.size).fractions()[0]) * ring.variance(u.law, u.column)
        return [one, shift, shift * shift + spread][: order + 1]
    shift, spread = _shift(part).fractions()[0], _spread(part).fractions()[0]
    return [one, ring.number(shift), ring.number(shift * shift + spread)][: order + 1]


def _weighed(part: Part, ring: Ring, order: int) -> list[Any]:
    """One entry: moments as sums over its table, without writing out its rows."""
    (entry,) = part.block.entries
    b = _shift(part)
    a = part.factors[0][2] if part.factors else Column.constant(0)
    c = part.factors[0][1] if part.factors else 0
    one = Column.constant(1)

    def weigh(power: int, factor: Column) -> Any:
        return _zero(ring) if factor.is_zero else entry.table.weigh(ring, c, power, factor, entry.index)

    found = [weigh(0, one)]
    if order > 0:
        found.append(weigh(1, a) + weigh(0, b))
    if order > 1:
        cross = a * b * Column.constant(2)
        found.append(weigh(2, a * a) + weigh(1, cross) + weigh(0, b * b + _spread(part)))
    return found


def _rowwise(part: Part, ring: Ring, order: int) -> list[Any]:
    """Several entries: multiply moments row by row, then add up."""
    rows, scaled = part.block.size, {id(e): (c, f) for e, c, f in part.factors}
    moments = []
    for entry in part.block.entries:
        c, factor = scaled.get(id(entry), (0, None))
        mass = entry.table.moment(ring, 0, 0)[entry.index]
        found, power = [mass], Column.constant(1)
        for n in range(1, order + 1):
            power = power * factor if factor is not None else Column.constant(0)
            found.append(entry.table.moment(ring, c, n)[entry.index].scale(power.spread(rows)) if factor is not None
                         else mass.scale(Column.constant(0).spread(rows)))
        moments.append(found)
    unit = ring.vector(Column.constant(1).spread(rows))
    shift = _shift_vector(part, ring, rows)
    moments.append([unit, shift, shift * shift + _spread_vector(part, ring, rows)][: order + 1])
    joint = product(moments)
    if part.block.factor is not None:
        joint = [m.scale(part.block.factor) for m in joint]
    return [m.sum() for m in joint]


def _shift_vector(part: Part, ring: Ring, rows: int) -> Any:
    if not isinstance(ring, Batch):
        return ring.vector(_shift(part).spread(rows))
    shift = ring.vector(part.rest.spread(rows))
    for (law, column), coefficient in part.truths:
        shift = shift + ring.outer(coefficient.spread(rows), ring.mean(law, column))
    return shift


def _spread_vector(part: Part, ring: Ring, rows: int) -> Any:
    if not isinstance(ring, Batch):
        return ring.vector(_spread(part).spread(rows))
    spread = ring.vector(Column.constant(0).spread(rows))
    for u in part.unseen:
        spread = spread + ring.outer((u.factor * u.factor * u.size).spread(rows), ring.variance(u.law, u.column))
    return spread


def _zero(ring: Ring) -> Any:
    return ring.number(Fraction(0))
