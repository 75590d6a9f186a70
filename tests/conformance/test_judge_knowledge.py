"""What may be told to the judge beyond a pixel and a tolerance, and what it says back."""

import math
from fractions import Fraction

import numpy as np
import pytest
from tests.conformance.estimators import COLOUR, EIGHTH, Together, draws, fixed, kirk_arvo, only, uniforms

from truemean.conformance import PlanCheck, Verdict, judge
from truemean.conformance.evidence import METHODS
from truemean.conformance.planning import planned
from truemean.errors import InputError, InputTypeError, SubjectError, Unsupported
from truemean.oracle.pixel import Pixel

HALF = {"half": Pixel.two("1/2")}

# -- tolerances -----------------------------------------------------------------------------------


def test_each_pixel_may_have_its_own_tolerance():
    report = judge(kirk_arvo, pixels=EIGHTH | HALF, tolerance={"eighth": "10%", "*": 0.02})
    assert [case.tolerance for case in report.cases] == [Fraction(1, 10), Fraction(0.02)]
    assert [case.verdict for case in report.cases] == ["CONFORMS", "CONFORMS"]
    assert report.to_json()["arguments"]["tolerance"]["eighth"] == "10%"


# -- estimates without a range --------------------------------------------------------------------


def unbounded(pixel, seeds):
    """The pixel's mean plus noise of a normal law: of variance 1/25, without bounds."""
    values, weights = pixel.arrays()
    pair = uniforms(seeds, 2)
    return weights @ values + 0.2 * np.sqrt(-2 * np.log1p(-pair[:, 0])) * np.cos(2 * np.pi * pair[:, 1])


def test_without_a_range_a_bound_on_the_variance_is_needed():
    with pytest.raises(InputError, match=r"no finite range.*variance=v"):
        judge(unbounded, pixels=EIGHTH, tolerance="5%", range=(-math.inf, math.inf))


@pytest.mark.parametrize(("shift", "verdict"), [(0, "CONFORMS"), (0.1, "BIASED"), (-0.1, "BIASED")])
def test_a_bound_on_the_variance_decides(shift, verdict):
    def shifted(pixel, seeds):
        return unbounded(pixel, seeds) + shift

    case = only(judge(shifted, pixels=EIGHTH, tolerance="3%", range=("-inf", "inf"), variance="1/20", seed=3))
    assert case.verdict == verdict
    assert case.bias_interval[0] <= shift <= case.bias_interval[1]
    assert math.isclose(case.std, 0.2, rel_tol=0.1)
    assert case.range == (-math.inf, math.inf)
    assert shift >= 0 or "below" in case.reason


def test_an_infinite_output_breaks_even_without_a_range():
    def diverges(pixel, seeds):
        return np.where(uniforms(seeds, 1)[:, 0] < 0.05, math.inf, unbounded(pixel, seeds))

    case = only(judge(diverges, pixels=EIGHTH, tolerance="3%", range=("-inf", "inf"), variance=1))
    assert (case.verdict, "inf for seed" in case.reason) == (Verdict.BROKEN, True)


# -- what is declared -----------------------------------------------------------------------------


def with_prediction(estimator, **predicted):
    def subject(pixel, seeds):
        return estimator(pixel, seeds)

    subject.predicts = lambda pixel: predicted
    return subject


def test_a_bias_as_declared_reads_differently_from_another():
    declared = only(judge(kirk_arvo, pixels=EIGHTH, tolerance="1%", declares=("kirk-arvo", {"n": 8})))
    other = only(judge(kirk_arvo, pixels=EIGHTH, tolerance="1%", declares=("fixed", {"n": 8})))
    assert declared.verdict is other.verdict is Verdict.BIASED
    assert "biased as declared: its plan has the bias -0.04295" in declared.reason
    assert "not as declared: its plan has the bias 0, within the tolerance" in other.reason


def test_measured_deviation_and_cost_stand_beside_the_declared():
    subject = Together(fixed)
    subject.costs = lambda pixel, seeds: np.full(seeds.size, 9.0)
    case = only(judge(subject, pixels=EIGHTH, tolerance="2%", declares=("fixed", {"n": 8})))
    assert (case.declared_cost, case.cost) == (8, 9)
    assert math.isclose(case.declared_std, math.sqrt(7 / 64 / 8))
    assert math.isclose(case.std, case.declared_std, rel_tol=0.2)


