"""Levels of observation: which one a statistic asks for, how many rows it has, and that a finer one changes nothing."""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations_with_replacement
from math import comb

import numpy as np
import pytest

from truemean.errors import NotExact
from truemean.oracle import Pixel, derive

EVEN = Pixel({0: "1/3", 1: "1/4", 2: "1/6", 3: "1/4"})
IRREGULAR = Pixel({"-5/3": "1/5", 0: "2/5", "2/7": "3/10", "9/4": "1/10"})
TWO = Pixel.two("1/8")
SCALAR = {"even": EVEN, "irregular": IRREGULAR, "two": TWO}
RGB = Pixel({(0, 1, 0): "1/2", (1, 0, 0): "1/4", (1, 1, "1/2"): "1/8", ("1/3", 0, 0): "1/8"})
RESULTS = ("expectation", "bias", "variance", "mse", "cost", "oracle_calls")


def modelled(derivation):
    """The levels by sample, in words."""
    return {name: str(level) for name, level in derivation.level.items()}


def deciding(decide, n):
    """Fig. 1 with a decision of one's own."""

    def figure_1(X):
        S = X.draw(n)
        return S.mean() if decide(S) else X.true_mean()

    return figure_1


# -- the level that a statistic asks for, and its rows ---------------------------------------------

ASKED = {
    "nothing": (lambda S: True, "unseen"),
    "all equal": (lambda S: S.all_equal(), "flat"),
    "range <= 0": (lambda S: S.range() <= 0, "flat"),
    "range == 0": (lambda S: S.range() == 0, "flat"),
    "range > 0": (lambda S: S.range() > 0, "flat"),
    "variance <= 0": (lambda S: S.variance() <= 0, "flat"),
    "standard error <= 0": (lambda S: S.std_error() <= 0, "flat"),
    "contrast <= 0": (lambda S: S.contrast(undefined=0) <= 0, "flat"),
    "minimum": (lambda S: S.min() > 0, "extremes"),
    "maximum": (lambda S: S.max() > 1, "extremes"),
    "range": (lambda S: S.range() <= 1, "extremes"),
    "contrast": (lambda S: S.contrast(undefined=0) <= Fraction(1, 2), "extremes"),
    "minimum and all equal": (lambda S: (S.min() > 0) & ~S.all_equal(), "extremes"),
    "mean": (lambda S: S.mean() <= 1, "sum"),
    "sum": (lambda S: S.sum() <= 3, "sum"),
    "mean and all equal": (lambda S: (S.mean() <= 1) & S.all_equal(), "flat x sum"),
    "variance": (lambda S: S.variance() <= 1, "moments"),
    "standard error": (lambda S: S.std_error() <= Fraction(1, 3), "moments"),
    "variance and all equal": (lambda S: (S.variance() <= 1) | S.all_equal(), "moments"),
    "range and mean": (lambda S: (S.range() <= 1) & (S.mean() > 0), "extremes x sum"),
    "range and variance": (lambda S: (S.range() <= 2) & (S.variance() > 1), "extremes x moments"),
    "median": (lambda S: np.median(S) <= 1, "counts"),
    "custom": (lambda S: S.statistic(lambda v: v[0] * v[-1]) <= 1, "counts"),
    "custom, in order": (lambda S: S.statistic(lambda v: v[0] - v[-1], ordered=True) <= 1, "sequence"),
    "an item": (lambda S: S[0] <= 1, "sequence"),
}

STATES = {
    "unseen": lambda draws: 0,
    "flat": lambda draws: draws[0] if draws[0] == draws[-1] else None,
    "extremes": lambda draws: (draws[0], draws[-1]),
    "sum": sum,
    "moments": lambda draws: (sum(draws), sum(v * v for v in draws)),
    "counts": lambda draws: draws,
}


def distinct(level, pixel, n):
    """How many states all multisets of n values have under a level: its rows, counted by hand."""
    parts = [STATES[part] for part in level.split(" x ")]
    draws = combinations_with_replacement(sorted(pixel.values), n)
    return len({tuple(part(draw) for part in parts) for draw in draws})


