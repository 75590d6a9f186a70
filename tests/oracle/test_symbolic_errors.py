"""What is known of symbols: pixels that have some, what follows from assumptions, and what is refused."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from sympy import IndexedBase, Piecewise, Sum, Symbol, expand, simplify
from tests.oracle import small_plans, small_plans_staged
from tests.oracle.test_symbolic import RULES, TWO, assert_at, plan_of, weights_of

from truemean.errors import AssumptionError, InputError, InputTypeError, NoClosedForm, PlanError, TruemeanError
from truemean.oracle import Pixel, derive, simulate
from truemean.oracle.plans import catalogue

n, k, v, w, a, eps = (Symbol(name) for name in ("n", "k", "v", "w", "a", "eps"))
figure_1 = catalogue["kirk-arvo"]
PARTED, COLOUR = small_plans_staged.PARTED, small_plans_staged.COLOUR
W, V = Fraction(2, 5), Fraction(1, 7)

# -- pixels with symbols ---------------------------------------------------------------------------

MADE_OF_SYMBOLS = {
    Pixel({0: 1 - w, 1: w}): {0: 1 - W, 1: W},
    Pixel({-1: w**2, 0: 1 - w, 1: w - w**2}): {-1: W**2, 0: 1 - W, 1: W - W**2},
    Pixel({0: 1 / (1 + w), 1: 1 - 1 / (1 + w)}): {0: 1 / (1 + W), 1: W / (1 + W)},
    Pixel({w: 1 - w, 2 * w: w}): {W: 1 - W, 2 * W: W},
    Pixel({v + w: v, 0: 1 - v - w, v: w}): {V + W: V, 0: 1 - V - W, V: W},
    Pixel.symbolic(3, values=(1, 0, 2), weights=(w, "16/35", v)): {1: W, 0: "16/35", 2: V},
}


@pytest.mark.parametrize(("X", "there"), MADE_OF_SYMBOLS.items(), ids=map(repr, MADE_OF_SYMBOLS))
@pytest.mark.parametrize("name", ["figure_1", "mean_of_squares", "range_with_ties", "variance_decides"])
def test_weights_and_values_may_be_expressions_and_some_of_them_numbers(name, X, there):
    plan = small_plans.SCALAR[name]
    assert_at(derive(plan, X), derive(plan, Pixel(there)), {"w": W, "v": V})


@pytest.mark.parametrize("plan", COLOUR.values(), ids=list(COLOUR))
def test_weights_of_colours_may_be_symbols(plan):
    X = Pixel({(0, 1): 1 - w, (1, 1): w * v, ("1/3", 0): w - w * v})
    there = Pixel({(0, 1): 1 - W, (1, 1): W * V, ("1/3", 0): W - W * V})
    assert_at(derive(plan, X), derive(plan, there), {"w": W, "v": V})


@pytest.mark.parametrize("plan", PARTED.values(), ids=list(PARTED))
def test_areas_of_regions_may_be_symbols(plan):
    def parts(area, weight):
        R, rest = Pixel({0: 1 - weight, 1: weight}), Pixel({1: "1/3", 2: "2/3"})
        return Pixel.from_regions({"R": (area, R), "rest": (1 - area, rest)})

    formulas = derive(plan, parts(a, w))
    for area, weight in ((Fraction(1, 4), W), (Fraction(5, 7), Fraction(1, 2))):
        assert_at(formulas, derive(plan, parts(area, weight)), {"a": area, "w": weight})


@pytest.mark.parametrize("plan", PARTED.values(), ids=list(PARTED))
def test_a_region_may_be_a_symbolic_pixel(plan):
    def parts(R):
        return Pixel.from_regions({"R": ("1/4", R), "rest": ("3/4", Pixel({0: "1/2", 1: "1/2"}))})

    assert_at(derive(plan, parts(Pixel.symbolic(2, values=(0, 1)))), derive(plan, parts(TWO)), weights_of(TWO))


def test_the_coverage_of_a_two_intensity_pixel_may_be_a_symbol():
    assert_at(derive(figure_1, Pixel.two(w)), derive(figure_1, Pixel.two(W)), {"w": W})


def test_weights_that_sum_to_1_only_when_brought_together_are_accepted():
    X = Pixel({0: 1 / (1 + w), 1: w / (1 + w)})
    assert_at(derive(figure_1, X), derive(figure_1, Pixel({0: 1 / (1 + W), 1: W / (1 + W)})), {"w": W})


def test_a_sample_known_by_its_moments_knows_whether_its_symbolic_values_are_equal():
    def plan(X):
        S = X.draw(2)
        if S.variance() > Fraction(1, 2):
            return S.mean()
        S.more(1)
        return 1 if S.all_equal() else S.mean()

    for ordered in (True, False):
        point = weights_of(TWO) | {"I1": Fraction(0), "I2": Fraction(1)}
        assert_at(derive(plan, Pixel.symbolic(2, ordered=ordered)), derive(plan, TWO), point)


def test_what_0_0_stands_for_holds_at_symbolic_values_too_or_the_formula_says_where_it_doesn_t():
    def plan(X):
        S = X.draw(2)
        return S.mean() if S.contrast(undefined=1) <= Fraction(1, 2) else X.true_mean()

    formulas = derive(plan, Pixel.symbolic(2, ordered=True))
    point = weights_of(TWO) | {"I1": Fraction(0), "I2": Fraction(1)}
    if not formulas.requirements:
        assert_at(formulas, derive(plan, TWO), point)


# -- a symbol for k --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["range <=", "grown where equal", "all equal"])
def test_a_symbol_for_k_stands_for_3(name):
    size = 3 if name == "grown where equal" else n
    families, three = (derive(plan_of(RULES[name]), Pixel.symbolic(count), n=size) for count in (k, 3))
    assert families.bias.has(Sum)
    named = {IndexedBase(b)[i]: Symbol(f"{b}{i}") for b in ("I", "omega") for i in (1, 2, 3)}
    for result in ("bias", "variance", "cost"):
        found = getattr(families, result)
        found = found.subs({s: 3 for s in found.free_symbols if s.name == "k"}).doit().xreplace(named)
        difference = found - getattr(three, result)
        assert simplify(expand(difference.subs(Pixel.symbolic(3).simplex))) == 0, result


NEEDS_ATOMS = {
    "range at eps > 0": lambda X: X.draw(2).mean() if X.draw(2).range() <= 1 else 0,
    "min": lambda X: X.draw(2).min(),
    "variance in a decision": lambda X: 1 if X.draw(2).variance() <= 1 else 0,
    "mean in a decision": lambda X: 1 if X.draw(2).mean() <= 1 else 0,
    "clamped mean": lambda X: np.minimum(X.draw(2).mean(), 1),
    "square of the mean": lambda X: X.draw(2).mean() ** 2,
    "variance": lambda X: X.draw(3).variance(),
    "median": lambda X: np.median(X.draw(3)),
    "statistic": lambda X: X.draw(2).statistic(lambda values: 1 if values[0] == values[-1] else 0),
    "first draw": lambda X: X.draw(2)[0],
    "until": lambda X: X.draw_until(lambda S: S.range() > 0, start=2, step=1, most=4).mean(),
    "sequential": catalogue["sequential"],
    "a value": lambda X: X.draw(2).mean() * X.values[0],
    "a weight": lambda X: X.draw(2).mean() * X.weights[0],
    "the number of values": lambda X: X.draw(2).mean() / len(X.values),
    "scale": lambda X: X.draw(2).mean() / X.scale,
}


@pytest.mark.parametrize("name", NEEDS_ATOMS)
def test_what_looks_at_single_values_is_refused_where_k_is_a_symbol(name):
    with pytest.raises(NoClosedForm, match="k"):
        _ = derive(NEEDS_ATOMS[name], Pixel.symbolic(k)).bias


FLAT = {
    "all equal as a factor": lambda X: (S := X.draw(2)).mean() * S.all_equal(),
    "sizes pooled": lambda X: (
        ((S := X.draw(2)).sum() + X.draw(np.where(S.all_equal(), 1, 3)).sum()) / 4 * S.all_equal()
    ),
    "either mean": lambda X: np.where((S := X.draw(3)).all_equal(), S.mean(), X.draw(1).mean()),
}


@pytest.mark.parametrize("name", FLAT)
def test_what_only_asks_whether_draws_are_equal_is_right_where_k_is_a_symbol(name):
    named = {IndexedBase(b)[i]: Symbol(f"{b}{i}") for b in ("I", "omega") for i in (1, 2, 3)}
    families, three = (derive(FLAT[name], Pixel.symbolic(count)) for count in (k, 3))
    assert families.bias.has(Sum)
    for result in ("bias", "variance", "cost"):
        found = getattr(families, result)
        found = found.subs({s: 3 for s in found.free_symbols if s.name == "k"}).doit().xreplace(named)
        assert expand((found - getattr(three, result)).subs(Pixel.symbolic(3).simplex)) == 0, result


# -- assumptions -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("known", "asked"),
    [("zero", 0), ("negative", 0), ("nonnegative", 1), ("positive", 1), ("nonpositive", 1), ("real", 2)],
)
def test_what_is_known_of_a_threshold_prunes_the_cases(known, asked):
    formula = derive(figure_1, TWO, n=3, eps=Symbol("eps", **{known: True})).bias
    assert len(formula.atoms(Piecewise)) == asked  # below 0 nothing is kept, at 1 everything


def test_a_zero_threshold_of_unordered_values_is_figure_1_without_any_case():
    formula = derive(figure_1, Pixel.symbolic(7), n=n, eps=Symbol("eps", zero=True)).bias
    assert formula == derive(figure_1, Pixel.symbolic(7), n=n).bias
    assert not formula.has(Piecewise)


def test_the_order_of_values_decides_what_depends_on_it_alone():
    def top(X):
        S = X.draw(2)
        return S.mean() if S.max() > X.values[0] else X.true_mean()

    assert not derive(top, Pixel.symbolic(3, ordered=True)).bias.has(Piecewise)
    with_one = Pixel.symbolic(3, values=(Symbol("low", negative=True), 0, Symbol("high", positive=True)))
    assert not derive(lambda X: np.maximum(X.draw(2).max(), 0), with_one).bias.has(Piecewise)


# -- errors ----------------------------------------------------------------------------------------


def counts_to_n(X, n=2):
    S = X.draw(1)
    for _ in range(n):
        S.more(1)
    return S.mean()


def asks_n(X, n=2):
    return X.draw(n).mean() if n > 3 else X.true_mean()


def until_n(X, n=4):
    return X.draw_until(lambda S: S.range() > 0, start=1, step=1, most=n).mean()


def roots_of_sums(X, n=3, eps=0):
    S, T = X.draw(n), X.draw(2)
    return S.mean() if S.std_error() + T.std_error() <= eps else T.mean()


def symbol(name, **known):
    return Symbol(name, **known)


def of_weights(x, y):
    return derive(figure_1, Pixel.symbolic(2, values=(0, 1), weights=(x, y)), n=2).bias


REFUSED = {
    "n negative": (
        AssumptionError,
        r"symbol n .*positive=True",
        lambda: derive(figure_1, TWO, n=symbol("n", negative=True)),
    ),
    "n no integer": (
        AssumptionError,
        r"symbol n .*integer=True",
        lambda: derive(figure_1, TWO, n=symbol("n", integer=False)),
    ),
    "n zero": (TruemeanError, "n", lambda: derive(figure_1, TWO, n=symbol("n", zero=True))),
    "n halved": (NoClosedForm, r"n/2 is no integer combination", lambda: derive(figure_1, TWO, n=n / 2)),
    "n below 1": (InputError, r"n=-n is less than 1", lambda: derive(figure_1, TWO, n=-n)),
    "weights beyond 1": (AssumptionError, r"sum to 2\*w", lambda: Pixel({0: w, 1: w})),
    "weights leave nothing": (
        AssumptionError,
        "leave -1/4 for w",
        lambda: Pixel.symbolic(3, weights=("1/2", "3/4", w)),
    ),
    "weights leave 0": (AssumptionError, "leave 0 for w", lambda: Pixel.symbolic(3, weights=("1/2", "1/2", w))),
    "weight negative": (AssumptionError, r"w .*positive=True", lambda: of_weights(symbol("w", negative=True), v)),
    "weight zero": (TruemeanError, "w", lambda: of_weights(symbol("w", zero=True), v)),
    "weight above 1": (
        AssumptionError,
        "w",
        lambda: Pixel({0: 1 + symbol("w", positive=True), 1: -symbol("w", positive=True)}),
    ),
    "weight imaginary": (AssumptionError, "w", lambda: of_weights(symbol("w", imaginary=True), v)),
    "area negative": (
        AssumptionError,
        r"area=a .*positive=True",
        lambda: derive(catalogue["kirk-arvo-unbiased"], TWO, area=symbol("a", negative=True)),
    ),
    "areas beyond 1": (InputError, r"sum to 2\*a", lambda: Pixel.from_regions({"R": (a, TWO), "rest": (a, TWO)})),
    "eps imaginary": (
        AssumptionError,
        r"symbol eps .*real=True",
        lambda: derive(figure_1, TWO, eps=symbol("eps", imaginary=True)).bias,
    ),
    "value imaginary": (
        AssumptionError,
        r"v .*real=True",
        lambda: Pixel.symbolic(2, values=(0, symbol("v", imaginary=True))),
    ),
    "values equal": (InputError, "not distinct", lambda: Pixel.symbolic(2, values=(v, v))),
    "order contradicted": (
        AssumptionError,
        "a.*b|b.*a",
        lambda: (
            derive(
                figure_1,
                Pixel.symbolic(2, values=(symbol("a", positive=True), symbol("b", negative=True)), ordered=True),
                eps=1,
            ).bias
        ),
    ),
    "seven in no order": (
        AssumptionError,
        r"I7 is not known.*ordered=True",
        lambda: derive(figure_1, Pixel.symbolic(7), eps=1).bias,
    ),
    "k negative": (AssumptionError, "k=k", lambda: Pixel.symbolic(symbol("k", negative=True))),
    "k with values": (AssumptionError, "k=k", lambda: Pixel.symbolic(k, values=(0, 1))),
    "variance at n": (
        NoClosedForm,
        r"variance\(S1\) <= 1.*make n concrete",
        lambda: derive(plan_of(lambda X, S, n, eps: 1 if S.variance() <= 1 else 0), TWO, n=n).bias,
    ),
    "mean at n": (
        NoClosedForm,
        r"mean\(S1\) <= 1.*make n concrete",
        lambda: derive(plan_of(lambda X, S, n, eps: 1 if S.mean() <= 1 else 0), TWO, n=n).bias,
    ),
    "loop over n": (PlanError, r"n=n.*X\.draw\(n\)", lambda: derive(counts_to_n, TWO, n=n)),
    "question to n": (PlanError, r"n=n.*make it concrete", lambda: derive(asks_n, TWO, n=n)),
    "most=n": (TruemeanError, "most=n", lambda: derive(until_n, TWO, n=n)),
    "stop by eps": (
        NoClosedForm,
        "<= eps, which a symbol decides",
        lambda: derive(catalogue["sequential"], TWO, most=6, eps=eps).bias,
    ),
    "two roots": (NoClosedForm, "roots", lambda: derive(roots_of_sums, TWO, eps=eps).bias),
    "rounded": (
        NoClosedForm,
        "eps.*make its symbols numbers",
        lambda: derive(plan_of(lambda X, S, n, eps: np.floor(S.mean() * eps)), TWO, eps=eps).bias,
    ),
    "law at n": (NoClosedForm, "make n concrete", lambda: derive(figure_1, TWO, n=n).distribution()),
    "sampled rows": (InputError, "n .*symbol", lambda: derive(figure_1, TWO, n=n, rows="sampled")),
    "float64": (
        InputError,
        "omega1, omega2 are symbols",
        lambda: derive(figure_1, Pixel.symbolic(2, values=(0, 1)), arithmetic="float64"),
    ),
    "exact": (InputError, "eps .*arithmetic='symbolic'", lambda: derive(figure_1, TWO, eps=eps, arithmetic="exact")),
    "ball": (InputError, "eps .*symbol", lambda: derive(figure_1, TWO, eps=eps, arithmetic="ball")),
    "simulated": (
        TruemeanError,
        "omega1|symbol",
        lambda: simulate(figure_1, Pixel.symbolic(2, values=(0, 1)), runs=5, seed=1),
    ),
    "arrays": (InputError, "omega1", lambda: Pixel.symbolic(2).arrays()),
    "colour with a symbol": (InputTypeError, "value=w", lambda: Pixel({(0, w): "1/2", (1, 0): "1/2"})),
    "two of one name": (
        AssumptionError,
        "two symbols are called e",
        lambda: derive(figure_1, TWO, eps=eps_of_two_kinds()).bias,
    ),
    "a weight and eps of one name": (
        AssumptionError,
        "w",
        lambda: derive(figure_1, Pixel({0: 1 - w, 1: w}), eps=symbol("w", negative=True)).bias,
    ),
    "proposal": (
        TruemeanError,
        "p",
        lambda: derive(lambda X, p: X.from_({0: p, 1: 1 - p}).draw(2).mean(), TWO, p=Symbol("p")).bias,
    ),
    "coin": (
        TruemeanError,
        r"coin\(p\)|p=p",
        lambda: derive(lambda X, p: X.draw(1).mean() if X.coin(p) else 0, TWO, p=Symbol("p")).bias,
    ),
}


def eps_of_two_kinds():
    return symbol("e", positive=True) - symbol("e")


@pytest.mark.parametrize("name", REFUSED)
def test_what_can_t_be_is_refused_with_the_symbol_and_the_way_out(name):
    error, message, made = REFUSED[name]
    with pytest.raises(error, match=message):
        made()


def test_a_size_chosen_by_a_comparison_of_symbols_is_refused_by_name():
    def plan(X):
        return X.draw(np.where(X.mean <= Fraction(1, 2), 1, 2)).mean()

    with pytest.raises(NoClosedForm, match="sample size"):
        _ = derive(plan, Pixel.symbolic(2, values=(0, 1))).bias
