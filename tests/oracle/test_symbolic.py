"""Formulas, with numbers put in for their symbols, are to the last digit what numbers give from the start."""

from __future__ import annotations

from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from sympy import And, IndexedBase, Mul, Piecewise, Pow, Rational, Sum, Symbol, expand, simplify, sympify
from sympy.core.relational import Relational
from tests.oracle import small_plans, small_plans_staged, strategies
from tests.oracle.brute_force import brute
from tests.oracle.catalogue_cases import cases

from truemean.errors import NoClosedForm
from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue

few = settings(deadline=None, derandomize=True, max_examples=3, suppress_health_check=list(HealthCheck))
some = settings(few, max_examples=12)

RESULTS = ("bias", "expectation", "mse", "variance", "cost", "oracle_calls")
SMALL = small_plans.SCALAR | small_plans.NONNEGATIVE | small_plans_staged.SCALAR
WRITES_SLOWLY = {"clamped", "sequential", "looked_at_grown_looked_at"}  # the formula of their variance fills pages
n, m, p, n1, n2, k, w, a, eps = (Symbol(name) for name in ("n", "m", "p", "n1", "n2", "k", "w", "a", "eps"))
TWO, THREE = Pixel({0: "2/5", 1: "3/5"}), Pixel({-1: "1/2", "1/3": "1/3", 2: "1/6"})
FOUR = Pixel({0: "1/8", "1/2": "1/2", "3/4": "1/4", 2: "1/8"})

# -- putting numbers in ----------------------------------------------------------------------------


def number(value):
    return Rational(value.numerator, value.denominator)


def at(formula, point):
    """The number that a formula is where symbols have the values given by name."""
    if isinstance(formula, tuple):
        return tuple(at(channel, point) for channel in formula)
    if not hasattr(formula, "free_symbols"):
        return formula
    found = formula.xreplace({symbol: number(point[symbol.name]) for symbol in formula.free_symbols})
    assert found.is_Rational, found
    return Fraction(int(found.p), int(found.q))


def law_at(derivation, point):
    law = {}
    for value, probability in derivation.distribution().items():
        if share := at(probability, point):  # a value has a place only where it is seen
            place = at(value, point)
            law[place] = law.get(place, 0) + share
    return law


def assert_at(formulas, numbers, point, *, law=True, results=RESULTS):
    """All results of a derivation with symbols are those of a derivation, or twin, without."""
    for name in results:
        assert at(getattr(formulas, name), point) == getattr(numbers, name), (name, point)
    shares = [at(path.probability, point) for path in formulas.paths]
    assert sum(shares) == 1
    biases = [at(path.bias, point) for path in formulas.paths]
    total = tuple(map(sum, zip(*biases, strict=True))) if isinstance(biases[0], tuple) else sum(biases)
    assert total == numbers.bias
    if hasattr(numbers, "paths"):
        seen = [share for share in shares if share]
        assert sorted(seen) == sorted(path.probability for path in numbers.paths)
    if law:
        found = numbers.distribution
        assert law_at(formulas, point) == (found() if callable(found) else found)


def weights_of(pixel):
    return {f"omega{i}": weight for i, weight in enumerate(pixel.weights, 1)}


def values_of(pixel):
    return {f"I{i}": value for i, value in enumerate(pixel.values, 1)}


def pixels_of(count, values=(*strategies.SPACED, *strategies.IRREGULAR)):
    """Pixels of ``count`` values with positive weights."""

    def build(chosen, parts):
        return Pixel({v: Fraction(part, sum(parts)) for v, part in zip(chosen, parts, strict=True)})

    chosen = st.lists(st.sampled_from([Fraction(v) for v in values]), min_size=count, max_size=count, unique=True)
    return st.builds(build, chosen, st.lists(st.integers(1, 5), min_size=count, max_size=count))


# -- 1. every small plan ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", SMALL)
def test_symbolic_weights_of_every_small_plan_stand_for_any(name):
    allowed = [v for v in strategies.IRREGULAR if v >= 0 or name not in small_plans.NONNEGATIVE]

    @few
    @given(pixels_of(2, allowed) | pixels_of(3, allowed))
    def check(pixel):
        formulas = derive(SMALL[name], Pixel.symbolic(len(pixel.values), values=pixel.values))
        assert_at(formulas, brute(SMALL[name], pixel), weights_of(pixel))

    check()


