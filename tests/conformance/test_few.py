"""Estimators with so many replicates and no more: each is used once, and then the evidence is what it is."""

from __future__ import annotations

import numpy as np
import pytest
from tests.conformance.estimators import EIGHTH, draws, fixed, only

from truemean.conformance import PlanCheck, Verdict, check_subject, judge
from truemean.conformance.replicates import Few
from truemean.errors import InputError, SubjectError
from truemean.oracle.pixel import Pixel


class Images:
    """So many renders of n samples on disk, by number."""

    name = "images"

    def __init__(self, replicates, n=8, bias=0.0):
        self.replicates, self.n, self.bias, self.seen = replicates, n, bias, []

    def run(self, pixel, seeds):
        self.seen += seeds.tolist()
        assert 0 <= seeds.min() <= seeds.max() < self.replicates
        return draws(pixel, seeds + 7, self.n).mean(axis=1) * (1 - self.bias)


class Frames(Images):
    def run_many(self, pixels, seeds):
        return np.stack([self.run(pixel, seeds) for pixel in pixels], axis=1)

    def pixels(self):
        return EIGHTH | {"half": Pixel.two("1/2"), "colour": Pixel({(1, 0): "1/2", (0, 1): "1/2"})}


# -- the seeds ------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [1, 2, 7, 1000])
def test_every_replicate_is_there_once(number):
    few = Few(3, number)
    pieces = [few.take(start, min(start + 3, number)) for start in range(0, number, 3)]
    assert few.capacity == number
    assert sorted(np.concatenate(pieces).tolist()) == list(range(number))
    assert np.array_equal(np.concatenate(pieces), few.take(0, number))
    assert few.take(0, number).dtype == np.int64
    assert few.spent == f"all {number} replicates are used"


def test_the_seed_picks_their_order():
    first, again, other = (Few(seed, 1000).take(0, 1000).tolist() for seed in (0, 0, 1))
    assert first == again != other


@pytest.mark.parametrize("number", [0, -1, 2.5, "many"])
def test_numbers_that_can_not_be_meant(number):
    with pytest.raises(InputError, match=f"replicates={number!r} must be a whole number from 1 up"):
        Few(0, number)
    with pytest.raises(InputError, match=f"replicates={number!r}"):
        judge(Images(number), tolerance="1%", pixels=EIGHTH)


# -- judging ----------------------------------------------------------------------------------------


def test_a_judgement_ends_when_all_are_used():
    subject = Images(300)
    case = only(judge(subject, tolerance="1%", pixels=EIGHTH, seed=5))
    assert (case.verdict, case.replicates) == (Verdict.INCONCLUSIVE, 300)
    assert case.reason.startswith("all 300 replicates are used, E[ξ] - I lies in [")
    assert sorted(subject.seen[-300:]) == list(range(300))
    assert case.mean == pytest.approx(Images(300).run(EIGHTH["eighth"], np.arange(300)).mean(), rel=1e-12)


def test_a_budget_below_their_number_is_spent_first():
    case = only(judge(Images(300), tolerance="1%", pixels=EIGHTH, budget=100))
    assert (case.replicates, case.reason.startswith("the budget is spent")) == (100, True)


def test_a_verdict_needs_no_more_of_them_than_it_takes():
    report = judge(Images(100_000), tolerance="5%", pixels=EIGHTH)
    assert report.verdict is Verdict.CONFORMS
    assert only(report).replicates < 2000
    biased = judge(Images(100_000, bias=0.5), tolerance="1%", pixels=EIGHTH)
    assert biased.verdict is Verdict.BIASED
    deviating = judge(Images(100_000), tolerance="5%", pixels=EIGHTH, declares=("fixed", {"n": 4}))
    assert deviating.plan_check is PlanCheck.DEVIATES


def test_frames_share_their_replicates():
    report = judge(Frames(200), tolerance="1%")
    assert {case.replicates for case in report.cases} == {200}
    assert [case.name for case in report.cases] == ["eighth", "half", "colour[0]", "colour[1]"]


EQUAL = pytest.mark.xfail(reason="equal by chance, they are taken for an estimator without a seed", strict=True)


@pytest.mark.parametrize("number", [1, 2, 5, 15])
def test_a_handful_says_little_but_breaks_nothing(number):
    case = only(judge(Images(number), tolerance="1%", pixels={"half": Pixel.two("1/2")}))
    assert (case.verdict, case.replicates) == (Verdict.INCONCLUSIVE, number)


def test_many_that_are_one_ignore_their_seeds():
    def one(pixel, seeds):
        return np.full(len(seeds), 0.25)

    one.replicates = 500
    with pytest.raises(SubjectError, match="for every seed"):
        judge(one, tolerance="1%", pixels={"half": Pixel.two("1/2")})


def test_the_number_of_a_function_is_its_attribute():
    def function(pixel, seeds):
        assert seeds.max() < 40
        return fixed(pixel, seeds)

    function.replicates = 40
    assert only(judge(function, tolerance="1%", pixels=EIGHTH)).replicates == 40


# -- checking ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [1, 2, 10, 63, 64, 1000])
def test_they_keep_the_promises_of_an_estimator(number):
    for subject in (Images(number), Frames(number)):
        checks = check_subject(subject)
        assert "all bits of a seed are used" not in {check.promise for check in checks}
        neighbours = {check.kept for check in checks if check.promise == "neighbouring seeds are not correlated"}
        assert neighbours <= {True, None}
        assert (neighbours == {None}) == (2 <= number < 64)


def test_neighbours_that_are_alike_are_found():
    class Pairs(Images):
        def run(self, pixel, seeds):
            return super().run(pixel, seeds // 4)

    with pytest.raises(SubjectError, match="neighbouring seeds are not correlated: half: correlation 0"):
        check_subject(Pairs(1000), pixels={"half": Pixel.two("1/2")})
