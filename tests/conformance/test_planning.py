"""Plans of a run: hand-computed cases, what must grow with what, and what real runs then take."""

import json
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.conformance.estimators import COLOUR, EIGHTH, fixed, kirk_arvo, uniforms

from truemean.conformance import Verdict, judge
from truemean.conformance.outlook import first_passage
from truemean.conformance.planning import plan_run
from truemean.errors import InputError, InputTypeError, Unsupported
from truemean.oracle.pixel import Pixel

HALF, EIGHTH_OF = Fraction(1, 2), Fraction(1, 8)


def coin(weight):
    return {0: 1 - Fraction(weight), 1: Fraction(weight)}


def mean_of(n, weight):
    w = Fraction(weight)
    return {Fraction(i, n): math.comb(n, i) * w**i * (1 - w) ** (n - i) for i in range(n + 1)}


def pilot(n, weight):
    w = Fraction(weight)
    return {0: (1 - w) ** n, w: 1 - w**n - (1 - w) ** n, 1: w**n}


class Sampler:
    """An estimator whose estimates have a law, and which says so; ``own`` is what it really has."""

    def __init__(self, law, own=None):
        self.law = law
        self.values, masses = (np.array(list(map(float, part))) for part in zip(*(own or law).items(), strict=True))
        self.limits = np.cumsum(masses)[:-1]

    def predicts(self, pixel):
        return {"law": self.law}

    def run(self, pixel, seeds):
        return self.values[np.searchsorted(self.limits, uniforms(seeds, 1)[:, 0], "right")]


def only(plan):
    (case,) = plan.cases
    return case


# -- by hand --------------------------------------------------------------------------------------


def test_evidence_without_noise_passes_a_level_on_time():
    drift, barrier = np.array([0.5]), np.array([10.0])
    assert first_passage(19, drift, np.zeros(1), barrier) == 0
    assert first_passage(21, drift, np.zeros(1), barrier) == 1
    assert first_passage(1, np.array([math.inf]), np.zeros(1), barrier) == 1


def test_first_passage_is_that_of_a_random_walk():
    rng = np.random.default_rng(1)
    walks = np.cumsum(rng.normal(0.02, 0.2, (2000, 400)), axis=1)
    for n in (100, 200, 400):
        passed = float(np.mean(walks[:, :n].max(axis=1) >= 5))
        # Steps jump over the level by 0.58 deviations in the mean (Siegmund 1985).
        planned = float(first_passage(n, np.array([0.02]), np.array([0.04]), np.array([5 + 0.58 * 0.2]))[0])
        assert passed == pytest.approx(planned, abs=4 * math.sqrt(0.25 / 2000))


def test_a_coin_takes_the_closed_form_of_the_relative_entropy():
    # Against E[y] <= 1/2 a coin of 3/5 wins KL(3/5, 1/2) nats a toss; it is declared, so half of the money is on it.
    p, m = 0.6, 0.5
    up, down = math.log(p / m), math.log((1 - p) / (1 - m))
    growth = p * up + (1 - p) * down
    variance = p * (1 - p) * (up - down) ** 2
    case = only(plan_run(coin("3/5"), tolerance=0, pixels=Pixel.two("1/2"), alpha=0.02))
    barrier = np.array([-math.log(0.01 * 0.5)])
    at, before = (
        first_passage(n, np.array([growth]), np.array([variance]), barrier)[0]
        for n in (case.biased, 0.98 * case.biased)
    )
    assert at >= 0.5 > before
    assert case.declared_bias == Fraction(1, 10)
    assert case.declared_std == pytest.approx(math.sqrt(0.24))


def test_a_point_within_the_tolerance_is_certified_without_noise():
    # Against E[y] <= 0.4 the outcome 1/2 wins log(1 + .99 / 4) a time, on .8 of the money.
    case = only(plan_run({HALF: 1}, tolerance="0.1", pixels=Pixel.two("1/2")))
    growth = math.log1p(0.99 * 0.25)
    assert case.conforms == math.ceil(-math.log(0.01 * 0.8) / growth)
    assert case.biased is None


def test_what_the_range_implies_needs_nothing():
    constant = only(plan_run({"3/8": 1}, tolerance=0))
    assert (constant.conforms, constant.certifiable, constant.detectable) == (1, 0.0, None)
    assert only(plan_run(coin("1/2"), tolerance="1/2")).conforms == 1


def test_the_edge_of_the_tolerance_is_a_boundary():
    case = only(plan_run(coin("3/5"), tolerance="0.1", pixels=Pixel.two("1/2")))
    assert (case.verdict_expected, case.conforms, case.biased) == ("boundary", None, None)
    hunt = only(plan_run(coin("1/2"), tolerance=0))
    assert (hunt.verdict_expected, hunt.conforms, hunt.biased) == (Verdict.INCONCLUSIVE, None, None)


def test_the_budget_says_which_verdict_to_expect():
    given = {"tolerance": "0.05", "pixels": Pixel.two("1/2")}
    assert only(plan_run(coin("1/2"), **given)).verdict_expected is Verdict.CONFORMS
    assert only(plan_run(coin("7/10"), **given)).verdict_expected is Verdict.BIASED
    assert only(plan_run(coin("1/2"), budget=100, **given)).verdict_expected is Verdict.INCONCLUSIVE
    assert only(plan_run(coin("7/10"), budget=10, **given)).detectable is None


