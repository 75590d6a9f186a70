"""Wrong use, one row each: which error, and that it has the name, the offending value and the way out."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from truemean.errors import (
    InputError,
    InputTypeError,
    NeedsScene,
    PlanError,
    RowBudgetExceeded,
    UndefinedValue,
    UnknownName,
)
from truemean.oracle import Pixel, derive, plan, simulate
from truemean.oracle.plans import catalogue
from truemean.oracle.scene import load_scene
from truemean.oracle.simulate import PlanEstimator

X2 = Pixel.two("1/8")
X8 = Pixel(dict.fromkeys(range(8), "1/8"))
RGB = Pixel({(0, 1): "1/2", (1, 0): "1/2"})
PARTS = Pixel.from_regions({"left": ("1/4", X2), "right": ("3/4", Pixel.two("1/2"))})
PLACED = load_scene("tile").pixel(4, 0)
fixed, kirk_arvo, sequential = catalogue["fixed"], catalogue["kirk-arvo"], catalogue["sequential"]

Row = tuple[Callable[[], Any], type[Exception], tuple[str, ...]]


def on(function: Callable[[Any], Any], pixel: Pixel = X2, **options: Any) -> Callable[[], Any]:
    """Deriving the bias of a plan."""
    return lambda: derive(function, pixel, **options).bias


PIXELS: dict[str, Row] = {
    "weights not 1": (lambda: Pixel({0: "1/2", 1: "1/3"}), InputError, ("weights", "1/2, 1/3", "5/6", "1")),
    "negative weight": (lambda: Pixel({0: "3/2", 7: "-1/2"}), InputError, ("weight of 7", "-1/2", "between 0 and 1")),
    "float weight": (lambda: Pixel({0: 0.875, 1: 0.125}), InputTypeError, ("weight of 0", "0.875", "write '0.875'")),
    "NaN weight": (lambda: Pixel({0: math.nan}), InputTypeError, ("weight of 0", "nan", "Fraction")),
    "NaN weight in words": (lambda: Pixel({0: "nan"}), InputError, ("weight of 0", "'nan'", "'p/q'")),
    "weight over 0": (lambda: Pixel({0: "1/0"}), InputError, ("weight of 0", "1/0", "'p/q'")),
    "no weight": (lambda: Pixel({0: None}), InputTypeError, ("weight of 0", "None", "Fraction")),
    "NaN value": (lambda: Pixel({math.nan: 1}), InputError, ("value", "nan", "finite")),
    "infinite value": (lambda: Pixel({-math.inf: 1}), InputError, ("value", "-inf", "finite")),
    "word for a value": (lambda: Pixel({"red": 1}), InputError, ("value", "'red'", "decimal")),
    "no values": (lambda: Pixel({}), InputError, ("at least one value", "write Pixel(")),
    "list": (lambda: Pixel([0, 1]), InputTypeError, ("mapping", "[0, 1]", "list")),  # type: ignore[arg-type]
    "mixed kinds": (lambda: Pixel({0: "1/2", (0, 1): "1/2"}), InputError, ("values", "0, (0, 1)", "mix")),
    "mixed lengths": (lambda: Pixel({(0,): "1/2", (0, 1): "1/2"}), InputError, ("values", "(0), (0, 1)", "lengths")),
    "no channels": (lambda: Pixel({(): 1}), InputError, ("value=()", "a tuple of numbers")),
    "more than all white": (lambda: Pixel.two("9/8"), InputError, ("weight of 1", "9/8", "coverage")),
    "areas not 1": (lambda: Pixel.from_regions({"R": ("1/2", X2)}), InputError, ("areas", "'R'", "1/2")),
    "float area": (lambda: Pixel.from_regions({"R": (0.5, X2)}), InputTypeError, ("region 'R'", "write '0.5'")),
    "region without area": (
        lambda: Pixel.from_regions({"R": X2}),  # type: ignore[dict-item]
        InputTypeError,
        ("region 'R'", "Pixel({0: 7/8, 1: 1/8})", "('area', Pixel(...))"),
    ),
    "empty part": (lambda: X2.split(0), InputError, ("area=0", "strictly between 0 and 1")),
    "part larger than the whole": (lambda: X2.split("3/2"), InputError, ("area='3/2'", "between 0 and 1")),
    "quadrants of no scene": (X2.quadrants, NeedsScene, ("quadrants()", "scene file")),
    "cells of no scene": (lambda: X2.grid(3), NeedsScene, ("grid()", "scene file")),
    "no cells": (lambda: PLACED.grid(0), InputError, ("n=0", "at least 1")),
    "half a cell": (lambda: PLACED.grid("1/2"), InputError, ("n=1/2", "an integer")),
    "position in no scene": (lambda: X2.at(0, 0), NeedsScene, ("at()", "scene file")),
}

PARAMETERS: dict[str, Row] = {
    "n < 1": (on(fixed, n=0), InputError, ("n=0", "at least 1")),
    "negative n": (on(fixed, n=-3), InputError, ("n=-3", "at least 1")),
    "cells in a plan": (on(catalogue["centre-and-grid"], PLACED, grid=0), InputError, ("n=0", "at least 1")),
    "half a draw": (on(fixed, n="1/2"), InputError, ("n=1/2", "integer")),
    "NaN draws": (on(fixed, n=math.nan), InputError, ("n=nan", "finite")),
    "n in words": (on(fixed, n="four"), InputError, ("n='four'", "integer")),
    "n forgotten": (on(lambda X, n: X.draw(n).mean()), InputError, ("needs n", "n=4")),  # type: ignore[arg-type, misc]
    "NaN threshold": (on(kirk_arvo, eps=math.nan), InputError, ("nan", "finite")),
    "threshold in words": (on(kirk_arvo, eps="little"), InputError, ("eps='little'", "decimal")),
    "threshold of 3 channels": (on(kirk_arvo, RGB, eps=(0, 0, 0)), PlanError, ("2 and 3 channels",)),
    "unknown plan": (lambda: catalogue["kirk"], UnknownName, ("plan", "'kirk'", "did you mean kirk-arvo")),
    "plan like no other": (lambda: catalogue["zzz"], UnknownName, ("plan", "'zzz'", "known: kirk-arvo, ")),
    "unknown parameter": (on(kirk_arvo, m=4), UnknownName, ("parameter of plan kirk-arvo", "'m'", "n, eps")),
    "parameter misspelt": (on(sequential, mots=4), UnknownName, ("'mots'", "did you mean most")),
    "name for a plan": (on("fixed"), InputTypeError, ("plan='fixed'", "function of X")),  # type: ignore[arg-type]
    "mapping for a pixel": (on(fixed, {0: 1}), InputTypeError, ("X={0: 1}", "dict", "write Pixel(")),  # type: ignore[arg-type]
    "unknown arithmetic": (on(fixed, arithmetic="float32"), UnknownName, ("'float32'", "did you mean float64")),
    "rtol of exact numbers": (on(fixed, rtol=1e-3), InputError, ("rtol=0.001", "float64")),
    "rtol 0": (on(fixed, arithmetic="float64", rtol=0), InputError, ("rtol=0", "positive")),
    "no rows": (on(fixed, rows=0), InputError, ("rows=0", "'sampled'")),
    "all rows": (on(fixed, rows="all"), InputError, ("rows='all'", "'sampled'")),
    "loop ends before it starts": (on(sequential, start=4, most=2), InputError, ("most=2", "start=4")),
    "negative runs": (lambda: simulate(fixed, X2, runs=-1), InputError, ("runs=-1", ">= 0")),
    "half a run": (lambda: simulate(fixed, X2, runs=2.5), InputError, ("runs=2.5", "integer")),  # type: ignore[arg-type]
    "seed of a half": (lambda: simulate(fixed, X2, seed=0.5), InputError, ("seed=0.5", "integer")),  # type: ignore[arg-type]
    "simulated name": (lambda: simulate("fixed", X2), InputTypeError, ("plan='fixed'", "function of X")),
    "simulated parameter": (lambda: simulate(fixed, X2, m=2), UnknownName, ("'m'", "known: n")),
    "simulated in no scene": (lambda: simulate(catalogue["hierarchical"], X2), NeedsScene, ("geometry",)),
    "one sampled row": (on(fixed, rows="sampled", runs=1), InputError, ("runs=1", "at least 2")),
    "unknown estimator": (lambda: PlanEstimator("fixd"), UnknownName, ("'fixd'", "did you mean fixed")),
    "estimator's parameter": (lambda: PlanEstimator("fixed", m=2), UnknownName, ("'m'", "known: n")),
}

PLANS: dict[str, Row] = {
    "no argument": (on(lambda: 0), PlanError, ("takes no argument", "def plan(X, n=4)")),  # type: ignore[arg-type, misc]
    "open arguments": (on(lambda X, *sizes: 0), PlanError, ("*sizes", "name its parameters")),
    "policy": (lambda: plan(undefined="zero")(lambda X: 0), InputError, ("undefined='zero'", "'error' or 'nan'")),
    "coin too heavy": (on(lambda X: 1 if X.coin(2) else 0), InputError, ("X.coin(2)", "between 0 and 1")),
    "coin too heavy by row": (
        on(lambda X: 1 if X.coin(X.draw(2).sum()) else 0),
        PlanError,
        ("X.coin(", "[0, 1]", "np.clip"),
    ),
    "pick of nothing": (on(lambda X: X.pick([0, 0])), InputError, ("X.pick([0, 0])", "probabilities")),
    "negative pick": (on(lambda X: X.pick([2, -1])), InputError, ("X.pick([2, -1])", "probabilities")),
    "proposal that never draws": (on(lambda X: X.from_({0: 1}).draw(2).mean()), PlanError, ("never draws 1", "1/8")),
    "proposal of other values": (
        on(lambda X: X.from_({0: "1/2", 1: "1/4", 2: "1/4"}).draw(2).mean()),
        PlanError,
        ("values that the pixel has not",),
    ),
    "ratio without proposal": (on(lambda X: X.draw(2).mean(weight="ratio")), PlanError, ("'ratio'", "X.from_(")),
    "three halves": (
        on(lambda X: X.draw_until(lambda *S: S[0].all_equal(), start=2, most=4, parts=3).mean()),
        InputError,
        ("parts=3", "1, or 2"),
    ),
    "stop that is no decision": (
        on(lambda X: X.draw_until(lambda S: S.range(), start=2, most=4).mean()),
        PlanError,
        ("range(S)", "not a decision", "<= eps"),
    ),
    "size of a loop by row": (
        on(lambda X: X.draw_until(lambda S: S.all_equal(), start=2, most=X.draw(2).sum() + 2).mean()),
        InputError,
        ("most=", "depends on the row", "integer"),
    ),
    "unknown region": (on(lambda X: X.regions["lift"].draw(1).mean(), PARTS), UnknownName, ("'lift'", "left")),
    "region of none": (on(lambda X: X.regions["R"].draw(1).mean()), UnknownName, ("'R'", "no regions")),
    "geometry": (on(catalogue["hierarchical"]), NeedsScene, ("quadrants()", "scene file")),
    "statistic of nothing": (on(lambda X: X.draw(2).statistic(3)), InputTypeError, ("statistic=3", "function")),
    "statistic that is none": (
        on(lambda X: X.draw(2).statistic(lambda values: None)),
        PlanError,
        ("None", "returns one number"),
    ),
    "statistic that is NaN": (
        on(lambda X: X.draw(2).statistic(lambda values: math.nan)),
        PlanError,
        ("nan", "returns one number"),
    ),
    "variance of one draw": (on(lambda X: X.draw(1).variance()), UndefinedValue, ("variance(S1)", "undefined=")),
    "one number for two channels": (on(lambda X: X.draw(2).mean()[0], RGB), PlanError, ("2 channels", "S.mean()")),
    "sub-estimate by no plan": (on(lambda X: X.estimate(3)), InputTypeError, ("plan=3", "function of X")),
    "estimate beyond the values": (
        on(lambda X: X.draw(2).mean() - 1, rows="sampled", runs=50),
        PlanError,
        ("rows='sampled'", "[0.0, 1.0]"),
    ),
}

BUDGETS: dict[str, Row] = {
    "counts": (
        on(lambda X: X.draw(9).statistic(lambda values: values[0]), X8, rows=100),
        RowBudgetExceeded,
        ("counts", "9 draws of 8 values", "11,440 rows", "rows=100", "'sampled'"),
    ),
    "sequences": (
        on(lambda X: X.draw(30)[0]),
        RowBudgetExceeded,
        ("sequence", "30 draws of 2 values", "1,073,741,824 rows", "coarser"),
    ),
    "joint rows": (
        on(lambda X: abs(X.draw(40).sum() - X.draw(40).sum()), X8, rows=10_000),
        RowBudgetExceeded,
        ("78,961 rows", "rows=10,000"),
    ),
    "a growing sample": (
        on(lambda X: X.draw_until(lambda S: S.mean() > 9, start=2, most=20).mean(), X8, rows=10_000),
        RowBudgetExceeded,
        ("X.draw_until(most=20)", "8 values", "rows=10,000"),
    ),
}

RESULTS: dict[str, Row] = {
    "relative to 0": (
        lambda: derive(fixed, Pixel({-1: "1/2", 1: "1/2"})).relative_bias,
        InputError,
        ("relative_bias", "true mean 0", "use bias"),
    ),
    "other values": (lambda: derive(fixed, X2).at({0: "1/2", 2: "1/2"}), InputError, ("[0, 2]", "values")),
    "other weights": (lambda: derive(fixed, X2).at({0: "1/2", 1: "1/4"}), InputError, ("1/2, 1/4", "3/4")),
    "wrong shape": (lambda: derive(fixed, X2).at([0.5, 0.25, 0.25]), InputError, ("shape (3,)", "2 values")),
    "arrays not 1": (lambda: derive(fixed, X2).at([0.5, 0.25]), InputError, ("weights", "sum to 1")),
    "negative arrays": (lambda: derive(fixed, X2).at([1.5, -0.5]), InputError, ("weights", ">= 0")),
    "NaN arrays": (lambda: derive(fixed, X2).at([math.nan, 0.5]), InputError, ("weights", ">= 0")),
    "arrays for regions": (lambda: derive(fixed, PARTS).at([0.5, 0.5]), InputError, ("regions", "derive it for each")),
}

TABLE = {
    f"{table}: {name}": row
    for table, rows in (
        ("pixel", PIXELS),
        ("parameter", PARAMETERS),
        ("plan", PLANS),
        ("budget", BUDGETS),
        ("result", RESULTS),
    )
    for name, row in rows.items()
}


@pytest.mark.parametrize("name", TABLE)
def test_wrong_use_is_one_sentence_with_name_value_and_way_out(name):
    use, error, words = TABLE[name]
    with pytest.raises(InputError) as caught:
        use()
    assert type(caught.value) is error
    message = str(caught.value)
    assert [word for word in words if word not in message] == []
    assert "\n" not in message
    assert len(message) < 300


def test_a_row_budget_that_is_large_enough_is_no_obstacle():
    found = derive(lambda X: X.draw(9).statistic(lambda values: values[0]), X8, rows=11_440)
    assert found.rows == 11_440


def test_a_float_weight_is_also_python_s_own_type_error():
    with pytest.raises(TypeError, match=r"write '0\.5'"):
        Pixel({0: 0.5, 1: 0.5})
    with pytest.raises(ValueError, match="sum to"):
        Pixel({0: "1/2"})
