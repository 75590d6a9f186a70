"""Statistics of a sample by row: what each asks to be observed, and its value from the states."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from truemean.errors import NoClosedForm, PlanError
from truemean.oracle.assumptions import possible_signs
from truemean.oracle.columns import Column, Ints, Surd, plus, symbolic, times
from truemean.oracle.exact import exact_number
from truemean.oracle.features import squares, total
from truemean.oracle.law import Law
from truemean.oracle.quantity import Node
from truemean.oracle.rows import Entry, pool
from truemean.oracle.symbols import Ratio

__all__ = ["Observed", "features_of", "flat", "statistic"]


@dataclass(frozen=True, slots=True)
class Observed:
    """What is known of some segments of a sample, pooled, by joint row."""

    entries: list[Entry]

    @property
    def law(self) -> Law:
        """The law of one draw."""
        return self.entries[0].table.law

    @property
    def sizes(self) -> Ints:
        """Number of draws by row."""
        sizes = [e.table.sizes[e.index] for e in self.entries]
        return np.asarray(sum(sizes[1:], sizes[0]))

    def state(self, feature: str) -> Ints:
        """The pooled state under a feature."""
        return pool(self.entries, feature)


def features_of(leaf: Node) -> frozenset[str]:
    """The features that a statistic (or the test for flatness) asks for."""
    law = leaf.args[0].law
    if leaf.op == "flat":
        return frozenset({"flat" if leaf.args[2] is None else "support"})
    if leaf.op in ("mean", "sum"):
        return frozenset({total(leaf.args[2])})
    _, _, name, column, option = leaf.args
    if name == "size":
        return frozenset()
    if name in ("min", "max", "range", "contrast"):
        return frozenset({"extremes" if law.ordered else "support"})
    if name in ("variance", "std_error", "deviations"):
        return frozenset({total(column), squares(column)})
    if name == "custom":
        return frozenset({"sequence" if option.ordered else "counts"})
    return frozenset({"sequence"})


def statistic(leaf: Node, seen: Observed) -> Column | Surd:
    """The value of a statistic on every row."""
    if leaf.op in ("mean", "sum"):
        sums = _sum(seen, leaf.args[2])
        return sums / Column.whole(seen.sizes) if leaf.op == "mean" else sums
    _, _, name, column, option = leaf.args
    value = _STATISTICS[name](seen, column, option)
    if isinstance(option, Node):
        value = _declared(value, option.args[0])
    return value


def flat(leaf: Node, seen: Observed) -> tuple[Any, Any]:
    """``(holds, undefined)`` of the test for equal draws, in one channel or altogether."""
    sample, _, column, least, _, comparison = leaf.args
    if column is None:
        holds = seen.state("flat") != -1
    else:
        low, high = _ends(seen, column)
        holds = low >= high
    return (~holds if comparison in (">", "!=") else holds), _too_small(seen.sizes, least, sample)


def _too_small(sizes: Ints, least: int, sample: Any) -> Ints:
    """Where a sample has fewer draws than a statistic needs; a symbolic size is required to have enough."""
    if not symbolic(sizes):
        return sizes < least
    for size in {n for n in sizes.tolist() if isinstance(n, Ratio) and possible_signs(n - least) & {-1}}:
        size.field.require(f"{size} >= {least}")
    return np.array([not isinstance(n, Ratio) and n < least for n in sizes])


def _declared(value: Column | Surd, policy: Fraction) -> Column | Surd:
    missing = value.undefined
    constant = Column.constant(policy)
    if isinstance(value, Column):
        return constant.where(missing, value)
    zero = Column.constant(0)
    return Surd(
        constant.where(missing, value.rational), zero.where(missing, value.factor), zero.where(missing, value.radicand)
    )


def _sum(seen: Observed, column: int) -> Column:
    lattice = seen.law.lattice(column)
    scaled = Column.whole(seen.state(total(column))) * Column.constant(lattice.step)
    return scaled + Column.whole(seen.sizes) * Column.constant(lattice.base)


def _ends(seen: Observed, column: int) -> tuple[Ints, Ints]:
    """Smallest and largest lattice number seen of a column; the smallest is larger where nothing was."""
    law = seen.law
    e = law.lattice(column).e
    if law.symbolic_values:
        return _symbolic_ends(law, e, seen)
    above = np.append(e, [e.max() + 1, -1])
    if law.channels == 1 and column == 0:
        return above[seen.state("lowest")], above[seen.state("highest")]
    low, high = np.full(len(seen.sizes), e.max() + 1), np.full(len(seen.sizes), -1)
    support = seen.state("support")
    for atom in range(law.k):
        drawn = (support >> atom) & 1 > 0
        low = np.where(drawn, np.minimum(low, e[atom]), low)
        high = np.where(drawn, np.maximum(high, e[atom]), high)
    return low, high


def _symbolic_ends(law: Any, e: Ints, seen: Observed) -> tuple[Ints, Ints]:
    if not law.ordered:
        ends: tuple[Ints, Ints] = law.ends(seen.state("support"))
        return ends
    padded = np.append(e, [0, 0])  # k and -1 stand for an empty sample, which has neither end
    return padded[seen.state("lowest")], padded[seen.state("highest")]


def _end(which: int) -> Callable[[Observed, int, Any], Column]:
    def value(seen: Observed, column: int, option: Any) -> Column:
        lattice = seen.law.lattice(column)
        found = _ends(seen, column)[which]
        scaled = Column.whole(found) * Column.constant(lattice.step) + Column.constant(lattice.base)
        return Column(scaled.num, np.where(seen.sizes == 0, 0, scaled.den))

    return value


_minimum, _maximum = _end(0), _end(1)


def _range(seen: Observed, column: int, option: Any) -> Column:
    low, high = _ends(seen, column)
    spread = Column.whole(high - low) * Column.constant(seen.law.lattice(column).step)
    return Column(spread.num, np.where(seen.sizes == 0, 0, spread.den))


def _contrast(seen: Observed, column: int, option: Any) -> Column:
    total = _minimum(seen, column, None) + _maximum(seen, column, None)
    for number in {x for x in total.num.tolist() if isinstance(x, Ratio) and 0 in possible_signs(x)}:
        number.field.require(f"{number} != 0")
    return _range(seen, column, None) / total


def _deviations(seen: Observed, column: int, option: Any) -> Column:
    """N Q - S^2 in lattice units, which no offset of the values can spoil."""
    step = seen.law.lattice(column).step
    s, q, n = seen.state(total(column)), seen.state(squares(column)), seen.sizes
    return Column(plus(times(n, q), -times(s, s)), n) * Column.constant(step * step)


def _variance(seen: Observed, column: int, option: Any) -> Column:
    return _deviations(seen, column, None) / Column.whole(seen.sizes - 1)


def _std_error(seen: Observed, column: int, option: Any) -> Surd:
    return Surd.root(_variance(seen, column, None) / Column.whole(seen.sizes))


def _size(seen: Observed, column: int, option: Any) -> Column:
    return Column.whole(seen.sizes)


def _item(seen: Observed, column: int, option: Any) -> Column:
    return Column.of(seen.law.column(column))[seen.state("sequence")[:, option]]


def _custom(seen: Observed, column: int, option: Any) -> Column:
    """Call the function once per distinct tuple of values."""
    law = seen.law
    if law.symbolic_values and not (law.ordered or option.ordered):
        raise NoClosedForm(f"statistic {option.name} takes the values in ascending order: give one, ordered=True")
    values = [v if law.channels > 1 else v[0] for v in law.values]
    states = seen.state("sequence" if option.ordered else "counts").tolist()
    known: dict[tuple[int, ...], Any] = {}
    for state in map(tuple, states):
        if state not in known:
            atoms = state if option.ordered else [i for i, count in enumerate(state) for _ in range(count)]
            try:
                result = option.function(tuple(values[i] for i in atoms))
            except TypeError as error:
                if law.symbolic_values:
                    raise NoClosedForm(
                        f"statistic {option.name} compares symbols ({error}): make values numbers"
                    ) from None
                raise
            try:
                known[state] = result if isinstance(result, Ratio) else exact_number(result, f"statistic {option.name}")
            except ValueError as error:
                raise PlanError(f"{error}; a statistic returns one number") from error
    return Column.of(known[tuple(state)] for state in states)


_STATISTICS: dict[str, Callable[[Observed, int, Any], Column | Surd]] = {
    "min": _minimum,
    "max": _maximum,
    "range": _range,
    "contrast": _contrast,
    "deviations": _deviations,
    "variance": _variance,
    "std_error": _std_error,
    "size": _size,
    "item": _item,
    "custom": _custom,
}
