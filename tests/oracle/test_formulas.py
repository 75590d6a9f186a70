"""Formulas, substituted at random rational points, are the exact engine's numbers, to the last digit."""

from fractions import Fraction

import pytest
import sympy
from hypothesis import HealthCheck, given, reject, settings
from hypothesis import strategies as st
from sympy import Rational, Symbol
from tests.oracle import small_plans, small_plans_staged, strategies
from tests.oracle.catalogue_cases import cases

from truemean.errors import NoClosedForm
from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue

RESULTS = ("expectation", "bias", "variance", "mse", "cost", "oracle_calls")
n, m, eps = Symbol("n"), Symbol("m"), Symbol("eps")
WHOLE = {s: Symbol(s.name, integer=True, positive=True) for s in (n, m)}
FIG_1, POOLED = catalogue["kirk-arvo"], catalogue["two-stage-pooled"]
once = settings(max_examples=2, suppress_health_check=list(HealthCheck))
some = settings(max_examples=15, suppress_health_check=list(HealthCheck))

SMALL = {
    name: (plan, pixels)
    for group, pixels in (
        (small_plans.SCALAR, strategies.pixels()),
        (small_plans.NONNEGATIVE, strategies.pixels(nonnegative=True)),
        (small_plans_staged.SCALAR, strategies.pixels()),
    )
    for name, plan in group.items()
}
# What has no formula in symbolic values, and why; "ascending order" only where the order is open too.
NO_VALUES = {
    "coin_by_the_pilot": "the sign of",
    "grown_by_its_own_mean_and_never_looked_at_again": "write the comparison as an if",
    "pilot_sizes_and_is_pooled": "write the comparison as an if",
    "quantised": "can't be rounded",
    "second_stage_of_random_size_decides": "can't be rounded",
    "two_standard_errors": "under several roots",
    "until_extremes_then_grown_and_looked_at": "X.draw_until stops by",
    "until_halves_agree": "X.draw_until stops by",
    "until_standard_error": "X.draw_until stops by",
}
NO_ORDER = {"custom_statistic", "numpy_reductions"}


def rational(number):
    return Rational(number.numerator, number.denominator)


def put(formula, numbers):
    """A formula at a point, a Fraction."""
    value = sympy.sympify(formula).xreplace(numbers).doit()
    assert value.is_Rational, value
    return Fraction(int(value.p), int(value.q))


def assert_is(derivation, exact, numbers, law=True):
    """Every result, path and the law of a formula, at a point, are those of the exact derivation."""
    for name in RESULTS:
        assert put(getattr(derivation, name), numbers) == getattr(exact, name), name
    assert sum(put(path.probability, numbers) for path in derivation.paths) == 1
    assert sum(put(path.bias, numbers) for path in derivation.paths) == exact.bias
    if law:
        found = {}
        for value, probability in derivation.distribution().items():
            key = put(value, numbers)
            found[key] = found.get(key, Fraction(0)) + put(probability, numbers)
        assert {v: p for v, p in found.items() if p} == exact.distribution()


def point(X, Y):
    """The numbers of pixel X for the symbols of Y, a pixel of as many values."""
    pairs = [*zip(Y.values, X.values, strict=True), *zip(Y.weights, X.weights, strict=True)]
    return {symbol: rational(number) for symbol, number in pairs if isinstance(symbol, Symbol)}


def ascending(X):
    """The pixel with positive weights only, values ascending."""
    return Pixel({v: X.law[v] for v in sorted(X.values) if X.law[v]})


# -- symbolic weights and values ------------------------------------------------------------------------


@pytest.mark.parametrize("name", SMALL)
def test_every_small_plan_with_open_weights(name):
    plan, pixels = SMALL[name]

    @once
    @given(pixels)
    def check(pixel):
        X = ascending(pixel)
        Y = Pixel.symbolic(len(X.values), values=X.values)
        assert_is(derive(plan, Y), derive(plan, X), point(X, Y), law=not name.startswith("sub_estimate"))

    check()


@pytest.mark.parametrize("ordered", [True, False], ids=["ordered", "unordered"])
@pytest.mark.parametrize("name", SMALL)
def test_every_small_plan_with_open_values(name, ordered):
    plan, _ = SMALL[name]
    X = Pixel({"1/3": "2/7", "3/2": "5/7"})
    Y = Pixel.symbolic(2, ordered=ordered)
    reason = NO_VALUES.get(name) or ("ascending order" if name in NO_ORDER and not ordered else None)
    if reason is None:
        assert_is(derive(plan, Y), derive(plan, X), point(X, Y), law=False)
        return
    with pytest.raises(NoClosedForm, match=reason):
        _ = derive(plan, Y).variance


