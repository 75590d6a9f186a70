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

from truemean.oracle.columns import Ints, times

__all__ = ["Family", "family"]


@dataclass(frozen=True, slots=True, eq=False)
class Family:
    """Subsets, either windows ``low..high`` of the sorted atoms or bit masks, and signed incidence.

    Entry t says: row ``row[t]`` contains subset ``subset[t]`` with ``sign[t]``; sorted by row.
    """

    k: int
    rows: int
    low: Ints | None
    high: Ints | None
    masks: Ints | None
    row: Ints
    subset: Ints
    sign: Ints
    states: dict[str, Ints]

    def members(self) -> NDArray[np.bool_]:
        """Membership ``[subsets, k]``."""
        atoms = np.arange(self.k)
        if self.masks is not None:
            return np.asarray((self.masks[:, None] >> atoms) & 1 > 0)
        assert self.low is not None and self.high is not None
        return np.asarray((self.low[:, None] <= atoms) & (atoms <= self.high[:, None]))

    def sums(self, atoms: Ints) -> Ints:
        """Sum of exact atom values over each subset."""
        if self.masks is not None:
            found = np.zeros(len(self.masks), dtype=object)
            for i, atom in enumerate(atoms):
                found[(self.masks >> i) & 1 > 0] += atom
            return found
        prefix = np.concatenate([np.zeros(1, dtype=object), np.cumsum(atoms)])
        assert self.low is not None and self.high is not None
        return np.asarray(prefix[self.high + 1] - prefix[self.low])

    def to_rows(self, values: Any) -> Any:
        """Values over subsets, inverted into values by row."""
        from truemean.oracle.columns import Column

        signed = values[self.subset].scale(Column.whole(self.sign).spread(len(self.sign)))
        return signed.group(np.searchsorted(self.row, np.arange(self.rows)))

    def to_subsets(self, factors: Ints, index: Ints) -> tuple[Family, Ints]:
        """The transpose: factors on some rows as factors on the few subsets where they don't cancel."""
        by_row = np.zeros(self.rows, dtype=factors.dtype)
        by_row[index] = factors
        found = np.zeros(1 + int(self.subset.max(initial=0)), dtype=factors.dtype)
        np.add.at(found, self.subset, times(by_row[self.row], self.sign))
        kept = np.flatnonzero(found)
        return self.only(kept), found[kept]

    def only(self, kept: Ints) -> Family:
        """The same family with only some of its subsets (for sums, not for inversion)."""
        if self.masks is not None:
            return replace(self, masks=self.masks[kept])
        assert self.low is not None and self.high is not None
        return replace(self, low=self.low[kept], high=self.high[kept])

    def terms(self, row: int) -> list[tuple[int, int]]:
        """``(subset, sign)`` of one row."""
        entries = slice(*np.searchsorted(self.row, [row, row + 1]))
        return list(zip(self.subset[entries].tolist(), self.sign[entries].tolist(), strict=True))


@lru_cache(maxsize=64)
def family(name: str, k: int, n: int) -> Family:
    """The family of a feature for k atoms; rows that n draws can't reach are left out."""
    makers = {"all": _all, "flat": _flat, "extremes": _windows, "support": _supports}
    return makers[name](k, n)


def _all(k: int, n: int) -> Family:
    one, zero = np.ones(1, dtype=np.int64), np.zeros(1, dtype=np.int64)
    return Family(k, 1, zero, one * (k - 1), None, zero, zero, one, {})


def _flat(k: int, n: int) -> Family:
    """k constant rows, and one mixed row as the complement."""
    atoms = np.arange(k)
    if k == 1 or n == 1:
        one = np.ones(k, dtype=np.int64)
        return Family(k, k, atoms, atoms, None, atoms, atoms, one, {"flat": atoms})
    row = np.concatenate([atoms, np.full(k + 1, k)])
    subset = np.concatenate([atoms, atoms, [k]])
    sign = np.concatenate([np.ones(k), -np.ones(k), [1]]).astype(np.int64)
    low, high = np.append(atoms, 0), np.append(atoms, k - 1)
    return Family(k, k + 1, low, high, None, row, subset, sign, {"flat": np.append(atoms, -1)})


def _windows(k: int, n: int) -> Family:
    """One row per (lowest, highest) atom seen."""
    low, high = np.triu_indices(k) if n > 1 else (np.arange(k), np.arange(k))
    rows = len(low)
    if n == 1:
        ids = np.arange(k)
        states = {"lowest": low, "highest": high}
        return Family(k, k, low, high, None, ids, ids, np.ones(k, dtype=np.int64), states)
    place = np.full((k + 1, k + 1), -1)
    place[low, high] = np.arange(rows)
    row, subset, sign = [], [], []
    for down, up, s in ((0, 0, 1), (1, 0, -1), (0, 1, -1), (1, 1, 1)):
        a, b = low + down, high - up
        inside = np.flatnonzero((a <= b) & (b >= 0))
        row.append(inside)
        subset.append(place[a[inside], b[inside]])
        sign.append(np.full(len(inside), s, dtype=np.int64))
    order = np.argsort(np.concatenate(row), kind="stable")
    joined = [np.concatenate(x)[order] for x in (row, subset, sign)]
    return Family(k, rows, low, high, None, *joined, {"lowest": low, "highest": high})


def _supports(k: int, n: int) -> Family:
    """One row per set of atoms seen: Moebius over all its subsets."""
    sizes = [mask.bit_count() for mask in range(1 << k)]
    reached = [mask for mask in range(1, 1 << k) if sizes[mask] <= n]
    row, subset, sign = [], [], []
    for number, mask in enumerate(reached):
        part = mask
        while part:
            row.append(number)
            subset.append(part - 1)
            sign.append(-1 if (sizes[mask] - sizes[part]) % 2 else 1)
            part = (part - 1) & mask
    arrays = [np.array(x, dtype=np.int64) for x in (row, subset, sign)]
    masks = np.arange(1, 1 << k, dtype=np.int64)
    return Family(k, len(reached), None, None, masks, *arrays, {"support": np.array(reached, dtype=np.int64)})
