"""Planted subjects are judged rightly, whatever the pixel, the seed and the budget."""

import json
import math
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from tests.conformance.estimators import COLOUR, EIGHTH, Together, breaking, fixed, kirk_arvo, only, uniforms

from truemean.conformance import PlanCheck, Verdict, judge, standard_pixels
from truemean.errors import InputError, InputTypeError, PlanError, TruemeanError, UnknownName
from truemean.oracle.pixel import Pixel
from truemean.oracle.plans import find_plan

SEED_CHECK = (
    4  # calls before the run: the first seeds twice, another batch between, and once more to see that estimates vary
)

# -- verdicts -------------------------------------------------------------------------------------


def test_an_unbiased_estimator_conforms_everywhere():
    report = judge(fixed, tolerance="2%", seed=7)
    assert report.verdict is Verdict.CONFORMS
    assert len(report.cases) == 10 + 3
    assert {case.pixel for case in report.cases} == set(standard_pixels())
    for case in report.cases:
        lower, upper = case.bias_interval
        assert -float(case.tolerance) <= lower <= 0 <= upper <= float(case.tolerance)
        assert case.bias_bound == max(-lower, upper)
        assert case.plan_check is case.cost is case.predicted is None


def test_the_bias_of_figure_1_is_found_with_its_sign():
    report = judge(kirk_arvo, tolerance="1%", seed=7)
    assert report.verdict is Verdict.BIASED
    by_name = {case.name: case for case in report.cases}
    for name, sign in (("eighth", -1), ("quarter", -1), ("three-quarters", 1), ("seven-eighths", 1)):
        case = by_name[name]
        white = case.true_mean
        bias = white**8 * (1 - white) + (1 - white) ** 8 * (0 - white)
        assert case.verdict is Verdict.BIASED
        assert case.bias_interval[0] <= bias <= case.bias_interval[1]
        assert sign * case.bias_interval[0] > 0
        assert ("above" if sign > 0 else "below") in case.reason
    assert by_name["half"].verdict is Verdict.CONFORMS  # by symmetry its bias is 0
    assert "of 13 cases BIASED" in report.reason


def test_mean_and_deviation_are_those_of_the_replicates():
    seen = []

    def recording(pixel, seeds):
        seen.append(10**8 + uniforms(seeds, 1)[:, 0])
        return seen[-1]

    pixel = Pixel({10**8: "1/2", 10**8 + 1: "1/2"})
    case = only(judge(recording, pixels=pixel, tolerance="1%", budget=5000))
    outputs = np.concatenate(seen[SEED_CHECK:])
    assert case.replicates == outputs.size
    assert math.isclose(case.mean - 10**8, (outputs - 10**8).mean(), rel_tol=1e-6)
    assert math.isclose(case.std, (outputs - 10**8).std(ddof=1), rel_tol=1e-6)


def test_a_bias_as_large_as_the_tolerance_is_neither_found_nor_excused():
    case = only(
        judge(lambda pixel, seeds: fixed(Pixel.two("1/4"), seeds), pixels=EIGHTH, tolerance="1/8", budget=20_000)
    )
    assert case.verdict is Verdict.INCONCLUSIVE
    assert case.replicates == 20_000
    assert case.bias_interval[0] < 0.125 < case.bias_bound


def test_inconclusive_says_what_could_be_certified_and_what_it_would_take():
    first = only(judge(fixed, pixels=EIGHTH, tolerance="1%", budget=500))
    assert first.verdict is Verdict.INCONCLUSIVE
    assert f"{first.bias_bound:.4g}" in first.reason
    assert str(first.predicted) in first.reason
    assert only(judge(fixed, pixels=EIGHTH, tolerance=1.1 * first.bias_bound, budget=500)).verdict is Verdict.CONFORMS
    decided = only(judge(fixed, pixels=EIGHTH, tolerance="1%"))
    assert first.predicted / 3 < decided.replicates < first.predicted * 3