@some
@given(strategies.plans(), strategies.pixels())
def test_a_random_plan_with_open_weights(tree, pixel):
    X = ascending(pixel)
    Y = Pixel.symbolic(len(X.values), values=X.values)
    try:
        assert_is(derive(tree, Y), derive(tree, X), point(X, Y))
    except NoClosedForm:  # it reads the true mean where a number is needed
        reject()


@pytest.mark.parametrize(
    ("name", "params", "pixel"), cases(lambda name, short, X: name != "hierarchical" and len(X.values) < 8)
)
def test_numbers_in_symbolic_arithmetic_are_the_numbers(name, params, pixel):
    exact, formula = (derive(catalogue[name], pixel, arithmetic=a, **params) for a in ("exact", "symbolic"))
    for result in RESULTS:
        a, b = getattr(formula, result), getattr(exact, result)
        assert (a if isinstance(a, tuple) else (a,)) == tuple(map(rational, b if isinstance(b, tuple) else (b,)))


def by_the_mean(X, n=2):
    """Decides by what is no draw: the weights."""
    S = X.draw(n)
    if X.mean * 3 > 1:
        return S.mean()
    return S.max() if X.mean * 3 > 1 or X.mean >= 0 else S.min()


def test_a_decision_that_only_weights_decide():
    Y = Pixel.symbolic(2, values=(0, 1))
    formula = derive(by_the_mean, Y)
    for weight in ("1/4", "1/3", "1/2"):
        assert_is(formula, derive(by_the_mean, Pixel.two(weight)), point(Pixel.two(weight), Y))
    assert len(formula.paths) == 2  # X.mean >= 0 is known, and nothing is asked twice


# -- symbolic n -----------------------------------------------------------------------------------------


def lowest(X, n=4, t=1):
    S = X.draw(n)
    return S.mean() if S.min() >= t else X.true_mean()


def highest_grown(X, n=4, t=1):
    S = X.draw(n)
    if S.max() < t:
        S.more(n)
    return S.mean()


def contrasted(X, n=4, eps="1/2"):
    S = X.draw(n)
    return S.mean() if S.contrast() <= eps else X.draw(n).mean()


def two_pilots(X, n=2):
    A, B = X.draw(n), X.draw(n)
    return A.mean() if A.range() <= 1 and B.max() <= 1 else B.mean()


THREE = Pixel({1: "1/2", 2: "1/3", 4: "1/6"})
FOUR = Pixel({0: "1/10", 1: "2/10", 3: "3/10", 4: "4/10"})
GROWING = [
    (FIG_1, THREE, {}),
    (FIG_1, FOUR, {"eps": 1}),
    (FIG_1, FOUR, {"eps": 3}),
    (POOLED, THREE, {"m": 5}),
    (lowest, FOUR, {}),
    (highest_grown, THREE, {"t": 4}),
    (contrasted, THREE, {}),
    (two_pilots, THREE, {}),
    (lambda X, n: X.draw(n).mean() if X.draw(n).all_equal() else X.true_mean(), THREE, {}),
]


@pytest.mark.parametrize(("plan", "pixel", "params"), GROWING, ids=range(len(GROWING)))
def test_symbolic_n_is_every_n(plan, pixel, params):
    formula = derive(plan, pixel, n=n, **params)
    for size in range(1, 13):
        assert_is(formula, derive(plan, pixel, n=size, **params), {WHOLE[n]: sympy.Integer(size)}, law=False)


def test_several_sizes_and_an_area_at_once():
    names = {"p": Symbol("p"), "n1": Symbol("n1"), "n2": Symbol("n2"), "area": Symbol("a")}
    formula = derive(catalogue["kirk-arvo-unbiased"], THREE, **names)
    for numbers in ({"p": 2, "n1": 1, "n2": 3, "area": "1/3"}, {"p": 5, "n1": 7, "n2": 2, "area": "3/4"}):
        at = {Symbol(k, integer=True, positive=True): sympy.Integer(v) for k, v in numbers.items() if k != "area"}
        at[names["area"]] = Rational(numbers["area"])
        assert_is(formula, derive(catalogue["kirk-arvo-unbiased"], THREE, **numbers), at, law=False)


@settings(max_examples=8)
@given(st.integers(1, 9), st.integers(1, 9))
def test_a_second_stage_of_another_symbol(size, more):
    numbers = {WHOLE[n]: sympy.Integer(size), WHOLE[m]: sympy.Integer(more)}
    assert_is(derive(POOLED, THREE, n=n, m=m), derive(POOLED, THREE, n=size, m=more), numbers, law=False)


# -- Eq. 6 ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("k", [2, 3, 5])
def test_equation_6(k):
    X = Pixel.symbolic(k)
    bias = derive(FIG_1, X, n=n).bias
    written = sum(w ** WHOLE[n] * (value - X.mean) for value, w in zip(X.values, X.weights, strict=True))
    assert sympy.expand(bias - written) == 0
    assert all(bias.coeff(w ** WHOLE[n]) == value - X.mean for value, w in zip(X.values, X.weights, strict=True))


