"""Where textbook floats fail: each naive formula is shown to fail, and the oracle not to.

The numbers are exact fractions worked out here by hand or by a plain loop. The naive side is
ordinary float64 (or float32) code; that it fails is asserted too, else the row would prove nothing.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from itertools import product
from typing import Any

import numpy as np
import pytest

from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue

HALF = Fraction(1, 2)
TINY, NANO = Fraction(1, 10**20), Fraction(1, 10**9)
NEAR_HALF = HALF - Fraction(1, 10**12)


def two(weight_of_0: Fraction) -> Pixel:
    """Values 0 and 1, as Eq. 6 has them: omega_1 is the weight of 0."""
    return Pixel({0: weight_of_0, 1: 1 - weight_of_0})


def equation_6(weight_of_0: Fraction, n: int) -> Fraction:
    """The bias of Fig. 1 on values 0 and 1."""
    w1, w2 = weight_of_0, 1 - weight_of_0
    return -(w1**n) * w2 + w2**n * w1


# -- the naive formulas ----------------------------------------------------------------------------


def difference(w1: float, n: int) -> float:
    """E[xi] - I."""
    w2 = 1 - w1
    expectation = w2**n + (1 - w1**n - w2**n) * w2
    return expectation - w2


def direct_sum(w1: float, n: int) -> float:
    """Eq. 6 term by term."""
    w2 = 1 - w1
    return w1**n * (0 - w2) + w2**n * (1 - w2)


def complement(w: float, n: int) -> float:
    """1 - Prob[easy] by Eq. 4."""
    return 1 - w**n - (1 - w) ** n


def equation_3(n: int, first: int) -> float:
    """Eq. 3 with factorials in float64, weights 1/2."""
    with np.errstate(over="ignore"):
        factorial = [np.prod(np.arange(1.0, m + 1)) for m in (n, first, n - first)]
        return float(factorial[0] / (factorial[1] * factorial[2]) * 0.5**n)


def second_moment_minus_square(values: tuple[float, float], w: float, n: int) -> float:
    """Var of a mean as (E[X^2] - E[X]^2) / n."""
    mean = (1 - w) * values[0] + w * values[1]
    return ((1 - w) * values[0] ** 2 + w * values[1] ** 2 - mean**2) / n


def inclusion_exclusion(w: float, n: int) -> float:
    """Prob[both outer values of three seen], each of weight w."""
    return 1 - 2 * (1 - w) ** n + (1 - 2 * w) ** n


# -- numbers: a result of the oracle, and how wrong the naive formula is ---------------------------


def outer_values(X: Any, n: int) -> Any:
    return (X.draw(n).range() == 2) * 1


def exactly(X: Any, n: int, hits: int) -> Any:
    return (X.draw(n).sum() == hits) * 1


@dataclass(frozen=True)
class Number:
    """One number, three ways; the naive one is at least ``wrong`` from it, relatively."""

    naive: float
    wrong: float
    exact: Fraction
    plan: Any
    pixel: Pixel
    result: str
    params: dict[str, Any]

    def derived(self, **options: Any) -> Any:
        return getattr(derive(self.plan, self.pixel, **self.params, **options), self.result)


FIG_1 = catalogue["kirk-arvo"]
OFFSET = 10**6 + Fraction(1, 256)
NUMBERS = {
    "1 bias as E - I, n = 64": Number(
        difference(1 / 3, 64), 1e-6, equation_6(Fraction(1, 3), 64), FIG_1, two(Fraction(1, 3)), "bias", {"n": 64}
    ),
    "2 bias as E - I, n = 128": Number(
        difference(1 / 3, 128), 1, equation_6(Fraction(1, 3), 128), FIG_1, two(Fraction(1, 3)), "bias", {"n": 128}
    ),
    "3 Eq. 6 near symmetry": Number(
        direct_sum(0.5 - 1e-12, 8), 1e-6, equation_6(NEAR_HALF, 8), FIG_1, two(NEAR_HALF), "bias", {"n": 8}
    ),
    "4 Prob[hard] of a speck": Number(
        complement(1e-20, 2), 1, 1 - TINY**2 - (1 - TINY) ** 2, FIG_1, two(TINY), "oracle_calls", {"n": 2}
    ),
    "5 Eq. 3 by factorials": Number(
        equation_3(171, 85),
        math.inf,
        Fraction(math.comb(171, 85), 2**171),
        exactly,
        two(HALF),
        "expectation",
        {"n": 171, "hits": 85},
    ),
    "14 variance on an offset": Number(
        second_moment_minus_square((1e6, 1e6 + 1 / 256), 1 / 3, 1024),
        0.9,
        Fraction(2, 9) / 256**2 / 1024,
        catalogue["fixed"],
        Pixel({10**6: "2/3", OFFSET: "1/3"}),
        "variance",
        {"n": 1024},
    ),
    "17 inclusion and exclusion": Number(
        inclusion_exclusion(1e-9, 2),
        0.9,
        2 * NANO**2,
        outer_values,
        Pixel({0: NANO, 1: 1 - 2 * NANO, 2: NANO}),
        "expectation",
        {"n": 2},
    ),
}


def relative(found: float, exact: Fraction) -> float:
    return abs(found - float(exact)) / float(abs(exact))


@pytest.mark.parametrize("row", NUMBERS)
def test_the_naive_formula_fails_and_the_exact_number_does_not(row):
    number = NUMBERS[row]
    assert relative(number.naive, number.exact) >= number.wrong
    assert number.derived() == number.exact


@pytest.mark.parametrize("row", NUMBERS)
def test_floats_hold_their_bound_there(row):
    number = NUMBERS[row]
    found = number.derived(arithmetic="float64")
    assert abs(Fraction(found.value) - number.exact) <= Fraction(found.error)
    assert found.error < 1e-6


@pytest.mark.parametrize("row", NUMBERS)
def test_floats_hold_twelve_digits_when_told_to(row):
    number = NUMBERS[row]
    found = number.derived(arithmetic="float64", rtol=1e-12)
    assert abs(Fraction(found.value) - number.exact) <= Fraction(1, 10**12) * abs(number.exact)
    assert found.error <= 1.001e-12 * abs(float(number.exact))


def test_7_a_conditional_mean_whose_condition_has_no_float():
    """Eq. 5 at n = 1100: both sides of the quotient are below the smallest float64."""
    assert 0.5**1100 == 0.0
    easy, hard = derive(FIG_1, two(HALF), n=1100).paths
    assert easy.probability == Fraction(1, 2**1099)
    assert easy.bias / easy.probability + HALF == HALF
    assert hard.probability == 1 - easy.probability
    rough, _ = derive(FIG_1, two(HALF), n=1100, arithmetic="float64").paths
    assert abs(Fraction(rough.probability.value) - easy.probability) <= Fraction(rough.probability.error)
    lopsided = derive(FIG_1, two(Fraction(1, 3)), n=1100).paths[0]
    assert lopsided.bias / lopsided.probability == Fraction(2**1100, 2**1100 + 1) - Fraction(2, 3)


def test_16_a_thousand_unnormalised_steps_keep_all_probability():
    mass = 1.0
    for _ in range(1024):
        mass = reduce(operator.add, [mass * 0.1] * 10)  # not sum(), which Python 3.12 made careful
    assert mass != 1.0
    tenths = Pixel(dict.fromkeys(range(10), "0.1"))
    assert sum(path.probability for path in derive(FIG_1, tenths, n=1024, eps=8).paths) == 1
    rough = [path.probability for path in derive(FIG_1, tenths, n=1024, eps=8, arithmetic="float64").paths]
    total = sum((Fraction(p.value) for p in rough), Fraction(0))
    assert abs(total - 1) <= sum(Fraction(p.error) for p in rough)


# -- variances and decisions -----------------------------------------------------------------------


def one_pass(values: Any, kind: Any = np.float64) -> Any:
    """(sum of squares - n mean^2) / (n - 1)."""
    x = np.array(values, dtype=kind)
    n = kind(len(x))
    return (np.sum(x * x, dtype=kind) - np.sum(x, dtype=kind) ** 2 / n) / (n - 1)


def two_pass(values: Any) -> float:
    """Sum of (x - mean)^2 / (n - 1), in a plain loop."""
    mean = sum(values) / len(values)
    return float(sum((x - mean) ** 2 for x in values) / (len(values) - 1))


def chance(pixel: Pixel, n: int, holds: Callable[[tuple[Fraction, ...]], bool]) -> Fraction:
    """The probability that n draws satisfy something, over all sequences."""
    atoms = list(pixel.law.items())
    found = Fraction(0)
    for draws in product(atoms, repeat=n):
        if holds(tuple(value for value, _ in draws)):
            found += Fraction(math.prod(weight for _, weight in draws))
    return found


def variance(values: tuple[Fraction, ...]) -> Fraction:
    mean = Fraction(sum(values), len(values))
    return sum(((v - mean) * (v - mean) for v in values), Fraction(0)) / (len(values) - 1)


def easy(pixel: Pixel, decide: Callable[[Any], Any], n: int) -> Fraction:
    """The probability that the oracle gives to the easy case."""
    calls = derive(lambda X: 0 if decide(X.draw(n)) else X.true_mean(), pixel).oracle_calls
    return 1 - Fraction(calls)


@pytest.mark.parametrize(
    ("offset", "unit", "kind", "naive"),
    [(10**8, 1, np.float64, 0.0), (10**4, 10, np.float32, 74.66667)],
    ids=["8 float64", "9 float32"],
)
def test_8_9_a_one_pass_variance_on_an_offset(offset, unit, kind, naive):
    sample = [offset + unit * i for i in (0, 1, 2, 1)]
    truth = Fraction(2, 3) * unit**2
    assert one_pass(sample, kind) == pytest.approx(naive)
    assert variance(tuple(map(Fraction, sample))) == truth
    pixel = Pixel({offset: "1/4", offset + unit: "1/2", offset + 2 * unit: "1/4"})
    expected = chance(pixel, 4, lambda values: variance(values) == truth)
    assert easy(pixel, lambda S: S.variance() == truth, 4) == expected > 0
    assert derive(lambda X: X.draw(4).variance(), pixel).expectation == pixel.variance


def test_10_two_values_one_apart_at_a_thousand_million():
    assert one_pass([1e9, 1e9 + 1]) <= 0
    pixel = Pixel({10**9: "1/2", 10**9 + 1: "1/2"})
    for decide in (lambda S: S.variance() <= 0, lambda S: S.all_equal(), lambda S: S.variance() <= Fraction(1, 10**9)):
        assert easy(pixel, decide, 2) == HALF


@pytest.mark.parametrize("tenth", ["0.1", 0.1], ids=["decimal", "binary"])
def test_11_three_equal_tenths_have_no_variance(tenth):
    assert 0 < two_pass([0.1, 0.1, 0.1]) < 1e-30
    pixel = Pixel({tenth: "1/2", 5: "1/2"})
    for eps in (0, Fraction(1, 10**60)):
        assert easy(pixel, lambda S, eps=eps: S.variance() <= eps, 3) == Fraction(1, 4)


def textbook_errors(n: int, hits: int) -> list[float]:
    """s / sqrt(n) of 0/1 samples, three ways."""
    x = [1.0] * hits + [0.0] * (n - hits)
    return [
        math.sqrt(two_pass(x)) / math.sqrt(n),
        math.sqrt((hits - hits * hits / n) / (n - 1) / n),
        math.sqrt((n * hits - hits * hits) / (n * (n - 1))) / math.sqrt(n),
    ]


def test_12_a_tie_of_the_standard_error_is_kept():
    assert [s <= 1 / 3 for s in textbook_errors(3, 1)].count(False) == 2
    pixel = two(Fraction(1, 3))
    assert easy(pixel, lambda S: S.std_error() <= "1/3", 3) == 1
    assert easy(pixel, lambda S: S.std_error() < "1/3", 3) == Fraction(1, 3)

    def only_one_tie(X, tied):
        S = X.draw(3)
        small = S.all_equal() | ((S.sum() == 2) & (S.std_error() <= "1/3"))
        return S.mean() if small | (tied & (S.std_error() == "1/3")) else X.true_mean()

    kept, lost = (derive(only_one_tie, pixel, tied=t).expectation for t in (True, False))
    assert abs(kept - lost) == Fraction(2, 27)
    assert float(kept - lost) == pytest.approx(-7.4e-2, rel=2e-2)


def rational_root(square: Fraction) -> Fraction | None:
    root = Fraction(math.isqrt(square.numerator), math.isqrt(square.denominator))
    return root if root**2 == square else None


def test_12_all_ties_of_0_1_samples_up_to_64_draws():
    """Where the standard error is rational and at least one of the three formulas is above it."""
    misjudged = 0
    for n in range(2, 65):
        for hits in range(1, n):
            tie = rational_root(Fraction(hits * (n - hits), n * n * (n - 1)))
            if tie is None or all(s <= float(tie) for s in textbook_errors(n, hits)):
                continue
            misjudged += 1
            at = Fraction(math.comb(n, hits), 2**n)
            law = easy(two(HALF), lambda S, tie=tie: S.std_error() == tie, n)
            assert law == (at if 2 * hits == n else 2 * at)
    assert misjudged >= 40


@pytest.mark.parametrize(("low", "high", "eps"), [("0.7", "0.8", "0.1"), ("1.0", "1.1", "0.1"), ("0.1", "0.3", "0.2")])
def test_13_a_range_that_equals_its_threshold_in_decimals(low, high, eps):
    in_floats = float(high) - float(low) <= float(eps)
    assert in_floats is (low == "0.1")
    decimal = Pixel({low: "1/2", high: "1/2"})
    assert easy(decimal, lambda S: S.range() <= eps, 3) == 1
    assert easy(decimal, lambda S: S.range() < eps, 3) == Fraction(1, 4)
    binary = Pixel({float(low): "1/2", float(high): "1/2"})
    holds = Fraction(float(high)) - Fraction(float(low)) <= Fraction(float(eps))
    assert easy(binary, lambda S: S.range() <= float(eps), 3) == (1 if holds else Fraction(1, 4))