def test_tolerance_zero_hunts_for_bias_only():
    biased = judge(kirk_arvo, pixels=EIGHTH, tolerance=0)
    assert biased.verdict is Verdict.BIASED
    assert any("CONFORMS can't be reached" in note for note in biased.notes)
    assert judge(fixed, pixels=EIGHTH, tolerance=0, budget=5000).verdict is Verdict.INCONCLUSIVE


@pytest.mark.parametrize("tolerance", [0, "1%"])
def test_a_range_of_one_point_is_settled_by_the_first_look(tolerance):
    constant = {"constant": Pixel({"1/3": 1})}
    case = only(judge(fixed, pixels=constant, tolerance=tolerance))
    assert (case.verdict, case.replicates) == (Verdict.CONFORMS, 16)
    off = only(judge(lambda pixel, seeds: np.full(seeds.size, 0.4), pixels=constant, tolerance=tolerance))
    assert off.verdict is Verdict.BROKEN
    with pytest.raises(InputError, match="does not contain its true mean 1/3"):
        judge(fixed, pixels=constant, tolerance=tolerance, range=(0.4, 0.4))


def test_what_the_range_implies_needs_no_evidence():
    assert only(judge(fixed, pixels=EIGHTH, tolerance=1)).replicates == 16


def test_a_tight_range_decides_sooner():
    def nearly(pixel, seeds):
        return 0.126 + 0.001 * uniforms(seeds, 1)[:, 0]

    wide = only(judge(nearly, pixels=EIGHTH, tolerance="0.05%"))
    nearly.range = lambda pixel: ("0.12", "0.13")
    tight = only(judge(nearly, pixels=EIGHTH, tolerance="0.05%"))
    assert wide.verdict is tight.verdict is Verdict.BIASED
    assert tight.replicates * 10 < wide.replicates
    assert tight.range == (Fraction("0.12"), Fraction("0.13"))


def test_colours_are_judged_by_channel():
    def green_is_dim(pixel, seeds):
        return fixed(pixel, seeds) * [1, 0.5, 1]

    report = judge(green_is_dim, pixels=COLOUR, tolerance="3%")
    assert [case.channel for case in report.cases] == [0, 1, 2]
    assert [case.true_mean for case in report.cases] == [Fraction(1, 2), Fraction(1, 4), Fraction(1, 4)]
    assert [case.verdict for case in report.cases] == ["CONFORMS", "BIASED", "CONFORMS"]
    assert report.reason.startswith("1 of 3 cases BIASED; colour[1]")


def test_small_biases_in_many_pixels_are_one_bias_somewhere():
    def brighter(pixel, seeds):
        return np.where(uniforms(seeds, 1)[:, 0] < 0.55, 1.0, 0.0)

    pixels = {f"pixel {i}": Pixel.two("1/2") for i in range(10)}
    reports = [judge(Together(brighter), pixels=pixels, tolerance=0, budget=budget) for budget in (100, 700, 720, 1000)]
    assert [report.verdict for report in reports] == ["INCONCLUSIVE", "BIASED", "BIASED", "BIASED"]
    named = [sum(case.verdict is Verdict.BIASED for case in report.cases) for report in reports]
    assert named == [0, 0, 0, 10]
    assert reports[1].reason == "biased somewhere; no single pixel is named at this alpha"
    assert len(reports[1].discoveries) == 10


def test_the_levels_are_shared_by_all_cases():
    one = only(judge(kirk_arvo, pixels=EIGHTH, tolerance=0))
    many = judge(kirk_arvo, pixels={str(i): Pixel.two("1/8") for i in range(50)}, tolerance=0)
    least = sorted(case.evidence["biased"] for case in many.cases)
    # Holm: once k of the 50 are named, the next needs evidence for 50 - k only.
    assert math.log(50 / 0.01) <= least[-1]
    assert all(math.log((i + 1) / 0.01) <= found for i, found in enumerate(least))
    assert math.log(1 / 0.01) <= one.evidence["biased"] < math.log(50 / 0.01)


