"""The worst pixel: enclosures hold what a dense grid finds, and the pixel named is as bad as said."""

from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sympy import Symbol
from tests.oracle.brute_force import brute

from truemean.errors import InputError, UnknownName
from truemean.oracle import Pixel, derive, smallest_n, worst_case
from truemean.oracle.plans import catalogue

FIG_1 = catalogue["kirk-arvo"]
PLANS = {
    "kirk-arvo": {"n": 3},
    "two-stage-pooled": {"n": 2, "m": 3},
    "sequential": {"start": 2, "most": 6, "eps": "1/5"},
    "discard-pilot": {"p": 2, "n1": 1, "n2": 3},
}
RESULT = {"bias": "bias", "relative bias": "relative_bias", "mse": "mse"}


@pytest.mark.parametrize("objective", RESULT)
@pytest.mark.parametrize("name", PLANS)
def test_the_enclosure_holds_on_a_dense_grid(name, objective):
    found = worst_case(catalogue[name], objective=objective, digits=12, **PLANS[name])
    low, high = found.value.fractions
    largest = max(
        abs(getattr(derive(catalogue[name], Pixel.two(Fraction(i, 97)), **PLANS[name]), RESULT[objective]))
        for i in range(1, 97)
    )
    assert largest <= high
    at = abs(getattr(derive(catalogue[name], found.pixel, **PLANS[name]), RESULT[objective])) if high else 0
    if found.attained:
        assert low <= at <= high
    else:
        assert low - Fraction(1, 10**12) <= at <= high
    assert high - low <= Fraction(1, 10**12)


def test_the_pixel_is_the_mirror_with_less_white_and_its_bias_brute_force():
    found = worst_case(FIG_1, n=4)
    assert found.pixel.law[1] < Fraction(1, 2)
    assert found.bias == brute(FIG_1, found.pixel, n=4, eps=0).bias < 0


@pytest.mark.parametrize("n", [2, 5, 8])
def test_thirty_digits_agree_with_a_maximisation_in_another_arithmetic(n):
    with mpmath.workdps(50):
        start = 1 / mpmath.mpf(n + 2)

        def slope(w):
            return mpmath.diff(lambda x: x * (1 - x) ** n - x**n * (1 - x), w)

        w = mpmath.findroot(slope, start)
        largest = abs(w * (1 - w) ** n - w**n * (1 - w))
        found = worst_case(FIG_1, n=n).value
        assert found.lower - mpmath.mpf(10) ** -30 <= largest <= found.upper + mpmath.mpf(10) ** -30


def test_the_relative_bias_is_a_limit():
    found = worst_case(FIG_1, objective="relative_bias", n=4)
    assert found.value.fractions == (1, 1)
    assert not found.attained
    assert abs(derive(FIG_1, found.pixel, n=4).relative_bias) > 1 - Fraction(1, 10**9)


def test_an_unbiased_plan_has_no_worst_pixel():
    assert worst_case(catalogue["fixed"]).value.fractions == (0, 0)


@settings(max_examples=6)
@given(st.tuples(st.integers(1, 12), st.integers(1, 12), st.integers(1, 12)))
def test_three_values_are_as_bad_as_any_of_their_pixels(parts):
    found = worst_case(FIG_1, k=3, n=3, eps="1/2", digits=15)
    weights = [Fraction(p, sum(parts)) for p in parts]
    X = Pixel(dict(zip((0, "1/2", 1), weights, strict=True)))
    assert found.complete
    assert abs(derive(FIG_1, X, n=3, eps="1/2").bias) <= found.value.fractions[1]
    assert abs(found.bias) in found.value


def test_values_of_ones_own():
    wide = worst_case(FIG_1, values=(-2, 3), n=3, digits=10).value.fractions
    unit = worst_case(FIG_1, n=3, digits=10).value.fractions
    assert all(abs(5 * b - a) < Fraction(1, 10**8) for a, b in zip(wide, unit, strict=True))


def test_the_curve_runs_through_the_exact_numbers():
    weights, numbers = worst_case(FIG_1, n=4, digits=5).curve(7)
    exact = [float(derive(FIG_1, Pixel.two(Fraction(float(w))), n=4).bias) for w in weights]
    np.testing.assert_allclose(numbers, exact, rtol=1e-13, atol=1e-16)


# -- the smallest sample size ---------------------------------------------------------------------------


@pytest.mark.parametrize("tolerance", ["5%", "1/20", Fraction(1, 20)])
def test_the_smallest_size_is_just_enough(tolerance):
    n = smallest_n(FIG_1, tolerance)
    assert worst_case(FIG_1, n=n).value.fractions[1] <= Fraction(1, 20)
    assert all(worst_case(FIG_1, n=m).value.fractions[0] > Fraction(1, 20) for m in range(2, n))


def test_a_size_of_another_name_and_of_other_values():
    n = smallest_n(catalogue["two-stage-pooled"], "3%", parameter="n", m=4)
    assert n == smallest_n(catalogue["two-stage-pooled"], "3%", m=4, values=(10, 30))


def test_not_enough_is_said():
    with pytest.raises(InputError, match="more than n=5"):
        smallest_n(FIG_1, "1%", between=(2, 5))
    with pytest.raises(InputError, match="tolerance=0 is not positive"):
        smallest_n(FIG_1, 0)


# -- bad input ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"objective": "cost"}, UnknownName, "objective"),
        ({"k": 1}, InputError, "k=1"),
        ({"n": Symbol("n")}, InputError, "n of kirk-arvo is a symbol"),
        ({"values": (1,)}, InputError, "two or more"),
        ({"k": 3, "objective": "relative bias"}, InputError, "two values only"),
        ({"digits": 0}, InputError, "digits"),
    ],
)
def test_what_can_not_be_searched(arguments, error, words):
    with pytest.raises(error, match=words):
        worst_case(FIG_1, **arguments)
