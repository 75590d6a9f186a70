"""One test for each error of the design review that a first attempt at the engine makes."""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations, product
from math import prod

import numpy as np
import pytest
from tests.oracle.brute_force import brute

from truemean.errors import PlanError, UndefinedValue
from truemean.oracle import Pixel, derive

THIRDS = Pixel({0: "1/2", 1: "1/3", 3: "1/6"})
SIGNED = Pixel({-3: "1/4", -1: "1/4", 2: "1/2"})


def assert_twin(function, pixel, **params):
    """The derivation, once everything in it equals the twin's."""
    derivation = derive(function, pixel, **params)
    brute(function, pixel, **params).assert_equals(derivation)
    return derivation


# -- E1: levels are sets of features, not a chain ---------------------------------------------------


def test_e1_equal_sums_and_squares_do_not_tell_the_range():
    pixel = Pixel({0: "1/2", 1: "1/4", 3: "1/8", 4: "1/8"})
    assert (sum((0, 3, 3)), sum(v * v for v in (0, 3, 3))) == (sum((1, 1, 4)), sum(v * v for v in (1, 1, 4)))

    def variance_then_minimum(X):
        S = X.draw(3)
        if S.variance() == 3 and S.min() > 0:
            return S.mean() + 5
        return S.max()

    assert_twin(variance_then_minimum, pixel)


def test_e1_the_sum_does_not_tell_whether_all_draws_are_equal():
    def mean_then_all_equal(X):
        S = X.draw(2)
        if S.mean() == 1 and S.all_equal():
            return 5
        return S.mean()

    assert_twin(mean_then_all_equal, Pixel({0: "1/2", 1: "1/4", 2: "1/4"}))


def test_e1_a_custom_statistic_after_the_range_keeps_both():
    def range_then_middle(X):
        S = X.draw(4)
        if S.range() <= 1:
            return S.statistic(lambda values: values[1] * values[2])
        return S.mean()

    assert_twin(range_then_middle, THIRDS)


# -- E2, E3: no finer a level than asked ------------------------------------------------------------


def test_e2_a_mean_in_a_decision_needs_sums_only():
    lattice = Pixel(dict.fromkeys(range(6), "1/6"))

    def by_mean(X, n):
        S = X.draw(n)
        return S.mean() if S.mean() <= 2 else X.true_mean()

    assert_twin(by_mean, lattice, n=4)
    assert derive(by_mean, lattice, n=64).rows <= 5 * 64 + 1


@pytest.mark.parametrize("variation", ["range", "variance", "std_error"])
def test_e3_a_variation_compared_with_zero_needs_no_more_than_all_equal(variation):
    def easy_or_hard(X, n):
        S = X.draw(n)
        return S.mean() if getattr(S, variation)() <= 0 else X.true_mean()

    assert_twin(easy_or_hard, THIRDS, n=3)
    derivation = derive(easy_or_hard, THIRDS, n=1000)
    assert derivation.rows <= len(THIRDS.values) + 1
    assert derivation.bias == sum(w**1000 * (v - THIRDS.mean) for v, w in THIRDS.law.items())


def test_e3_contrast_is_no_variation_where_values_are_negative():
    def by_contrast(X):
        S = X.draw(3)
        return S.mean() if S.contrast() <= 0 else X.true_mean()

    flat_only = sum(w**3 * (v - SIGNED.mean) for v, w in SIGNED.law.items())
    assert assert_twin(by_contrast, SIGNED).bias != flat_only


# -- E5: growing ------------------------------------------------------------------------------------


def test_e5_an_older_statistic_survives_the_growth_of_its_sample():
    def old_and_new(X):
        S = X.draw(2)
        old = S.mean()
        if S.range() <= 0:
            return old
        S.more(1)
        if S.mean() > 1:
            S.more(1)
        return (old + S.mean()) / 2

    assert_twin(old_and_new, THIRDS)


def test_e5_an_old_statistic_in_a_decision_after_a_look_at_the_grown_sample():
    def new_then_old(X):
        S = X.draw(2)
        old = S.max()
        S.more(2)
        if S.mean() > 1 and old <= 1:
            S.more(1)
            return S.mean() * old
        return S.mean() if old > 0 else S.range()

    assert_twin(new_then_old, THIRDS)


def test_e5_rows_of_two_sizes_are_not_merged():
    def sizes_differ(X):
        S = X.draw(1)
        S.more(np.where(S.max() > 0, 1, 2))
        if S.sum() == 1:
            return S.mean() * 6
        return S.sum() / S.size

    assert_twin(sizes_differ, THIRDS)


def test_e5_pooling_in_place_costs_no_rows_that_nobody_looks_at():
    def pooled(X, n, m):
        S = X.draw(n)
        if S.range() > 0:
            S.more(m)
        return S.mean()

    assert_twin(pooled, THIRDS, n=3, m=2)
    derivation = derive(pooled, THIRDS, n=32, m=64)
    easy = sum(w**32 * (v - THIRDS.mean) for v, w in THIRDS.law.items())
    assert derivation.bias == easy * (1 - Fraction(32, 96))
    assert derivation.rows <= 2 * (len(THIRDS.values) + 1)


def test_e5_a_look_by_another_sample_between_growths_keeps_both_apart():
    def crossed(X):
        S, T = X.draw(1), X.draw(1)
        first = S.mean()
        if S.mean() > T.mean():
            S.more(1)
        if S.mean() > T.mean():
            T.more(1)
        return first * T.mean() + S.mean()

    assert_twin(crossed, THIRDS)


# -- E6: colours ------------------------------------------------------------------------------------