# -- symmetry and repetition ----------------------------------------------------------------------


@pytest.mark.parametrize("estimator", [fixed, kirk_arvo])
def test_mirrored_values_give_mirrored_results(estimator):
    pixel = Pixel({0: "5/8", "1/4": "1/4", 1: "1/8"})
    mirror = Pixel({1: "5/8", "3/4": "1/4", 0: "1/8"})
    case, other = (only(judge(estimator, pixels=p, tolerance="1%", budget=1000)) for p in (pixel, mirror))
    assert (case.verdict, case.replicates) == (other.verdict, other.replicates)
    assert np.allclose(case.bias_interval, [-end for end in reversed(other.bias_interval)], atol=1e-9)
    assert math.isclose(case.evidence["biased"], other.evidence["biased"], abs_tol=1e-9)


def test_scale_and_offset_do_not_matter():
    case = only(judge(fixed, pixels=Pixel.two("1/4"), tolerance="1%"))
    other = only(judge(fixed, pixels=Pixel({-3: "3/4", 5: "1/4"}), tolerance="1%"))
    assert (case.verdict, case.replicates) == (other.verdict, other.replicates)
    assert np.allclose(np.multiply(case.bias_interval, 8), other.bias_interval, atol=1e-6)


def test_the_same_seed_gives_the_same_report_and_another_other_replicates():
    reports = [judge(fixed, pixels=EIGHTH, tolerance="1%", seed=seed) for seed in (1, 1, 2)]
    assert reports[0].cases == reports[1].cases
    assert reports[0].cases[0].mean != reports[2].cases[0].mean


def test_no_seed_is_used_twice_once_the_seeds_are_checked():
    batches = []

    def recording(pixel, seeds):
        batches.append(seeds.tolist())
        return fixed(pixel, seeds)

    judge(recording, tolerance="1%", budget=700)
    assert batches[0] == batches[2]
    used = [seed for batch in batches[SEED_CHECK:] for seed in batch]
    assert len(used) == len(set(used)) > 5000
    assert 0 <= min(used) <= max(used) < 2**53


def test_few_seed_bits_end_the_run_instead_of_repeating_seeds():
    def small(pixel, seeds):
        assert seeds.max() < 2**8
        return fixed(pixel, seeds)

    small.seed_bits = 8
    case = only(judge(small, pixels=EIGHTH, tolerance=0))
    assert (case.verdict, case.replicates) == (Verdict.INCONCLUSIVE, 256)
    assert "no fresh seed of 8 bits is left" in case.reason


def test_looks_follow_a_geometric_schedule():
    batches = []

    def recording(pixel, seeds):
        batches.append(seeds.size)
        return fixed(pixel, seeds)

    judge(recording, pixels=EIGHTH, tolerance=0, budget=1000)
    looks = np.cumsum(batches[SEED_CHECK:])
    assert looks[0] == 16
    assert looks[-1] == 1000
    assert all(later <= math.ceil(1.05 * look) for look, later in pairwise(looks))
    assert len(looks) < 90


def test_decided_pixels_leave_their_budget_to_the_others():
    pixels = {"easy": Pixel({"1/2": 1}), "hard": Pixel.two("1/2")}
    cases = {case.pixel: case for case in judge(fixed, pixels=pixels, tolerance="0.1%", budget=1000).cases}
    assert cases["easy"].replicates == 16
    assert cases["hard"].replicates == 2000 - 16


# -- ends before the end --------------------------------------------------------------------------


def test_an_interrupt_keeps_what_was_gathered():
    def interrupt(pixel, replicates, undecided):
        if replicates > 100:
            raise KeyboardInterrupt

    report = judge(fixed, pixels=EIGHTH, tolerance="1%", progress=interrupt)
    assert report.interrupted
    assert report.cases[0].verdict is Verdict.INCONCLUSIVE
    assert report.cases[0].reason.startswith("interrupted")
    assert report.cases[0].replicates > 100


