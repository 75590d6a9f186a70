"""Formulas, with numbers put in for their symbols, are to the last digit what numbers give from the start."""

from __future__ import annotations

from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, given, reject, settings
from hypothesis import strategies as st
from sympy import Basic, Piecewise, Pow, Rational, Symbol, expand, simplify
from tests.oracle import small_plans, small_plans_staged, strategies
from tests.oracle.brute_force import brute
from tests.oracle.catalogue_cases import cases

from truemean.errors import NoClosedForm, UndefinedValue
from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue

few = settings(deadline=None, derandomize=True, max_examples=2, suppress_health_check=list(HealthCheck))

RESULTS = ("bias", "expectation", "mse", "variance", "cost", "oracle_calls")
SMALL = small_plans.SCALAR | small_plans.NONNEGATIVE | small_plans_staged.SCALAR
WRITES_SLOWLY = {"clamped", "sequential"}  # the formulas of their variance and law fill pages
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


def shares(count):
    """Positive weights that sum to 1."""
    parts = st.lists(st.integers(1, 5), min_size=count, max_size=count)
    return parts.map(lambda found: [Fraction(part, sum(found)) for part in found])


def pixels_of(count, values=(*strategies.SPACED, *strategies.IRREGULAR)):
    exact = [Fraction(v) for v in values]
    chosen = st.lists(st.sampled_from(exact), min_size=count, max_size=count, unique=True)
    return st.builds(lambda found, weights: Pixel(dict(zip(found, weights, strict=True))), chosen, shares(count))


# -- every small plan ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", SMALL)
def test_symbolic_weights_of_every_small_plan_stand_for_any(name):
    allowed = [v for v in strategies.IRREGULAR if v >= 0 or name not in small_plans.NONNEGATIVE]

    @settings(few, max_examples=1)
    @given(pixels_of(3, allowed))
    def check(pixel):
        formulas = derive(SMALL[name], Pixel.symbolic(3, values=pixel.values))
        assert_at(formulas, brute(SMALL[name], pixel), weights_of(pixel))

    check()


