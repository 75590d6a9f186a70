"""What a first program would do: plain loops over Fractions, one per task, sharing nothing with the engine."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from fractions import Fraction
from itertools import product

from truemean.oracle.pixel import Pixel

Law = list[tuple[Fraction, Fraction]]


def atoms(pixel: Pixel) -> Law:
    """Values and weights."""
    return list(pixel.law.items())


def tuples(k: int, n: int) -> Iterator[tuple[int, ...]]:
    """All k-tuples of counts that sum to n."""
    if k == 1:
        yield (n,)
        return
    for first in range(n + 1):
        for rest in tuples(k - 1, n - first):
            yield (first, *rest)


def chance(counts: tuple[int, ...], law: Law) -> Fraction:
    """Eq. 3."""
    orders = math.factorial(sum(counts))
    probability = Fraction(1)
    for count, (_, weight) in zip(counts, law, strict=True):
        orders //= math.factorial(count)
        probability *= weight**count
    return orders * probability


def moments(counts: tuple[int, ...], law: Law) -> tuple[Fraction, Fraction]:
    """Sample mean and variance."""
    n = sum(counts)
    mean = sum((c * value for c, (value, _) in zip(counts, law, strict=True)), Fraction(0)) / n
    spread = sum((c * (value - mean) ** 2 for c, (value, _) in zip(counts, law, strict=True)), Fraction(0))
    return mean, spread / (n - 1)


def figure_1(pixel: Pixel, n: int, easy: Callable[[tuple[int, ...], Law], bool]) -> Fraction:
    """E[xi] of Fig. 1 over all k-tuples, as the paper's section 3 says."""
    law = atoms(pixel)
    expectation, truth = Fraction(0), sum((value * weight for value, weight in law), Fraction(0))
    for counts in tuples(len(law), n):
        estimate = moments(counts, law)[0] if easy(counts, law) else truth
        expectation += chance(counts, law) * estimate
    return expectation


def figure_1_by_sequences(pixel: Pixel, n: int, eps: Fraction) -> Fraction:
    """E[xi] of Fig. 1 over all k^n sequences."""
    law = atoms(pixel)
    expectation, truth = Fraction(0), sum((value * weight for value, weight in law), Fraction(0))
    for draws in product(law, repeat=n):
        values = [value for value, _ in draws]
        probability = Fraction(1)
        for _, weight in draws:
            probability *= weight
        estimate = sum(values, Fraction(0)) / n if max(values) - min(values) <= eps else truth
        expectation += probability * estimate
    return expectation


def within(eps: Fraction) -> Callable[[tuple[int, ...], Law], bool]:
    """range <= eps."""

    def easy(counts: tuple[int, ...], law: Law) -> bool:
        seen = [value for count, (value, _) in zip(counts, law, strict=True) if count]
        return max(seen) - min(seen) <= eps

    return easy


def calm(bound: Fraction) -> Callable[[tuple[int, ...], Law], bool]:
    """variance <= bound."""
    return lambda counts, law: moments(counts, law)[1] <= bound


def pooled_law(pixel: Pixel, n: int, m: int) -> dict[Fraction, Fraction]:
    """The law of the two-stage pooled mean: a second sample of m where the first of n varies."""
    law = atoms(pixel)
    found: dict[Fraction, Fraction] = {}
    second = [(chance(counts, law), counts) for counts in tuples(len(law), m)]
    for counts in tuples(len(law), n):
        probability = chance(counts, law)
        if n in counts:
            mean = Fraction(sum(c * value for c, (value, _) in zip(counts, law, strict=True)), n)
            found[mean] = found.get(mean, Fraction(0)) + probability
            continue
        for p, more in second:
            both = zip(counts, more, law, strict=True)
            mean = Fraction(sum((a + b) * value for a, b, (value, _) in both), n + m)
            found[mean] = found.get(mean, Fraction(0)) + probability * p
    return found


def stopped(pixel: Pixel, start: int, most: int, bound: Callable[[int], Fraction]) -> Fraction:
    """E[mean] where sampling stops at variance <= bound(n), or at most: a DP over counts in Fractions."""
    law = atoms(pixel)
    states: dict[tuple[int, ...], Fraction] = {(0,) * len(law): Fraction(1)}
    expectation = Fraction(0)
    for n in range(most + 1):
        after: dict[tuple[int, ...], Fraction] = {}
        for counts, probability in states.items():
            if n >= start:
                mean, variance = moments(counts, law)
                if n == most or variance <= bound(n):
                    expectation += probability * mean
                    continue
            for number, (_, weight) in enumerate(law):
                grown = (*counts[:number], counts[number] + 1, *counts[number + 1 :])
                after[grown] = after.get(grown, Fraction(0)) + probability * weight
        states = after
    return expectation
