"""From the expression that a path returned to a form: coefficients on rows observed as far as needed."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from fractions import Fraction
from functools import partial
from typing import Any

from truemean.errors import NotExact
from truemean.oracle.columns import Column, NotRational
from truemean.oracle.enclose import enclosures
from truemean.oracle.evaluate import Evaluator, leaves
from truemean.oracle.features import total
from truemean.oracle.law import Law
from truemean.oracle.linear import ZERO, Linear, Truth, added_up, least, linear, per_draw, plus, times
from truemean.oracle.moments import Form, Part, Unseen
from truemean.oracle.observing import Replay
from truemean.oracle.paths import Path
from truemean.oracle.quantity import Node, Quantity, constant, quantity
from truemean.oracle.rows import Block, Entry, Rows
from truemean.oracle.sample import Sample
from truemean.oracle.wording import text

__all__ = ["prepare"]


class _Draft:
    """A form while its blocks are still being joined."""

    def __init__(self, path: Path, rows: Rows, form: Linear) -> None:
        self.path, self.rows = path, rows
        self.factors: list[tuple[Sample, int, int, Quantity]] = []
        self.unseen: list[tuple[Law, int, Quantity, Quantity]] = []
        self.truths: list[tuple[Truth, Quantity]] = list(form.truths)
        self.rest: list[Quantity] = [form.rest]
        self.checks: list[Quantity] = []
        self.sizes: list[tuple[Sample, Quantity]] = []

    def join(self, nodes: Iterable[Node], sample: Sample | None = None) -> None:
        """Bring what the nodes read, and a sample already observed, into one block."""
        asked = leaves(*nodes)
        if not asked:
            return
        self.rows, _ = self.path.observer.require(self.rows, asked)
        if sample is not None:
            self.rows, _ = self.path.observer.joined(self.rows, [sample, *(leaf.args[0] for leaf in asked)])


def prepare(path: Path, estimate: Quantity, truth: Truth | None, order: int, bits: int = 0) -> Form:
    """The form of an estimate on the rows of a path, observed as far as its moments need.

    ``truth`` is subtracted if given. Order 1 leaves alone what only the variance needs. Raises
    Replay where a sample was observed too coarsely, NotExact for irrational coefficients unless
    ``bits`` says to how many they may be enclosed.
    """
    form = linear(estimate)
    if truth is not None:
        form = form.plus(Linear(truths=((truth, constant(-1)),)))
    path.observer.keep_versions(path.rows, leaves(estimate))
    rows = path.rows
    while (draft := _drafted(path, rows, form, order)).rows is not rows:
        rows = draft.rows  # what coefficients read has been observed: read the samples' terms anew
    return _finished(draft, bits)


def _drafted(path: Path, rows: Rows, form: Linear, order: int) -> _Draft:
    """Coefficients of everything in the form, and the blocks that they read joined."""
    draft = _Draft(path, rows, form)
    for group in _by_sample(form.samples):
        _draft_sample(draft, group, order)
    for sample, _, _, factor in draft.factors:
        draft.join([factor], sample)
    for _, _, factor, size in draft.unseen:
        draft.join([factor, size])
    for _, coefficient in _added(draft.truths):
        draft.join([coefficient])
    for node in (*draft.rest, *draft.checks, *(size for _, size in draft.sizes)):
        draft.join([node])
    return draft


def _by_sample(terms: Iterable[tuple[Quantity, Quantity]]) -> list[list[tuple[Quantity, Quantity]]]:
    groups: dict[Any, list[tuple[Quantity, Quantity]]] = {}
    for leaf, coefficient in terms:
        groups.setdefault(leaf.args[0].label, []).append((leaf, coefficient))
    return list(groups.values())


def _draft_sample(draft: _Draft, terms: list[tuple[Quantity, Quantity]], order: int) -> None:
    """Turn terms in one sample into coefficients of the sums of its segments."""
    sample: Sample = terms[0][0].args[0]
    if len({leaf.args[2] for leaf, _ in terms}) > 1:
        draft.rest += [times(leaf, coefficient) for leaf, coefficient in terms]
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
        if entries:
            draft.path.observer.keep_versions(draft.rows, [leaf])
        size = quantity(sample.size_of(*span))
        whole = coefficient if leaf.op == "mean" else times(coefficient, size)
        draft.truths.append(((sample.law, column), whole))
        factors.append((span, per_draw(leaf, coefficient)))
        if leaf.op == "mean" and least(size) < 1:
            draft.sizes.append((sample, size))
            draft.checks.append(factors[-1][1])
    # A coefficient that depends on these very draws makes them anything but unseen.
    depends_on = draft.path.observer.depends_on
    own = [f for _, f in factors if any(x.args[0].label == sample.label for x in depends_on(draft.rows, leaves(f)))]
    if own and draft.rows.covered(sample) < len(sample.segments):
        draft.join(own)
    covered = entries[-1].last if entries else 0
    for e in entries:
        draft.factors.append((sample, e.first, column, added_up(f for s, f in factors if s[0] <= e.first < s[1])))
    if order > 1:
        for number, segment in enumerate(sample.segments[covered:], covered):
            factor = added_up(f for s, f in factors if s[0] <= number < s[1])
            draft.unseen.append((sample.law, column, factor, quantity(segment.size)))


def _added(truths: list[tuple[Truth, Quantity]]) -> list[tuple[Truth, Quantity]]:
    """Coefficients of equal true means added up, so that 1 - 1 is nothing at all."""
    totals: dict[Truth, Quantity] = {}
    for truth, coefficient in truths:
        totals[truth] = plus(totals.get(truth, ZERO), coefficient)
    return [(t, c) for t, c in totals.items() if not (c.op == "const" and c.args[0] == 0)]


def _finished(draft: _Draft, bits: int) -> Form:
    """Evaluate every coefficient on the block that its samples have ended in."""
    homes = _Homes(draft, bits)
    for sample, first, column, factor in draft.factors:
        place = homes.of([factor], sample)
        entry = next(e for e in place.evaluator.block.entries_of(sample) if e.first == first)
        value = homes.column(place, factor, partial(_largest_sum, entry.table.law, column, entry.table.sizes))
        if not value.is_zero:
            place.factors.append((entry, column, value))
    for law, column, factor, size in draft.unseen:
        place = homes.of([factor, size])
        sizes = homes.column(place, size)
        value = homes.column(place, factor, partial(_largest_sum, law, column, sizes))
        place.unseen.append(Unseen(law, column, value, sizes))
    for truth, coefficient in _added(draft.truths):
        place = homes.of([coefficient])
        place.truths.append((truth, homes.column(place, coefficient, partial(_size_of_mean, *truth))))
    for sample, size in draft.sizes:
        draft.path.observer.sizes(homes.of([size]).evaluator.block, size, sample)
    for node in draft.checks:
        homes.column(homes.of([node]), node)
    for node in draft.rest:
        place = homes.of([node])
        place.rest = place.rest + homes.column(place, node)
    return Form(draft.rows, tuple(place.part() for place in homes.places.values()), homes.slack)


class _Place:
    """What is gathered for one block."""

    def __init__(self, evaluator: Evaluator) -> None:
        self.evaluator = evaluator
        self.factors: list[tuple[Entry, int, Column]] = []
        self.unseen: list[Unseen] = []
        self.truths: list[tuple[Truth, Column]] = []
        self.rest = Column.constant(0)

    def part(self) -> Part:
        """The block's part of the form."""
        return Part(self.evaluator.block, tuple(self.factors), tuple(self.unseen), tuple(self.truths), self.rest)


