"""The exact law of code that asks for its samples, beside a brute force over all sequences of answers.

Sampled means over fixed seeds are compared with the exact expectation at 4.5 standard errors in up to 24 numbers:
right code would fail one such test in 6,000.
"""

from __future__ import annotations

import itertools
import math
from fractions import Fraction
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.oracle.strategies import pixels

from truemean.adapters import asking
from truemean.adapters.exhaustive import ORDERS, Asking
from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue

PIXELS = {
    "thin": Pixel.two("1/8"),
    "tones": Pixel({0: "1/2", "1/4": "1/3", 1: "1/6"}),
    "signed": Pixel({"-1/2": "2/7", "3/4": "4/7", 4: "1/7"}),
    "never drawn": Pixel({5: 0, 0: "3/4", "1/2": 0, 1: "1/4"}),
    "constant": Pixel({"3/8": 1}),
    "colour": Pixel({(1, 0, 0): "5/8", (0, "1/2", 0): "1/4", (0, 0, 3): "1/8"}),
}
SCALAR = {name: X for name, X in PIXELS.items() if not X.channels}


# -- the brute force ------------------------------------------------------------------------------


class Fed:
    """Answers one sequence of indices and one of choices, whatever is asked."""

    def __init__(self, pixel, places, choices):
        self.values = [np.array(v, dtype=float) if isinstance(v, tuple) else float(v) for v in pixel.values]
        self.places, self.choices = list(places), list(choices)
        self.mass, self.drawn = Fraction(1), 0

    def __call__(self, count=None):
        told = [self.values[self.places.pop(0)] for _ in range(1 if count is None else count)]
        self.drawn += len(told)
        return told[0] if count is None else np.array(told)

    def pick(self, weights):
        place = self.choices.pop(0)
        self.mass *= Fraction(weights[place]) if place < len(weights) else 0
        return min(place, len(weights) - 1)

    def coin(self, p):
        return bool(self.pick([1 - Fraction(p), p]))


def exact(value):
    return tuple(map(Fraction, value)) if np.ndim(value) else Fraction(value)


def brute_force(code, pixel, samples, choices=0, ways=2):
    """``(law, cost)`` over all sequences of so many samples and choices; those not asked for are summed over."""
    law, cost = {}, Fraction(0)
    for places in itertools.product(range(len(pixel.weights)), repeat=samples):
        for told in itertools.product(range(ways), repeat=choices):
            fed = Fed(pixel, places, told)
            value = exact(code(pixel, fed))
            mass = math.prod((pixel.weights[place] for place in places), start=fed.mass) / ways ** len(fed.choices)
            law[value] = law.get(value, 0) + mass
            cost += mass * fed.drawn
    assert sum(law.values()) == 1
    return {value: mass for value, mass in law.items() if mass}, cost


# -- code that asks --------------------------------------------------------------------------------


def fixed(pixel, draw):
    return draw(4).mean(axis=0)


def kirk_arvo(pixel, draw):
    S = draw(4)
    values, weights = pixel.arrays()
    return weights @ values if np.ptp(S, axis=0).any() else S.mean(axis=0)


def pooled(pixel, draw):
    S = draw(2)
    return (np.concatenate([S, draw(2)]) if np.ptp(S, axis=0).any() else S).mean(axis=0)


def discard_pilot(pixel, draw):
    S = draw(2)
    return draw(4 if np.ptp(S, axis=0).any() else 2).mean(axis=0)


def sequential(pixel, draw):
    """Grow until s^2 / n <= 1/16, or n = 5, in exact arithmetic."""
    S = [Fraction(draw()), Fraction(draw())]
    while len(S) < 5:
        mean = sum(S) / len(S)
        if sum((x - mean) ** 2 for x in S) <= Fraction(len(S) * (len(S) - 1), 16):
            break
        S.append(Fraction(draw()))
    return sum(S) / len(S)


def russian_roulette(pixel, draw):
    light, throughput = 0.5 * draw(), 0.5
    for _ in range(3):
        if not draw.coin("3/4"):
            break
        throughput /= 1.5
        light = light + throughput * draw()
    return light


def picked(pixel, draw):
    """One of three ways, chosen with unequal probabilities."""
    way = draw.pick([Fraction(1, 2), "1/3", "1/6"])
    return (draw(), draw(2).mean(axis=0), 2 * draw() if draw.coin(0.5) else 0 * draw())[way]


