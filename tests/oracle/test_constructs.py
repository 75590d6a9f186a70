"""Which Python constructs a plan may use, and what the others raise (review, section 11)."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from tests.oracle.brute_force import brute

from truemean.errors import InputError, NotDeterministic, PlanError, UndefinedValue
from truemean.oracle import Pixel, derive, plan, simulate

X3 = Pixel({0: "1/2", 1: "1/3", 3: "1/6"})
RGB = Pixel({(0, 1): "1/2", (1, 0): "1/3", (1, 1): "1/6"})

WORKS: dict[str, Callable[[Any, Any], Any]] = {
    "and": lambda X, S: S.max() if S.min() > 0 and S.max() > 1 else S.min(),
    "or": lambda X, S: S.max() if S.min() > 0 or S.max() > 1 else S.min(),
    "not": lambda X, S: S.max() if not S.min() > 0 else S.min(),
    "chained comparison": lambda X, S: 1 if 0 < S.mean() <= 1 else 0,
    "membership": lambda X, S: S.mean() if S.max() in (0, 3) else 5,
    "max of two": lambda X, S: max(S.mean(), S.max() / 2, 1),
    "min of two": lambda X, S: min(S.mean(), S.max() / 2),
    "sorted": lambda X, S: sorted([S.mean(), S.max() / 2, Fraction(1, 2)])[1],
    "np.max of a list": lambda X, S: np.max([S.mean(), S.max() / 2]),
    "np.maximum.reduce": lambda X, S: np.maximum.reduce([S.mean(), S.max() / 2, S.min() + 1]),
    "and as an operator": lambda X, S: np.where((S.min() > 0) & (S.max() > 1), 1, S.mean()),
    "or as an operator": lambda X, S: np.where((S.min() > 0) | (S.max() > 1), 1, S.mean()),
    "not as an operator": lambda X, S: np.where(~(S.min() > 0), 1, S.mean()),
    "logical_and": lambda X, S: np.where(np.logical_and(S.min() > 0, S.max() > 1), 1, S.mean()),
    "minimum and maximum": lambda X, S: np.minimum(np.maximum(S.mean(), 1), S.max()),
    "clip": lambda X, S: np.clip(S.mean(), 0.5, 1),
    "where": lambda X, S: np.where(S.mean() > 1, S.mean(), S.max()),
    "root in a decision": lambda X, S: 1 if np.sqrt(S.mean()) <= S.mean() else 0,
    "abs": lambda X, S: abs(S.mean() - 1) + np.abs(S.min() - 1),
    "integer power": lambda X, S: S.mean() ** 2 + S.mean() ** 0,
    "power one half": lambda X, S: 1 if S.mean() ** 0.5 < 1 else 0,
    "square": lambda X, S: np.square(S.mean()),
    "round half to even": lambda X, S: round(S.mean()) + np.round(S.mean() * 5) + np.rint(S.mean()),
    "round to digits": lambda X, S: round(S.mean() / 8, 2) + np.round(S.mean() / 8, 1),
    "floor and ceil": lambda X, S: math.floor(S.mean()) + np.ceil(S.mean()) * 2 + np.floor(-S.mean()),
    "NumPy scalar times quantity": lambda X, S: np.float64(0.5) * S.mean() + np.int64(2) * S.max(),
    "array times quantity": lambda X, S: (np.array([0.5, 2.0]) * S.mean())[1] + (S.mean() * np.array([1, 3]))[0],
    "sum of a list": lambda X, S: sum([S.mean(), S.max()]),
    "np.mean of a list": lambda X, S: np.mean([S.mean(), S.max()]),
    "np.mean of a sample": lambda X, S: np.mean(S),
    "np.var": lambda X, S: np.var(S) + np.var(S, ddof=1),
    "np.std": lambda X, S: S.mean() if np.std(S) < 1 else np.where(np.std(S, ddof=1) < 2, 1, 2),
    "np.min and np.max": lambda X, S: np.min(S) + np.max(S),
    "np.ptp": lambda X, S: np.ptp(S),
    "np.median": lambda X, S: np.median(S),
    "decision times quantity": lambda X, S: (S.mean() > 1) * S.max() + (S.min() > 0),
    "int of a quantity": lambda X, S: X.draw(1 + int(S.max())).mean() * int(S.max()),
    "range of a quantity": lambda X, S: sum([S.mean() for _ in range(S.max())]) + S.min(),
    "quantity as an index": lambda X, S: (5, 7, 9, 11)[S.max()],
    "a sample's items": lambda X, S: S[0] - S[1] * 2,
    "a loop over a sample": lambda X, S: sum(i * x for i, x in enumerate(S)),
    "max of a sample": lambda X, S: max(S),
    "recursion of plain functions": lambda X, S: _redraw(X, S, 2),
    "a number": lambda X, S: 2,
    "a NumPy number": lambda X, S: np.float64(0.25),
    "assert": lambda X, S: _asserted(S),
}


def _redraw(X, S, times):
    return S.mean() if times == 0 or S.range() <= 0 else _redraw(X, X.draw(1), times - 1)


def _asserted(S):
    assert S.max() >= S.min()
    return S.mean()


@pytest.mark.parametrize("name", WORKS)
def test_construct_works_and_equals_its_twin(name):
    def function(X):
        return WORKS[name](X, X.draw(2))

    derivation, law = derive(function, X3), brute(function, X3)
    assert derivation.distribution() == law.distribution
    assert (derivation.bias, derivation.variance, derivation.cost) == (law.bias, law.variance, law.cost)


REFUSED: dict[str, tuple[Callable[[Any, Any], Any], type[Exception], str]] = {
    "truth of a quantity": (lambda X, S: 1 if S.mean() else 0, PlanError, "compare it"),
    "float of a quantity": (lambda X, S: float(S.mean()), PlanError, "np.sqrt"),
    "math.sqrt of a quantity": (lambda X, S: math.sqrt(S.mean()), PlanError, "np.sqrt"),
    "format of a quantity": (lambda X, S: len(f"{S.mean():.3f}"), PlanError, "many values"),
    "quantity as a key": (lambda X, S: {S.mean(): 1}, TypeError, "unhashable"),
    "set of quantities": (lambda X, S: {S.mean()}, TypeError, "unhashable"),
    "int of a fraction": (lambda X, S: int(S.mean()), PlanError, "floor"),
    "nothing returned": (lambda X, S: None, PlanError, "return a number or a quantity"),
    "bool returned": (lambda X, S: True, PlanError, "return a number or a quantity"),
    "decision returned": (lambda X, S: S.mean() > 1, PlanError, "return a number or a quantity"),
    "str returned": (lambda X, S: "0.5", PlanError, "return a number or a quantity"),
    "generator returned": (lambda X, S: (x for x in (1, 2)), PlanError, "return a number or a quantity"),
    "tuple returned for a scalar pixel": (
        lambda X, S: (S.mean(), S.mean()),
        PlanError,
        "return a number or a quantity",
    ),
    "sample returned": (lambda X, S: S, PlanError, "return a number or a quantity"),
    "NaN returned": (lambda X, S: math.nan, InputError, "nan"),
    "unguarded division by 0": (lambda X, S: 1 / S.max(), UndefinedValue, "0/0"),
    "size that is no integer": (lambda X, S: X.draw(S.mean()).mean(), PlanError, "integer"),
    "negative size": (lambda X, S: X.draw(S.max() - 1).mean(), InputError, "-1"),
    "no draws at all": (lambda X, S: X.draw(0).mean(), InputError, "n=0"),
    "unknown statistic": (lambda X, S: S.skewness(), AttributeError, "skewness"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_construct_is_refused_with_the_way_out(name):
    body, error, words = REFUSED[name]

    def function(X):
        return body(X, X.draw(2))

    with pytest.raises(error, match=words):
        derive(function, X3).distribution()


def test_coroutines_are_refused():
    made = []

    async def waiting(X):
        return X.draw(2).mean()

    def plan_of_another_kind(X):
        made.append(waiting(X))
        return made[-1]

    with pytest.raises(PlanError, match="return a number or a quantity"):
        _ = derive(plan_of_another_kind, X3).bias
    for coroutine in made:
        coroutine.close()


def test_a_decision_by_channel_names_all_and_any():
    def ambiguous(X):
        S = X.draw(2)
        return S.mean() if S.range() <= 0 else X.true_mean()

    with pytest.raises(PlanError, match=r"\.all\(\).*\.any\(\)"):
        _ = derive(ambiguous, RGB).bias


def test_a_colour_may_be_returned_as_a_tuple_of_its_channels():
    def channels(X):
        S = X.draw(2)
        red, green = S.mean()
        return green * 2, np.minimum(red, S.max()[1])

    derivation, law = derive(channels, RGB), brute(channels, RGB)
    assert (derivation.bias, derivation.distribution()) == (law.bias, law.distribution)


def test_a_closure_that_counts_is_not_deterministic():
    calls = []

    def counting(X):
        calls.append(1)
        S = X.draw(2)
        return S.mean() * len(calls) if S.range() <= 0 else X.true_mean()

    with pytest.raises(NotDeterministic, match="coin"):
        _ = derive(counting, X3).bias


def test_constants_of_equal_hash_do_not_hide_a_plan_that_changes():
    constants = iter([-1, *[-2] * 1000])
    assert hash(-1) == hash(-2)

    def drifting(X):
        return X.draw(2).mean() + next(constants)

    with pytest.raises(NotDeterministic, match="coin"):
        _ = derive(drifting, X3).bias


@pytest.mark.parametrize("roll", [random.random, np.random.random], ids=["random", "numpy"])
def test_random_numbers_of_other_makers_are_not_deterministic(roll):
    def noisy(X):
        S = X.draw(2)
        return S.mean() if S.mean() <= roll() else S.max()

    with pytest.raises(NotDeterministic, match="coin"):
        _ = derive(noisy, X3).bias


def test_an_exception_of_the_plan_keeps_its_type_and_tells_where():
    def fails(X):
        S = X.draw(2)
        if S.max() > 1:
            raise KeyError("no such colour")
        return S.mean()

    with pytest.raises(KeyError) as caught:
        _ = derive(fails, X3).bias
    notes = " ".join(getattr(caught.value, "__notes__", ()))
    assert "max(S1) > 1" in notes
    assert "11/36" in notes


def test_an_assertion_that_fails_on_some_rows_is_an_error_of_the_plan():
    def asserts(X):
        S = X.draw(2)
        assert S.max() <= 1, "too bright"
        return S.mean()

    with pytest.raises(AssertionError, match="too bright"):
        _ = derive(asserts, X3).bias


def test_a_loop_without_end_is_stopped_and_tells_what_is_still_alive():
    def endless(X):
        S = X.draw(1)
        while S.max() < 3:
            S.more(1)
        return S.mean()

    with pytest.raises(PlanError, match="probability"):
        _ = derive(endless, X3).bias


def test_a_recursion_without_base_case_has_its_own_error():
    def bottomless(X):
        return X.estimate(bottomless) + X.draw(1).mean()

    with pytest.raises(PlanError, match=r"recursion|base case"):
        _ = derive(bottomless, X3).bias


def test_printing_is_allowed(capsys):
    def prints(X):
        S = X.draw(2)
        print(S.mean())  # noqa: T201
        return S.mean()

    assert derive(prints, X3).bias == 0
    assert "mean" in capsys.readouterr().out


def test_the_text_of_a_quantity_is_its_formula():
    texts = []

    def shows(X):
        S = X.draw(2)
        texts.append(f"{S.mean() / 2}")
        return S.mean()

    _ = derive(shows, X3).bias
    assert "mean" in texts[0]
    assert "2" in texts[0]


def test_a_plan_called_outside_a_derivation_says_so():
    @plan
    def decorated(X):
        return X.draw(2).mean()

    with pytest.raises(PlanError, match="derive"):
        decorated(X3)


@pytest.mark.parametrize(
    "reserved", ["arithmetic", "digits", "rtol", "rows", "runs", "seed", "k", "values", "objective"]
)
def test_a_plan_with_a_reserved_parameter_is_refused(reserved):
    scope: dict[str, Any] = {}
    exec(f"def function(X, {reserved}=1):\n    return X.draw(2).mean()", scope)
    with pytest.raises(PlanError, match=reserved):
        plan(scope["function"])


def test_an_unknown_parameter_is_refused_with_the_nearest_names():
    def sized(X, size=2):
        return X.draw(size).mean()

    with pytest.raises(InputError, match="size"):
        derive(sized, X3, sise=3)


def test_a_decision_outside_any_derivation_says_so():
    kept = []

    def leaks(X):
        S = X.draw(2)
        kept.append(S.mean() > 1)
        return S.mean()

    _ = derive(leaks, X3).bias
    with pytest.raises(PlanError, match="derive"):
        bool(kept[0])


@pytest.mark.parametrize(
    "use",
    [lambda old, S: old + S.mean(), lambda old, S: 1 if old > S.mean() else 0],
    ids=["in the estimate", "in a decision"],
)
def test_a_quantity_of_an_earlier_derivation_is_refused(use):
    kept = []

    def keeps(X):
        S = X.draw(2)
        kept.append(S.mean())
        return S.max()

    _ = derive(keeps, X3).bias
    with pytest.raises(PlanError, match="earlier run"):
        _ = derive(lambda X: use(kept[0], X.draw(2)), X3).bias


def test_thresholds_in_binary_are_taken_at_their_exact_value():
    def tie(X, eps):
        S = X.draw(2)
        return S.mean() if S.range() <= eps else X.true_mean()

    pixel = Pixel({0: "1/2", "0.1": "1/2"})
    assert len(derive(tie, pixel, eps=Fraction(1, 10)).paths) == 1
    assert len(derive(tie, pixel, eps=np.nextafter(0.1, 0)).paths) == 2
    assert Fraction(0.1) > Fraction(1, 10)
    assert len(derive(tie, pixel, eps=0.1).paths) == 1


def test_simulation_runs_the_same_constructs():
    def function(X):
        S = X.draw(2)
        return np.clip(S.mean(), 0, 1) if S.mean() > 0 and X.coin("1/3") else S.max() * 2

    runs = 20_000
    values = simulate(function, X3, runs=runs, seed=5)
    law = brute(function, X3)
    for value, probability in law.distribution.items():  # 6 standard deviations: false alarm below 1e-7
        hits = (values == float(value)).sum()
        assert abs(hits - runs * probability) <= 6 * math.sqrt(runs * probability * (1 - probability))
