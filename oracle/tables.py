"""Tables: the n-th power of one draw's law in the algebra of a level.

A level is a commutative monoid, a table the n-th power of sum omega_i [e(x_i)] in its algebra.
Each row carries what the level sees (its *states*) and three moments: its probability, and the
first and second moment of the centred sum of the draws on it. Structure never depends on the
weights; moments are asked for in any ring.

Idempotent features become pointwise powers W^n over subsets of the atoms, turned into rows by a
Moebius inversion; additive features are powers of polynomials; counts are monomials.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
from flint import fmpz_mpoly_ctx

from truemean.errors import NoClosedForm
from truemean.oracle.columns import Column, Ints, grouping, integers, largest, quotient, symbolic, times
from truemean.oracle.features import IDEMPOTENT, Level, gives, squares, total
from truemean.oracle.float64 import Float64, round_integers
from truemean.oracle.law import Law
from truemean.oracle.rings import Exact, Integers, Ring, Subsets
from truemean.oracle.subsets import Family
from truemean.oracle.symbolic import SymbolicLaw

__all__ = ["CountTable", "LatticeTable", "PolynomialTable", "SequenceTable", "Table", "power", "rows_of"]

_EXPONENT_LIMIT = 1 << 61


class Table(ABC):
    """Rows of one level; subclasses give the states and the probability of each row."""

    law: Law
    level: Level
    sizes: Ints
    states: dict[str, Ints]

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.sizes)

    def knows(self, feature: str) -> bool:
        """Whether the states determine a feature."""
        return gives(self.level, feature, self.law.channels)

    def state(self, feature: str) -> Ints:
        """The state of each row under a feature, derived from a finer one if need be."""
        if feature not in self.states:
            self.states[feature] = _derive_state(self, feature)
        return self.states[feature]

    def has_moments(self, column: int) -> bool:
        """Whether the moments of a column's sum are known on each row."""
        return self.knows(total(column))

    def sums(self, column: int) -> Column:
        """The sum of a column over the draws of each row."""
        lattice = self.law.lattice(column)
        scaled = Column.whole(self.state(total(column))) * Column.constant(lattice.step)
        return scaled + Column.whole(self.sizes) * Column.constant(lattice.base)

    @abstractmethod
    def mass(self, ring: Ring) -> Any:
        """The probability of each row."""

    def moment(self, ring: Ring, column: int, order: int) -> Any:
        """E[(centred sum)^order; row] by row; order 0 is the probability."""
        key = (ring, column if order else 0, order)
        if key not in self.memo:
            self.memo[key] = self._moment(*key)
        return self.memo[key]

    def _moment(self, ring: Ring, column: int, order: int) -> Any:
        moment = self.mass(ring)
        if order:
            deviation = ring.deviation(self.sums(column), Column.whole(self.sizes), self.law, column)
            moment = moment * deviation**order
        return moment

    @cached_property
    def memo(self) -> dict[tuple[Ring, int, int], Any]:
        """Moments already asked for."""
        return {}

    def weigh(self, ring: Ring, column: int, order: int, factors: Column, index: Ints) -> Any:
        """Sum over the rows ``index`` of a moment times an exact factor."""
        return self.moment(ring, column, order)[index].scale(factors.spread(len(index))).sum()


class LatticeTable(Table):
    """Idempotent features only: closed forms W^n, whatever n, be it a symbol."""

    def __init__(self, law: Law, n: Any, wanted: Level) -> None:
        (name,) = wanted
        self.law, self.n, self.level = law, n, wanted
        self.family: Family = law.family(name, n)
        self.sizes = np.full(self.family.rows, n, dtype=np.int64 if isinstance(n, int) else object)
        self.states = dict(self.family.states)

    def has_moments(self, column: int) -> bool:
        return True

    def mass(self, ring: Ring) -> Any:
        return self.moment(ring, 0, 0)

    def _moment(self, ring: Ring, column: int, order: int) -> Any:
        return self.family.to_rows(self._power(ring, column, order, self.family.subsets))

    def weigh(self, ring: Ring, column: int, order: int, factors: Column, index: Ints) -> Any:
        num, den = factors.spread(len(index)).common()
        subsets, signed = self.family.to_subsets(num, index)
        if not len(signed):
            return ring.number(Fraction(0))
        return self._power(ring, column, order, subsets).scale(Column.whole(signed, den)).sum()

    def _power(self, ring: Ring, column: int, order: int, subsets: Subsets) -> Any:
        """W^n and its two derivatives along the centred values, over subsets of the atoms."""
        n = self.n
        w = ring.subset_sums(self.law, column, 0, subsets)
        if order == 0:
            return w**n
        u = ring.subset_sums(self.law, column, 1, subsets)
        if order == 1:
            return (w ** (n - 1) * u).scale(Column.constant(n))
        v = ring.subset_sums(self.law, column, 2, subsets)
        second = (w ** (n - 1) * v).scale(Column.constant(n))
        if n != 1:
            second = second + (w ** (n - 2) * u**2).scale(Column.constant(n * (n - 1)))
        return second


