"""The engine beside plain loops over Fractions, task by task: ``pytest tests/benchmarks``.

Each group of the table is one task; where a plain loop can do it at all it stands in the same
group, so that the number in parentheses is the ratio. Every timed call derives from scratch,
pixel and tables included, and both sides are asked for the same number, which is compared with
``==``. The tasks T1 to T4 are those of the project's survey of engines: values 0, 1, 4, 9, ...
with weights in proportion to 1, 2, ..., k. No test asserts a time.

Useful options: ``-k T3``, ``--benchmark-columns=min,median,rounds``, ``--benchmark-json=FILE``.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import pytest
from tests.benchmarks import plain

from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue


def squares(k: int) -> Pixel:
    """Values 0, 1, 4, 9, ..., weights in proportion to 1, 2, ..., k."""
    return Pixel({i * i: Fraction(i + 1, k * (k + 1) // 2) for i in range(k)})


def lattice(k: int) -> Pixel:
    """Values 0, 1, 2, ..., weights in proportion to 1, 2, ..., k."""
    return Pixel({i: Fraction(i + 1, k * (k + 1) // 2) for i in range(k)})


def grey(k: int) -> Pixel:
    """k equally spaced tones."""
    return Pixel({Fraction(i, k - 1): Fraction(2 * i + 1, k * k) for i in range(k)})


def until(k: int, most: int) -> Fraction:
    """The square of T3's threshold, which spreads the stopping out."""
    return Fraction(1, 4 * most) if k == 2 else Fraction(3, most)


def growing(X: Any, k: int, most: int) -> Any:
    """T3 by X.draw_until."""
    return X.draw_until(lambda S: S.variance() <= S.size * until(k_of(X), most), start=4, most=most).mean()


def k_of(X: Any) -> int:
    """The number of values of a population."""
    return len(X.values)


def looping(X: Any, most: int) -> Any:
    """T3 as a plain while loop."""
    S = X.draw(4)
    while S.size < most and S.variance() > S.size * until(k_of(X), most):
        S.more(1)
    return S.mean()


def by_variance(X: Any, n: int, bound: Any) -> Any:
    """Fig. 1 with the sample variance as variation."""
    S = X.draw(n)
    return S.mean() if S.variance() <= bound else X.true_mean()