def test_a_timeout_ends_the_run_between_batches():
    report = judge(fixed, pixels=EIGHTH | {"half": Pixel.two("1/2")}, tolerance=0, timeout=1e-9)
    assert [case.replicates for case in report.cases] == [16, 0]
    assert "timeout=1e-09, E[ξ] - I lies in" in report.cases[0].reason
    assert report.cases[1].reason == "stopped by timeout=1e-09 before a replicate was drawn"
    assert not report.interrupted


def test_progress_is_told_after_each_look():
    told = []
    judge(fixed, pixels=EIGHTH | {"half": Pixel.two("1/2")}, tolerance="3%", progress=lambda *news: told.append(news))
    assert told[:2] == [("eighth", 16, 2), ("half", 16, 2)]
    assert told[-1][2] == 0


# -- the report -----------------------------------------------------------------------------------


def test_the_report_is_plain_json():
    report = judge(Together(breaking(math.nan)), tolerance="0.5%", budget=1000, seed=np.int64(11), range=("-1/3", 2))
    text = json.dumps(report.to_json(), allow_nan=False)
    back = json.loads(text)
    assert back["schema"] == "truemean-judge/1"
    assert {"python", "numpy", "truemean"} <= set(back["versions"])
    assert (back["seed"], back["arguments"]["tolerance"], back["verdict"]) == (11, "0.5%", "BROKEN")
    first = back["cases"][0]
    assert first["true_mean"] == {"exact": "1/8", "value": 0.125}
    assert [end["exact"] for end in first["range"]] == ["-1/3", "2"]
    assert first["bias_interval"] == list(report.cases[0].bias_interval)
    exact = judge(fixed, pixels=EIGHTH, tolerance=Fraction(1, 3)).to_json()
    assert exact["arguments"]["tolerance"] == {"exact": "1/3", "value": 1 / 3}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"tolerance": -1}, "tolerance=-1 is negative"),
        ({"tolerance": "-1%"}, "tolerance='-1%'"),
        ({"tolerance": "one"}, "tolerance='one'"),
        ({"tolerance": math.nan}, "tolerance=nan"),
        ({"alpha": 0}, "alpha=0"),
        ({"beta": 1.0}, "beta=1.0"),
        ({"budget": 0}, "budget=0"),
        ({"budget": 1e5}, "budget=100000.0"),
        ({"seed": -1}, "seed=-1"),
        ({"timeout": 0}, "timeout=0"),
        ({"range": (1, 0)}, r"range=\(1, 0\) is empty"),
        ({"range": (0, math.inf)}, "no finite range.*variance=v"),
        ({"range": (0, "inf"), "variance": 0}, "variance=0 is no bound"),
        ({"range": ("1/4", 1)}, "does not contain its true mean 1/8"),
        ({"tolerance": {"half": "1%"}}, "no pixel with a tolerance is called 'half'|has none for pixel 'eighth'"),
        ({"tolerance": {"eighth": math.nan}}, "tolerance=nan"),
        ({"method": "students"}, "no method is called 'students'"),
        ({"regions": {"sky": ["cloud"]}}, "no pixel is called 'cloud'"),
        ({"regions": 8}, "'eighth' has no place"),
        ({"suspects": ["kirk-arvoo"]}, "did you mean kirk-arvo"),
        ({"suspects": "kirk-arvoo"}, "did you mean kirk-arvo"),
        ({"range": (0, "inf"), "variance": [1, 1]}, "has 1 channels, give one or as many"),
        ({"range": 3}, "range=3"),
        ({"pixels": {}}, r"pixels=\{\}"),
        ({"pixels": "eighth"}, "pixels='eighth'"),
        ({"pixels": Pixel({0: "1/2", 10**400: "1/2"})}, "a value beyond the floats"),
        ({"declares": 3}, "declares=3"),
    ],
)
def test_arguments_that_cannot_be_meant(arguments, message):
    with pytest.raises(InputError, match=message):
        judge(fixed, **({"tolerance": "1%", "pixels": EIGHTH} | arguments))