class _Homes:
    """Each expression belongs to the block of the samples that it reads, constants to an empty one."""

    def __init__(self, draft: _Draft, bits: int) -> None:
        self.draft, self.bits = draft, bits
        self.constants = Block((), 1)
        self.places: dict[int, _Place] = {}
        self.slack = Fraction(0)

    def of(self, nodes: list[Quantity], sample: Sample | None = None) -> _Place:
        """The place of what the nodes read; of a sample where they read nothing."""
        samples = [leaf.args[0] for leaf in leaves(*nodes)] or [sample]
        block = (self.draft.rows.of(samples[0]) if samples[0] is not None else None) or self.constants
        if id(block) not in self.places:
            self.places[id(block)] = _Place(Evaluator(block, self.draft.path.exploration.lenient))
        return self.places[id(block)]

    def column(self, place: _Place, node: Quantity, bound: Callable[[], Any] = lambda: 1) -> Column:
        """A coefficient by row; an irrational one within its radius, times the ``bound`` of what it multiplies."""
        try:
            return place.evaluator.column(node)
        except NotRational:
            if not self.bits:
                message = f"the estimate needs {text(node)}, which is irrational: use arithmetic='ball' or 'float64'"
                raise NotExact(message) from None
        found, radius = _midpoints(place.evaluator, node, self.bits)
        self.slack += radius * bound()
        return found


def _largest_sum(law: Law, column: int, sizes: Any) -> Any:
    """A bound of the centred sum of draws."""
    sizes = sizes.fractions() if isinstance(sizes, Column) else sizes
    values = law.column(column)
    return max(map(int, sizes), default=0) * (max(values) - min(values))


def _size_of_mean(law: Law, column: int) -> Any:
    return abs(law.mean(column))


def _midpoints(evaluator: Evaluator, node: Quantity, bits: int) -> tuple[Column, Fraction]:
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