def test_a_mean_alone_may_be_declared():
    right = only(judge(with_prediction(fixed, mean="1/8"), pixels=EIGHTH, tolerance="2%"))
    wrong = only(judge(with_prediction(fixed, mean="1/4"), pixels=EIGHTH, tolerance="2%"))
    assert (right.plan_check, wrong.plan_check) == (PlanCheck.FOLLOWS, PlanCheck.DEVIATES)
    assert "the estimates have another mean than declared" in wrong.reason
    assert right.declared_std is None


def test_an_estimator_noisier_than_declared_is_no_bias():
    quiet, loud = {"mean": "1/8", "variance": "7/512"}, {"mean": "1/8", "variance": "7/2048"}
    follows = only(judge(with_prediction(fixed, **quiet), pixels=EIGHTH, tolerance="2%"))
    noisier = only(judge(with_prediction(fixed, **loud), pixels=EIGHTH, tolerance="2%"))
    assert follows.verdict is noisier.verdict is Verdict.CONFORMS
    assert (follows.plan_check, noisier.plan_check) == (PlanCheck.FOLLOWS, PlanCheck.DEVIATES)
    assert "noisier than declared" in noisier.reason


def test_a_law_may_be_declared_without_a_plan():
    law = {Fraction(i, 8): Fraction(math.comb(8, i) * 7 ** (8 - i), 8**8) for i in range(9)}
    case = only(judge(with_prediction(fixed, law=law), pixels=EIGHTH, tolerance="2%"))
    assert (case.plan_check, case.declared_bias, case.verdict) == (PlanCheck.FOLLOWS, 0, Verdict.CONFORMS)


@pytest.mark.parametrize(
    ("predicted", "message"),
    [
        ({"law": {0: "1/2", 1: "1/3"}}, "sum to 5/6, not to 1"),
        ({"law": {}}, "law={}"),
        ({"bias": 0}, "return a mapping with any of"),
        ({"mean": math.nan}, "mean=nan"),
    ],
)
def test_a_prediction_that_cannot_be_meant(predicted, message):
    with pytest.raises((InputError, InputTypeError), match=message):
        judge(with_prediction(fixed, **predicted), pixels=EIGHTH, tolerance="2%")


def test_a_suspect_is_found_sooner_and_never_convicted_for_being_suspected():
    pixels = {"eighth": Pixel({0: "11/20", 1: "9/20"})}
    alone, suspected = (
        np.median([only(judge(kirk_arvo, pixels=pixels, tolerance=0, suspects=s, seed=i)).replicates for i in range(7)])
        for s in ([], [("kirk-arvo", {"n": 8})])
    )
    assert suspected < alone
    assert only(judge(fixed, pixels=EIGHTH, tolerance="2%", suspects=["kirk-arvo"])).verdict is Verdict.CONFORMS


# -- seeds ----------------------------------------------------------------------------------------


def test_the_same_seed_must_give_the_same_estimate():
    rng = np.random.default_rng(4)
    with pytest.raises(SubjectError, match=r"for the same seed [0-9]+: take every random number from the seed"):
        judge(lambda pixel, seeds: rng.random(seeds.size), pixels=EIGHTH, tolerance="1%")


@pytest.mark.parametrize("value", [0.125, 0.25])
def test_different_seeds_must_differ_somewhere_unless_declared_otherwise(value):
    def one(pixel, seeds):
        return np.full(seeds.size, value)

    with pytest.raises(SubjectError, match="declare deterministic = True"):
        judge(one, pixels=EIGHTH, tolerance="1%")
    verdict = Verdict.CONFORMS if value == 0.125 else Verdict.BIASED
    assert judge(one, pixels=EIGHTH, tolerance="1%", deterministic=True).verdict is verdict
    one.deterministic = True
    assert judge(one, pixels=EIGHTH, tolerance="1%").verdict is verdict


def test_pixels_too_still_to_tell_raise_no_alarm():
    dark = {"rare": Pixel.two("1/1000")}
    assert only(judge(lambda p, s: draws(p, s, 1)[:, 0], pixels=dark, tolerance="1%")).verdict is Verdict.CONFORMS


# -- many pixels ----------------------------------------------------------------------------------


def brighter(pixel, seeds):
    return np.where(uniforms(seeds, 1)[:, 0] < 0.53, 1.0, 0.0)