def test_a_variance_plans_as_the_law_does():
    class Told:
        def run(self, pixel, seeds):
            raise AssertionError

        def predicts(self, pixel):
            return {"mean": "1/8", "variance": Fraction(7, 512)}

    by_variance = only(plan_run(Told(), tolerance="0.01", pixels=EIGHTH))
    by_law = only(plan_run(mean_of(8, EIGHTH_OF), tolerance="0.01", pixels=EIGHTH))
    assert by_variance.conforms == pytest.approx(by_law.conforms, rel=0.05)
    assert by_variance.detectable == pytest.approx(by_law.detectable, rel=0.1)
    assert by_variance.declared_std == pytest.approx(math.sqrt(7 / 512))


def test_laws_of_another_bias_have_it_whether_tilted_or_moved():
    for law in (mean_of(8, EIGHTH_OF), {HALF: 1}, {Fraction(499, 1000): HALF, Fraction(501, 1000): HALF}):
        outlook = only(plan_run(law, tolerance="0.01", range=(0, 1))).outlook
        biases = np.linspace(-outlook.room(-1), outlook.room(1), 9)
        values, masses = outlook.laws(biases)
        middle = float(outlook.target.true_mean)
        assert np.allclose((values * masses).sum(axis=1) - middle, biases, atol=1e-6)
        assert values.min() >= 0
        assert values.max() <= 1


# -- what grows with what -------------------------------------------------------------------------

weights = st.fractions(min_value="1/50", max_value="49/50", max_denominator=50)


@settings(max_examples=12, deadline=None)
@given(weights, st.integers(50, 20_000), st.integers(2, 20))
def test_more_budget_finds_smaller_biases_and_certifies_smaller_tolerances(weight, budget, times):
    few, many = (only(plan_run(coin(weight), tolerance="0.01", budget=b)) for b in (budget, times * budget))
    assert few.conforms == many.conforms
    assert (many.detectable or math.inf) <= 1.01 * (few.detectable or math.inf)
    assert many.certifiable <= 1.01 * few.certifiable
    assert few.outlook.biased(np.array([0.02]), budget) <= many.outlook.biased(np.array([0.02]), times * budget)


@settings(max_examples=12, deadline=None)
@given(weights, st.fractions(min_value="1/1000", max_value="1/100"), st.fractions(min_value="11/10", max_value=4))
def test_stricter_asks_for_more(weight, tolerance, times):
    loose, tight = (only(plan_run(coin(weight), tolerance=t)) for t in (tolerance * times, tolerance))
    surer = only(plan_run(coin(weight), tolerance=tolerance, beta=1e-4))
    assert loose.conforms <= tight.conforms <= surer.conforms


def test_a_curve_rises_away_from_the_tolerance_and_its_ends_are_seen():
    case = only(plan_run(mean_of(8, EIGHTH_OF), tolerance="0.02", pixels=EIGHTH, budget=2000))
    biases, biased, conforms = case.power_curve(41)
    assert biases.shape == biased.shape == conforms.shape == (41,)
    assert np.all(np.diff(biased[biases > 0]) >= -1e-9)
    assert np.all(biased[np.abs(biases) <= 0.02] == 0)
    assert biased[-1] > 0.99
    assert conforms[np.abs(biases) < 0.002].min() > 0.9
    assert np.all(biased + conforms <= 1)
    assert case.power(case.detectable) == pytest.approx(0.99, abs=0.01)


# -- what is planned ------------------------------------------------------------------------------


def test_every_channel_of_every_pixel_is_a_case_and_shares_alpha():
    plan = plan_run(None, declares=("fixed", {"n": 8}), tolerance="2%", pixels=EIGHTH | COLOUR)
    assert [case.name for case in plan.cases] == ["eighth", "colour[0]", "colour[1]", "colour[2]"]
    alone = only(plan_run(None, declares=("fixed", {"n": 8}), tolerance="2%", pixels=EIGHTH))
    assert plan.cases[0].detectable > alone.detectable
    assert plan.cases[0].conforms == alone.conforms
    read = json.loads(json.dumps(plan.to_json()))
    assert read["schema"] == "truemean-plan/1"
    assert read["cases"][0]["verdict_expected"] == "CONFORMS"
    assert read["arguments"]["declares"] == {"plan": "fixed", "params": {"n": 8}}
    assert read["arguments"]["pixels"] == ["eighth", "colour"]


def test_an_estimator_brings_its_declaration_and_pixels():
    class Mine:
        declares = ("kirk-arvo", {"n": 8})

        def run(self, pixel, seeds):
            return kirk_arvo(pixel, seeds)

        def pixels(self):
            return EIGHTH

    case = only(plan_run(Mine(), tolerance="1%"))
    assert (case.name, case.verdict_expected, case.conforms) == ("eighth", Verdict.BIASED, None)