def test_what_is_no_estimator():
    with pytest.raises(InputTypeError, match="subject=3"):
        judge(3, tolerance="1%")


# -- declared plans -------------------------------------------------------------------------------


def test_an_estimator_follows_the_plan_it_declares():
    case = only(judge(kirk_arvo, pixels=EIGHTH, tolerance="1%", declares=("kirk-arvo", {"n": 8})))
    assert (case.verdict, case.plan_check) == (Verdict.BIASED, PlanCheck.FOLLOWS)
    assert case.declared_bias == Fraction(1, 8) ** 8 * Fraction(7, 8) - Fraction(7, 8) ** 8 * Fraction(1, 8)


def test_an_estimator_deviates_from_another_plan():
    report = judge(kirk_arvo, pixels=EIGHTH, tolerance="1%", declares=("fixed", {"n": 7}))
    assert report.plan_check is PlanCheck.DEVIATES
    assert report.cases[0].verdict is Verdict.BIASED
    assert "law of the declared plan" in report.cases[0].reason


def test_the_estimators_own_declaration_is_read_and_may_be_overridden():
    def own(pixel, seeds):
        return fixed(pixel, seeds)

    own.declares = ("fixed", {"n": 8})
    assert judge(own, pixels=EIGHTH, tolerance="1%").plan_check is PlanCheck.FOLLOWS
    assert judge(own, pixels=EIGHTH, tolerance="1%", declares=("fixed", {"n": 3})).plan_check is PlanCheck.DEVIATES


def test_a_declared_law_decides_sooner():
    with_law = only(judge(fixed, pixels=EIGHTH, tolerance="0.5%", declares=("fixed", {"n": 8})))
    without = only(judge(fixed, pixels=EIGHTH, tolerance="0.5%"))
    assert with_law.verdict is without.verdict is Verdict.CONFORMS
    assert with_law.replicates < without.replicates


def test_colours_follow_by_channel():
    report = judge(fixed, pixels=COLOUR, tolerance="3%", declares=("fixed", {"n": 8}))
    assert [case.plan_check for case in report.cases] == [PlanCheck.FOLLOWS] * 3


def test_a_plan_of_a_readers_own_is_found_by_file_and_named_by_its_function(tmp_path):
    (tmp_path / "plans_of_judge.py").write_text("def three_draws(X, n=3):\n    return X.draw(n).mean()\n")
    place = f"{tmp_path}/plans_of_judge.py:three_draws"
    report = judge(fixed, pixels=EIGHTH, tolerance="1%", declares=(place, {"n": 7}))
    assert (report.plan_check, report.arguments["declares"]["plan"]) == (PlanCheck.DEVIATES, place)
    report = judge(fixed, pixels=EIGHTH, tolerance="1%", declares=(find_plan(place), {"n": 8}))
    assert (report.plan_check, report.arguments["declares"]["plan"]) == (PlanCheck.FOLLOWS, "three-draws")


def test_a_declared_plan_that_raises_is_wrong_use():
    def divides(X, n=8):
        return X.draw(n).mean() + 1 / (n - 8)

    with pytest.raises(PlanError, match=r"plan 'divides' raised ZeroDivisionError.*test_judge.py, line"):
        judge(fixed, pixels=EIGHTH, tolerance="1%", declares=divides)


def test_an_unknown_plan_is_named():
    with pytest.raises(UnknownName, match="kirk-arvo"):
        judge(fixed, pixels=EIGHTH, tolerance="1%", declares=("kirk-arvoo", {}))
    assert issubclass(UnknownName, TruemeanError)
