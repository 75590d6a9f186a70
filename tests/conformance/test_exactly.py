"""Code whose law is known is judged exactly: no replicates, no statistics, and the verdict at the very edge."""

from __future__ import annotations

import json
import math
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

from truemean.adapters import asking
from truemean.conformance import PlanCheck, Verdict, judge
from truemean.conformance.evidence import METHODS
from truemean.conformance.report import judged_html, judged_markdown
from truemean.errors import InputError, InputTypeError, Unsupported
from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue
from truemean.subject import Exact

SLACK = Fraction(1, 10**9)  # of a pixel of scale 1
EIGHTH = {"eighth": Pixel.two("1/8")}
PIXELS = EIGHTH | {
    "half": Pixel.two("1/2"),
    "thirds": Pixel({0: "1/3", "1/2": "1/3", 1: "1/3"}),
    "colour": Pixel({(1, 0, 0): "1/2", (0, 1, 0): "1/4", (0, 0, 1): "1/4"}),
    "constant": Pixel({"1/3": 1}),
}


class Lawful:
    """An estimator of a given law, which must not be run."""

    name = "lawful"

    def __init__(self, law, **more):
        self.law = law
        self.__dict__.update(more)

    def exact(self, pixel):
        law = self.law(pixel) if callable(self.law) else self.law
        return Exact(law, Fraction(2), 3, "3 paths")

    def run(self, pixel, seeds):
        raise AssertionError("replicates are drawn")


def only(report):
    (case,) = report.cases
    return case


def shifted(bias):
    return Lawful({Fraction(1, 8) + Fraction(bias): 1})


def mean(draw):
    return draw(4).mean(axis=0)


def pooled(draw, m=4):
    S = draw(4)
    return (np.concatenate([S, draw(m)]) if np.ptp(S, axis=0).any() else S).mean(axis=0)


# -- verdicts -------------------------------------------------------------------------------------


def test_an_unbiased_mean_conforms_at_tolerance_0_without_a_replicate():
    report = judge(asking(mean), tolerance=0, pixels=PIXELS)
    assert report.verdict is Verdict.CONFORMS
    assert [case.name for case in report.cases] == [
        "eighth",
        "half",
        "thirds",
        *(f"colour[{c}]" for c in range(3)),
        "constant",
    ]
    for case in report.cases:
        assert (case.replicates, case.predicted, case.evidence, case.cost) == (0, None, {}, 4)
        assert abs(case.exact_bias) < 1e-16
        assert abs(case.mean - float(case.true_mean)) < 1e-15
    assert report.notes == ("all verdicts are exact: every path of the code was run, and nothing is left to chance",)


def test_what_is_found_is_that_of_the_plan():
    case = only(judge(asking(pooled), tolerance="1%", pixels=EIGHTH))
    derivation = derive(catalogue["two-stage-pooled"], EIGHTH["eighth"], n=4, m=4)
    assert case.verdict is Verdict.BIASED
    assert case.reason == "exactly, over 226 sequences of answers: E[ξ] - I = -1197/32768"
    assert case.exact_bias == derivation.bias == Fraction(-1197, 32768)
    assert case.mean == float(derivation.expectation)
    assert case.bias_interval == (float(derivation.bias),) * 2
    assert case.bias_bound == -float(derivation.bias)
    assert math.isclose(case.std, math.sqrt(derivation.variance), rel_tol=1e-14)
    assert case.cost == float(derivation.cost)
    assert case.range == (0, 1)
    assert case.plan_check is case.declared_bias is case.declared_cost is None


@pytest.mark.parametrize("tolerance", [0, "1/100", "1%"])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_bias_is_judged_at_the_very_edge_of_the_tolerance(tolerance, sign):
    edge = (Fraction(1, 100) if tolerance else 0) + SLACK
    at_it = only(judge(shifted(sign * edge), tolerance=tolerance, pixels=EIGHTH))
    beyond = only(judge(shifted(sign * (edge + Fraction(1, 10**30))), tolerance=tolerance, pixels=EIGHTH))
    assert (at_it.verdict, at_it.exact_bias) == (Verdict.CONFORMS, sign * edge)
    assert (beyond.verdict, abs(beyond.exact_bias) - edge) == (Verdict.BIASED, Fraction(1, 10**30))
    low, high = beyond.bias_interval
    assert low <= beyond.exact_bias <= high <= np.nextafter(low, 1)


