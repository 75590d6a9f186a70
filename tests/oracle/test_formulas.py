"""Formulas, substituted at random rational points, are the exact engine's numbers, to the last digit."""

from fractions import Fraction

import pytest
import sympy
from hypothesis import HealthCheck, settings
from sympy import Rational, Symbol

from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue

RESULTS = ("expectation", "bias", "variance", "mse", "cost", "oracle_calls")
n, m, eps = Symbol("n"), Symbol("m"), Symbol("eps")
WHOLE = {s: Symbol(s.name, integer=True, positive=True) for s in (n, m)}
FIG_1, POOLED = catalogue["kirk-arvo"], catalogue["two-stage-pooled"]
once = settings(max_examples=2, suppress_health_check=list(HealthCheck))
some = settings(max_examples=15, suppress_health_check=list(HealthCheck))


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


# -- Eq. 6 ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("k", [2, 3, 5])
def test_equation_6(k):
    X = Pixel.symbolic(k)
    bias = derive(FIG_1, X, n=n).bias
    written = sum(w ** WHOLE[n] * (value - X.mean) for value, w in zip(X.values, X.weights, strict=True))
    assert sympy.expand(bias - written) == 0
    assert derive(FIG_1, X, n=n).oracle_calls == 1 - sum(w ** WHOLE[n] for w in X.weights)  # all weights are 1
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