class PolynomialTable(Table):
    """Additive features, alone or within each row of a lattice: powers of sparse polynomials."""

    def __init__(self, law: Law, n: int, wanted: Level) -> None:
        self.law, self.level = law, wanted
        sums = sorted(f for f in wanted if f.startswith(("sum", "squares")))
        (name,) = [f for f in wanted if f not in sums] or ["all"]
        shape = law.family(name, n)
        rows, exponents, numerators = _inverted(shape, n, _exponents(law, sums), law.masses)
        self.sizes = np.full(len(rows), n, dtype=np.int64)
        self.states = {key: values[rows] for key, values in shape.states.items() if wanted - set(sums)}
        self.states |= {name: exponents[:, i] for i, name in enumerate(sums)}
        self._mass = Integers(numerators, law.unit**n)

    def mass(self, ring: Ring) -> Any:
        if isinstance(ring, Exact):
            return self._mass
        if isinstance(ring, Float64):
            return round_integers(self._mass)
        return self._grown(ring)

    def _grown(self, ring: Ring) -> Any:
        """Other rings: group the rows of counts, which are monomials in every ring."""
        counts = CountTable(self.law, int(self.sizes[0]))
        names = list(self.states)
        order, starts = grouping([counts.state(name) for name in names])
        by_key = counts.mass(ring)[order].group(starts)
        mine, _ = grouping([self.states[name] for name in names])
        return by_key[np.argsort(mine)]


class MonomialTable(Table):
    """Rows whose probability is (number of orders) x (product of omega_i^counts_i)."""

    orders: Ints

    @property
    def exponents(self) -> Ints:
        """The powers of the weights in the probability of each row."""
        return self.state("counts")

    def mass(self, ring: Ring) -> Any:
        return ring.counted(self.orders, self.exponents, self.law)

    def weigh(self, ring: Ring, column: int, order: int, factors: Column, index: Ints) -> Any:
        """For symbolic weights: (S - n I)^order multiplied out, so that each power of I has one sum of monomials."""
        num, den = factors.spread(len(index)).common()
        law = self.law
        if not isinstance(law, SymbolicLaw) or law.symbolic_values or symbolic(num):
            return super().weigh(ring, column, order, factors, index)
        lattice, sizes = law.lattice(column), self.sizes[index].astype(object)
        scaled = num.astype(object) * self.orders[index]
        sums = self.state(total(column))[index].astype(object) if order else sizes
        gathered = ring.number(Fraction(0))
        for j in range(order + 1):
            part = law.monomials(self.exponents[index], scaled * sums ** (order - j) * sizes**j)
            share = math.comb(order, j) * lattice.step ** (order - j) * (lattice.base - lattice.mean) ** j
            gathered = gathered + part * share
        return gathered * Fraction(1, den)


class CountTable(MonomialTable):
    """How often each atom was drawn: Eq. 3 of the paper."""

    def __init__(self, law: Law, n: int) -> None:
        self.law, self.level = law, Level({"counts"})
        counts, self.orders = multinomial(n, law.k)
        self.sizes = np.full(len(counts), n, dtype=np.int64)
        self.states = {"counts": counts}


class SequenceTable(MonomialTable):
    """Every sequence of draws."""

    def __init__(self, law: Law, n: int) -> None:
        self.law, self.level = law, Level({"sequence"})
        grid = np.indices((law.k,) * n).reshape(n, -1).T if n else np.zeros((1, 0), dtype=np.int64)
        self.sizes = np.full(len(grid), n, dtype=np.int64)
        self.orders = np.ones(len(grid), dtype=object)
        self.states = {"sequence": grid}