def test_the_slack_is_the_estimators_own_rounding():
    subject = Lawful({Fraction(1, 8) + Fraction(1, 1000): 1}, rounding="1/1001")
    assert only(judge(subject, tolerance=0, pixels=EIGHTH)).verdict is Verdict.BIASED
    subject.rounding = "1/1000"
    assert only(judge(subject, tolerance=0, pixels=EIGHTH)).verdict is Verdict.CONFORMS


def test_channels_are_judged_apart():
    law = {(1, 0, 0): "1/2", (0, 1, 0): "3/8", (0, 0, 1): "1/8"}
    cases = judge(Lawful(law), tolerance="10%", pixels={"c": PIXELS["colour"]}).cases
    assert [(case.channel, case.exact_bias, str(case.verdict)) for case in cases] == [
        (0, 0, "CONFORMS"),
        (1, Fraction(1, 8), "BIASED"),
        (2, Fraction(-1, 8), "BIASED"),
    ]


@pytest.mark.parametrize("method", METHODS)
def test_what_only_replicates_need_is_harmless(method):
    report = judge(
        asking(pooled),
        tolerance="1%",
        pixels=EIGHTH,
        method=method,
        budget=1,
        seed=3,
        range=(0, 1),
        timeout=1,
        suspects=["two-stage-pooled"],
        regions={"all": ["eighth"]},
        independent=True,
        deterministic=True,
    )
    assert (report.verdict, only(report).replicates) == (Verdict.BIASED, 0)


# -- what is declared -----------------------------------------------------------------------------------


def declaring(code, plan, **params):
    subject = asking(code)
    subject.declares = (plan, params)
    return subject


def test_code_that_follows_its_plan_and_is_biased_as_declared():
    subject = declaring(pooled, "two-stage-pooled", n=4, m=4)
    report = judge(
        subject, tolerance="1%", pixels={name: PIXELS[name] for name in ("eighth", "half", "thirds", "constant")}
    )
    assert {case.plan_check for case in report.cases} == {PlanCheck.FOLLOWS}
    assert report.plan_check is PlanCheck.FOLLOWS
    assert report.cases[0].reason.endswith("E[ξ] - I = -1197/32768; biased as declared")
    for case in report.cases:
        assert case.bias_interval[0] <= case.declared_bias <= case.bias_interval[1]
        assert math.isclose(case.std, case.declared_std, abs_tol=1e-12)
        assert case.cost == float(case.declared_cost)


@pytest.mark.parametrize(
    ("code", "plan", "params", "verdict"),
    [
        (mean, "two-stage-pooled", {"n": 4, "m": 4}, Verdict.CONFORMS),
        (mean, "fixed", {"n": 5}, Verdict.CONFORMS),
        (pooled, "two-stage-pooled", {"n": 4, "m": 5}, Verdict.BIASED),
        (pooled, "fixed", {"n": 8}, Verdict.BIASED),
    ],
)
def test_code_that_does_not_follow_its_plan(code, plan, params, verdict):
    report = judge(declaring(code, plan, **params), tolerance=0, pixels=EIGHTH)
    assert (report.verdict, report.plan_check) == (verdict, PlanCheck.DEVIATES)
    assert report.cases[0].reason.endswith("; the estimates do not have the law of the declared plan")
    assert "as declared" not in report.cases[0].reason


COIN = {0: "7/8", 1: "1/8"}


@pytest.mark.parametrize(
    ("predicted", "follows"),
    [
        ({"law": COIN}, True),
        ({"law": {0: "7/8", "1.000000001": "1/8"}}, True),  # a rounding
        ({"law": {0: "7/8", "1.00000001": "1/8"}}, False),
        ({"law": {0: "7/8", 1: "1/16", "1.000000001": "1/16"}}, True),  # two outcomes that are one but for a rounding
        ({"law": {0: "6/8", 1: "1/8", 2: "1/8"}}, False),
        ({"law": {0: "13/16", "1/2": "1/8", 1: "1/16"}}, False),  # the mean is right
        ({"mean": "1/8"}, True),
        ({"mean": "1/8", "variance": "7/64"}, True),
        ({"mean": "1/8", "variance": "8/64"}, False),
        ({"mean": "1/4"}, False),
        ({"variance": "7/64"}, None),
        ({"cost": 2}, None),
    ],
)
def test_predictions_are_compared_as_far_as_they_go(predicted, follows):
    subject = Lawful(COIN, predicts=lambda pixel: predicted)
    check = only(judge(subject, tolerance="1%", pixels=EIGHTH)).plan_check
    assert check == {True: PlanCheck.FOLLOWS, False: PlanCheck.DEVIATES, None: None}[follows]