NO_FORMULA = {  # for values that are symbols, and why
    "quantised": "can't be rounded",
    "second_stage_of_random_size_decides": "can't be rounded",
    "two_standard_errors": "under several roots",
    "until_standard_error": "X.draw_until stops by",  # which states are merged depends on the decision
    "until_halves_agree": "X.draw_until stops by",
    "until_extremes_then_grown_and_looked_at": "X.draw_until stops by",
    "grown_by_its_own_mean_and_never_looked_at_again": "is divided by, and a symbol decides",
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
    light = name not in WRITES_SLOWLY
    results = RESULTS if light and ordered else ("bias", "mse", "cost", "oracle_calls")
    allowed = (0, Fraction(2, 7), 1, 2) if name in small_plans.NONNEGATIVE else (-1, 0, Fraction(1, 3), 1, 2)

    @settings(few, max_examples=3)
    @given(pixels_of(2, allowed))
    def check(pixel):
        if ordered:
            pixel = Pixel(dict(sorted(pixel.law.items())))
        point = weights_of(pixel) | values_of(pixel)
        assert_at(with_symbols(name, ordered), brute(SMALL[name], pixel), point, law=light, results=results)

    check()


@pytest.mark.parametrize("ordered", [True, False], ids=["ordered", "unordered"])
@pytest.mark.parametrize("name", ["figure_1", "range_with_ties", "all_equal_then_mean", "variance_decides"])
def test_three_symbolic_values_stand_for_any(name, ordered):
    formulas = derive(SMALL[name], Pixel.symbolic(3, ordered=ordered))

    @settings(few, max_examples=3)
    @given(pixels_of(3))
    def check(pixel):
        pixel = Pixel(dict(sorted(pixel.law.items()))) if ordered else pixel
        assert_at(formulas, brute(SMALL[name], pixel), weights_of(pixel) | values_of(pixel))

    check()


# -- a symbol for n --------------------------------------------------------------------------------


def grown_and_looked_at_twice(X, S, n, eps):
    old = S.mean()
    if S.range() <= eps:
        S.more(2 * n)
        return (S.mean() + old) / 2 if S.range() <= eps else S.max()
    S.more(1)
    return S.mean()


def grown_where_equal(X, S, n, eps):
    if S.variance(undefined=0) <= 0:
        S.more(2)
    return S.mean()


def parts_and_choices(X, S, n, eps):
    R, rest = X.split("1/3")
    T = R.draw(n)
    if X.coin("1/4"):
        return rest.estimate(catalogue["kirk-arvo"], n=n, eps=eps) * eps
    return T.mean() * R.area + rest.draw(1 if T.range() <= eps else n).mean() * rest.area


RULES = {
    "range <=": lambda X, S, n, eps: S.mean() if S.range() <= eps else X.true_mean(),
    "range <": lambda X, S, n, eps: S.mean() if S.range() < eps else X.draw(2).mean(),
    "min >": lambda X, S, n, eps: 2 * S.mean() if S.min() > eps else X.draw(n + 1).mean(),
    "max <": lambda X, S, n, eps: S.max() if S.max() < eps else S.mean(),
    "contrast": lambda X, S, n, eps: S.mean() if S.contrast(undefined=0) <= eps / 2 else X.true_mean(),
    "all equal": lambda X, S, n, eps: S.mean() if S.all_equal() and not X.draw(n + 1).all_equal() else eps,
    "some spread": lambda X, S, n, eps: S.mean() if S.std_error(undefined=0) > 0 else S.min() * S.max(),
    "size": lambda X, S, n, eps: X.draw(n if S.range() <= eps else 2 * n).mean() * np.where(S.max() > eps, 1, eps),
    "grown": grown_and_looked_at_twice,
    "grown where equal": grown_where_equal,
    "parts and choices": parts_and_choices,
}


def plan_of(rule):
    def plan(X, n=2, eps=0):
        return rule(X, X.draw(n), n, eps)

    return plan


@pytest.mark.parametrize(
    ("pixel", "threshold"), [(TWO, Fraction(1, 2)), (THREE, 1), (FOUR, Fraction(1, 2))], ids=["two", "three", "four"]
)
@pytest.mark.parametrize("name", RULES)
def test_a_symbol_for_n_stands_for_1_to_12(name, pixel, threshold):
    if name == "contrast" and pixel is THREE:
        pixel = Pixel({0: "1/2", "1/3": "1/3", 2: "1/6"})  # contrast takes values that are not negative
    plan = plan_of(RULES[name])
    formulas = derive(plan, pixel, n=n, eps=threshold)
    for size in range(2 if "n >= 2" in formulas.requirements else 1, 13):
        assert_at(formulas, derive(plan, pixel, n=size, eps=threshold), {"n": size}, law=False)


@pytest.mark.parametrize("threshold", [0, Fraction(1, 2)])
@pytest.mark.parametrize("name", ["kirk-arvo", "two-stage-pooled", "discard-pilot", "kirk-arvo-unbiased"])
def test_symbols_for_the_sizes_of_the_catalogue_stand_for_any(name, threshold):
    symbols = {"kirk-arvo": {"n": n}, "two-stage-pooled": {"n": n, "m": m}}.get(name, {"p": p, "n1": n1, "n2": n2})
    for pixel in (TWO, THREE):
        formulas = derive(catalogue[name], pixel, eps=threshold, **symbols)
        for sizes in [(1, 1, 1), (1, 3, 2), (2, 1, 5), (3, 2, 1), (5, 4, 12), *((size, 2, 3) for size in range(4, 13))]:
            point = dict(zip(symbols, sizes, strict=False))
            assert_at(formulas, derive(catalogue[name], pixel, eps=threshold, **point), point, law=False)


def test_figure_2_is_unbiased_whatever_its_sizes_area_and_threshold():
    symbols = {"p": p, "n1": n1, "n2": n2, "area": a}
    assert derive(catalogue["kirk-arvo-unbiased"], Pixel.symbolic(2), eps=eps, **symbols).bias == 0
    formulas = derive(catalogue["kirk-arvo-unbiased"], THREE, eps=1, **symbols)
    for chosen in ((1, 2, 3, Fraction(1, 3)), (4, 1, 7, Fraction(6, 7))):
        point = dict(zip(symbols, chosen, strict=True))
        numbers = derive(catalogue["kirk-arvo-unbiased"], THREE, eps=1, **point)
        assert_at(formulas, numbers, point | {"a": point["area"]}, law=False)


@pytest.mark.parametrize("size", [n + 2, 3 * n, n + m, n * m, n**2, n - 1])
def test_a_sample_size_may_be_a_formula(size):
    point = {"n": 3, "m": 2}
    formulas = derive(catalogue["kirk-arvo"], THREE, n=size, eps=1)
    assert_at(formulas, derive(catalogue["kirk-arvo"], THREE, n=int(size.subs(point)), eps=1), point, law=False)


@pytest.mark.parametrize("threshold", [1 / n, n / 4, w * 2 ** (-n), (n + 1) * w])
def test_a_threshold_may_depend_on_n_and_on_a_weight(threshold):
    formulas = derive(catalogue["kirk-arvo"], Pixel({0: 1 - w, "1/2": w}), n=n, eps=threshold)
    assert len(formulas.bias.free_symbols) == 2  # one n, one w, whatever was known of them
    for size, weight in ((2, Fraction(1, 6)), (1, Fraction(1, 4)), (4, Fraction(1, 2))):
        there, point = Pixel({0: 1 - weight, "1/2": weight}), {"n": size, "w": weight}
        numbers = derive(catalogue["kirk-arvo"], there, n=size, eps=at(threshold, point))
        assert_at(formulas, numbers, point, law=False)


# -- Eq. 6 -----------------------------------------------------------------------------------------


def test_the_bias_of_figure_1_is_equation_6():
    X = Pixel.symbolic(3)
    bias = derive(catalogue["kirk-arvo"], X, n=n).bias
    size = Symbol("n", integer=True, positive=True)
    equation = sum(weight**size * (value - X.mean) for value, weight in X.law.items())
    assert simplify(expand((bias - equation).subs(X.simplex))) == 0
    assert not bias.has(Piecewise)
    assert {weight**size for weight in X.weights} <= bias.atoms(Pow)
    assert len(bias.args) == 3


# -- symbolic thresholds ---------------------------------------------------------------------------


def asked_twice_and_nested(X, S, n, eps):
    T = X.draw(1)
    if S.range() <= eps:
        if T.mean() <= eps and not S.range() < eps:
            return T.mean()
        return S.max() if S.range() <= eps / 2 else 2 * S.min()
    return X.true_mean() if S.range() > 2 * eps else S.mean()


def while_the_range_is_small(X, S, n, eps):
    while S.range() <= eps and S.size <= 3:
        S.more(1)
    return S.mean()


ASKING = RULES | {
    "variance": lambda X, S, n, eps: S.mean() if S.variance() <= eps else X.true_mean(),
    "standard error": lambda X, S, n, eps: S.mean() if S.std_error() < eps else X.true_mean(),
    "2 s + eps": lambda X, S, n, eps: S.mean() if 2 * S.std_error() + eps >= S.mean() else X.draw(1).mean(),
    "clamped": lambda X, S, n, eps: np.minimum(S.mean(), eps) + np.where(S.max() >= eps, S.mean(), eps),
    "clipped": lambda X, S, n, eps: np.clip(S.mean(), 0, eps),
    "equal": lambda X, S, n, eps: S.mean() if S.range() == eps else np.where(S.max() != eps, 1, S.min()),
    "true mean": lambda X, S, n, eps: S.mean() if X.mean >= eps and S.min() < X.mean else X.draw(1).mean() + 1,
    "asked twice": asked_twice_and_nested,
    "while": while_the_range_is_small,
}
VALUES = {"contrast": (0, Fraction(1, 3), 2)} | dict.fromkeys(("asked twice", "while", "grown", "size"), (0, 1))
TIES = [Fraction(v) for v in ("0", "1/3", "1", "4/3", "5/3", "3", "2", "-1", "1/9", "2/3", "1/2", "-1/3", "1/7", "-4")]


@pytest.mark.parametrize("name", ASKING)
def test_a_symbolic_threshold_stands_for_any_ties_and_negative_ones_too(name):
    plan, values = plan_of(ASKING[name]), VALUES.get(name, THREE.values)
    formulas = derive(plan, Pixel.symbolic(len(values), values=values), eps=eps)

    @settings(few, max_examples=5)
    @given(st.sampled_from(TIES) | st.fractions(-2, 3, max_denominator=9), shares(len(values)))
    def check(level, weights):
        pixel = Pixel(dict(zip(values, weights, strict=True)))
        assert_at(formulas, derive(plan, pixel, eps=level), weights_of(pixel) | {"eps": level})

    check()


@pytest.mark.parametrize("name", ["range <=", "range <", "max <", "standard error", "while"])
def test_threshold_values_and_weights_may_all_be_symbols(name):
    formulas = derive(plan_of(ASKING[name]), Pixel.symbolic(2), eps=eps)

    @few
    @given(pixels_of(2), st.booleans(), st.sampled_from(TIES))
    def check(pixel, tie, level):
        level = abs(pixel.values[0] - pixel.values[1]) if tie else level
        numbers = derive(plan_of(ASKING[name]), pixel, eps=level)
        assert_at(formulas, numbers, weights_of(pixel) | values_of(pixel) | {"eps": level})

    check()


# -- sequential plans, random plans, numbers only ----------------------------------------------------


@pytest.mark.parametrize(("pixel", "most"), [(TWO, 10), (THREE, 7)])
def test_sequential_plans_with_symbolic_weights(pixel, most):
    X = Pixel.symbolic(len(pixel.values), values=pixel.values)
    for start, step, threshold in ((2, 1, Fraction(1, 4)), (3, 2, Fraction(1, 2))):
        given_numbers = {"start": start, "step": step, "most": most, "eps": threshold}
        formulas, numbers = (derive(catalogue["sequential"], x, **given_numbers) for x in (X, pixel))
        assert_at(formulas, numbers, weights_of(pixel))


@settings(few, max_examples=25)
@given(strategies.plans(draws=4), pixels_of(2) | pixels_of(3))
def test_symbolic_weights_of_a_random_plan_stand_for_any(tree, pixel):
    def plan(X):
        return tree(X)

    try:
        law = brute(plan, pixel)
        formulas = derive(plan, Pixel.symbolic(len(pixel.values), values=pixel.values))
        assert_at(formulas, law, weights_of(pixel))
    except (UndefinedValue, NoClosedForm):  # 0/0 on some row, or a size that depends on the weights
        reject()


@pytest.mark.parametrize(("name", "params", "pixel"), cases(lambda name, short, pixel: pixel.geometry is None))
def test_formulas_without_symbols_are_the_exact_numbers(name, params, pixel):
    formulas, numbers = (derive(catalogue[name], pixel, arithmetic=way, **params) for way in ("symbolic", "exact"))
    assert_at(formulas, numbers, {}, law=False)
    assert isinstance(formulas.cost, Basic)