NO_FORMULA = {  # for values that are symbols, and why
    "quantised": "can't be rounded",
    "second_stage_of_random_size_decides": "can't be rounded",
    "two_standard_errors": "under several roots",
    "until_standard_error": "X.draw_until stops by",  # which states are merged depends on the decision
    "until_halves_agree": "X.draw_until stops by",
    "until_extremes_then_grown_and_looked_at": "X.draw_until stops by",
    "grown_by_its_own_mean_and_never_looked_at_again": "sample size .* depends on what a symbol decides",
    "pilot_sizes_and_is_pooled": "is divided by, and a symbol decides",
    "coin_by_the_pilot": "the sign of .* is decided by a symbol",  # the mean, clipped to be a probability
}
NO_ORDER = dict.fromkeys(("numpy_reductions", "custom_statistic"), "values in ascending order: .* ordered=True")


@cache
def with_symbols(name, ordered):
    return derive(SMALL[name], Pixel.symbolic(2, ordered=ordered))


@pytest.mark.parametrize("ordered", [True, False], ids=["ordered", "unordered"])
@pytest.mark.parametrize("name", SMALL)
def test_symbolic_values_of_every_small_plan_stand_for_any(name, ordered):
    refusals = NO_FORMULA if ordered else NO_FORMULA | NO_ORDER
    if name in refusals:
        with pytest.raises(NoClosedForm, match=refusals[name]):
            _ = with_symbols(name, ordered).bias
        return
    results = [r for r in RESULTS if r != "variance" or name not in WRITES_SLOWLY]
    allowed = (0, Fraction(2, 7), 1, 2) if name in small_plans.NONNEGATIVE else (-1, 0, Fraction(1, 3), 1, 2)

    @settings(few, max_examples=4)
    @given(pixels_of(2, allowed))
    def check(pixel):
        if ordered:
            pixel = Pixel(dict(sorted(pixel.law.items())))
        point = weights_of(pixel) | values_of(pixel)
        assert_at(with_symbols(name, ordered), brute(SMALL[name], pixel), point, results=results)

    check()


@pytest.mark.parametrize("ordered", [True, False], ids=["ordered", "unordered"])
@pytest.mark.parametrize("name", ["figure_1", "range_with_ties", "all_equal_then_mean", "midrange", "variance_decides"])
def test_three_symbolic_values_stand_for_any(name, ordered):
    formulas = derive(SMALL[name], Pixel.symbolic(3, ordered=ordered))

    @settings(few, max_examples=5)
    @given(pixels_of(3))
    def check(pixel):
        pixel = Pixel(dict(sorted(pixel.law.items()))) if ordered else pixel
        assert_at(formulas, brute(SMALL[name], pixel), weights_of(pixel) | values_of(pixel))

    check()


# -- 2. a symbol for n -----------------------------------------------------------------------------


def strict_range(X, n=2, eps=0):
    S = X.draw(n)
    return S.mean() if S.range() < eps else X.draw(2).mean()


def lowest_above(X, n=2, eps=0):
    S = X.draw(n)
    return 2 * S.mean() if S.min() > eps else X.draw(n + 1).mean()


def highest_below(X, n=2, eps=0):
    S = X.draw(n)
    return S.max() if S.max() < eps else S.mean()


def small_contrast(X, n=2, eps=0):
    S = X.draw(n)
    return S.mean() if S.contrast(undefined=0) <= eps / 2 else X.true_mean()


def all_equal(X, n=2, eps=0):
    S, T = X.draw(n), X.draw(n + 1)
    return S.mean() if S.all_equal() and not T.all_equal() else T.mean() * eps


def spread_at_last(X, n=2, eps=0):
    S = X.draw(n + 1)
    return S.mean() if S.variance() > 0 else S.min() * S.max()


def grown_and_looked_at_twice(X, n=2, eps=0):
    S = X.draw(n)
    old = S.mean()
    if S.range() <= eps:
        S.more(2 * n)
        return (S.mean() + old) / 2 if S.range() <= eps else S.max()
    S.more(1)
    return S.mean()