def test_equation_6_for_any_number_of_values():
    k = Symbol("k")
    X = Pixel.symbolic(k)
    bias = derive(FIG_1, X, n=n).bias
    assert isinstance(bias, sympy.Sum)
    three = Pixel.symbolic(3)
    value, weight = sympy.IndexedBase("I"), sympy.IndexedBase("omega")
    named = {value[i + 1]: v for i, v in enumerate(three.values)} | {
        weight[i + 1]: w for i, w in enumerate(three.weights)
    }
    expected = derive(FIG_1, three, n=n)
    for name in RESULTS:
        opened = getattr(derive(FIG_1, X, n=n), name).subs(k, 3).doit().xreplace(named)
        difference = (opened - getattr(expected, name)).subs(three.simplex)
        assert sympy.simplify(sympy.expand(difference.subs(WHOLE[n], 3))) == 0, name


# -- symbolic thresholds --------------------------------------------------------------------------------


def by_variance(X, n=3, eps=1):
    S = X.draw(n)
    return S.mean() if S.variance() < eps else X.true_mean()


def by_error(X, n=3, eps=1):
    S = X.draw(n)
    return S.mean() if S.std_error() <= eps else X.true_mean()


def clamped(X, n=2, eps=1):
    return sympy_free_minimum(X.draw(n).mean(), eps)


def sympy_free_minimum(a, b):
    import numpy as np

    return np.minimum(a, b) + np.where(a > b, b, 0)


def strictly(X, n=3, eps=1):
    S = X.draw(n)
    return S.mean() if S.range() < eps else S.min()


THRESHOLDS = ["-1", "0", "1/3", "1/2", "1", "4/3", "2", "9/4", "3", "7"]


@pytest.mark.parametrize("plan", [FIG_1, by_variance, by_error, clamped, strictly])
@pytest.mark.parametrize("size", [2, 3])
def test_a_symbolic_threshold_is_every_threshold_ties_too(plan, size):
    X = Pixel({0: "1/2", 1: "1/3", 3: "1/6"})
    formula = derive(plan, X, n=size, eps=eps)
    for threshold in THRESHOLDS:
        exact = derive(plan, X, n=size, eps=threshold)
        assert_is(formula, exact, {eps: Rational(threshold)}, law=False)


def test_values_threshold_and_size_all_open():
    Y = Pixel.symbolic(3, ordered=True)
    formula = derive(FIG_1, Y, n=n, eps=eps)
    X = Pixel({0: "1/2", 1: "1/3", 3: "1/6"})
    for threshold in THRESHOLDS:
        at = {**point(X, Y), eps: Rational(threshold), WHOLE[n]: sympy.Integer(3)}
        assert put(formula.bias, at) == derive(FIG_1, X, n=3, eps=threshold).bias


@pytest.mark.parametrize(
    ("assumption", "conditions"), [({}, 4), ({"nonnegative": True}, 3), ({"positive": True}, 3), ({"zero": True}, 0)]
)
def test_assumptions_prune(assumption, conditions):
    bias = derive(FIG_1, Pixel({0: "1/2", 1: "1/4", 3: "1/4"}), n=n, eps=Symbol("eps", **assumption)).bias
    assert len(bias.atoms(sympy.Piecewise)) == conditions


# -- parts of a pixel -----------------------------------------------------------------------------------


def stratified(X, n=2):
    return sum(part.area * part.draw(n).mean() for part in X.regions.values())


def test_areas_and_weights_that_are_formulas():
    a, w = Symbol("a"), Symbol("w")
    X = Pixel.from_regions({"R": (a, Pixel({0: 1 - w, 1: w})), "rest": (1 - a, Pixel.two("1/2"))})
    assert derive(stratified, X).bias == 0
    exact = derive(POOLED, Pixel({0: "13/24", 1: "11/24"}))
    assert_is(derive(POOLED, X), exact, {a: Rational(1, 3), w: Rational(3, 8)}, law=False)


def test_some_weights_open():
    X = Pixel.symbolic(3, values=(0, 1, 2), weights=("1/2", Symbol("u"), Symbol("v")))
    at = {Symbol("u"): Rational(1, 3), Symbol("v"): Rational(1, 6)}
    assert_is(derive(by_variance, X), derive(by_variance, Pixel({0: "1/2", 1: "1/3", 2: "1/6"})), at)


def test_a_law_over_independent_samples_and_coins_sums_to_one():
    def plan(X):
        S, T = X.draw(2), X.draw(2)
        if S.all_equal() and X.coin(T.range()):
            return S.mean()
        return T.sum() * 0

    Y = Pixel.symbolic(1, values=("9/4",))
    assert derive(plan, Y).distribution() == {sympy.Integer(0): 1}
