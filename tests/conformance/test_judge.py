"""Planted subjects are judged rightly, and whatever a subject does wrong is told from a bias."""

import json
import math
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

from truemean.conformance import PlanCheck, Verdict, judge, standard_pixels
from truemean.errors import InputError, InputTypeError, PlanError, SubjectError, TruemeanError, UnknownName, Unsupported
from truemean.oracle.pixel import Pixel
from truemean.oracle.plans import find_plan

EIGHTH = {"eighth": Pixel.two("1/8")}
COLOUR = {"colour": Pixel({(1, 0, 0): "1/2", (0, 1, 0): "1/4", (0, 0, 1): "1/4"})}


def uniforms(seeds, number):
    """Numbers in [0, 1), ``[seeds, number]``, by splitmix64: the same for the same seed in any batch."""
    z = (seeds.astype(np.uint64)[:, None] << np.uint64(8)) + np.arange(number, dtype=np.uint64)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        z = (z ^ (z >> np.uint64(shift))) * np.uint64(factor)
    return (z ^ (z >> np.uint64(31))) / 2**64


def draws(pixel, seeds, number):
    values, weights = pixel.arrays()
    return values[np.minimum(np.searchsorted(np.cumsum(weights), uniforms(seeds, number), "right"), len(weights) - 1)]


def fixed(pixel, seeds):
    return draws(pixel, seeds, 8).mean(axis=1)


def kirk_arvo(pixel, seeds):
    sample = draws(pixel, seeds, 8)
    values, weights = pixel.arrays()
    easy = (sample == sample[:, :1]).reshape(seeds.size, -1).all(axis=1)
    return np.where(easy.reshape(-1, *[1] * (values.ndim - 1)), sample[:, 0], weights @ values)


def only(report):
    (case,) = report.cases
    return case


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
    outputs = np.concatenate(seen)
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
    wrong = only(
        judge(lambda pixel, seeds: np.full(seeds.size, 0.4), pixels=constant, tolerance=tolerance, range=(0.4, 0.4))
    )
    assert wrong.verdict is Verdict.BIASED


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
    reports = [
        judge(Together(brighter), pixels=pixels, tolerance=0, budget=budget) for budget in (100, 1000, 1200, 3000)
    ]
    assert [report.verdict for report in reports] == ["INCONCLUSIVE", "BIASED", "BIASED", "BIASED"]
    named = [sum(case.verdict is Verdict.BIASED for case in report.cases) for report in reports]
    assert named == [0, 0, 0, 10]
    assert reports[1].reason == "biased somewhere; no single pixel is named at this alpha"


def test_the_levels_are_shared_by_all_cases():
    one = only(judge(kirk_arvo, pixels=EIGHTH, tolerance=0))
    many = judge(kirk_arvo, pixels={str(i): Pixel.two("1/8") for i in range(50)}, tolerance=0)
    assert all(case.evidence["below"] >= math.log(2 * 50 / 0.01) for case in many.cases)
    assert math.log(2 / 0.01) <= one.evidence["below"] < math.log(2 * 50 / 0.01)


# -- symmetry and repetition ----------------------------------------------------------------------


@pytest.mark.parametrize("estimator", [fixed, kirk_arvo])
def test_mirrored_values_give_mirrored_results(estimator):
    pixel = Pixel({0: "5/8", "1/4": "1/4", 1: "1/8"})
    mirror = Pixel({1: "5/8", "3/4": "1/4", 0: "1/8"})
    case, other = (only(judge(estimator, pixels=p, tolerance="1%", budget=1000)) for p in (pixel, mirror))
    assert (case.verdict, case.replicates) == (other.verdict, other.replicates)
    assert np.allclose(case.bias_interval, [-end for end in reversed(other.bias_interval)], atol=1e-9)
    assert math.isclose(case.evidence["above"], other.evidence["below"], abs_tol=1e-9)


def test_scale_and_offset_do_not_matter():
    case = only(judge(fixed, pixels=Pixel.two("1/4"), tolerance="1%"))
    other = only(judge(fixed, pixels=Pixel({-3: "3/4", 5: "1/4"}), tolerance="1%"))
    assert (case.verdict, case.replicates) == (other.verdict, other.replicates)
    assert np.allclose(np.multiply(case.bias_interval, 8), other.bias_interval, atol=1e-6)


def test_the_same_seed_gives_the_same_report_and_another_other_replicates():
    reports = [judge(fixed, pixels=EIGHTH, tolerance="1%", seed=seed) for seed in (1, 1, 2)]
    assert reports[0].cases == reports[1].cases
    assert reports[0].cases[0].mean != reports[2].cases[0].mean


def test_no_seed_is_used_twice():
    used = []

    def recording(pixel, seeds):
        used.extend(seeds.tolist())
        return fixed(pixel, seeds)

    judge(recording, tolerance="1%", budget=700)
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
    looks = np.cumsum(batches)
    assert looks[0] == 16
    assert looks[-1] == 1000
    assert all(later <= math.ceil(1.1 * look) for look, later in pairwise(looks))
    assert len(looks) < 60