def ramp(pixel, draw):
    return (draw() + 2 * draw() + 4 * draw()) / 8


CASES = {  # the most samples and choices of each, and the orders that make no difference to it
    fixed: (4, 0, ("blocks", "all")),
    kirk_arvo: (4, 0, ("blocks", "all")),
    pooled: (4, 0, ("blocks",)),
    discard_pilot: (6, 0, ("blocks",)),
    sequential: (5, 0, ("blocks", "all")),
    russian_roulette: (4, 3, ("blocks",)),
    picked: (4, 2, ("blocks",)),
    ramp: (3, 0, ("blocks",)),
}


@pytest.mark.parametrize(
    ("code", "order", "name"),
    [
        (code, order, name)
        for code, case in CASES.items()
        for order in ("sequence", *case[2])
        for name in (SCALAR if code is sequential else PIXELS)
    ],
    ids=lambda part: part if isinstance(part, str) else part.__name__,
)
def test_the_law_is_that_of_all_sequences(code, order, name):
    X, (samples, choices, _) = PIXELS[name], CASES[code]
    found = asking(code, order=order).exact(X)
    law, cost = brute_force(code, X, samples, choices, ways=3 if code is picked else 2)
    assert (found.law, found.cost) == (law, cost)


@pytest.mark.parametrize("name", sorted({*SCALAR} - {"tones", "signed"}))  # whose true means are no floats
def test_the_law_is_that_of_figure_1(name):
    X = SCALAR[name]
    assert asking(kirk_arvo).exact(X).law == derive(catalogue["kirk-arvo"], X, n=4).distribution()


@pytest.mark.parametrize("name", SCALAR)
@pytest.mark.parametrize(
    ("code", "plan", "params"),
    [
        (fixed, "fixed", {"n": 4}),
        (pooled, "two-stage-pooled", {"n": 2, "m": 2}),
        (discard_pilot, "discard-pilot", {"p": 2, "n1": 2, "n2": 4}),
        (sequential, "sequential", {"start": 2, "step": 1, "most": 5, "eps": "1/4"}),
    ],
)
def test_the_law_is_that_of_the_plan(name, code, plan, params):
    X = SCALAR[name]
    derivation, found = derive(catalogue[plan], X, **params), asking(code).exact(X)
    assert found.law == {outcome: mass for outcome, mass in derivation.distribution().items() if mass}
    assert sum(outcome * mass for outcome, mass in found.law.items()) == derivation.expectation
    assert found.cost == derivation.cost


def test_what_it_took_is_told():
    X = Pixel.two("1/8")
    told = {order: asking(fixed, order=order).exact(X) for order in ORDERS}
    assert {order: (found.paths, found.how) for order, found in told.items()} == {
        "sequence": (16, "16 sequences of answers"),
        "blocks": (6, "6 counts of answers"),
        "all": (6, "6 counts of answers"),
    }
    assert asking(fixed).exact(PIXELS["constant"]).how == "1 sequence of answers"


def test_counts_reach_where_sequences_do_not():
    X, n = Pixel.two("1/8"), 200
    found = asking(lambda draw: float(draw(n).sum()), order="blocks").exact(X)
    assert found.law == {Fraction(i): Fraction(math.comb(n, i) * 7 ** (n - i), 8**n) for i in range(n + 1)}
    one_by_one = asking(lambda draw: sum(draw() for _ in range(64)) / 64, order="all").exact(X)
    assert sum(x * p for x, p in one_by_one.law.items()) == X.mean
    assert one_by_one.paths == 65 * 66 // 2


def test_no_samples_at_all_and_blocks_of_none():
    X = PIXELS["thin"]
    assert asking(lambda draw: 0.25).exact(X).law == {Fraction(1, 4): 1}
    for order in ORDERS:
        found = asking(lambda draw: draw(0).sum() + draw() + draw(0).size, order=order).exact(X)
        assert (found.law, found.cost) == ({0: Fraction(7, 8), 1: Fraction(1, 8)}, 1)


def test_weights_of_a_choice_are_exact_and_floats_that_miss_one_by_a_rounding_do():
    X = PIXELS["constant"]
    assert asking(lambda draw: draw.pick([1 / 3] * 3)).exact(X).law == dict.fromkeys((0, 1, 2), Fraction(1, 3))
    assert asking(lambda draw: draw.coin(0.1)).exact(X).law[1] == Fraction(0.1)
    assert asking(lambda draw: draw.coin("0.1")).exact(X).law[1] == Fraction(1, 10)
    assert asking(lambda draw: draw.coin(1)).exact(X).law == {1: 1}
    # A choice with the pixel's own weights is no sample.
    found = asking(lambda draw: 2 * draw.pick(["7/8", "1/8"]) + draw()).exact(Pixel.two("1/8"))
    assert (found.cost, found.law[3]) == (1, Fraction(1, 64))


