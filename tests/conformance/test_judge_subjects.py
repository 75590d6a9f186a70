"""Whatever a subject does wrong is told from a bias, and the evidence before it is kept."""

import math
from fractions import Fraction

import numpy as np
import pytest
from tests.conformance.estimators import COLOUR, EIGHTH, Together, breaking, draws, fixed, kirk_arvo, only, uniforms

from truemean.conformance import Verdict, judge
from truemean.errors import InputTypeError, SubjectError, Unsupported
from truemean.oracle.pixel import Pixel

# -- subjects that break --------------------------------------------------------------------------


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

    fresh = [1] * 5  # four calls to check the seeds, and the first look
    report = judge(tired, pixels=EIGHTH, tolerance="1%")
    assert only(report).reason == "declined after 16 replicates: enough"
    assert (report.verdict, report.skipped) == (Verdict.BROKEN, {})


def test_many_pixels_are_rendered_at_once_from_the_same_seeds():
    subject = Together(kirk_arvo)
    report = judge(subject, tolerance="2%")
    assert [case.name for case in report.cases] == ["eighth", "colour[0]", "colour[1]", "colour[2]", "quarter"]
    assert [report.cases[i].verdict for i in (0, 4)] == ["BIASED", "BIASED"]
    assert {number for number, _ in subject.calls} == {2}
    seeds = [seed for _, batch in subject.calls[3:] for seed in batch]  # after the seeds were checked
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


# -- what a subject says of itself -----------------------------------------------------------------


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
        return lambda *arguments: np.zeros(np.size(arguments[-1]))


@pytest.mark.parametrize("name", ["pixels", "declares", "versions", "seed_bits", "name", "run_many"])
def test_a_subject_that_crashes_when_asked_about_itself_is_to_blame(name):
    with pytest.raises(
        SubjectError, match=f"{name} crashed with LookupError: no such thing .*test_judge_subjects.py, line"
    ):
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
    case = only(judge(Failing("costs", after=7), pixels=EIGHTH, tolerance="1%"))
    # Four calls to check the seeds, then looks at 16, 17 and 18.
    assert (case.verdict, case.replicates) == (Verdict.BROKEN, 18)