def test_decided_pixels_leave_their_budget_to_the_others():
    pixels = {"easy": Pixel({"1/2": 1}), "hard": Pixel.two("1/2")}
    cases = {case.pixel: case for case in judge(fixed, pixels=pixels, tolerance="0.1%", budget=1000).cases}
    assert cases["easy"].replicates == 16
    assert cases["hard"].replicates == 2000 - 16


# -- subjects that break --------------------------------------------------------------------------


def breaking(value, after=100):
    drawn = {}

    def broken(pixel, seeds):
        estimates = np.array(fixed(pixel, seeds))
        drawn[id(pixel)] = drawn.get(id(pixel), 0) + seeds.size
        if drawn[id(pixel)] > after:
            estimates[-1] = value
        return estimates

    return broken


@pytest.mark.parametrize(
    ("value", "reason"), [(math.nan, "NaN"), (math.inf, "inf"), (1.01, "outside its range"), (-2.0, "-2.0")]
)
def test_an_output_that_is_no_estimate_breaks_the_pixel_and_keeps_its_evidence(value, reason):
    case = only(judge(breaking(value), pixels=EIGHTH, tolerance="1%"))
    assert case.verdict is Verdict.BROKEN
    assert reason in case.reason
    assert "for seed" in case.reason
    assert 0 < case.replicates <= 100
    assert case.mean is not None
    assert case.bias_interval[0] > -0.125


def test_one_bad_channel_breaks_the_whole_pixel():
    def broken(pixel, seeds):
        estimates = fixed(pixel, seeds)
        estimates[3, 2] = math.nan
        return estimates

    assert [case.verdict for case in judge(broken, pixels=COLOUR, tolerance="1%").cases] == ["BROKEN"] * 3


def test_a_crash_breaks_only_its_pixel():
    def crashing(pixel, seeds):
        if pixel is not EIGHTH["eighth"]:
            raise RuntimeError("no light")
        return fixed(pixel, seeds)

    report = judge(crashing, pixels=EIGHTH | {"quarter": Pixel.two("1/4")}, tolerance="3%")
    assert [case.verdict for case in report.cases] == ["CONFORMS", "BROKEN"]
    assert report.cases[1].reason.startswith("run(pixel, seeds) crashed with RuntimeError: no light (")
    assert (report.cases[1].replicates, report.cases[1].mean, report.cases[1].std) == (0, None, None)
    assert report.verdict is Verdict.BROKEN


def test_a_wrong_shape_breaks():
    report = judge(lambda pixel, seeds: np.zeros((seeds.size, 3)), pixels=EIGHTH, tolerance="1%")
    assert "shape (16, 3) for 16 seeds, expected (16,)" in report.reason


def test_a_crashing_range_breaks():
    def subject(pixel, seeds):
        return fixed(pixel, seeds)

    subject.range = lambda pixel: 1 / 0
    assert "range(pixel) crashed with ZeroDivisionError" in only(judge(subject, pixels=EIGHTH, tolerance="1%")).reason


def test_a_verdict_once_reached_stays_whatever_comes_later():
    report = judge(breaking(math.nan, after=2000), pixels={"half": Pixel.two("1/2"), **COLOUR}, tolerance="3%")
    assert {case.verdict for case in report.cases} == {Verdict.CONFORMS}


def test_outputs_within_the_slack_are_clipped_and_the_slack_counts():
    def rounded(pixel, seeds):
        return np.where(uniforms(seeds, 1)[:, 0] < 0.5, -5e-7, 1 + 5e-7)

    half = {"half": Pixel.two("1/2")}
    assert only(judge(rounded, pixels=half, tolerance="5%")).verdict is Verdict.BROKEN
    rounded.rounding = 1e-6
    case = only(judge(rounded, pixels=half, tolerance="5%"))
    assert case.verdict is Verdict.CONFORMS
    assert only(judge(rounded, pixels=half, tolerance=5e-7, budget=100)).verdict is Verdict.INCONCLUSIVE


def test_rounding_on_top_of_a_large_offset_is_no_range_violation():
    offset = Pixel({10**8: "1/2", 10**8 + 1: "1/2"})
    almost = lambda pixel, seeds: np.nextafter(draws(pixel, seeds, 1)[:, 0], np.inf)  # noqa: E731 - one line is clearer
    assert only(judge(almost, pixels=offset, tolerance="5%")).verdict is Verdict.CONFORMS


# -- what a subject may bring ---------------------------------------------------------------------


def test_declined_pixels_are_skipped_with_the_reason():
    def grey_only(pixel, seeds):
        if pixel.channels:
            raise Unsupported("no colours")
        return fixed(pixel, seeds)

    report = judge(grey_only, pixels=EIGHTH | COLOUR, tolerance="3%")
    assert report.skipped == {"colour": "no colours"}
    assert [case.pixel for case in report.cases] == ["eighth"]
    assert report.verdict is Verdict.CONFORMS
    nothing = judge(grey_only, pixels=COLOUR, tolerance="3%")
    assert (nothing.verdict, nothing.reason) == (Verdict.INCONCLUSIVE, "every pixel was skipped")