def test_a_pixel_that_cannot_be_planned_says_why():
    class Odd:
        def run(self, pixel, seeds):
            raise AssertionError

        def range(self, pixel):
            if pixel is COLOUR["colour"]:
                raise Unsupported("no colours")
            return (0, 1)

        def predicts(self, pixel):
            return {"law": {2: 1}} if pixel is EIGHTH["eighth"] else {"mean": "1/2"}

    plan = plan_run(Odd(), tolerance="1%", pixels=EIGHTH | COLOUR | {"half": Pixel.two("1/2")})
    assert plan.cases == ()
    assert plan.skipped["colour"] == "no colours"
    assert "estimates of 2 lie outside the range [0.0, 1.0]" in plan.skipped["eighth"]
    assert "its law is unknown" in plan.skipped["half"]


@pytest.mark.parametrize(
    ("subject", "changes", "message"),
    [
        ({0: "1/2", 1: "1/4"}, {}, "3/4"),
        ({0: "3/2", 1: "-1/2"}, {}, "-1/2"),
        ({0: 0.5, 1: 0.5}, {}, "write '0.5'"),
        ({}, {}, "mapping outcome -> probability"),
        ({2: 1}, {"pixels": Pixel.two("1/2")}, "declare the range"),
        (fixed, {}, "declares no plan"),
        (None, {}, "declares no plan"),
        (coin("1/2"), {"tolerance": "-1%"}, "negative"),
        (coin("1/2"), {"tolerance": math.nan}, "not finite"),
        (coin("1/2"), {"alpha": 0}, "alpha=0"),
        (coin("1/2"), {"beta": 1.0}, "beta=1.0"),
        (coin("1/2"), {"budget": 0}, "budget=0"),
        (coin("1/2"), {"pixels": {}}, "pixels={}"),
    ],
)
def test_what_cannot_be_meant_is_refused(subject, changes, message):
    with pytest.raises(InputError) as caught:
        plan_run(subject, **({"tolerance": "1%"} | changes))
    assert message in str(caught.value)


def test_a_subject_that_is_neither_is_refused():
    with pytest.raises(InputTypeError):
        plan_run(3, tolerance="1%")


def test_impossible_biases_and_curves_are_refused():
    case = only(plan_run(coin("1/2"), tolerance="1%"))
    for bias in (0.6, -0.6, math.nan):
        with pytest.raises(InputError):
            case.power(bias)
    with pytest.raises(InputError):
        case.power_curve(1)


# -- what runs then take --------------------------------------------------------------------------

RUNS = 25
PLANNED = {
    "coin": (coin("1/2"), HALF, "0.08"),
    "mean of 8": (mean_of(8, EIGHTH_OF), EIGHTH_OF, "0.03"),
    "rare event": (coin("1/50"), Fraction(1, 50), "0.015"),
    "nearly one value": ({Fraction(499, 1000): HALF, Fraction(501, 1000): HALF}, HALF, "0.02"),
    "kirk-arvo 1/8": (pilot(8, EIGHTH_OF), EIGHTH_OF, "0.01"),
    "kirk-arvo 3/4": (pilot(8, "3/4"), Fraction(3, 4), "0.005"),
    "biased coin": (coin("3/5"), HALF, "0.01"),
}


@pytest.mark.parametrize(("law", "mean", "tolerance"), PLANNED.values(), ids=PLANNED)
def test_runs_take_what_was_planned(law, mean, tolerance):
    given = {"tolerance": tolerance, "pixels": Pixel.two(mean)}
    case = only(plan_run(law, **given))
    reports = [judge(Sampler(law), seed=seed, **given) for seed in range(RUNS)]
    assert {report.verdict for report in reports} == {case.verdict_expected}
    # Medians of 25 runs, at the looks of a run, which are up to 10 % apart.
    median = float(np.median([report.cases[0].replicates for report in reports]))
    planned = case.conforms or case.biased
    assert planned / 1.5 <= median <= 1.5 * planned


@pytest.mark.parametrize("sign", [1, -1])
def test_the_detectable_bias_is_found_as_often_as_planned(sign):
    given = {"tolerance": "0.02", "pixels": Pixel.two("1/2"), "budget": 400, "beta": 0.1}
    declared = mean_of(4, HALF)
    case = only(plan_run(declared, **given))
    biased = mean_of(4, HALF + sign * Fraction(case.detectable))  # which is the declared law, tilted
    found = [judge(Sampler(declared, biased), seed=seed, **given).verdict is Verdict.BIASED for seed in range(RUNS)]
    assert case.power(sign * case.detectable) >= 0.9
    # With probability 0.9 each, fewer than 18 of 25 have probability 2e-3.
    assert sum(found) >= 18


def test_the_certifiable_tolerance_is_certified_as_often_as_planned():
    given = {"pixels": Pixel.two("1/2"), "budget": 400, "beta": 0.1}
    law = mean_of(4, HALF)
    tolerance = Fraction(only(plan_run(law, tolerance="1%", **given)).certifiable)
    runs = [judge(Sampler(law), tolerance=tolerance, seed=seed, **given).verdict for seed in range(RUNS)]
    assert sum(verdict is Verdict.CONFORMS for verdict in runs) >= 18
