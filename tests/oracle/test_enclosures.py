"""Enclosures contain the number, to the digits asked for, also where it is irrational."""

from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.oracle.catalogue_cases import OF_A_SCENE, cases

from truemean.errors import InputError, NotExact
from truemean.oracle import Enclosure, Pixel, derive
from truemean.oracle.enclosure import Ball
from truemean.oracle.plans import catalogue

RESULTS = ("expectation", "bias", "variance", "mse", "cost")


def toned(X, n=3):
    """The tone curve of many viewers, after a decision."""
    S = X.draw(n)
    return np.sqrt(S.mean()) if S.range() <= 1 else X.true_mean()


def in_logarithms(X, n=2):
    S = X.draw(n)
    return np.log(1 + S.mean()) * S.mean() + X.mean / 3


def channels(value):
    return value if isinstance(value, tuple) else (value,)


def exact_in_mpmath(plan, weights, values, n):
    """E, bias and variance over all sequences, in 60 digits."""
    with mpmath.workdps(60):
        mean = sum(w * v for w, v in zip(weights, values, strict=True))
        moments = [mpmath.mpf(0)] * 3
        for draws in np.ndindex(*(len(values),) * n):
            p = mpmath.fprod(weights[i] for i in draws)
            x = plan([values[i] for i in draws], mean)
            moments = [m + p * x**order for order, m in enumerate(moments)]
        return moments[1], moments[1] - mean, moments[2] - moments[1] ** 2


FORMULAS = {
    toned: lambda x, mean: mpmath.sqrt(sum(x) / mpmath.mpf(len(x))) if max(x) - min(x) <= 1 else mean,
    in_logarithms: lambda x, mean: mpmath.log(1 + sum(x) / mpmath.mpf(len(x))) * sum(x) / len(x) + mean / 3,
}


@pytest.mark.parametrize("plan", FORMULAS)
@pytest.mark.parametrize("digits", [5, 30, 45])
def test_an_irrational_result_lies_within(plan, digits):
    n = 3 if plan is toned else 2
    X = Pixel({0: "1/2", 1: "1/3", 2: "1/6"})
    derivation = derive(plan, X, arithmetic="ball", digits=digits)
    with mpmath.workdps(60):
        weights = [mpmath.mpf(w.numerator) / w.denominator for w in X.weights]
        expected = exact_in_mpmath(FORMULAS[plan], weights, [0, 1, 2], n)
        for name, number in zip(("expectation", "bias", "variance"), expected, strict=True):
            found = getattr(derivation, name)
            assert found.lower - mpmath.mpf(10) ** -55 <= number <= found.upper + mpmath.mpf(10) ** -55
            assert found.upper - found.lower <= 2 * mpmath.mpf(10) ** -digits * 2
    total = sum((mpmath.mpf(path.bias.lower) for path in derivation.paths), mpmath.mpf(0))
    assert abs(total - derivation.bias.lower) < 1e-4


@pytest.mark.parametrize(
    ("name", "params", "pixel"), cases(lambda name, short, X: name not in OF_A_SCENE and len(X.values) < 4)
)
def test_every_rational_result_lies_within_and_zero_is_a_point(name, params, pixel):
    exact, ball = (derive(catalogue[name], pixel, arithmetic=a, **params) for a in ("exact", "ball"))
    for result in RESULTS:
        for number, found in zip(channels(getattr(exact, result)), channels(getattr(ball, result)), strict=True):
            assert number in found
            low, high = found.fractions
            assert high - low <= Fraction(2, 10**30) * abs(number)


def test_floats_escalate_to_balls_for_a_relative_tolerance():
    X = Pixel({1: "1/2", "4/3": "1/2"})
    ball = derive(in_logarithms, X, arithmetic="ball", digits=40).bias
    found = derive(in_logarithms, X, arithmetic="float64", rtol=1e-15).bias
    assert abs(Fraction(found.value) - ball.fractions[0]) <= Fraction(found.error)
    assert found.error <= 1e-15 * abs(found.value) * 2


def test_an_irrational_zero_has_no_relative_tolerance():
    def difference(X):
        return np.exp(np.log(1 + X.draw(1).mean())) - 1

    with pytest.raises(NotExact, match="use arithmetic='ball'"):
        _ = derive(difference, Pixel.two("1/2"), arithmetic="float64", rtol=1e-3).bias


def test_an_exact_irrational_result_points_to_balls():
    with pytest.raises(NotExact, match="arithmetic='ball'"):
        _ = derive(toned, Pixel.two("1/2")).bias
    with pytest.raises(NotExact, match="moments have enclosures"):
        derive(toned, Pixel.two("1/2"), arithmetic="ball").distribution()


@settings(max_examples=60)
@given(st.fractions(), st.fractions(0, 1), st.integers(1, 60))
def test_bounds_are_rounded_outwards(low, width, digits):
    found = Enclosure.around(low, low + width, digits)
    assert low in found
    assert low + width in found
    texts = [Fraction(text) for text in found.texts]
    assert texts[0] <= found.fractions[0]
    assert texts[1] >= found.fractions[1]


@pytest.mark.parametrize("digits", [0, -1, 2.5, True])
def test_wrong_digits(digits):
    with pytest.raises(InputError, match=f"digits={digits}"):
        derive(toned, Pixel.two("1/2"), arithmetic="ball", digits=digits)


small = st.fractions(-3, 3, max_denominator=20)


@given(small, small, st.fractions(0, 1, max_denominator=20), st.fractions(0, 1, max_denominator=20), small.filter(bool))
def test_balls_hold_what_their_numbers_can_become(a, b, r, s, divisor):
    """The corners of two balls lie in the balls of their sum, difference, product and quotient."""
    first, second = Ball(a, r), Ball(b, s)
    for x in (a - r, a, a + r):
        assert abs(x / divisor - (first / divisor).centre) <= (first / divisor).radius
        for y in (b - s, b, b + s):
            for exact, ball in ((x + y, first + second), (x - y, first - second), (x * y, first * second)):
                assert abs(exact - ball.centre) <= ball.radius