@pytest.mark.parametrize("n", [2, 5])
@pytest.mark.parametrize("asked", ASKED)
def test_a_statistic_asks_for_its_level_and_no_more(asked, n):
    decide, level = ASKED[asked]
    derivation = derive(deciding(decide, n), EVEN)
    assert modelled(derivation) == {"S1": level}
    assert derivation.rows == (4**n if level == "sequence" else distinct(level, EVEN, n))


@pytest.mark.parametrize("k", [1, 2, 6])
@pytest.mark.parametrize("n", [1, 2, 7])
def test_the_rows_are_as_many_as_the_table_of_levels_says(k, n):
    pixel = Pixel({i: Fraction(1, k) for i in range(k)})
    mixed = k > 1 and n > 1
    formulas = {
        "all equal": k + mixed,
        "range": k + mixed * k * (k - 1) // 2,
        "mean": n * (k - 1) + 1,
        "median": comb(n + k - 1, k - 1),
    }
    for asked, rows in formulas.items():
        assert derive(deciding(ASKED[asked][0], n), pixel).rows == rows, asked


def test_a_contrast_of_negative_values_is_no_test_for_equal_draws():
    decide = ASKED["contrast <= 0"][0]
    assert modelled(derive(deciding(decide, 3), Pixel({-3: "1/2", -1: "1/4", 2: "1/4"}))) == {"S1": "extremes"}
    assert modelled(derive(deciding(decide, 3), Pixel({0: "1/2", 2: "1/2"}))) == {"S1": "flat"}


COLOURED = {
    "all equal": (lambda S: S.all_equal(), "flat", 4 + 1),
    "range <= 0": (lambda S: (S.range() <= 0).all(), "flat", 4 + 1),
    "range > 0": (lambda S: (S.range() > 0).any(), "flat", 4 + 1),
    "some channel flat": (lambda S: (S.range() <= 0).any(), "support", 4 + 6 + 4),
    "range": (lambda S: (S.range() <= Fraction(1, 2)).all(), "support", 4 + 6 + 4),
    "minimum of one channel": (lambda S: S.min()[2] > 0, "support", 4 + 6 + 4),
}


@pytest.mark.parametrize("asked", COLOURED)
def test_colours_are_observed_by_the_values_seen(asked):
    decide, level, rows = COLOURED[asked]
    derivation = derive(deciding(decide, 3), RGB)
    assert modelled(derivation) == {"S1": level}
    assert derivation.rows == rows


def test_each_sample_has_its_own_level_and_each_result_its_own_need():
    def staged(X):
        S, T, U = X.draw(3), X.draw(2), X.draw(5)
        if S.range() <= 0:
            return T.mean() if T.mean() > 1 else U.mean()
        return U.mean()

    derivation = derive(staged, EVEN)
    assert modelled(derivation) == {"S1": "flat", "S2": "sum", "S3": "unseen"}
    _ = derivation.variance
    assert modelled(derivation) == {"S1": "flat", "S2": "sum", "S3": "unseen"}


@pytest.mark.parametrize(
    "estimate", [lambda S: S.mean() ** 2, lambda S: np.minimum(S.mean(), 1)], ids=["square", "clamp"]
)
def test_a_nonlinear_use_of_the_mean_asks_for_the_sum(estimate):
    assert modelled(derive(lambda X: estimate(X.draw(4)), EVEN)) == {"S1": "sum"}


def test_a_linear_use_asks_for_nothing_however_large_the_sample():
    derivation = derive(lambda X: X.draw(10**9).mean() / 3 + X.draw(10**6).sum(), EVEN)
    assert set(modelled(derivation).values()) == {"unseen"}
    assert derivation.rows == 1


def test_an_estimate_that_needs_a_root_is_refused_at_any_level():
    with pytest.raises(NotExact, match="arithmetic"):
        _ = derive(lambda X: np.sqrt(X.draw(2).mean()), EVEN).bias


# -- a finer level changes nothing -----------------------------------------------------------------