# -- random code ------------------------------------------------------------------------------------


def table(salt, deepest, symmetric):
    """Code that asks and ends as a random table says, which looks at its answers, or at their counts alone."""

    def code(pixel, draw):
        seen, chosen = [], []
        while True:
            random = Random(f"{salt} {sorted(seen) if symmetric else seen} {chosen}")
            if len(seen) == deepest or (seen and random.random() < 0.3):
                return random.randrange(16) / 16
            if len(chosen) < 2 and random.random() < 0.2:
                chosen.append(draw.pick(["1/5", "4/5"]))
            elif len(seen) + 2 <= deepest and random.random() < 0.5:
                seen += draw(2).tolist()
            else:
                seen.append(draw())

    return code


@given(pixels(), st.integers(0, 10**6), st.integers(1, 4))
@settings(max_examples=40)
def test_random_code_has_the_law_of_all_sequences(pixel, salt, deepest):
    code = table(salt, deepest, symmetric=False)
    found = asking(code).exact(pixel)
    law, cost = brute_force(code, pixel, deepest, 2)
    assert sum(found.law.values()) == 1
    assert (found.law, found.cost) == (law, cost)


@given(pixels(), st.integers(0, 10**6), st.integers(1, 4))
@settings(max_examples=40)
def test_random_symmetric_code_has_one_law_in_every_order(pixel, salt, deepest):
    code = table(salt, deepest, symmetric=True)
    law, cost = brute_force(code, pixel, deepest, 2)
    for order in ORDERS:
        found = asking(code, order=order).exact(pixel)
        assert (found.law, found.cost) == (law, cost)


@given(pixels(), st.integers(0, 10**6))
@settings(max_examples=30)
def test_random_code_is_sampled_with_its_law(pixel, salt):
    estimator = asking(table(salt, 3, symmetric=False))
    outcomes = {float(outcome) for outcome in estimator.exact(pixel).law}
    assert set(estimator.run(pixel, np.arange(50)).tolist()) <= outcomes


# -- sampled answers --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PIXELS)
@pytest.mark.parametrize("code", [kirk_arvo, pooled, russian_roulette, picked])
def test_sampled_estimates_and_costs_have_the_exact_means(name, code):
    X, seeds = PIXELS[name], np.arange(4000)
    estimator = asking(code)
    found, estimates = estimator.exact(X), estimator.run(X, seeds)
    means = [np.array(outcome, dtype=float) * float(mass) for outcome, mass in found.law.items()]
    error = estimates.std(axis=0) / math.sqrt(seeds.size)
    assert (np.abs(estimates.mean(axis=0) - sum(means)) <= 4.5 * error + 1e-9).all()
    costs = estimator.costs(X, seeds)
    assert abs(costs.mean() - float(found.cost)) <= 4.5 * costs.std() / math.sqrt(seeds.size) + 1e-9


def test_sampled_estimates_depend_on_their_seed_alone():
    X, seeds = PIXELS["tones"], np.arange(60)
    together = asking(pooled).run(X, seeds)
    again = asking(pooled)
    assert np.array_equal(again.run(X, seeds[::-1])[::-1], together)
    assert np.array_equal(np.concatenate([again.run(X, [seed]) for seed in seeds.tolist()]), together)
    assert np.array_equal(again.costs(X, seeds), asking(pooled).costs(X, seeds))
    assert len(set(together.tolist())) > 3
    assert asking(pooled).run(PIXELS["colour"], seeds).shape == (60, 3)


# -- the estimator itself ----------------------------------------------------------------------------


def test_a_law_is_found_once_and_computed_again_on_demand():
    calls = []
    estimator = Asking(lambda pixel, answers: calls.append(1) or answers.one() / 2)
    first = estimator.exact(Pixel.two("1/8"))
    count = len(calls)
    assert estimator.exact(Pixel.two("1/8")) is first
    assert len(calls) == count
    assert estimator.enumerate(Pixel.two("1/8")) == first
    assert len(calls) == 2 * count
