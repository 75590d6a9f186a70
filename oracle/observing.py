"""Observing: bringing samples into the rows of a path, no further than somebody asks.

What each sample is asked for is noted under its label; a path that meets a sample observed too
coarsely, or merged too early, notes the need and is run again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from truemean.errors import PlanError
from truemean.oracle.assumptions import read_size
from truemean.oracle.columns import Column, Ints, integers
from truemean.oracle.evaluate import Evaluator, leaves
from truemean.oracle.features import Level, gives, level
from truemean.oracle.quantity import Node, Quantity
from truemean.oracle.rows import Block, Entry, Rows, StackedTable
from truemean.oracle.sample import Sample
from truemean.oracle.statistics import features_of
from truemean.oracle.symbols import Ratio
from truemean.oracle.tables import Table
from truemean.oracle.wording import text

if TYPE_CHECKING:
    from truemean.oracle.loops import Loop

__all__ = ["Observer", "Replay"]

Span = tuple[int, int]


class Replay(BaseException):
    """A need was noted: run the path again. Not an Exception, so that no plan catches it."""

    def __init__(self, label: Any) -> None:
        self.label = label


class Observer:
    """The needs of all samples of a plan, and how samples enter the rows."""

    def __init__(self, tables: dict[Any, Any], check_budget: Callable[[int, str], None], lenient: bool) -> None:
        self.tables, self.check_budget, self.lenient = tables, check_budget, lenient
        self.needs: dict[Any, set[str]] = {}
        self.apart: set[Any] = set()

    def require(self, rows: Rows, asked: Sequence[Node], why: Node | None = None) -> tuple[Rows, Block]:
        """Observe what statistics ask for, and bring their samples into one block."""
        self.keep_versions(rows, asked)
        why = asked[0] if why is None and asked else why
        wanted: dict[Any, tuple[Sample, set[str], list[Span]]] = {}
        for leaf in asked:
            sample = leaf.args[0]
            _, features, spans = wanted.setdefault(sample.label, (sample, set(), []))
            features |= features_of(leaf)
            spans.append(leaf.args[1])
        for sample, features, spans in wanted.values():
            rows = self.observe(rows, sample, features, spans, why)
        return self.joined(rows, [sample for sample, _, _ in wanted.values()], why)

    def joined(self, rows: Rows, samples: list[Sample], why: Node | None = None) -> tuple[Rows, Block]:
        """Samples brought into one block, if its rows are within the budget."""
        blocks = {id(b): b.size for b in rows.blocks if any(b is rows.of(sample) for sample in samples)}
        names = ", ".join(dict.fromkeys(sample.name for sample in samples))
        self.check_budget(math.prod(blocks.values()), f"{names if why is None else text(why)}: {names} side by side")
        return rows.joined(samples)

    def depends_on(self, rows: Rows, asked: Sequence[Node]) -> list[Node]:
        """What statistics look at, also by way of the sizes and chances of samples not yet attached."""
        found, open_leaves = [], list(asked)
        while open_leaves:
            leaf = open_leaves.pop()
            found.append(leaf)
            sample, covered = leaf.args[0], rows.covered(leaf.args[0])
            sizes = [s.size for s in sample.segments[covered : leaf.args[1][1]] if isinstance(s.size, Quantity)]
            if sample.loop is None:
                open_leaves += leaves(*sizes, *([] if covered else sample.chances or []))
        return found

    def observe(self, rows: Rows, sample: Sample, features: set[str], spans: list[Span], why: Node | None) -> Rows:
        """Attach a sample, up to the last version mentioned, at a level that gives the features."""
        self.note(rows, sample, features)
        last = max(end for _, end in spans)
        # A sample that grew until it stopped brings its own rows.
        if sample.loop is not None and not rows.covered(sample):
            rows = self._attach_loop(rows, sample, sample.loop)
        # Sizes come first: they may look at this very sample.
        for segment in sample.segments[rows.covered(sample) : last]:
            if isinstance(segment.size, Quantity):
                rows, _ = self.require(rows, leaves(segment.size), segment.size)
        # Attach what was drawn since the last look, and merge it in unless an older version is still in use.
        covered = rows.covered(sample)
        apart = sample.label in self.apart
        for first, end in [(i, i + 1) for i in range(covered, last)] if apart else [(covered, last)]:
            if end > first:
                rows = self._attach(rows, sample, first, end, why)
        grown = rows.of(sample)
        if 0 < covered < last and not apart and grown is not None:
            rows = rows.put((grown,), grown.merged(sample, self.level_of(sample)))
        return rows

    def note(self, rows: Rows, sample: Sample, features: set[str]) -> None:
        """Note what a sample is needed for; Replay if it was observed at a coarser level."""
        needs, channels = self.needs.setdefault(sample.label, set()), sample.law.channels
        entries = rows.entries_of(sample)
        if not all(gives(level(needs, channels), f, channels) for f in features):
            needs |= features
            if entries:
                raise Replay(sample.label)
        if any(not e.table.knows(f) for e in entries for f in needs):
            raise Replay(sample.label)

    def keep_versions(self, rows: Rows, asked: Sequence[Node]) -> None:
        """An older version that outlives growth needs the segments of its sample kept apart."""
        cuts: dict[Any, set[int]] = {}
        samples: dict[Any, Sample] = {}
        for leaf in self.depends_on(rows, asked):
            samples[leaf.args[0].label] = leaf.args[0]
            cuts.setdefault(leaf.args[0].label, set()).update(leaf.args[1])
        for label, sample in samples.items():
            if any(0 < cut < max(cuts[label]) for cut in cuts[label]):
                self.apart.add(label)
            if any(e.first < cut < e.last for e in rows.entries_of(sample) for cut in cuts[label]):
                self.apart.add(label)
                raise Replay(label)

    def level_of(self, sample: Sample) -> Level:
        """The coarsest level that gives all that a sample is needed for."""
        return level(self.needs[sample.label], sample.law.channels)

    # -- attaching ---------------------------------------------------------------------------

    def _attach(self, rows: Rows, sample: Sample, first: int, last: int, why: Node | None) -> Rows:
        """Bring segments of a sample into the rows, as a table of their total size."""
        size, wanted = sample.size_of(first, last), self.level_of(sample)

        def tables(n: Any, wanted: Level) -> Table:
            return sample.segments[first].tables(n, wanted, sample.name if why is None else text(why))

        if sample.chances is not None:
            return self._attach_choice(rows, sample, tables(1, wanted))
        if not isinstance(size, Quantity):
            block, table = rows.of(sample) or Block((), 1), tables(size, wanted)
            which, bounds = np.zeros(block.size, dtype=np.int64), [0, table.rows]
        else:
            rows, block = self._beside_size(rows, sample, size)
            sizes = self.sizes(block, size, sample)
            distinct = sorted(set(sizes.tolist()), key=lambda n: (isinstance(n, Ratio), n if isinstance(n, int) else 0))
            place = {n: i for i, n in enumerate(distinct)}
            which = np.array([place[n] for n in sizes.tolist()], dtype=np.int64)
            stack = [tables(n if isinstance(n, Ratio) else int(n), wanted) for n in distinct]
            table, bounds = StackedTable(stack, wanted), [0, *np.cumsum([t.rows for t in stack])]
        pairs = self._pairs(block, which, bounds, sample, why)
        return rows.put((block,), block.extended(sample, first, last, table, pairs))

    def _beside_size(self, rows: Rows, sample: Sample, size: Quantity) -> tuple[Rows, Block]:
        """What the size reads and what is known of the sample, in one block."""
        rows, _ = self.require(rows, leaves(size), size)
        return self.joined(rows, [sample, *(leaf.args[0] for leaf in leaves(size))], size)

    def _attach_loop(self, rows: Rows, sample: Sample, loop: Loop) -> Rows:
        key = ("loop", sample.label)
        if key not in self.tables:
            self.tables[key] = loop.tables()
        index = np.arange(self.tables[key][0].rows)
        entries = tuple(Entry(sample, part, part + 1, t, index) for part, t in enumerate(self.tables[key]))
        return rows.put((), Block(entries, len(index)))

    def _attach_choice(self, rows: Rows, sample: Sample, table: Table) -> Rows:
        """A choice whose probabilities depend on the row: they become factors of the joint rows."""
        rows, block = self.require(rows, leaves(*(sample.chances or [])))
        columns = self.chances(block, sample)
        left, right = self._pairs(block, np.zeros(block.size, dtype=np.int64), [0, table.rows], sample, None)
        option = np.array([int(v) for v in table.sums(0).fractions()])[right]
        factor = columns[0][left]
        for number, column in enumerate(columns):
            factor = column[left].where(option == number, factor)
        factor = factor * Column.constant(len(columns))  # the table holds each option with equal probability
        wider = block.extended(sample, 0, 1, table, (left, right))
        if wider.factor is not None:
            factor = factor * wider.factor
        return rows.put((block,), Block(wider.entries, wider.size, factor).select(np.flatnonzero(factor.sign())))

    def chances(self, block: Block, sample: Sample) -> list[Column]:
        """The probabilities of a choice by row, summing to 1."""
        evaluator = Evaluator(block, self.lenient)
        columns = [evaluator.column(c).spread(block.size) for c in sample.chances or []]
        total = sum(columns[1:], columns[0])
        if any((c.sign() < 0).any() for c in columns) or (total.sign() <= 0).any():
            raise PlanError(f"{sample.name} has a probability outside [0, 1] on some row: clamp it with np.clip")
        return [c / total for c in columns]

    def _pairs(
        self, block: Block, which: Ints, bounds: Sequence[int], sample: Sample, why: Node | None
    ) -> tuple[Ints, Ints]:
        """Each joint row with every row of its sub-table (rows ``bounds[which] .. bounds[which + 1]``)."""
        starts, ends = np.array(bounds[:-1], dtype=np.int64)[which], np.array(bounds[1:], dtype=np.int64)[which]
        counts = ends - starts
        total = int(counts.sum())
        self.check_budget(total, f"{sample.name if why is None else text(why)} on {sample.name}")
        offset = np.arange(total) - np.repeat(np.cumsum(counts) - counts, counts)
        return np.repeat(np.arange(block.size), counts), np.repeat(starts, counts) + offset

    def sizes(self, block: Block, size: Quantity, sample: Sample) -> Ints:
        """The number of draws by row; PlanError where it is no integer >= 0."""
        values = Evaluator(block, self.lenient).column(size).spread(block.size).fractions()
        bad = next((v for v in values if not isinstance(v, Ratio) and (v.denominator != 1 or v < 0)), None)
        if bad is not None:
            raise PlanError(f"the size {text(size)} of {sample.name} is {bad} on a row: a size is an integer >= 0")
        return integers([read_size(v.field, v) if isinstance(v, Ratio) else int(v) for v in values])