BASES = {
    "unseen": lambda X, S: S.mean(),
    "flat": lambda X, S: S.mean() if (S.range() <= 0).all() else X.true_mean(),
    "extremes": lambda X, S: S.mean() if (S.range() <= 1).all() else X.draw(2).mean(),
    "sum": lambda X, S: (S.mean() + X.mean) / 2 if (S.mean() > X.mean).all() else S.sum(),
    "moments": lambda X, S: S.mean() if (S.variance() <= 1).all() else (S.mean() + X.draw(1).mean()) / 2,
}
FINER = {
    "flat": lambda S: S.all_equal() | ~S.all_equal(),
    "extremes": lambda S: (S.range() >= 0).all(),
    "sum": lambda S: (S.mean() == S.mean() * 1).all(),
    "moments": lambda S: (S.variance() >= 0).all(),
    "counts": lambda S: S.statistic(lambda values: 0) >= 0,
    "sequence": lambda S: S.statistic(lambda values: 0, ordered=True) >= 0,
}
ORDER = ("flat", "extremes", "sum", "moments", "counts", "sequence")


def joined(first, second):
    """The coarsest level that gives both, by the table of levels."""
    fine = max((first, second), key=lambda name: ORDER.index(name) if name in ORDER else -1)
    pair = {first, second} - {"unseen"}
    if fine in ("counts", "sequence") or len(pair) == 1 or pair in ({"flat", "extremes"}, {"flat", "moments"}):
        return fine
    return "moments" if pair == {"sum", "moments"} else " x ".join(sorted(pair, key=ORDER.index))


def forced(base, force, early):
    """The plan with a decision that always holds, before its own or after it."""

    def plan(X):
        S = X.draw(4)
        if early:
            assert force(S)
        estimate = base(X, S)
        if not early:
            assert force(S)
        return estimate

    return plan


def assert_same(fine, coarse):
    assert [getattr(fine, r) for r in RESULTS] == [getattr(coarse, r) for r in RESULTS]
    assert fine.distribution() == coarse.distribution()
    assert [(p.probability, p.bias) for p in fine.paths] == [(p.probability, p.bias) for p in coarse.paths]
    assert fine.rows >= coarse.rows


@pytest.mark.parametrize("early", [True, False], ids=["first", "last"])
@pytest.mark.parametrize("finer", FINER)
@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("short", SCALAR)
def test_a_finer_level_gives_the_same_numbers(short, base, finer, early):
    pixel = SCALAR[short]
    coarse = derive(lambda X: BASES[base](X, X.draw(4)), pixel)
    fine = derive(forced(BASES[base], FINER[finer], early), pixel)
    assert modelled(coarse)["S1"] == base
    assert modelled(fine)["S1"] == joined(base, finer)
    assert_same(fine, coarse)
    approx = derive(forced(BASES[base], FINER[finer], early), pixel, arithmetic="float64").bias
    assert abs(Fraction(approx.value) - coarse.bias) <= Fraction(approx.error)


@pytest.mark.parametrize("finer", FINER)
@pytest.mark.parametrize("base", BASES)
def test_a_finer_level_gives_the_same_colours(base, finer):
    coarse = derive(lambda X: BASES[base](X, X.draw(4)), RGB)
    fine = derive(forced(BASES[base], FINER[finer], True), RGB)
    renamed = "support" if base == "extremes" else base
    assert modelled(coarse)["S1"] == renamed
    assert modelled(fine)["S1"] == joined(base, finer).replace("extremes", "support")
    assert_same(fine, coarse)


@pytest.mark.parametrize("finer", FINER)
def test_a_finer_level_of_a_sample_that_grows_gives_the_same_numbers(finer):
    def growing(force):
        def plan(X):
            S = X.draw(2)
            before = S.mean()
            if S.range() > 1:
                S.more(2)
            return (before + S.mean()) / 2 if force(S) else 0

        return plan

    assert_same(derive(growing(FINER[finer]), EVEN), derive(growing(lambda S: True), EVEN))