def power(law: Law, n: Any, wanted: Level) -> Table:
    """The n-th power of a law at a level; NoClosedForm where a symbolic n has none."""
    if law.indexed:
        return LatticeTable(law, n, Level({"flat"}))
    if not isinstance(n, int):
        return LatticeTable(law, n, _closed(wanted, n) or Level({"flat"}))
    if "sequence" in wanted:
        return SequenceTable(law, n)
    if "counts" in wanted or n == 0 or _too_wide(law, n, wanted):
        return CountTable(law, n)
    if any(f.startswith("sum") for f in wanted):
        return PolynomialTable(law, n, wanted)
    return LatticeTable(law, n, wanted or Level({"flat"}))


def _closed(wanted: Level, n: Any) -> Level:
    """A level that stays the same however many draws; NoClosedForm for any other."""
    if wanted <= set(IDEMPOTENT):
        return wanted
    raise NoClosedForm(
        f"level {wanted} has no closed form in n={n}: make {n} concrete, or decide on range, min, max, "
        f"contrast or all_equal"
    )


def rows_of(law: Law, n: Any, wanted: Level) -> int:
    """How many rows a table will have, at most; asked before it is built."""
    k = law.k
    if law.indexed and (n == 0 or wanted - {"flat"}):
        raise NoClosedForm(
            "with an open number of values only all_equal, or a variation at 0, can be looked at: make k concrete"
        )
    if not isinstance(n, int):
        _closed(wanted, n)
        n = k + 1
    if "sequence" in wanted:
        return int(k**n)
    counts = math.comb(n + k - 1, k - 1)
    if "counts" in wanted or n == 0 or _too_wide(law, n, wanted):
        return counts
    lattice = {"flat": k + 1, "extremes": k * (k + 1) // 2, "support": 2**k}
    rows = math.prod(bound for name, bound in lattice.items() if name in wanted)
    for feature in wanted:
        if feature.startswith(("sum", "squares")):
            column = int(feature.split(":")[1])
            rows *= n * largest(law.lattice(column).e) ** (2 if feature.startswith("squares") else 1) + 1
    return int(min(rows, counts))


def multinomial(n: int, k: int) -> tuple[Ints, Ints]:
    """All k-tuples of counts that sum to n, and n! / (n_1! ... n_k!) of each."""
    if k == 1:
        return np.array([[n]], dtype=np.int64), np.array([1], dtype=object)
    counts, orders = np.zeros((1, 0), dtype=np.int64), np.array([1], dtype=object)
    left = np.array([n], dtype=np.int64)
    binomials = {m: np.array([math.comb(m, j) for j in range(m + 1)], dtype=object) for m in range(n + 1)}
    for _ in range(k - 1):
        repeats = left + 1
        drawn = np.concatenate([np.arange(m + 1) for m in left])
        choose = np.concatenate([binomials[int(m)] for m in left])
        counts = np.column_stack([np.repeat(counts, repeats, axis=0), drawn])
        orders = np.repeat(orders, repeats) * choose
        left = np.repeat(left, repeats) - drawn
    return np.column_stack([counts, left]), orders


# -- polynomials ------------------------------------------------------------------------------------


def _exponents(law: Law, sums: list[str]) -> list[tuple[int, ...]]:
    columns = []
    for feature in sums:
        e = [int(x) for x in law.lattice(int(feature.split(":")[1])).e]
        columns.append([x * x for x in e] if feature.startswith("squares") else e)
    return list(zip(*columns, strict=True))


def _too_wide(law: Law, n: int, wanted: Level) -> bool:
    """Whether the exponents would outgrow the polynomials (values taken from binary floats do), or are formulas."""
    for feature in wanted:
        if feature.startswith(("sum", "squares")):
            if law.symbolic or symbolic(law.lattice(int(feature.split(":")[1])).e):
                return True
            degree = 2 if feature.startswith("squares") else 1
            if n * largest(law.lattice(int(feature.split(":")[1])).e) ** degree >= _EXPONENT_LIMIT:
                return True
    return False


def _inverted(shape: Family, n: int, exponents: list[tuple[int, ...]], masses: list[int]) -> tuple[Ints, Ints, Ints]:
    """Polynomial powers over subsets, turned into (row, exponents, numerator) of each state."""
    context = fmpz_mpoly_ctx.get([f"z{i}" for i in range(len(exponents[0]))], "lex")
    atoms = [context.from_dict({e: mass}) for e, mass in zip(exponents, masses, strict=True)]
    powers = {}
    for subset, members in enumerate(shape.subsets.members()):
        base = sum((atoms[i] for i in np.flatnonzero(members)), context.from_dict({}))
        powers[subset] = base**n
    rows: list[int] = []
    found: list[tuple[int, ...]] = []
    numerators: list[int] = []
    for row in range(shape.rows):
        polynomial = context.from_dict({})
        for subset, sign in shape.terms(row):
            polynomial = polynomial + powers[subset] if sign > 0 else polynomial - powers[subset]
        monomials = polynomial.monoms()
        rows += [row] * len(monomials)
        found += monomials
        numerators += map(int, polynomial.coeffs())
    states = np.array([[int(x) for x in m] for m in found], dtype=np.int64).reshape(len(found), len(exponents[0]))
    return np.array(rows, dtype=np.int64), states, np.array(numerators, dtype=object)


# -- coarser states from finer ones -----------------------------------------------------------------


def _derive_state(table: Table, feature: str) -> Ints:
    law = table.law
    if not table.knows("extremes" if feature in ("lowest", "highest") else feature):
        raise KeyError(f"level {table.level!r} does not determine {feature!r}")
    if feature == "counts":
        sequence = table.state("sequence")
        return np.stack([(sequence == i).sum(axis=1) for i in range(law.k)], axis=1).astype(np.int64)
    if feature in ("lowest", "highest") and not table.knows("counts"):
        return _ends(table.state("support"), law.k)[0 if feature == "lowest" else 1]
    if feature.startswith(("sum", "squares")):
        e = law.lattice(int(feature.split(":")[1])).e
        return _weighted(table.state("counts"), times(e, e) if feature.startswith("squares") else e)
    if feature == "flat":
        return _flat(table)
    seen = table.state("counts") > 0
    if feature == "support":
        return np.asarray(seen @ (1 << np.arange(law.k, dtype=np.int64)))
    return _first_last(seen)[0 if feature == "lowest" else 1]


def _weighted(counts: Ints, e: Ints) -> Ints:
    if e.dtype == object or largest(e) * (int(counts.sum(axis=1).max(initial=0)) + 1) >= 1 << 62:
        return np.asarray(counts.astype(object) @ e.astype(object))
    return np.asarray(counts @ e)


def _first_last(seen: Ints) -> tuple[Ints, Ints]:
    """First and last atom seen; for an empty sample k and -1, so that min and max absorb it."""
    k = seen.shape[1]
    some = seen.any(axis=1)
    return np.where(some, seen.argmax(axis=1), k), np.where(some, k - 1 - seen[:, ::-1].argmax(axis=1), -1)


def _ends(masks: Ints, k: int) -> tuple[Ints, Ints]:
    return _first_last((masks[:, None] >> np.arange(k)) & 1 > 0)


def _flat(table: Table) -> Ints:
    """Index of the one atom drawn, -1 where several were, -2 where none was."""
    if table.knows("extremes"):
        low, high = table.state("lowest"), table.state("highest")
        return np.where(low > high, -2, np.where(low == high, low, -1))
    law, flat = table.law, np.full(table.rows, True)
    index = {tuple(Fraction(1) * law.lattice(c).e.tolist()[i] for c in range(law.channels)): i for i in range(law.k)}
    means = []
    for c in range(law.channels):
        s, q = table.state(total(c)), table.state(squares(c))
        flat &= np.asarray(times(q, table.sizes) == times(s, s), dtype=bool)
        means.append([quotient(x, max(int(n), 1)) for x, n in zip(s.tolist(), table.sizes.tolist(), strict=True)])
    found = [index[m] if f and n else -1 for f, n, m in zip(flat, table.sizes, zip(*means, strict=True), strict=True)]
    return np.where(table.sizes == 0, -2, integers(found))