# -- pixels that are not judged exactly -------------------------------------------------------------------


def test_pixels_with_too_many_paths_are_sampled_and_share_alpha_among_themselves():
    tones = {f"tones {k}": Pixel({i: Fraction(1, k) for i in range(k)}) for k in (8, 9)}
    report = judge(asking(mean, paths=1000), tolerance="10%", pixels=PIXELS | tones)
    assert report.verdict is Verdict.CONFORMS
    exactly = {case.name: case.exact_bias is not None for case in report.cases}
    assert list(exactly.values()) == [True] * 7 + [False] * 2
    for case in report.cases:
        assert (case.replicates > 0) == (not exactly[case.name])
    assert [note for note in report.notes if "sampled" in note] == [
        f"tones {k}: judged by sampled replicates, not exactly: more than paths=1000 runs would be needed"
        for k in (8, 9)
    ]
    assert any("probability at most 0.01" in note for note in report.notes)
    # Their evidence is asked for as if they were alone.
    alone = judge(asking(mean, paths=1000), tolerance="10%", pixels=tones)
    assert [case.replicates for case in alone.cases] == [case.replicates for case in report.cases[-2:]]
    assert [case.evidence for case in alone.cases] == [case.evidence for case in report.cases[-2:]]


def test_a_tolerance_may_name_any_pixel_of_a_mixed_run():
    pixels = EIGHTH | {"tones": Pixel({i: Fraction(1, 9) for i in range(9)})}
    report = judge(asking(mean, paths=1000), tolerance={"eighth": 0, "tones": "10%"}, pixels=pixels)
    assert report.verdict is Verdict.CONFORMS


def test_a_biased_pixel_may_be_among_the_sampled_ones():
    pixels = {"constant": PIXELS["constant"], "eighth": EIGHTH["eighth"]}
    report = judge(asking(lambda draw: draw(4).sum() / 5, paths=1), tolerance="1%", pixels=pixels)
    assert [(case.verdict, case.replicates > 0) for case in report.cases] == [
        (Verdict.BIASED, False),
        (Verdict.BIASED, True),
    ]


def test_a_path_that_breaks_is_broken_with_its_answers():
    def fails(draw):
        return 1 / (2 - draw() - draw())

    report = judge(asking(fails), tolerance=0, pixels=EIGHTH | {"constant": Pixel({0: 1})})
    broken, other = report.cases
    assert (report.verdict, broken.verdict) == (Verdict.BROKEN, Verdict.BROKEN)
    assert "ZeroDivisionError" in broken.reason
    assert "when its samples were 1, 1" in broken.reason
    assert (broken.replicates, broken.exact_bias, broken.mean) == (0, None, None)
    assert broken.bias_interval == (-0.125, 0.875)
    assert other.verdict is Verdict.BIASED  # 1/2 where the pixel is 0
    json.dumps(report.to_json(), allow_nan=False)


def test_an_outcome_beyond_the_range_that_is_declared_is_broken():
    subject = Lawful(COIN, range=lambda pixel: (0, 0.75))
    case = only(judge(subject, tolerance=0, pixels=EIGHTH))
    assert (case.verdict, case.reason) == (
        Verdict.BROKEN,
        "returns 1.0 on some path, outside its range [0.0, 0.75]",
    )
    assert only(judge(Lawful(COIN), tolerance=0, pixels=EIGHTH, range=(0.1, 2))).verdict is Verdict.BROKEN
    assert only(judge(Lawful(COIN), tolerance=0, pixels=EIGHTH, range=(0, 1))).verdict is Verdict.CONFORMS
    # Where none is declared, the outcomes may lie anywhere; and no bound on the variance is needed for an infinite one.
    wide = {-3: "1/2", "13/4": "1/2"}
    assert only(judge(Lawful(wide), tolerance=0, pixels=EIGHTH)).verdict is Verdict.CONFORMS
    assert only(judge(Lawful(wide), tolerance=0, pixels=EIGHTH, range=("-inf", "inf"))).range == (-3, Fraction(13, 4))


