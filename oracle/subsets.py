"""Families of subsets of the atoms, on which idempotent features are pointwise powers.

"All draws fell into A" has probability W_A^n. A family holds the subsets that a feature needs,
and the signs of the Moebius inversion that turn these into probabilities of rows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truemean.oracle.columns import Column, Ints, times

__all__ = ["Family", "family"]


@dataclass(frozen=True, slots=True, eq=False)
class Windows:
    """Subsets ``low..high`` of the sorted atoms."""

    k: int
    low: Ints
    high: Ints

    def members(self) -> NDArray[np.bool_]:
        """Membership ``[subsets, k]``."""
        atoms = np.arange(self.k)
        return np.asarray((self.low[:, None] <= atoms) & (atoms <= self.high[:, None]))

    def sums(self, atoms: Ints) -> Ints:
        """Sum of exact atom values over each subset."""
        prefix = np.concatenate([np.zeros(1, dtype=object), np.cumsum(atoms)])
        return np.asarray(prefix[self.high + 1] - prefix[self.low])

    def only(self, kept: Ints) -> Windows:
        """Some of the subsets."""
        return Windows(self.k, self.low[kept], self.high[kept])


@dataclass(frozen=True, slots=True, eq=False)
class Masks:
    """Any subsets, as bit masks."""

    k: int
    masks: Ints

    def members(self) -> NDArray[np.bool_]:
        """Membership ``[subsets, k]``."""
        return np.asarray((self.masks[:, None] >> np.arange(self.k)) & 1 > 0)

    def sums(self, atoms: Ints) -> Ints:
        """Sum of exact atom values over each subset."""
        found = np.zeros(len(self.masks), dtype=object)
        for i, atom in enumerate(atoms):
            found[(self.masks >> i) & 1 > 0] += atom
        return found

    def only(self, kept: Ints) -> Masks:
        """Some of the subsets."""
        return Masks(self.k, self.masks[kept])


@dataclass(frozen=True, slots=True, eq=False)
class Family:
    """Subsets, and the signed incidence that makes rows of them.

    Entry t says: row ``row[t]`` contains subset ``subset[t]`` with ``sign[t]``; sorted by row.
    """

    rows: int
    subsets: Any
    row: Ints
    subset: Ints
    sign: Ints
    states: dict[str, Ints]

    def to_rows(self, values: Any) -> Any:
        """Values over subsets, inverted into values by row."""
        signed = values[self.subset].scale(Column.whole(self.sign).spread(len(self.sign)))
        return signed.group(np.searchsorted(self.row, np.arange(self.rows)))

    def to_subsets(self, factors: Ints, index: Ints) -> tuple[Any, Ints]:
        """The transpose: factors on some rows as factors on the few subsets where they don't cancel."""
        by_row = np.zeros(self.rows, dtype=factors.dtype)
        by_row[index] = factors
        found = np.zeros(1 + int(self.subset.max(initial=0)), dtype=factors.dtype)
        np.add.at(found, self.subset, times(by_row[self.row], self.sign))
        kept = np.flatnonzero(found)
        return self.subsets.only(kept), found[kept]

    def terms(self, row: int) -> list[tuple[int, int]]:
        """``(subset, sign)`` of one row."""
        entries = slice(*np.searchsorted(self.row, [row, row + 1]))
        return list(zip(self.subset[entries].tolist(), self.sign[entries].tolist(), strict=True))


@lru_cache(maxsize=64)
def family(name: str, k: int, n: int) -> Family:
    """The family of a feature for k atoms; rows that n draws can't reach are left out.

    >>> family("flat", 3, 2).states["flat"]
    array([ 0,  1,  2, -1])
    """
    if name == "all":
        return replace(_constants(1), subsets=Windows(k, np.array([0]), np.array([k - 1])), states={})
    if n == 1 or k == 1:
        return _constants(k)
    return _supports(k, n) if name == "support" else {"flat": _flat, "extremes": _windows}[name](k)


def _constants(k: int) -> Family:
    """Nothing but samples of equal draws: one row per atom, whatever the feature."""
    atoms = np.arange(k)
    states = {"flat": atoms, "lowest": atoms, "highest": atoms, "support": 1 << atoms}
    return Family(k, Windows(k, atoms, atoms), atoms, atoms, np.ones(k, dtype=np.int64), states)


def _flat(k: int) -> Family:
    """K constant rows, and one mixed row as the complement."""
    atoms = np.arange(k)
    row = np.concatenate([atoms, np.full(k + 1, k)])
    subset = np.concatenate([atoms, atoms, [k]])
    sign = np.concatenate([np.ones(k), -np.ones(k), [1]]).astype(np.int64)
    subsets = Windows(k, np.append(atoms, 0), np.append(atoms, k - 1))
    return Family(k + 1, subsets, row, subset, sign, {"flat": np.append(atoms, -1)})


def _windows(k: int) -> Family:
    """One row per (lowest, highest) atom seen."""
    low, high = np.triu_indices(k)
    place = np.full((k + 1, k + 1), -1)
    place[low, high] = np.arange(len(low))
    rows, subsets, signs = [], [], []
    for down, up, sign in ((0, 0, 1), (1, 0, -1), (0, 1, -1), (1, 1, 1)):
        inside = np.flatnonzero((low + down <= high - up) & (high >= up))
        rows.append(inside)
        subsets.append(place[low[inside] + down, high[inside] - up])
        signs.append(np.full(len(inside), sign, dtype=np.int64))
    order = np.argsort(np.concatenate(rows), kind="stable")
    row, subset, sign_of = (np.concatenate(x)[order] for x in (rows, subsets, signs))
    return Family(len(low), Windows(k, low, high), row, subset, sign_of, {"lowest": low, "highest": high})


def _supports(k: int, n: int) -> Family:
    """One row per set of atoms seen: Moebius over all its subsets."""
    reached = [mask for mask in range(1, 1 << k) if mask.bit_count() <= n]
    entries = []
    for number, mask in enumerate(reached):
        part = mask
        while part:
            entries.append((number, part - 1, -1 if (mask.bit_count() - part.bit_count()) % 2 else 1))
            part = (part - 1) & mask
    row, subset, sign = np.array(entries, dtype=np.int64).T
    masks = np.arange(1, 1 << k, dtype=np.int64)
    return Family(len(reached), Masks(k, masks), row, subset, sign, {"support": np.array(reached, dtype=np.int64)})