def sized_by_a_pilot(X, n=2, eps=0):
    S = X.draw(n)
    return X.draw(np.where(S.range() <= eps, n, 2 * n)).mean()


def parts_and_choices(X, n=2, eps=0):
    R, rest = X.split("1/3")
    S = R.draw(n)
    if X.coin("1/4"):
        return rest.estimate(catalogue["kirk-arvo"], n=n, eps=eps)
    return S.mean() * R.area + rest.draw(1 if S.range() <= eps else n).mean() * rest.area


WINDOWED = (
    catalogue["kirk-arvo"],
    strict_range,
    lowest_above,
    highest_below,
    all_equal,
    spread_at_last,
    grown_and_looked_at_twice,
    sized_by_a_pilot,
    parts_and_choices,
)


@pytest.mark.parametrize("pixel", [TWO, THREE, FOUR], ids=["two", "three", "four"])
@pytest.mark.parametrize("plan", [*WINDOWED, small_contrast], ids=lambda plan: getattr(plan, "name", plan.__name__))
@pytest.mark.parametrize("threshold", [Fraction(1, 2), 1])
def test_a_symbol_for_n_stands_for_1_to_12(plan, threshold, pixel):
    if plan is small_contrast and min(pixel.values) < 0:
        pixel = FOUR
    formulas = derive(plan, pixel, n=n, eps=threshold)
    for size in range(1, 13):
        assert_at(formulas, derive(plan, pixel, n=size, eps=threshold), {"n": size}, law=False)


SIZES = [(1, 1, 1), (1, 3, 2), (2, 1, 5), (3, 2, 1), (5, 4, 12), (12, 7, 3)]


@pytest.mark.parametrize("name", ["two-stage-pooled", "discard-pilot", "kirk-arvo-unbiased"])
@pytest.mark.parametrize("threshold", [0, Fraction(1, 2)])
def test_symbols_for_the_sizes_of_both_stages_stand_for_any(name, threshold):
    symbols = {"n": n, "m": m} if name == "two-stage-pooled" else {"p": p, "n1": n1, "n2": n2}
    for pixel in (TWO, THREE):
        formulas = derive(catalogue[name], pixel, eps=threshold, **symbols)
        for sizes in SIZES:
            point = dict(zip(symbols, sizes, strict=False))
            assert_at(formulas, derive(catalogue[name], pixel, eps=threshold, **point), point, law=False)


def test_figure_2_is_unbiased_whatever_its_sizes_area_and_threshold():
    symbols = {"p": p, "n1": n1, "n2": n2, "area": a}
    assert derive(catalogue["kirk-arvo-unbiased"], Pixel.symbolic(2), eps=eps, **symbols).bias == 0
    formulas = derive(catalogue["kirk-arvo-unbiased"], THREE, eps=1, **symbols)
    for *sizes, area in ((1, 2, 3, Fraction(1, 3)), (4, 1, 7, Fraction(6, 7))):
        point = dict(zip(symbols, (*sizes, area), strict=True))
        assert_at(formulas, derive(catalogue["kirk-arvo-unbiased"], THREE, eps=1, **point), point, law=False)


@pytest.mark.parametrize("size", [n + 2, 3 * n, n + m, n * m, n**2, n - 1])
def test_a_sample_size_may_be_a_formula(size):
    point = {"n": 3, "m": 2}
    formulas = derive(catalogue["kirk-arvo"], THREE, n=size, eps=1)
    assert_at(formulas, derive(catalogue["kirk-arvo"], THREE, n=int(size.subs(point)), eps=1), point, law=False)


@pytest.mark.parametrize("threshold", [1 / n, n / 4, 2 ** (-n), (n + 1) * w])
def test_a_threshold_may_depend_on_n_and_on_a_weight(threshold):
    formulas = derive(catalogue["kirk-arvo"], Pixel({0: 1 - w, "1/2": w}), n=n, eps=threshold)
    assert len(formulas.bias.free_symbols) == 2  # one n, one w, whatever was known of them
    for point in ({"n": 2, "w": Fraction(1, 6)}, {"n": 1, "w": Fraction(1, 4)}, {"n": 4, "w": Fraction(1, 2)}):
        there = Pixel({0: 1 - point["w"], "1/2": point["w"]})
        level = at(threshold, point)
        numbers = derive(catalogue["kirk-arvo"], there, n=point["n"], eps=level)
        assert_at(formulas, numbers, point, law=False)