SHADES = Pixel({(0, 2): "1/4", (1, 1): "1/8", (2, 0): "1/8", (1, 2): "1/4", (2, 2): "1/4"})


def colour_figure_1(X, n):
    S = X.draw(n)
    return S.mean() if (S.range() <= 1).all() else X.true_mean()


def test_e6_pairs_of_extremes_by_colour_are_boxes():
    assert_twin(colour_figure_1, SHADES, n=3)


def test_e6_boxes_stay_closed_in_n():
    n, bias = 64, [Fraction(0)] * 2
    values, weights = SHADES.values, SHADES.weights
    for size in range(1, 6):
        for seen in combinations(range(5), size):
            if any(max(values[i][c] for i in seen) - min(values[i][c] for i in seen) > 1 for c in (0, 1)):
                continue
            for kept in (s for r in range(1, size + 1) for s in combinations(seen, r)):
                weight = sum(weights[i] for i in kept) ** (n - 1) * (-1) ** (size - len(kept))
                for c in (0, 1):
                    bias[c] += weight * sum(weights[i] * (values[i][c] - SHADES.mean[c]) for i in kept)
    derivation = derive(colour_figure_1, SHADES, n=n)
    assert derivation.bias == tuple(bias)
    assert derivation.rows <= 2**5


# -- E7, E8, E9 -------------------------------------------------------------------------------------


def test_e7_a_single_draw_has_no_rows_with_two_extremes():
    def would_divide_by_nothing(X):
        S = X.draw(1)
        if S.range() > Fraction(1, 2):
            return 1 / (S.max() - S.max())
        return S.max()

    assert len(assert_twin(would_divide_by_nothing, THIRDS).paths) == 1


def test_e7_a_value_of_weight_zero_makes_no_path():
    def white_is_special(X):
        S = X.draw(2)
        return 1 / (S.max() - 1) if S.max() >= 1 else S.mean()

    assert len(assert_twin(white_is_special, Pixel({0: "1/2", 1: 0, 5: "1/2"})).paths) == 2
    assert len(assert_twin(white_is_special, Pixel({0: 1, 1: 0})).paths) == 1


def test_e8_the_length_of_a_sample_is_an_integer_where_it_is_one():
    def weighted_by_length(X):
        S = X.draw(3)
        S.more(1)
        return S.sum() * len(S)

    assert derive(weighted_by_length, THIRDS).expectation == 16 * THIRDS.mean


def test_e8_a_length_that_varies_by_row_names_size():
    def varying(X):
        S = X.draw(2)
        return len(X.draw(np.where(S.range() <= 0, 1, 2))) * S.mean()

    with pytest.raises(PlanError, match=r"\.size"):
        derive(varying, THIRDS)


def test_e8_an_empty_sample_has_sum_0_and_a_mean_only_with_coefficient_0():
    def coefficient(X):
        S = X.draw(2)
        T = X.draw(np.where(S.range() <= 0, 0, 2))
        return S.mean() + T.sum() + np.where(S.range() <= 0, 0, 1) * T.mean()

    def guard(X):
        S = X.draw(2)
        T = X.draw(np.where(S.range() <= 0, 0, 2))
        return S.mean() + T.sum() + np.where(S.range() <= 0, 0, T.mean())

    brute(guard, THIRDS).assert_equals(derive(coefficient, THIRDS))
    assert_twin(guard, THIRDS)


@pytest.mark.parametrize("result", ["bias", "variance", "paths"])
def test_e8_the_mean_of_an_empty_sample_is_undefined(result):
    def unguarded(X):
        S = X.draw(2)
        return X.draw(np.where(S.range() <= 0, 0, 2)).mean()

    with pytest.raises(UndefinedValue):
        brute(unguarded, THIRDS)
    with pytest.raises(UndefinedValue):
        getattr(derive(unguarded, THIRDS), result)


def test_e9_a_bias_far_below_the_rounding_of_the_mean_keeps_its_digits():
    pixel = Pixel({0: "1/10", 1: "2/10", 2: "3/10", 3: "4/10"})

    def figure_1(X, n):
        S = X.draw(n)
        return S.mean() if S.range() <= 0 else X.true_mean()

    exact = derive(figure_1, pixel, n=150).bias
    assert exact == sum(w**150 * (v - pixel.mean) for v, w in pixel.law.items())
    assert float(exact + pixel.mean) - float(pixel.mean) == 0 < exact < Fraction(1, 10**59)
    rough = derive(figure_1, pixel, n=150, arithmetic="float64").bias
    assert abs(Fraction(rough.value) - exact) <= Fraction(rough.error) <= exact / 10**9


def test_e9_a_sample_that_nobody_looks_at_adds_exactly_nothing_in_floats():
    pixel = Pixel({"0.1": "1/3", "0.7": "2/3"})

    def weighted(X):
        return X.draw(3).mean() * Fraction(1, 3) + X.draw(7).mean() * Fraction(2, 3)

    assert derive(weighted, pixel, arithmetic="float64").bias.value == 0


# -- two values the hash of Python confuses ---------------------------------------------------------


def test_minus_one_and_minus_two_are_different_constants():
    def clamps(X):
        S = X.draw(2)
        return np.maximum(S.mean(), -1) * np.maximum(S.mean(), -2)

    assert hash(Fraction(-1)) == hash(Fraction(-2))
    pixel = Pixel({-3: "1/2", 1: "1/2"})
    by_hand = sum(
        prod((Fraction(1, 4), max(Fraction(a + b, 2), -1), max(Fraction(a + b, 2), -2)))
        for a, b in product((-3, 1), repeat=2)
    )
    assert derive(clamps, pixel).expectation == by_hand
