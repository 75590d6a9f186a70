"""Laws that evidence is measured on: those that the methods were chosen on, and random ones that they never saw.

Continuous laws are 2000 equally likely values, each the mean of its share of the law, so that the mean is
exact. The lower bound is worked out here, without the package.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truemean.conformance.evidence import Batch

__all__ = ["CONFORMING", "LAWS", "Law", "nats", "random_laws"]

FloatArray = NDArray[np.float64]
FINE = 2000  # values that stand for a continuous law
MANY = 64  # values from which on outcomes are drawn one by one


@dataclass(frozen=True, eq=False)
class Law:
    """Outcomes in [0, 1] with probabilities, and the mean that they are said to have."""

    name: str
    values: FloatArray
    probabilities: FloatArray
    mean: float

    @cached_property
    def own_mean(self) -> float:
        return float(self.values @ self.probabilities)

    @cached_property
    def variance(self) -> float:
        return float((self.values - self.own_mean) ** 2 @ self.probabilities)

    @cached_property
    def _cumulated(self) -> FloatArray:
        return np.cumsum(self.probabilities)[:-1]

    def bound(self, level: float) -> float:
        """The outcomes that any test needs on average: log(1 / level) / KL_inf."""
        return -math.log(level) / nats(self, 1 if self.own_mean > self.mean else -1, self.mean)

    def within_bound(self, level: float, tolerance: float) -> float:
        """The same for showing that the mean lies within the tolerance: the slower of both edges."""
        slower = min(nats(self, sign, self.mean - sign * tolerance) for sign in (1, -1))
        return -math.log(level) / slower

    def draw(self, number: int, rng: np.random.Generator) -> Batch:
        """So many outcomes."""
        if self.values.size >= MANY:
            return Batch.of(self.values[np.searchsorted(self._cumulated, rng.random(number), side="right")])
        counts = rng.multinomial(number, self.probabilities)
        seen = np.flatnonzero(counts)
        return Batch(self.values[seen], counts[seen].astype(float))

    def draws(self, number: int, runs: int, rng: np.random.Generator) -> FloatArray:
        """Number, sum and sum of squares of so many outcomes, ``[3, runs]``."""
        counts = rng.multinomial(number, self.probabilities, size=runs)
        return np.array([np.full(runs, float(number)), counts @ self.values, counts @ self.values**2])

    def against(self, mean: float, name: str = "") -> Law:
        """The same outcomes, said to have another mean."""
        return Law(name or self.name, self.values, self.probabilities, mean)


def logs(law: Law, sign: int, edge: float) -> FloatArray:
    """What each outcome is worth against a mean of at most ``edge`` (sign 1), or at least (-1), at the best bet."""
    y, m = (law.values, edge) if sign > 0 else (1 - law.values, 1 - edge)
    if m <= 0:
        return np.full_like(y, math.inf)
    gains, low, high = y / m - 1, 0.0, 1.0
    for _ in range(60):
        middle = (low + high) / 2
        rising = law.probabilities @ (gains / (1 + middle * gains)) > 0
        low, high = (middle, high) if rising else (low, middle)
    return np.log1p(low * gains)


def nats(law: Law, sign: int, edge: float) -> float:
    """KL_inf: nats an outcome at the best bet."""
    return float(logs(law, sign, edge) @ law.probabilities)


def of(name: str, values: ArrayLike, probabilities: ArrayLike, bias: float) -> Law:
    """A law whose own mean is off by ``bias``."""
    y, p = np.asarray(values, dtype=float), np.asarray(probabilities, dtype=float)
    p = p / p.sum()
    return Law(name, y, p, float(y @ p) - bias)


def coin(heads: float, said: float) -> Law:
    return Law(f"coin {said:g} -> {heads:g}", np.array([0.0, 1.0]), np.array([1 - heads, heads]), said)


def binomial(n: int, w: float) -> tuple[FloatArray, FloatArray]:
    """The mean of n samples of a pixel of coverage w."""
    chances = [math.comb(n, i) * w**i * (1 - w) ** (n - i) for i in range(n + 1)]
    return np.arange(n + 1) / n, np.array(chances)


def kirk_arvo(w: float, n: int) -> Law:
    """Fig. 1: a pilot of n that agree is the estimate, else it is fresh samples without number, hence w."""
    rest = 1 - w**n - (1 - w) ** n
    return Law(f"Fig. 1, w={w:g} n={n}", np.array([0.0, w, 1.0]), np.array([(1 - w) ** n, rest, w**n]), w)


def pooled(w: float, n: int = 4, more: int = 12) -> Law:
    """Pilot and refinement in one mean."""
    (_, first), (_, then) = binomial(n, w), binomial(more, w)
    mixed = np.convolve(np.where((np.arange(n + 1) > 0) & (np.arange(n + 1) < n), first, 0.0), then)
    mixed[[0, -1]] += first[[0, -1]]
    return Law(f"pooled {n}+{more}, w={w:g}", np.arange(n + more + 1) / (n + more), mixed, w)


def uniform() -> tuple[FloatArray, FloatArray]:
    return (np.arange(FINE) + 0.5) / FINE, np.full(FINE, 1 / FINE)


def beta(a: float, b: float) -> tuple[FloatArray, FloatArray]:
    """Equally likely values, each the mean of its share of the law."""
    from scipy.special import betainc, betaincinv

    ends = betaincinv(a, b, np.linspace(0, 1, FINE + 1))
    means = FINE * a / (a + b) * np.diff(betainc(a + 1, b, ends))
    return np.clip(means, 0.0, 1.0), np.full(FINE, 1 / FINE)


def mixed(share: float, value: float) -> tuple[FloatArray, FloatArray]:
    """``share`` on one value, the rest uniform."""
    values, probabilities = uniform()
    return np.append(value, values), np.append(share, (1 - share) * probabilities)


TENTHS = (np.arange(11) / 10, np.full(11, 1 / 11))
SKEWED = ([0.0, 0.125, 1.0], [0.326, 0.67, 0.004])
LAWS = (
    *(kirk_arvo(w, n) for w in (0.125, 0.45, 0.75) for n in (4, 8, 16)),
    *(pooled(w) for w in (0.125, 0.75)),
    of("firefly, clamped", [0.2], [1.0], -8e-5),
    coin(2e-4, 1e-4),
    of("nearly equal +.002", [0.501, 0.503], [0.5, 0.5], 0.002),
    *(of(f"uniform {bias:+g}", *uniform(), bias) for bias in (0.05, 0.01, -0.2)),
    of("beta 2 5 -.03", *beta(2, 5), -0.03),
    of("beta .5 .5 +.03", *beta(0.5, 0.5), 0.03),
    of("beta 20 60 +.01", *beta(20, 60), 0.01),
    *(of(f"beta .2 5 {bias:+g}", *beta(0.2, 5), bias) for bias in (0.01, -0.01)),
    *(of(f"11 equal {bias:+g}", *TENTHS, bias) for bias in (0.1, 0.02)),
    *(of(f"mean of 16, .125 {bias:+g}", *binomial(16, 0.125 + bias), bias) for bias in (0.01, -0.01)),
    of("mean of 16, .5 +.005", *binomial(16, 0.505), 0.005),
    *(coin(heads, 0.5) for heads in (0.52, 0.6, 0.9)),
    *(coin(heads, 0.1) for heads in (0.12, 0.05)),
    *(coin(heads, 0.01) for heads in (0.02, 0.005)),
    coin(0.93, 0.9),
    coin(0.05, 1e-3),
    coin(1.5e-3, 1e-3),
    of(".3 or uniform +.01", *mixed(0.9, 0.3), 0.01),
    of("0 or uniform -.02", *mixed(0.5, 0.0), -0.02),
    of(".25 or .35 +.01", [0.25, 0.35], [0.5, 0.5], 0.01),
    of("0, .125, rarely 1, -.005", *SKEWED, -0.005),
    of("firefly doubled", [0.2, 1.0], [1 - 2e-4, 2e-4], 8e-5),
    of("rarely dark -.0006", [0.0, 0.6], [2e-3, 1 - 2e-3], -6e-4),
)


def centred(law: Law) -> Law:
    return law.against(law.own_mean, f"{law.name}, own mean")


def _conforming(tolerance: float) -> tuple[Law, ...]:
    sixteenths = (*binomial(16, 0.125), 0.0)
    return (
        of("mean of 16, .125", *sixteenths),
        of("mean of 16, .5", *binomial(16, 0.5), 0.0),
        kirk_arvo(0.45, 16),
        of("firefly", [0.2, 1.0], [1 - 1e-4, 1e-4], 0.0),
        of("nearly equal", [0.499, 0.501], [0.5, 0.5], 0.0),
        coin(0.5, 0.5),
        coin(0.1, 0.1),
        of("uniform", *uniform(), 0.0),
        of("beta 2 5", *beta(2, 5), 0.0),
        centred(pooled(0.125)),
        centred(kirk_arvo(0.75, 8)),
        of("0, .125, rarely 1", *SKEWED, 0.0),
        of("mean of 16, .125, half off", *binomial(16, 0.125), tolerance / 2),
        of("uniform, half off", *uniform(), -tolerance / 2),
    )


CONFORMING = tuple((tolerance, law) for tolerance in (0.02, 0.005) for law in _conforming(tolerance))


def random_laws(number: int, seed: int) -> tuple[Law, ...]:
    """Laws of five kinds in turn, each off by what makes its lower bound at 0.01 random between 20 and 20000.

    Not among them are laws of which a single outcome decides: any test has to wait for it, far beyond the bound.
    """
    rng, found = np.random.default_rng(seed), list[Law]()
    while len(found) < number:
        law = _off(*KINDS[len(found) % len(KINDS)](rng), rng)
        if logs(law, 1 if law.own_mean > law.mean else -1, law.mean).max() < math.log(100):
            found.append(law)
    return tuple(found)


def _off(name: str, values: FloatArray, probabilities: FloatArray, rng: np.random.Generator) -> Law:
    exact = of(name, values, probabilities, 0.0)
    sign, asked = rng.choice([1, -1]), 20 * 1000 ** rng.random()
    low, high = 0.0, exact.mean if sign > 0 else 1 - exact.mean
    for _ in range(60):
        middle = (low + high) / 2
        easy = exact.against(exact.mean - sign * middle).bound(0.01) < asked
        low, high = (low, middle) if easy else (middle, high)
    return exact.against(exact.mean - sign * low, f"{name} {sign * low:+.2g}")


Drawn = tuple[str, FloatArray, FloatArray]


def _atoms(rng: np.random.Generator) -> Drawn:
    size = int(rng.integers(2, 13))
    return f"{size} values", np.sort(rng.random(size)), rng.dirichlet(np.full(size, 0.7))


def _beta(rng: np.random.Generator) -> Drawn:
    a, b = 10 ** rng.uniform(-0.7, 1.7, 2)
    return (f"beta {a:.2g} {b:.2g}", *beta(a, b))


def _coin(rng: np.random.Generator) -> Drawn:
    rare = 10 ** rng.uniform(-3, -0.3)
    heads = rare if rng.random() < 0.5 else 1 - rare
    return f"coin {heads:.3g}", np.array([0.0, 1.0]), np.array([1 - heads, heads])


def _rare(rng: np.random.Generator) -> Drawn:
    """Within a narrow band, rarely at an end of the range."""
    chance, low, end = 10 ** rng.uniform(-3.5, -1.5), rng.uniform(0.05, 0.85), int(rng.integers(2))
    values = np.append(low + 0.1 * np.sort(rng.random(6)), end)
    order = np.argsort(values)
    body = np.append((1 - chance) * rng.dirichlet(np.ones(6)), chance)
    return f"band, {end} w.p. {chance:.1g}", values[order], body[order]


def _pooled(rng: np.random.Generator) -> Drawn:
    law = pooled(float(rng.uniform(0.02, 0.98)), int(rng.integers(2, 9)), int(rng.integers(4, 33)))
    return law.name, law.values, law.probabilities


KINDS: tuple[Callable[[np.random.Generator], Drawn], ...] = (_atoms, _beta, _coin, _rare, _pooled)