def test_declining_halfway_is_breaking():
    def tired(pixel, seeds):
        if seeds.size > 16 or not fresh:
            raise Unsupported("enough")
        fresh.pop()
        return fixed(pixel, seeds)

    fresh = [1]
    report = judge(tired, pixels=EIGHTH, tolerance="1%")
    assert only(report).reason == "declined after 16 replicates: enough"
    assert (report.verdict, report.skipped) == (Verdict.BROKEN, {})


class Together:
    """Renders many pixels at once, from the same seeds."""

    name = "together"
    versions = {"renderer": "1.2"}  # noqa: RUF012 - a fake

    def __init__(self, estimator):
        self.estimator, self.calls = estimator, []

    def run(self, pixel, seeds):
        return self.estimator(pixel, seeds)

    def run_many(self, pixels, seeds):
        self.calls.append((len(pixels), seeds.tolist()))
        return np.stack([self.estimator(pixel, seeds) for pixel in pixels], axis=1)

    def costs(self, pixel, seeds):
        return np.where(seeds % 2, 8, 4)

    def pixels(self):
        return EIGHTH | COLOUR | {"quarter": Pixel.two("1/4")}


def test_many_pixels_are_rendered_at_once_from_the_same_seeds():
    subject = Together(kirk_arvo)
    report = judge(subject, tolerance="2%")
    assert [case.name for case in report.cases] == ["eighth", "colour[0]", "colour[1]", "colour[2]", "quarter"]
    assert [report.cases[i].verdict for i in (0, 4)] == ["BIASED", "BIASED"]
    assert {number for number, _ in subject.calls} == {2}
    seeds = [seed for _, batch in subject.calls for seed in batch]
    assert len(set(seeds)) == len(seeds)
    assert all(abs(case.cost - 6) < 1 for case in report.cases)
    assert (report.subject, report.versions["renderer"]) == ("together", "1.2")


def test_a_bad_output_breaks_only_its_pixel_of_a_render():
    def nan_on_quarters(pixel, seeds):
        return fixed(pixel, seeds) if pixel.mean == Fraction(1, 8) else np.full(seeds.size, math.nan)

    report = judge(Together(nan_on_quarters), pixels=EIGHTH | {"quarter": Pixel.two("1/4")}, tolerance="3%")
    assert [case.verdict for case in report.cases] == ["CONFORMS", "BROKEN"]


class Bare:
    """A pixel as an adapter may bring it, without the oracle."""

    values, weights = (0, 1), ("7/8", "1/8")

    def arrays(self):
        return np.array([0.0, 1.0]), np.array([0.875, 0.125])


def test_pixels_of_an_adapter_need_values_and_weights_only():
    assert only(judge(fixed, pixels={"bare": Bare()}, tolerance="3%")).true_mean == Fraction(1, 8)
    with pytest.raises(InputTypeError, match=r"pixels\['x'\]=3"):
        judge(fixed, pixels={"x": 3}, tolerance="3%")


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


class Failing:
    """Draws like `fixed`; what it says of itself under one name crashes."""

    def __init__(self, name, after=0):
        self.failing, self.left = name, after

    def run(self, pixel, seeds):
        return fixed(pixel, seeds)

    def __getattr__(self, name):
        if name != self.__dict__["failing"]:
            raise AttributeError(name)
        self.left -= 1
        if self.left < 0:
            raise LookupError("no such thing")
        return lambda *arguments: np.zeros(1)


@pytest.mark.parametrize("name", ["pixels", "declares", "versions", "seed_bits", "name", "run_many"])
def test_a_subject_that_crashes_when_asked_about_itself_is_to_blame(name):
    with pytest.raises(SubjectError, match=f"{name} crashed with LookupError: no such thing .*test_judge.py, line"):
        judge(Failing(name), tolerance="1%")


def test_pixels_that_crash_are_the_subjects_fault():
    subject = Together(fixed)
    subject.pixels = lambda: 1 / 0
    with pytest.raises(SubjectError, match=r"pixels\(\) crashed with ZeroDivisionError"):
        judge(subject, tolerance="1%")


@pytest.mark.parametrize("name", ["range", "rounding", "costs"])
def test_a_crash_on_a_pixel_is_its_verdict(name):
    case = only(judge(Failing(name), pixels=EIGHTH, tolerance="1%"))
    assert (case.verdict, f"{name} crashed with LookupError" in case.reason) == (Verdict.BROKEN, True)


def test_the_evidence_before_costs_crash_is_kept():
    case = only(judge(Failing("costs", after=3), pixels=EIGHTH, tolerance="1%"))
    assert (case.verdict, case.replicates) == (Verdict.BROKEN, 20)  # looks at 16, 18 and 20


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
        ({"range": (0, math.inf)}, "range=inf"),
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