def test_every_channel_of_a_broken_colour_is():
    report = judge(asking(lambda draw: math.nan), tolerance=0, pixels={"c": PIXELS["colour"]})
    assert [(case.channel, str(case.verdict)) for case in report.cases] == [(c, "BROKEN") for c in range(3)]


def test_a_pixel_that_is_declined_is_skipped():
    def scalars_only(pixel, draw):
        if isinstance(pixel.values[0], tuple):
            raise Unsupported("no colours")
        return draw()

    report = judge(asking(scalars_only), tolerance=0, pixels=PIXELS)
    assert report.skipped == {"colour": "no colours"}
    assert {case.pixel for case in report.cases} == set(PIXELS) - {"colour"}
    everything = judge(asking(scalars_only), tolerance=0, pixels={"c": PIXELS["colour"]})
    assert (everything.verdict, everything.skipped) == (Verdict.INCONCLUSIVE, {"c": "no colours"})


def test_an_exact_that_crashes_breaks_its_pixel():
    def crashes(pixel):
        raise RuntimeError("no law")

    report = judge(SimpleNamespace(run=None.__eq__, exact=crashes), tolerance=0, pixels=EIGHTH)
    assert only(report).reason == f"exact(pixel) crashed with {only(report).reason.rpartition('with ')[2]}"
    assert "RuntimeError: no law" in only(report).reason


@pytest.mark.parametrize(
    ("law", "error", "words"),
    [
        ({0: "1/2", 1: "1/3"}, InputError, "sum to 5/6, not to 1"),
        ({}, InputTypeError, "write a mapping"),
        (None, InputTypeError, "write a mapping"),
        ({0: 0.5, 1: 0.5}, InputError, "probability"),
    ],
)
def test_a_law_that_is_none(law, error, words):
    with pytest.raises(error, match=words):
        judge(Lawful(law), tolerance=0, pixels=EIGHTH)


def test_an_exact_must_give_one():
    subject = SimpleNamespace(run=None.__eq__, exact=lambda pixel: {0: 1})
    with pytest.raises(InputTypeError, match=r"exact\(pixel\) gave \{0: 1\} \(type=dict\): return an Exact"):
        judge(subject, tolerance=0, pixels=EIGHTH)


# -- what a reader sees -------------------------------------------------------------------------------------


def test_the_report_in_json_has_the_bias_exactly():
    report = judge(asking(pooled), tolerance="1%", pixels=EIGHTH)
    data = json.loads(json.dumps(report.to_json(), allow_nan=False))
    (case,) = data["cases"]
    assert case["exact_bias"] == {"exact": "-1197/32768", "value": -0.036529541015625}
    assert (case["replicates"], case["evidence"], case["predicted"]) == (0, {}, None)
    assert case["range"] == [{"exact": "0", "value": 0.0}, {"exact": "1", "value": 1.0}]


def test_a_bias_of_roundings_is_told_as_a_number():
    case = only(judge(asking(lambda draw: draw() / 3 * 3 + 0.1), tolerance=0, pixels=EIGHTH))
    assert case.reason.endswith("E[ξ] - I = 0.1")


@pytest.mark.parametrize("declared", [True, False])
def test_the_report_as_a_page(declared):
    subject = declaring(pooled, "two-stage-pooled", n=4, m=4) if declared else asking(pooled)
    tones = {"tones": Pixel({i: Fraction(1, 9) for i in range(9)})}
    subject.paths = 7000
    report = judge(subject, tolerance="1%", pixels=PIXELS | tones, budget=2000)
    html, markdown = judged_html(report), judged_markdown(report)
    for page in (html, markdown):
        assert "1197/32768" in page
        assert "judged by sampled replicates" in page
        assert "nan" not in page.lower().replace("luminance", "")
    assert "<svg" in html
    row = next(line for line in markdown.splitlines() if line.startswith("| eighth"))
    assert ("FOLLOWS" in row) == declared
    assert "BIASED" in row


def test_code_that_asks_is_not_taken_for_one_that_ignores_its_seed():
    levels = {"greys": Pixel({Fraction(i, 99): Fraction(1, 100) for i in range(100)})}

    def fig_1(draw):
        samples = [draw() for _ in range(4)]
        return samples[0] if len(set(samples)) == 1 else 0.5

    report = judge(asking(fig_1, paths=1000), tolerance="5%", pixels=levels, budget=2000)
    assert (report.verdict, report.cases[0].exact_bias) == (Verdict.CONFORMS, None)