# -- 3. Eq. 6 --------------------------------------------------------------------------------------


def test_the_bias_of_figure_1_is_equation_6():
    X = Pixel.symbolic(3)
    bias = derive(catalogue["kirk-arvo"], X, n=n).bias
    size = Symbol("n", integer=True, positive=True)
    equation = sum(weight**size * (value - X.mean) for value, weight in X.law.items())
    assert simplify(expand((bias - equation).subs(X.simplex))) == 0
    assert not bias.has(Piecewise)
    assert {weight**size for weight in X.weights} <= bias.atoms(Pow)
    assert len(bias.args) == 3


def with_three(formula):
    """A formula in I[1..k] and omega[1..k], k = 3, in the symbols of `Pixel.symbolic`."""
    found = formula.subs({s: 3 for s in formula.free_symbols if s.name == "k"}).doit()
    names = {"I": "I", "omega": "omega"}
    named = {IndexedBase(base)[i]: Symbol(f"{name}{i}") for base, name in names.items() for i in (1, 2, 3)}
    return found.xreplace(named)


def grown_where_equal(X, n=2):
    S = X.draw(n)
    if S.variance() <= 0:
        S.more(2)
    return S.mean()


def second_stage_where_equal(X, n=2):
    S = X.draw(n)
    return X.draw(np.where(S.all_equal(), 1, 3)).mean() / 2 + X.estimate(catalogue["kirk-arvo"], n=n) / 2


@pytest.mark.parametrize("plan", [catalogue["kirk-arvo"], grown_where_equal, second_stage_where_equal])
def test_a_symbol_for_k_stands_for_3(plan):
    size = 2 if plan is grown_where_equal else n
    families, three = derive(plan, Pixel.symbolic(k), n=size), derive(plan, Pixel.symbolic(3), n=size)
    assert families.bias.has(Sum)
    simplex = Pixel.symbolic(3).simplex
    for result in ("bias", "variance", "cost", "oracle_calls"):
        difference = with_three(getattr(families, result)) - getattr(three, result)
        assert simplify(expand(difference.subs(simplex))) == 0, result


# -- 4. symbolic thresholds ------------------------------------------------------------------------


def threshold_of_the_variance(X, n=2, eps=0):
    S = X.draw(n + 1)
    return S.mean() if S.variance() <= eps else X.true_mean()


def threshold_of_the_standard_error(X, n=2, eps=0):
    S = X.draw(n + 1)
    return S.mean() if S.std_error() < eps else X.true_mean()


def not_quite_two_standard_errors(X, n=2, eps=0):
    S = X.draw(n + 1)
    return S.mean() if 2 * S.std_error() + eps >= S.mean() else X.draw(1).mean()


def clamped(X, n=2, eps=0):
    S = X.draw(n)
    return np.minimum(S.mean(), eps) + np.where(S.max() >= eps, S.mean(), eps) + np.clip(S.mean(), 0, eps)


def exactly(X, n=2, eps=0):
    S = X.draw(n)
    if S.range() == eps:
        return S.mean()
    return 1 if S.max() != eps else S.min()


def asked_twice_and_nested(X, n=2, eps=0):
    S, T = X.draw(n), X.draw(1)
    if S.range() <= eps:
        if T.mean() <= eps and not S.range() < eps:
            return T.mean()
        return S.max() if S.range() <= eps / 2 else 2 * S.min()
    return X.true_mean() if S.range() > 2 * eps else S.mean()


def while_the_range_is_small(X, n=2, eps=0):
    S = X.draw(1)
    while S.range() <= eps and S.size <= n:
        S.more(1)
    return S.mean()


ASKING = (
    threshold_of_the_variance,
    threshold_of_the_standard_error,
    not_quite_two_standard_errors,
    clamped,
    exactly,
    asked_twice_and_nested,
    while_the_range_is_small,
)
TIES = [Fraction(v) for v in ("0", "1", "1/3", "4/3", "5/3", "3", "2", "-1", "1/9", "2/3", "1/2", "1/7", "-4")]