def test_independent_pixels_add_up():
    pixels = {f"box#{i % 8},{i // 8}": Pixel.two("1/2") for i in range(64)}
    alone = judge(brighter, pixels=pixels, tolerance=0, budget=400)
    together = judge(brighter, pixels=pixels, tolerance=0, budget=400, independent=True)
    assert (alone.verdict, together.verdict) == ("INCONCLUSIVE", "BIASED")
    assert "somewhere" in together.reason
    assert any("independent by declaration" in note for note in together.notes)


def test_pixels_of_one_render_are_not_independent():
    with pytest.raises(InputError, match="rendered together"):
        judge(Together(fixed), tolerance="1%", pixels=EIGHTH | HALF, independent=True)


def test_independent_colours_are_one_pixel_each():
    report = judge(fixed, pixels=COLOUR | EIGHTH, tolerance="3%", independent=True)
    assert report.verdict is Verdict.CONFORMS


def test_regions_say_what_they_could_see():
    pixels = {f"box#{i % 4},{i // 4}": Pixel.two("1/2") for i in range(8)}

    def left_is_brighter(pixel, seeds):
        return (brighter if pixel in left else lambda p, s: draws(p, s, 1)[:, 0])(pixel, seeds)

    pixels["box#0,0"] = pixels["box#1,0"] = Pixel({0: "1/2", 1: "1/2"})
    left = [pixels["box#0,0"]]
    report = judge(left_is_brighter, pixels=pixels, tolerance=0, budget=20_000, regions=2)
    found = {region.name: region for region in report.regions}
    assert [region.biased for region in found.values()] == [True, False]
    assert set(found) == {"tile 0,0", "tile 1,0"}
    quiet = found["tile 1,0"]
    assert 0.005 < quiet.visible < quiet.visible_alone < 0.05
    named = judge(fixed, pixels=EIGHTH | HALF, tolerance="3%", regions={"all": ["eighth", "half"]})
    assert named.to_json()["regions"][0]["cases"] == 2


# -- methods --------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_every_method_finds_a_large_bias_and_passes_the_unbiased(method):
    biased = judge(kirk_arvo, pixels=EIGHTH, tolerance=0, method=method)
    honest = judge(fixed, pixels=EIGHTH, tolerance="5%", method=method, seed=2)
    assert (biased.verdict, honest.verdict) == ("BIASED", "CONFORMS")
    assert method == "focus" or any(METHODS[method].guarantee in note for note in honest.notes)
    assert ("NOT valid" in str(honest.notes)) == (method == "welch")


# -- levels ---------------------------------------------------------------------------------------


def test_the_last_of_many_biased_cases_is_asked_as_if_it_were_alone():
    def subject(pixel, seeds):
        return brighter(pixel, seeds) if pixel.mean == Fraction(1, 2) else kirk_arvo(pixel, seeds)

    pixels = {str(i): Pixel.two("1/8") for i in range(10)} | HALF
    last = judge(subject, pixels=pixels, tolerance=0).cases[-1]
    assert (last.verdict, "where e^4.6 is asked" in last.reason) == (Verdict.BIASED, True)  # log(1 / 0.01)


def test_independence_and_a_declaration_take_half_of_alpha_each():
    alone, half, quarter = (
        only(judge(kirk_arvo, pixels=EIGHTH, tolerance=0, **given)).reason
        for given in ({}, {"independent": True}, {"independent": True, "declares": ("fixed", {"n": 8})})
    )
    assert "e^4.6 is asked" in alone  # log(100)
    assert "e^5.3 is asked" in half  # log(200)
    assert "e^6.0 is asked" in quarter  # log(400)


def test_independent_pixels_may_all_be_declined():
    def declines(pixel, seeds):
        raise Unsupported("no light")

    report = judge(declines, pixels=EIGHTH | HALF, tolerance="1%", independent=True)
    assert (report.verdict, len(report.skipped)) == (Verdict.INCONCLUSIVE, 2)


@pytest.mark.parametrize("given", [{"method": "mixture"}, {"suspects": ["kirk-arvo"]}, {"independent": True}])
def test_a_plan_stands_beside_only_what_it_models(given):
    asked = {"pixels": EIGHTH, "declares": ("fixed", {"n": 8})}
    report, plain = (judge(fixed, tolerance="5%", **asked, **more) for more in (given, {}))
    assert planned(report, fixed, *asked.values()).plan is None
    assert planned(plain, fixed, *asked.values()).plan.cases[0].conforms > 10
    assert planned(plain, fixed, EIGHTH).plan is None  # nothing is declared
