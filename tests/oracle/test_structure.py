"""The structural rule: what it proves is unbiased on every pixel tried, what is biased it never proves."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import sympy
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.oracle import small_plans, small_plans_staged, strategies, structured_plans
from tests.oracle.catalogue_cases import OF_A_SCENE, PARAMS

from truemean.errors import InputError, PlanError, UndefinedValue, UnknownName
from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue
from truemean.oracle.scene import load_scene
from truemean.oracle.structure import structural_proof

quiet = settings(deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
few = settings(quiet, max_examples=8)
TWO = Pixel.from_regions({"R": ("1/4", Pixel.two("1/8")), "rest": ("3/4", Pixel({0: "1/3", 7: "2/3"}))})
PIXELS = (Pixel.two("1/8"), Pixel({0: "1/2", 1: "1/3", 3: "1/6"}), Pixel({-3: "1/4", -1: "1/4", 9: "1/2"}), TWO)
PLACED = [load_scene(name).pixel(*place) for name, place in (("fig5", (18, 10)), ("tile", (4, 0)))]
SMALL = [
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


def named(group):
    return [pytest.param(plan, id=name) for name, plan in group.items()]


def biases(plan, pixels, **params):
    for pixel in pixels:
        bias = derive(plan, pixel, **params).bias
        yield from bias if isinstance(bias, tuple) else (bias,)


def assert_proved(plan, pixels, **params):
    found = structural_proof(plan, params)
    assert found.proved, found.reason
    assert set(biases(plan, pixels, **params)) == {0}


# -- what is proved, and what is not ---------------------------------------------------------------


@pytest.mark.parametrize("plan", named(structured_plans.UNBIASED))
def test_unbiased_by_structure_is_proved(plan):
    assert_proved(plan, PIXELS)


@pytest.mark.parametrize("plan", named(structured_plans.PLACED))
def test_parts_of_parts_of_a_scene_are_proved(plan):
    assert_proved(plan, PLACED)


@pytest.mark.parametrize("plan", named(structured_plans.BIASED))
def test_a_leak_is_refused(plan):
    assert not structural_proof(plan).proved
    pixels = [TWO] if "region" in plan.__name__ else PIXELS
    assert any(biases(plan, pixels))


def weighted_by_its_own_draws_alike(X):
    S = X.draw(2)
    return (S[0] + S[1]) / 2


def a_coin_that_another_decision_has_seen(X):
    heads, S = X.coin(Fraction(1, 2)), X.draw(2)
    if heads & (S.range() > 0):
        return 2 * X.draw(1).mean()
    return 2 * X.draw(1).mean() if heads else 0


def reads_its_values(X):
    return X.draw(1).mean() if len(X.values) < 100 else 0


def catches_errors(X):
    try:
        return X.draw(1 if X.draw(2).contrast() > 0 else 2).mean()
    except ValueError:
        return X.draw(2).max()


def looks_too_often(X):
    S, T = X.draw(2), X.draw(1)
    while S.range() <= T.size and S.size < 100:
        S.more(1)
    return T.mean()


def never_ends(X):
    return X.estimate(never_ends)


@pytest.mark.parametrize(
    "plan",
    [
        weighted_by_its_own_draws_alike,
        a_coin_that_another_decision_has_seen,
        reads_its_values,
        catches_errors,
        looks_too_often,
        never_ends,
    ],
)
def test_of_others_nothing_is_said(plan):
    assert not structural_proof(plan).proved


@pytest.mark.parametrize(("name", "params"), [(n, p) for n, sets in PARAMS.items() for p in sets])
def test_the_catalogue_is_proved_where_it_is_unbiased(name, params):
    unbiased = catalogue[name].unbiased
    assert structural_proof(catalogue[name], params).proved == unbiased
    if unbiased and params.get("n", 0) < 100:
        assert set(biases(catalogue[name], PLACED if name in OF_A_SCENE else PIXELS, **params)) == {0}


# -- soundness: whatever is proved is unbiased wherever it is derived ---------------------------------


@pytest.mark.parametrize(("plan", "pixels"), SMALL)
def test_a_small_plan_that_is_proved_is_unbiased_on_random_pixels(plan, pixels):
    if not structural_proof(plan).proved:
        return

    @few
    @given(pixels)
    def check(pixel):
        assert set(biases(plan, [pixel])) == {0}

    check()


@settings(quiet, max_examples=30)
@given(strategies.plans(draws=4), strategies.pixels())
def test_a_random_tree_that_is_proved_is_unbiased(tree, pixel):
    def plan(X):
        return tree.body(strategies.Scope(X, [X.draw(tree.n)], [], colour=False))

    if structural_proof(plan).proved:
        try:
            assert set(biases(plan, [pixel])) == {0}
        except UndefinedValue:
            return


LOOKS = (
    lambda S: S.range() <= 0,
    lambda S: S.mean() > Fraction(1, 2),
    lambda S: S.max() > 1,
    lambda S: S.all_equal(),
    lambda S: S.statistic(lambda values: values[0]) < 1,
)


class Weighed:
    """A random plan near what can be proved: weights that sum to 1, roulette, parts, growth, sizes by row."""

    def __init__(self, pick):
        self.pick, self.samples, self.coins = pick, [], []

    def look(self):
        if self.coins and not self.pick(4):
            return self.coins[self.pick(len(self.coins))]
        return LOOKS[self.pick(len(LOOKS))](self.samples[self.pick(len(self.samples))])

    def number(self, *values):
        one, other = values[self.pick(len(values))], values[self.pick(len(values))]
        if self.samples and one != other and self.pick(2):
            return np.where(self.look(), one, other)
        return np.clip(self.samples[0].mean(), one, 1) if self.samples and not self.pick(6) else one

    def size(self):
        return np.where(self.look(), 1, 2) if self.samples and not self.pick(3) else 1 + self.pick(2)

    def body(self, X, parts, depth):
        kind = self.pick(8) if depth else 8
        if kind in (0, 1):
            self.samples.append(parts[self.pick(3)].draw(self.size()))
        elif kind == 2 and self.samples:
            self.samples[self.pick(len(self.samples))].more(self.size())
        elif kind in (3, 4) and self.samples:
            if self.look():
                self.pick(1)  # the sides go different ways
        elif kind == 5:
            p = self.number(Fraction(1, 2), Fraction(1, 4), Fraction(0))
            return self.body(X, parts, depth - 1) / p if X.coin(p) else 0
        elif kind == 6:
            self.coins.append(X.coin(self.number(Fraction(1, 3), Fraction(3, 4))))
        elif kind >= 7:
            return self.estimate(parts, 2)
        return self.body(X, parts, depth - 1)

    def estimate(self, parts, depth):
        kind = self.pick(6) if depth else self.pick(3)
        if kind == 0 and self.samples:
            return self.samples[self.pick(len(self.samples))].mean()
        if kind == 1:
            return parts[0].true_mean()
        if kind <= 2:
            return parts[0].draw(self.size()).mean()
        if kind == 3:
            return sum(part.area * part.draw(self.size()).mean() for part in parts[1:])
        a = self.number(Fraction(1, 2), Fraction(1, 3), Fraction(1))
        return a * self.estimate(parts, depth - 1) + (1 - a) * self.estimate(parts, depth - 1)


@settings(quiet, max_examples=300)
@given(st.lists(st.integers(0, 59), min_size=12, max_size=40), st.integers(1, 5), st.booleans())
def test_a_plan_of_random_weights_that_is_proved_is_unbiased(choices, depth, declared):
    def plan(X):
        digits = iter(choices)
        parts = X.regions.values() if declared else X.split("1/4")
        return Weighed(lambda n: next(digits, 0) % n).body(X, [X, *parts], depth)

    if structural_proof(plan, parts={"R": "1/4", "rest": "3/4"} if declared else None).proved:
        assert set(biases(plan, [TWO] if declared else PIXELS[:3])) == {0}


# -- words -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("plan", "words"),
    [
        (structured_plans.figure_1, "not proved: the weight of S1 depends on range(S1) <= 0, which looks at S1"),
        (structured_plans.half, "not proved: the estimate averages to 1/2 * true mean, not to the true mean"),
        (structured_plans.product_of_means, "not proved: the estimate averages to true mean^2, not to the true mean"),
        (structured_plans.the_largest, "not proved: the estimate has max(S1) in it, which is no weighted mean"),
        (structured_plans.stopped_by_draw_until, "not proved: S1 stops where std_error(S1) <= 1/10, which looks at S1"),
        (
            structured_plans.size_chosen_by_what_is_then_weighted,
            "not proved: the weight of S1, 1/4 where range(S2) <= 0, else 3/4, looks at S1 itself",
        ),
        (reads_its_values, "not proved: the plan reads X.values or the like"),
        (
            structured_plans.figure_2_by_where,
            "S1 estimates R at the fixed weight 1/4 and otherwise only decides; S2 is fresh when it is weighted",
        ),
        (structured_plans.roulette, "the weights make up for X.coin(1/3); S1 is fresh when it is weighted"),
        (lambda X: X.true_mean(), "the estimate is the true mean itself"),
    ],
)
def test_the_reason_is_in_words(plan, words):
    assert structural_proof(plan).reason == words


def test_the_pixels_are_those_that_the_walk_considered():
    assert structural_proof(catalogue["discard-pilot"]).pixels == "every pixel"
    assert structural_proof(catalogue["hierarchical"]).pixels == "pixels of a scene"
    assert structural_proof(catalogue["hierarchical"], {"depth": 0}).pixels == "every pixel"
    pixels = structural_proof(catalogue["kirk-arvo-unbiased"]).pixels
    assert pixels == "pixels of a scene, or of two regions R and rest, or without declared regions"


def test_declared_regions_are_those_given():
    def by_parts(X):
        return sum(part.area * part.draw(1).mean() for part in X.regions.values())

    found = structural_proof(by_parts, parts={"sky": "1/2", "sea": "1/3", "land": "1/6"})
    assert found.proved
    assert found.pixels == "pixels of regions sky, sea, land"
    assert not structural_proof(by_parts).proved
    with pytest.raises(InputError, match="sum to"):
        structural_proof(by_parts, parts={"sky": "1/2"})


def test_symbols_are_numbers_that_nobody_knows():
    n, eps = sympy.Symbol("n", integer=True, positive=True), sympy.Symbol("epsilon", nonnegative=True)
    assert structural_proof(catalogue["discard-pilot"], {"n1": n, "eps": eps}).proved
    assert not structural_proof(catalogue["kirk-arvo"], {"n": n, "eps": eps}).proved


# -- errors ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("found", [None, True, "1/2", [1, 2].__iter__()])
def test_a_plan_that_returns_no_number_is_an_error_as_in_derive(found):
    for judge in (structural_proof, lambda plan: derive(plan, PIXELS[0])):
        with pytest.raises(PlanError, match="return a number or a quantity"):
            judge(lambda X: found)


def test_an_unknown_parameter_is_an_error_as_in_derive():
    with pytest.raises(UnknownName, match="eps"):
        structural_proof(catalogue["fixed"], {"eps": 0})


@pytest.mark.parametrize(
    ("plan", "words"),
    [
        (lambda X: None if X.draw(2).range() > 0 else X.draw(1).mean(), "where range(S1) > 0, the plan returned None"),
        (lambda X: X.draw(2).mean()[0], "not subscriptable"),
        (lambda X: (X.draw(1).mean(), 0), "the plan returned (mean(S1), 0)"),
        (lambda X: X.draw(0).mean(), "n=0 is not a sample size"),
        (lambda X: X.draw(range(int(X.draw(2).max()))[0]).mean(), "a plain number of max(S1)"),
        (lambda X: X.at(0, 0), "looks at a position"),
        (lambda X: X.from_({0: 1}).draw(1).mean(), "draws from a proposal"),
        (lambda X: X.regions["sky"].draw(1).mean(), "no pixel has what the plan asks for"),
        (lambda X: X.draw(2).mean() * float(np.random.default_rng().random()), "the plan does not do the same again"),
    ],
)
def test_what_can_not_be_walked_is_no_proof_and_no_error(plan, words):
    found = structural_proof(plan)
    assert not found.proved
    assert words in found.reason


def test_a_refusal_is_not_swallowed_by_a_helper_that_catches_all():
    def shielded(look):
        try:
            return look()
        except BaseException:  # noqa: BLE001  # that it is so broad is what is tested
            return None

    def plan(X):
        shielded(lambda: X.values)
        return X.draw(1).mean()

    assert structural_proof(plan).reason == "not proved: the plan reads X.values or the like"


def test_no_sympy_is_needed(run):
    code = (
        "import sys; from truemean.oracle.structure import structural_proof; from truemean.oracle.plans import catalogue;"
        "[structural_proof(p) for p in catalogue.values()]; print('sympy' in sys.modules)"
    )
    assert run("-c", code).stdout.strip() == "False"
