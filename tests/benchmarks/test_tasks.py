"""The engine beside plain loops over Fractions, task by task: ``pytest tests/benchmarks``.

Each group of the table is one task. Where a plain loop can do it at all it stands in the same
group, so that the number in parentheses is the ratio; it is asked for the same number, and the
two are compared with ``==``. Every timed call derives from scratch, tables included. The tasks T1
to T4 are those of the project's survey of engines: values 0, 1, 4, 9, ... with weights in
proportion to 1, 2, ..., k. No test asserts a time.

Useful options: ``-k T3``, ``--benchmark-columns=min,median,rounds``, ``--benchmark-json=FILE``.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import cache
from typing import Any

import pytest
from tests.benchmarks import plain

from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue

FIG_1, POOLED = catalogue["kirk-arvo"], catalogue["two-stage-pooled"]
Task = dict[str, Callable[[], Any]]


@cache
def pixel(k: int, power: int = 2) -> Pixel:
    """Values 0, 1, 2^power, 3^power, ..., weights in proportion to 1, 2, ..., k."""
    return Pixel({i**power: Fraction(i + 1, k * (k + 1) // 2) for i in range(k)})


def bound(k: int, most: int) -> Fraction:
    """eps^2 of T3, which spreads the stopping out."""
    return Fraction(1, 4 * most) if k == 2 else Fraction(3, most)


def recursion(X: Any, eps2: Any, most: Any) -> Any:
    """T3 by X.draw_until."""
    return X.draw_until(lambda S: S.variance() <= S.size * eps2, start=4, most=most).mean()


def loop(X: Any, eps2: Any, most: Any) -> Any:
    """T3 as a plain while loop."""
    S = X.draw(4)
    while S.size < most and S.variance() > S.size * eps2:
        S.more(1)
    return S.mean()


def by_variance(X: Any, n: Any, eps: Any) -> Any:
    """Fig. 1 with the sample variance as variation."""
    S = X.draw(n)
    return S.mean() if S.variance() <= eps else X.true_mean()


def expected(plan: Any, X: Pixel, **params: Any) -> Callable[[], Fraction]:
    """E[xi], the bias being what is derived."""
    return lambda: derive(plan, X, **params).expectation


def stopping(k: int, most: int) -> Task:
    """T3, three ways."""
    eps2 = bound(k, most)
    return {
        "draw_until": expected(recursion, pixel(k), eps2=eps2, most=most),
        "while": expected(loop, pixel(k), eps2=eps2, most=most),
        "plain": lambda: plain.stopped(pixel(k), 4, most, lambda n: n * eps2),
    }


def only(task: Task, *names: str) -> Task:
    """What of a task is tried at this size."""
    return {name: task[name] for name in names}


TASKS: dict[str, Task] = {
    "T1 range, k=3 n=7": {
        "engine": expected(FIG_1, pixel(3), n=7, eps=1),
        "plain": lambda: plain.figure_1_by_sequences(pixel(3), 7, Fraction(1)),
    },
    "T1 range, k=6 n=16": {
        "engine": expected(FIG_1, pixel(6), n=16, eps=4),
        "plain": lambda: plain.figure_1(pixel(6), 16, plain.within(Fraction(4))),
    },
    "T1 range, k=6 n=64, eps=0": {"engine": expected(FIG_1, pixel(6), n=64)},
    "T1 range, k=6 n=64, eps=4": {"engine": expected(FIG_1, pixel(6), n=64, eps=4)},
    "T1 range, k=256 n=64": {"engine": expected(FIG_1, pixel(256), n=64, eps=1000)},
    "T1 variance, k=6 n=10": {
        "engine": expected(by_variance, pixel(6, power=1), n=10, eps=1),
        "plain": lambda: plain.figure_1(pixel(6, power=1), 10, plain.calm(Fraction(1))),
    },
    "T1 variance, k=6 n=64": {"engine": expected(by_variance, pixel(6, power=1), n=64, eps=1)},
    "T2 mean, k=3 16/16": {
        "engine": expected(POOLED, pixel(3), n=16, m=16),
        "plain": lambda: sum(value * p for value, p in plain.pooled_law(pixel(3), 16, 16).items()),
    },
    "T2 mean, k=3 32/64": {"engine": expected(POOLED, pixel(3), n=32, m=64)},
    "T2 mean, k=3 32/10^6": {"engine": expected(POOLED, pixel(3), n=32, m=10**6)},
    "T3 stopping, k=2 N=64": stopping(2, 64),
    "T3 stopping, k=2 N=256": stopping(2, 256),
    "T3 stopping, k=3 N=32": stopping(3, 32),
    "T3 stopping, k=2 N=1024": only(stopping(2, 1024), "draw_until"),
    "T3 stopping, k=3 N=256": only(stopping(3, 256), "draw_until"),
    "T4 law, k=3 16/16": {
        "engine": lambda: derive(POOLED, pixel(3), n=16, m=16).distribution(),
        "plain": lambda: plain.pooled_law(pixel(3), 16, 16),
    },
    "T4 law, k=3 32/64": {
        "engine": lambda: derive(POOLED, pixel(3), n=32, m=64).distribution(),
    },
}


@cache
def answer(group: str) -> Any:
    """What the plain loop gives; the engine's own answer where there is none."""
    task = TASKS[group]
    return task.get("plain", next(iter(task.values())))()


@pytest.mark.benchmark(min_rounds=3, max_time=0.5)
@pytest.mark.parametrize(
    ("group", "way"),
    [pytest.param(group, way, id=f"{group}: {way}") for group, task in TASKS.items() for way in task],
)
def test_task(benchmark, group, way):
    benchmark.group = group
    assert benchmark(TASKS[group][way]) == answer(group)
