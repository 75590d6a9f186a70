"""float64 over the pixels of an image: many pixels of the same values at once."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truemean.errors import InputError, InputTypeError
from truemean.oracle.columns import Column, Ints
from truemean.oracle.law import Law
from truemean.oracle.rings import Subsets, Term

__all__ = ["Batch", "Plane", "checked_weights"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Plane:
    """Floats by row and pixel: ``array [rows, pixels]``."""

    array: Floats

    def __len__(self) -> int:
        return len(self.array)

    def __getitem__(self, index: Any) -> Plane:
        return Plane(self.array[index])

    def __add__(self, other: Plane) -> Plane:
        return Plane(self.array + other.array)

    def __mul__(self, other: Plane) -> Plane:
        return Plane(self.array * other.array)

    def __pow__(self, n: int) -> Plane:
        return Plane(self.array**n)

    def scale(self, column: Column) -> Plane:
        return Plane(self.array * column.floats()[:, None])

    def group(self, starts: Ints) -> Plane:
        return Plane(np.add.reduceat(self.array, starts, axis=0))

    def sum(self) -> Floats:
        return np.asarray(self.array.sum(axis=0))

    def join(self, others: list[Plane]) -> Plane:
        return Plane(np.concatenate([v.array for v in (self, *others)]))

    def numbers(self) -> tuple[list[Any], int]:
        return list(self.array), 1


class Batch:
    """Many pixels of the same values at once: ``weights [k, ...]`` in the order of the law's atoms."""

    closed = False

    def __init__(self, law: Law, weights: Floats) -> None:
        self.law, self.shape = law, weights.shape[1:]
        self.array = weights.reshape(len(weights), -1)

    def _weights(self, law: Law) -> Floats:
        """The open weights for the pixel's own law, the fixed ones for any other."""
        if law is self.law:
            return self.array
        return np.repeat(np.array(law.weights, dtype=float)[:, None], self.array.shape[1], axis=1)

    def _values(self, law: Law, column: int) -> Floats:
        return np.array([float(x) for x in law.column(column)])

    def subset_sums(self, law: Law, column: int, power: int, subsets: Subsets) -> Plane:
        atoms = self._weights(law) * self._deviations(law, column) ** power
        return Plane(subsets.members().astype(float) @ atoms)

    def _reference(self, law: Law, column: int) -> tuple[Ints, Floats]:
        """By pixel the heaviest atom, and how far the true mean is from it: small numbers stay exact to the last digit."""
        weights, values = self._weights(law), self._values(law, column)
        heaviest = weights.argmax(axis=0)
        return heaviest, (weights * (values[:, None] - values[heaviest])).sum(axis=0)

    def _deviations(self, law: Law, column: int) -> Floats:
        """Values minus the true mean, by atom and pixel."""
        values = self._values(law, column)
        heaviest, shift = self._reference(law, column)
        return values[:, None] - values[heaviest] - shift

    def mean(self, law: Law, column: int) -> Floats:
        return np.asarray(self._values(law, column) @ self._weights(law))

    def variance(self, law: Law, column: int) -> Floats:
        """The variance of a column, by pixel."""
        return np.asarray((self._weights(law) * self._deviations(law, column) ** 2).sum(axis=0))

    def number(self, value: Fraction) -> Floats:
        return np.full(self.array.shape[1], float(value))

    def vector(self, column: Column) -> Plane:
        return Plane(np.repeat(column.floats()[:, None], self.array.shape[1], axis=1))

    def combined(self, rest: Column, terms: list[Term]) -> Plane:
        total = self.vector(rest)
        for coefficient, (law, column), moment in terms:
            by_pixel = self.mean(law, column) if moment == "mean" else self.variance(law, column)
            total = total + Plane(coefficient.spread(len(rest)).floats()[:, None] * by_pixel)
        return total

    def counted(self, orders: Ints, exponents: Ints, law: Law) -> Plane:
        logs = np.array([math.log(int(n)) for n in orders])[:, None]
        with np.errstate(divide="ignore"):
            log_weights = np.log(self._weights(law))
        for powers, log_weight in zip(exponents.T, log_weights, strict=True):
            used = powers[:, None] > 0
            logs = logs + np.where(used, powers[:, None] * np.where(used, log_weight, 0.0), 0.0)
        return Plane(np.exp(logs))

    def deviation(self, sums: Column, sizes: Column, law: Law, column: int) -> Plane:
        heaviest, shift = self._reference(law, column)
        numbers = law.column(column)
        relative = np.stack([(sums - sizes * Column.constant(x)).floats() for x in numbers], axis=1)
        return Plane(relative[:, heaviest] - sizes.floats()[:, None] * shift)


def checked_weights(weights: Any, k: int) -> Floats:
    """Arrays of weights ``[k, ...]``; InputTypeError or InputError for what is none."""
    try:
        array = np.asarray(weights, dtype=float)
    except (TypeError, ValueError):
        raise InputTypeError(f"weights={weights!r} are neither a mapping value -> weight nor arrays [k, ...]") from None
    if array.ndim < 1 or len(array) != k:
        raise InputError(f"weights of shape {array.shape}: the first axis is the {k} values of the pixel")
    if not (array >= 0).all() or not np.allclose(array.sum(axis=0), 1, rtol=0, atol=1e-9):
        raise InputError("weights must be >= 0 and sum to 1 along the first axis, to 1e-9")
    return array
