"""The engine equals, to the last digit, its twin that runs every sequence of outcomes."""

from __future__ import annotations

from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, reject, settings
from hypothesis import strategies as st
from tests.oracle import small_plans, small_plans_staged, strategies
from tests.oracle.brute_force import brute
from tests.oracle.brute_numbers import Num

from truemean.errors import InputError, UndefinedValue
from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue
from truemean.oracle.scene import Scene, load_scene

quiet = settings(deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
few, many = settings(quiet, max_examples=6), settings(quiet, max_examples=80)

TABLE = [
    pytest.param(plan, pixels, id=name)
    for group, pixels in (
        (small_plans.SCALAR, strategies.pixels()),
        (small_plans.NONNEGATIVE, strategies.pixels(nonnegative=True)),
        (small_plans_staged.SCALAR, strategies.pixels()),
        (small_plans_staged.COLOUR, strategies.colours()),
        (small_plans_staged.PARTED, strategies.parted()),
    )
    for name, plan in group.items()
]


def channels(value):
    return value if isinstance(value, tuple) else (value,)


def assert_paths_add_up(derivation):
    assert sum(path.probability for path in derivation.paths) == 1
    assert all(path.probability > 0 for path in derivation.paths)
    totals = [sum(parts) for parts in zip(*(channels(path.bias) for path in derivation.paths), strict=True)]
    assert tuple(totals) == channels(derivation.bias)


def assert_within(approx, exact):
    for a, e in zip(channels(approx), channels(exact), strict=True):
        assert abs(Fraction(a.value) - e) <= Fraction(a.error), (a, float(e))


@pytest.mark.parametrize(("plan", "pixels"), TABLE)
def test_every_small_plan_equals_its_twin_on_random_pixels(plan, pixels):
    @few
    @given(pixels)
    def check(pixel):
        derivation = derive(plan, pixel)
        brute(plan, pixel).assert_equals(derivation)
        assert_paths_add_up(derivation)

    check()


@pytest.mark.parametrize(("plan", "pixels"), TABLE)
def test_the_float_bound_holds_for_every_small_plan_on_random_pixels(plan, pixels):
    @few
    @given(pixels)
    def check(pixel):
        exact, rough = brute(plan, pixel), derive(plan, pixel, arithmetic="float64")
        for name in ("bias", "expectation", "variance", "cost"):
            assert_within(getattr(rough, name), getattr(exact, name))

    check()


@many
@given(strategies.plans(), strategies.pixels() | strategies.colours(2))
def test_a_random_plan_equals_its_twin_on_a_random_pixel(tree, pixel):
    def plan(X):
        return tree(X)

    try:
        law = brute(plan, pixel)
    except UndefinedValue:
        with pytest.raises(UndefinedValue):
            derive(plan, pixel).distribution()
        return
    derivation = derive(plan, pixel)
    law.assert_equals(derivation)
    assert_paths_add_up(derivation)


@settings(many, max_examples=30)
@given(strategies.plans(draws=4), strategies.pixels())
def test_the_float_bound_holds_for_random_plans(tree, pixel):
    def plan(X):
        return tree(X)

    try:
        exact = brute(plan, pixel).bias
    except UndefinedValue:
        reject()
    assert_within(derive(plan, pixel, arithmetic="float64").bias, exact)


@settings(many, max_examples=25)
@given(strategies.plans(draws=4), strategies.pixels(), st.data())
def test_arrays_of_weights_give_what_pixels_with_these_weights_give_or_are_refused(tree, pixel, data):
    def plan(X):
        return tree(X)

    parts = data.draw(st.lists(st.integers(1, 5), min_size=len(pixel.values), max_size=len(pixel.values)))
    weights = [Fraction(part, sum(parts)) for part in parts]
    there = Pixel(dict(zip(pixel.values, weights, strict=True)))
    try:
        exact, derivation = brute(plan, there).bias, derive(plan, pixel)
    except UndefinedValue:
        reject()
    try:
        (moved,) = derivation.at(np.array(weights, dtype=float)[:, None]).bias
    except InputError as error:
        assert "other weights" in str(error)  # noqa: PT017 - the plan reads a weight
    else:
        assert abs(moved - float(exact)) < 1e-11


@few
@given(strategies.pixels() | strategies.colours(), st.data())
def test_importance_sampling_equals_its_twin(pixel, data):
    assume(all(pixel.weights))  # else all ratios drawn may be 0, and so may their sum
    parts = data.draw(st.lists(st.integers(1, 3), min_size=len(pixel.values), max_size=len(pixel.values)))
    proposal = {value: Fraction(part, sum(parts)) for value, part in zip(pixel.values, parts, strict=True)}

    def weighted(X):
        S, T = X.from_(proposal).draw(2), X.draw(1)
        return S.mean(weight="ratio") if (S.max() > T.mean()).all() else S.self_normalised_mean() + T.mean()

    brute(weighted, pixel).assert_equals(derive(weighted, pixel))


class Quarters:
    """A pixel's geometry: four quarters, the first of them made of four again."""

    def __init__(self, *parts):
        self.parts = parts

    def grid(self, n):
        assert n == 2
        return tuple(part.with_area("1/4") for part in self.parts)


def hierarchical(X, n=2, depth=2):
    S = X.draw(n)
    if depth == 0 or S.range() <= 0:
        return S.mean()
    return sum(Q.area * Q.estimate(hierarchical, n=n, depth=depth - 1) for Q in X.quadrants())


@pytest.mark.parametrize("depth", [0, 1, 2])
def test_a_recursion_over_quadrants_equals_its_twin(depth):
    black, white = Pixel({0: 1}), Pixel({1: 1})
    corner = Pixel({0: "3/4", 1: "1/4"}, geometry=Quarters(black, white, black, black))
    whole = Pixel({0: "11/16", 1: "5/16"}, geometry=Quarters(corner, black, white, black))
    brute(hierarchical, whole, depth=depth).assert_equals(derive(hierarchical, whole, depth=depth))


COLOURED = {
    "schema": "truemean-scene/1",
    "width": 2,
    "height": 1,
    "background": ["1/2", 0, 0],
    "polygons": [
        {"value": [1, "1/3", 0], "vertices": [["1/5", 0], [2, 0], [1, 1]]},
        {"value": [0, 0, 1], "vertices": [[0, "2/5"], ["1/3", 0], [1, "1/7"], ["2/3", 1]]},
    ],
}
SCENES = {"grey": load_scene("tile"), "coloured": Scene.from_dict(COLOURED)}


@pytest.mark.parametrize(("scene", "place"), [("grey", (4, 2)), ("coloured", (0, 0)), ("coloured", (1, 0))])
@pytest.mark.parametrize(
    ("name", "params"),
    [
        ("centre-first", {"n": 1}),
        ("centre-first", {"n": 4}),
        ("centre-and-grid", {"grid": 1}),
        ("centre-and-grid", {"grid": 2}),
        ("centre-and-grid", {"grid": 3}),
    ],
)
def test_a_plan_with_a_sample_at_the_centre_equals_its_twin(scene, place, name, params):
    X = SCENES[scene].pixel(*place)
    brute(catalogue[name], X, **params).assert_equals(derive(catalogue[name], X, **params))


# -- the twin itself -------------------------------------------------------------------------------


def test_the_twin_gives_the_paper_s_number_for_an_eighth_of_white():
    law = brute(small_plans.figure_1, Pixel.two("1/8"))
    assert (law.expectation, law.bias) == (Fraction(851, 16384), Fraction(-1197, 16384))


@quiet
@given(strategies.pixels())
def test_the_twin_obeys_equation_6(pixel):
    bias = sum((w**4 * (v - pixel.mean) for v, w in pixel.law.items()), Fraction(0))
    assert brute(small_plans.figure_1, pixel).bias == bias


@few
@given(st.sampled_from([*small_plans.SCALAR.values()]), strategies.pixels())
def test_the_twin_s_probabilities_sum_to_1(plan, pixel):
    law = brute(plan, pixel)
    assert sum(o.probability for o in law.outcomes) == 1
    assert sum(law.distribution.values()) == 1


def test_the_twin_refuses_a_half_empty_sample_too():
    with pytest.raises(UndefinedValue):
        brute(lambda X: X.draw(0).mean(), Pixel.two("1/8"))


@quiet
@given(st.lists(st.tuples(st.integers(-3, 3), st.integers(0, 60)), min_size=1, max_size=4))
def test_the_twin_s_sums_of_roots_have_the_sign_that_60_digits_show(terms):
    total = sum((factor * np.sqrt(Num(radicand)) for factor, radicand in terms), Num(0))
    with mpmath.workdps(60):
        digits = mpmath.fsum(factor * mpmath.sqrt(radicand) for factor, radicand in terms)
        assert total.sign() == (0 if abs(digits) < 1e-50 else mpmath.sign(digits))
