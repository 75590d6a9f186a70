"""A twin of the evidence in plain Python: one outcome and one bet at a time, from the formulas alone.

A side is ``(sign, m)``: E[y] <= m for y = x with sign 1, for y = 1 - x with sign -1. Every function takes
the batches, lists of outcomes, and yields the log evidence after each.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

Batches = Sequence[Sequence[float]]
Side = tuple[int, float]
GONE = -1e9


def log_sum(logs: Sequence[float]) -> float:
    most = max(logs)
    return most + math.log(math.fsum(math.exp(x - most) for x in logs))


def oriented(batch: Sequence[float], sign: int) -> list[float]:
    return [x if sign > 0 else 1 - x for x in batch]


def hybrid_prior(m: float, alpha: float, budget: int) -> list[tuple[float, float]]:
    """Bets and their weights: one large, eight arcsine nodes, a grid of thirds."""
    smallest = min(0.1, math.sqrt(2 * math.log(1 / alpha) * m / ((1 - m) * budget)))
    grid = [0.1]
    while grid[-1] > 1.7 * smallest:
        grid.append(grid[-1] / 3)
    nodes = [math.sin((2 * j + 1) * math.pi / 32) ** 2 for j in range(8)]
    return [(0.99, 0.4), *((c, 0.05) for c in nodes), *((c, 0.2 / len(grid)) for c in grid)]


def portfolio_prior(number: int) -> list[tuple[float, float]]:
    """Cover's prior Beta(1/2, 1/2) at Chebyshev nodes: exact up to 2 ``number`` - 1 outcomes."""
    return [(math.sin((2 * j + 1) * math.pi / (4 * number)) ** 2, 1 / number) for j in range(number)]


def constant_bets(batches: Batches, side: Side, prior: Sequence[tuple[float, float]]) -> Iterator[float]:
    """log of sum over bets of weight times product of 1 + c (y / m - 1)."""
    sign, m = side
    wealth = [0.0] * len(prior)
    for batch in batches:
        for y in oriented(batch, sign):
            for k, (c, _) in enumerate(prior):
                wealth[k] += math.log(1 - c + c * y / m)
        yield log_sum([math.log(weight) + won for (_, weight), won in zip(prior, wealth, strict=True)])


def static(batches: Batches, sides: Sequence[Side], alpha: float, budget: int) -> Iterator[float]:
    """The average over the sides of the hybrid mixture, at alpha divided among them."""
    share = alpha / len(sides)
    by_side = [constant_bets(batches, side, hybrid_prior(side[1], share, budget)) for side in sides]
    for logs in zip(*by_side, strict=True):
        yield log_sum(logs) - math.log(len(sides))


class FocusSide:
    """One side of the focused process: its nodes, their virtual wealth, and the real bets."""

    def __init__(self, side: Side, alpha: float, budget: int) -> None:
        self.sign, self.m = side
        self.s0 = self.m * (1 - self.m)
        natural = math.sqrt(self.m / (1 - self.m))
        small = min(0.5 * min(1.0, natural), 1.5 * natural * math.sqrt(2 * math.log(1 / alpha) / budget))
        self.low, self.high = math.log(small), math.log(min(1.0, natural))
        first = -math.ceil(-self.low / math.log(1.6)) - 2
        self.exponents = range(first, math.ceil(math.log(30) / math.log(1.6)) + 1)
        self.virtual = dict.fromkeys(self.exponents, 0.0)
        self.pull = 0.0  # the slope of the log wealth at a whole bet

    def weights(self, past: Sequence[float]) -> dict[int, float]:
        """v_j from past outcomes only."""
        n = len(past)
        mean = math.fsum(past) / n if n else 0.0
        squares = math.fsum((x - mean) ** 2 for x in past)
        variance = min(self.s0, (max(self.m, 1 - self.m) ** 2 + squares) / (n + 1))
        inside = sum(0 < x < 1 for x in past)
        logs = {}
        for j in self.exponents:
            u = math.log(0.99 * 1.6**j) + 0.5 * math.log(variance / self.s0)
            log = -max(0.0, u - self.high) - 6 * max(0.0, self.low - u)
            if j == 0:
                log += 0.7
            if j > 0:
                log += math.log(inside / n) if inside else GONE
            logs[j] = log + self.virtual[j]
        return logs

    def won(self, batch: Sequence[float]) -> dict[int, float]:
        """What the real bets make of the batch."""
        slope = max(0.0, self.pull)
        cap = min(0.99, slope / (slope + 0.2))
        bets = {j: cap if j > 0 else 0.99 * 1.6**j for j in self.exponents}
        ys = oriented(batch, self.sign)
        return {j: math.fsum(math.log(1 + bet * (y / self.m - 1)) for y in ys) for j, bet in bets.items()}

    def learn(self, batch: Sequence[float]) -> None:
        for y in oriented(batch, self.sign):
            self.pull += 1 - self.m / y if y else GONE
            for j in self.exponents:
                factor = 1 + 0.99 * 1.6**j * (y / self.m - 1)
                dead = self.virtual[j] <= GONE or factor <= 0
                self.virtual[j] = GONE if dead else self.virtual[j] + math.log(factor)


def focus(batches: Batches, sides: Sequence[Side], alpha: float, budget: int) -> Iterator[float]:
    """The focused process, one budget for all sides."""
    halves = [FocusSide(side, alpha / len(sides), budget) for side in sides]
    past: list[float] = []
    total = 0.0
    for batch in batches:
        before: list[float] = []
        after: list[float] = []
        for half in halves:
            weights, won = half.weights(past), half.won(batch)
            before += weights.values()
            after += [weights[j] + won[j] for j in weights]
        total += log_sum(after) - log_sum(before)
        for half in halves:
            half.learn(batch)
        past.extend(batch)
        yield total


def reserved(batches: Batches, sides: Sequence[Side], alpha: float, budget: int) -> Iterator[float]:
    """0.85 on the focused process, 0.15 on the static mixture."""
    for moving, fixed in zip(focus(batches, sides, alpha, budget), static(batches, sides, alpha, budget), strict=True):
        yield log_sum([math.log(0.85) + moving, math.log(0.15) + fixed])


def plug_in(batches: Batches, side: Side, distance: float) -> Iterator[float]:
    """One bet a look: the distance is known, the variance is learned."""
    sign, m = side
    past: list[float] = []
    total = 0.0
    for batch in batches:
        n = len(past)
        bet = 0.0
        if n >= 2:
            mean = math.fsum(past) / n
            coin = (m + distance) * (1 - m - distance)
            sample = math.fsum((y - mean) ** 2 for y in past) / (n - 1)
            variance = coin if all(y in (0, 1) for y in past) else sample
            bet = m * (distance - 0.2 * m / n) / (variance + distance**2 + 0.2 * m**2 / n)
            bet = min(max(bet, 0.0), 0.99)
        ys = oriented(batch, sign)
        total += math.fsum(math.log(1 + bet * (y / m - 1)) for y in ys)
        past += ys
        yield total


def conforming(batches: Batches, side: Side, beta: float, budget: int, distance: float) -> Iterator[float]:
    """Plug-in bets at the distance and at half of it, and the static mixture: 0.6, 0.15, 0.25."""
    parts = zip(
        plug_in(batches, side, distance),
        plug_in(batches, side, distance / 2),
        static(batches, [side], beta, budget),
        strict=True,
    )
    for logs in parts:
        yield log_sum([math.log(share) + log for share, log in zip((0.6, 0.15, 0.25), logs, strict=True)])
