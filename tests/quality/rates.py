"""Laws whose mean is known exactly, and how often, or how soon, a kind of evidence speaks against it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np
from scipy.special import betaincinv
from scipy.stats import binom

from truemean.conformance.evidence import (
    METHODS,
    Batch,
    Bounded,
    EProcess,
    FixedSample,
    FloatArray,
    Question,
    growth,
)

NOMINAL = 0.05  # alpha, or beta, in all that measures errors
POWER = 0.01  # alpha, or beta, in all that measures power
HORIZON, FAR = 2_500, 40_000  # outcomes a repetition; FAR is more than log(20) / 1e-4, what a rare event takes
EVERY, LOOK_GROWTH = 20, 0.1  # a look at each of the first outcomes, then at this share of those before
WIDEST = Fraction(1, 50)
FLOOR = 1e-4  # the least variance that the z test of Mitsuba 3 believes
SEED = 2026


@dataclass(frozen=True)
class Law:
    """A law on [0, 1] of known mean: finitely many atoms, or a quantile function."""

    mean: Fraction
    atoms: Mapping[Fraction, Fraction] = field(default_factory=dict)
    quantile: Callable[[FloatArray], FloatArray] | None = None
    horizon: int = HORIZON

    @property
    def tolerance(self) -> Fraction:
        """1/50, less where the mean is so small that a true mean below it would leave the range."""
        return min(WIDEST, self.mean / 2)

    @property
    def columns(self) -> tuple[FloatArray, FloatArray]:
        """Values and probabilities; those of a thousand quantiles if there are no atoms."""
        if self.quantile:
            return self.quantile((np.arange(1000) + 0.5) / 1000), np.full(1000, 1e-3)
        return np.array([float(v) for v in self.atoms]), np.array([float(p) for p in self.atoms.values()])

    def batches(self, rng: np.random.Generator, looks: Sequence[int]) -> Iterator[Batch]:
        """A batch for each look; all are drawn at once, so that stopping early changes nothing later."""
        if self.quantile:
            outcomes = self.quantile(rng.random(sum(looks)))
            return (Batch.of(part) for part in np.split(outcomes, np.cumsum(looks)[:-1]))
        values, probabilities = self.columns
        drawn = rng.multinomial(looks, probabilities / probabilities.sum()).astype(float)
        return (Batch(values[counts > 0], counts[counts > 0]) for counts in drawn)


def finite(atoms: Mapping[Fraction, Fraction], horizon: int = HORIZON) -> Law:
    """The law with these atoms, which sum to exactly 1."""
    if sum(atoms.values()) != 1:
        raise ValueError(f"probabilities sum to {sum(atoms.values())}, not 1")
    ascending = {value: atoms[value] for value in sorted(atoms) if atoms[value]}
    return Law(sum((v * p for v, p in ascending.items()), Fraction(0)), ascending, horizon=horizon)


def counted(n: int, white: Fraction) -> dict[int, Fraction]:
    """The binomial law: how many of ``n`` samples are white."""
    return {k: math.comb(n, k) * white**k * (1 - white) ** (n - k) for k in range(n + 1)}


def mean_of(n: int, white: Fraction) -> Law:
    """The mean of ``n`` samples of a black and white pixel."""
    return finite({Fraction(k, n): p for k, p in counted(n, white).items()})


def kirk_arvo(n: int, white: Fraction) -> Law:
    """A pilot that is returned if all of it agree, the exact mean if not: biased (Kirk & Arvo 1991)."""
    easy = {Fraction(0): (1 - white) ** n, Fraction(1): white**n}
    return finite({**easy, white: 1 - sum(easy.values(), Fraction(0))})


def two_stage(white: Fraction, *, pooled: bool) -> Law:
    """A pilot of 4 decides whether 12 more samples are drawn: pooled with them it biases, thrown away it does not."""
    atoms: dict[Fraction, Fraction] = {}
    for pilot, chance in counted(4, white).items():
        agree = pilot in (0, 4)
        more = 12 if not agree else 0 if pooled else 4
        kept = (pilot, 4) if pooled else (0, 0)
        for k, p in counted(more, white).items():
            value = Fraction(kept[0] + k, kept[1] + more)
            atoms[value] = atoms.get(value, Fraction(0)) + chance * p
    return finite(atoms)


def rare(dark: str, bright: str, probability: str) -> Law:
    """``bright`` with a small probability, otherwise ``dark``."""
    p = Fraction(probability)
    return finite({Fraction(dark): 1 - p, Fraction(bright): p}, FAR)


EIGHTH, HALF = Fraction(1, 8), Fraction(1, 2)

LAWS: Mapping[str, Law] = {
    "mean of 16, w = 1/8": mean_of(16, EIGHTH),
    "mean of 16, w = 0.01": mean_of(16, Fraction(1, 100)),
    "two-stage, fresh 4 + 12, w = 1/8": two_stage(EIGHTH, pooled=False),
    "Kirk-Arvo, w = 3/4, n = 8, about its own mean": kirk_arvo(8, Fraction(3, 4)),
    "1 with probability 1e-4, else 0": rare("0", "1", "1e-4"),
    "1 with probability 1e-4, else 0.2": rare("0.2", "1", "1e-4"),
    "0.5 ± 0.001": finite({Fraction("0.499"): HALF, Fraction("0.501"): HALF}),
    "0, 1/8 or, rarely, 1": finite(
        {Fraction(0): Fraction("0.19"), EIGHTH: Fraction("0.8"), Fraction(1): Fraction("0.01")}
    ),
    "uniform": Law(HALF, quantile=lambda u: u),
    "beta(0.2, 5)": Law(Fraction(1, 26), quantile=lambda u: np.asarray(betaincinv(0.2, 5.0, u))),
}


@dataclass(frozen=True)
class Biased:
    """A law, and another true mean it is compared with."""

    law: Law
    true_mean: Fraction

    @property
    def above(self) -> bool:
        return self.law.mean > self.true_mean

    @property
    def bound(self) -> float:
        """log(1/alpha)/KL_inf: the outcomes that any valid test needs on average, up to its power."""
        return -math.log(POWER) / _nats(self.law, Bounded.at(1 if self.above else -1, self.true_mean))


BIASED: Mapping[str, Biased] = {
    "Kirk-Arvo, w = 1/8, n = 4": Biased(kirk_arvo(4, EIGHTH), EIGHTH),
    "Kirk-Arvo, w = 3/4, n = 8": Biased(kirk_arvo(8, Fraction(3, 4)), Fraction(3, 4)),
    "Kirk-Arvo, w = 0.45, n = 4": Biased(kirk_arvo(4, Fraction("0.45")), Fraction("0.45")),
    "pooled 4 + 12, w = 1/8": Biased(two_stage(EIGHTH, pooled=True), EIGHTH),
    "1 with probability 0.02, not 0.01": Biased(rare("0", "1", "0.02"), Fraction("0.01")),
    "0.2 always, its highlights clamped": Biased(finite({Fraction("0.2"): Fraction(1)}), Fraction("0.20008")),
    "0.502 ± 0.001, not 0.5": Biased(finite({Fraction("0.501"): HALF, Fraction("0.503"): HALF}), HALF),
    "uniform on [0.1, 1], not [0, 1]": Biased(Law(Fraction("0.55"), quantile=lambda u: 0.1 + 0.9 * u), HALF),
}


def biased_of(law: Law, sign: int, level: float = NOMINAL) -> Question:
    """Is |E - I| > tolerance, where E - I is 0 (``sign`` 0), or exactly the tolerance, upwards (1) or downwards (-1)?"""
    margin = law.tolerance if sign else Fraction(0)
    true_mean = law.mean - sign * margin
    sides = tuple(Bounded.at(way, true_mean + way * margin) for way in (1, -1))
    return Question(sides, level, law.horizon)


def within_of(law: Law, sign: int, level: float = NOMINAL) -> Question:
    """Is E within the edge that it lies on: the upper (``sign`` 1) or the lower one (-1)?

    CONFORMS asks for this and for the other edge too, so it is no more often wrong.
    """
    return Question((Bounded.at(-sign, law.mean),), level, law.horizon, float(law.tolerance))


def looks(horizon: int, share: float = LOOK_GROWTH) -> list[int]:
    """How many outcomes each look adds, ``horizon`` in total."""
    sizes: list[int] = []
    seen = 0
    while seen < horizon:
        sizes.append(min(horizon - seen, 1 if seen < EVERY else math.ceil(seen * share)))
        seen += sizes[-1]
    return sizes


def alarms(
    start: EProcess, law: Law, level: float, sizes: Sequence[int], *, repetitions: int, seed: tuple[int, str]
) -> FloatArray:
    """After how many outcomes each repetition raised its alarm, inf if it raised none.

    The seed is a number and a name: of one law, every kind of evidence sees the same outcomes.
    """
    rng, asked, seen = np.random.default_rng([seed[0], *seed[1].encode()]), -math.log(level), np.cumsum(sizes)
    times = np.full(repetitions, np.inf)
    for i in range(repetitions):
        process = start
        for n, batch in zip(seen, law.batches(rng, sizes), strict=True):
            process = process.update(batch)
            if process.peak >= asked:
                times[i] = n
                break
    return times


def false_alarms(method: str, name: str, sign: int, *, repetitions: int, seed: int, share: float = LOOK_GROWTH) -> int:
    """How many repetitions end BIASED though |E - I| is 0, or the tolerance."""
    law = LAWS[name]
    start = METHODS[method].open(biased_of(law, sign))
    return _count(alarms(start, law, NOMINAL, looks(law.horizon, share), repetitions=repetitions, seed=(seed, name)))


def wrong_conforms(
    method: str, name: str, sign: int, *, repetitions: int, seed: int, share: float = LOOK_GROWTH
) -> int:
    """How many repetitions rule out the edge of the tolerance that E lies on."""
    law = LAWS[name]
    start = METHODS[method].open(within_of(law, sign))
    return _count(alarms(start, law, NOMINAL, looks(law.horizon, share), repetitions=repetitions, seed=(seed, name)))


def fixed_alarms(name: str, sizes: Sequence[int], *, floor: float, repetitions: int, seed: int) -> int:
    """How many repetitions end BIASED at tolerance 0 by a t test, or with a ``floor`` by a z test."""
    law = LAWS[name]
    start = FixedSample.open(biased_of(law, 0).sides, floor)
    return _count(alarms(start, law, NOMINAL, sizes, repetitions=repetitions, seed=(seed, name)))


def delays(method: str, name: str, *, most: float, repetitions: int, seed: int) -> FloatArray:
    """After what multiple of the bound each repetition is BIASED at tolerance 0, inf if beyond ``most`` of them."""
    case = BIASED[name]
    sides = tuple(Bounded.at(sign, case.true_mean) for sign in (1, -1))
    start = METHODS[method].open(Question(sides, POWER, 100_000))
    sizes = looks(math.ceil(most * case.bound))
    return alarms(start, case.law, POWER, sizes, repetitions=repetitions, seed=(seed, name)) / case.bound


def fixed_power(name: str, *, multiple: float, floor: float, repetitions: int, seed: int) -> int:
    """How many repetitions are BIASED by one look of a t or z test, at a multiple of the bound."""
    case = BIASED[name]
    start = FixedSample.open([Bounded.at(sign, case.true_mean) for sign in (1, -1)], floor)
    sizes = [math.ceil(multiple * case.bound)]
    return _count(alarms(start, case.law, POWER, sizes, repetitions=repetitions, seed=(seed, name)))


def within_bound(name: str) -> float:
    """log(1/beta)/KL_inf of the edge that is harder to rule out, E being I."""
    law = LAWS[name]
    nats = (_nats(law, Bounded.at(sign, law.mean - sign * law.tolerance)) for sign in (1, -1))
    return -math.log(POWER) / min(nats)


def conforming(method: str, name: str, *, most: float, repetitions: int, seed: int) -> FloatArray:
    """After what multiple of the bound each repetition CONFORMS, E being I, inf if beyond ``most`` of them."""
    law, bound = LAWS[name], within_bound(name)
    times = np.zeros(repetitions)
    for sign in (1, -1):
        side = Bounded.at(sign, law.mean - sign * law.tolerance)
        start = METHODS[method].open(Question((side,), POWER, 100_000, float(law.tolerance)))
        found = alarms(start, law, POWER, looks(math.ceil(most * bound)), repetitions=repetitions, seed=(seed, name))
        times = np.maximum(times, found)
    return times / bound


def limit(repetitions: int, error: float, level: float = NOMINAL) -> int:
    """Alarms of probability ``level`` at most are more than so many with probability less than ``error``."""
    return int(binom.isf(error, repetitions, level))


def _nats(law: Law, side: Bounded) -> float:
    values, probabilities = law.columns
    return growth(side.oriented(values), probabilities, side.mean)


def _count(times: FloatArray) -> int:
    return int(np.isfinite(times).sum())
