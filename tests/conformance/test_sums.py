"""Sums of many replicates as evidence: never more than the replicates themselves would be, and far more than their means.

Runs are from fixed seeds. Of 400 without a bias BIASED may come in 5 %; right code would be caught above 40 of them
by chance with a probability of 1e-5.
"""

from __future__ import annotations

import math
import re
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog
from tests.conformance.estimators import COLOUR, EIGHTH, draws, fixed, only

from truemean.conformance import PlanCheck, Verdict, check_subject, judge
from truemean.conformance.declared import Declared
from truemean.conformance.evidence import Batch, Bets, Blend, Bounded, Mixture, Outcomes, Spread, Sums, edge_of, hybrid
from truemean.conformance.openings import Levels
from truemean.conformance.target import Target
from truemean.conformance.trial import Trial
from truemean.errors import InputError
from truemean.oracle.pixel import Pixel

FRACTIONS = np.array([0.001, 0.1, 0.5, 0.9, 0.99])
LEVELS = Levels(biased=0.05, deviates=0.05, conforms=0.05, budget=10_000)
OUTCOMES = st.lists(st.floats(0, 1) | st.sampled_from([0.0, 1.0, 0.5, 1e-9]), min_size=1, max_size=12)


def sums_of(*groups):
    """Groups of outcomes ``[n]`` as counts, means and mean squares ``[3, groups]``."""
    return np.array([(len(y), np.mean(y), np.mean(np.square(y))) for y in groups]).T


def known(*groups, slack=0.0):
    return Sums(*sums_of(*groups), slack)


def wealth(side, look):
    return Mixture.open(side, Bets.equal(FRACTIONS)).update(look).log_wealths


class Summed:
    """Sums of so many replicates of an estimator a seed, on files that are so few."""

    def __init__(self, estimate=fixed, frames=500, replicates=10, **said):
        self.estimate, self.frames, self.replicates = estimate, frames, replicates
        self.__dict__.update(said)

    def _frames(self, pixel, seeds):
        numbers = (np.asarray(seeds)[:, None] * self.frames + np.arange(self.frames)).ravel()
        found = np.asarray(self.estimate(pixel, numbers), dtype=float)
        return found.reshape(len(seeds), self.frames, *found.shape[1:])

    def run(self, pixel, seeds):
        return self._frames(pixel, seeds).mean(axis=1)

    def sums(self, pixels, seeds):
        frames = np.stack([self._frames(pixel, seeds) for pixel in pixels], axis=2)
        means = frames.mean(axis=1)
        return np.full_like(means, self.frames), means, (frames**2).mean(axis=1)


def means_alone(subject):
    subject.sums = None
    return subject


def darker(pixel, seeds):
    return 0.75 * fixed(pixel, seeds)


# -- the bound ------------------------------------------------------------------------------------


@given(st.lists(OUTCOMES, min_size=1, max_size=4), st.floats(0.01, 0.99), st.sampled_from([1, -1]))
def test_no_constant_bet_wins_more_by_sums_than_by_the_outcomes(groups, edge, sign):
    side = Bounded.at(sign, edge)
    exact = wealth(side, Batch.of(np.concatenate(groups)))
    assert (wealth(side, known(*groups)) <= exact + 1e-6 * (1 + np.abs(exact))).all()
    assert (wealth(side, known(*groups, slack=1e-3)) <= wealth(side, known(*groups)) + 1e-9).all()


@given(st.lists(st.booleans(), min_size=1, max_size=40), st.floats(0.01, 0.99), st.sampled_from([1, -1]))
def test_nothing_is_lost_where_every_outcome_is_0_or_1(outcomes, edge, sign):
    y, side = np.array(outcomes, dtype=float), Bounded.at(sign, edge)
    assert wealth(side, known(y)) == pytest.approx(wealth(side, Batch.of(y)), abs=1e-9)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("mean", "square"), [(0.3, 0.2), (0.3, 0.091), (0.7, 0.6), (0.02, 0.01), (0.5, 0.2501)])
def test_no_law_of_these_moments_wins_less(mean, square, sign):
    """Linear programming over all laws on a fine grid."""
    for edge in (0.1, 0.45, 0.8):
        side = Bounded.at(sign, edge)
        least = Sums(*np.array([[1.0], [mean], [square]]))
        grid = np.unique(np.concatenate([np.linspace(0, 1, 401), least.against(sign).values]))
        won = side.log_factors(FRACTIONS, grid)
        for bet, found in zip(won, wealth(side, least), strict=True):
            law = linprog(bet, A_eq=np.array([grid**0, grid, grid**2]), b_eq=[1, mean, square], method="highs")
            assert law.fun == pytest.approx(found, abs=1e-6)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_larger_mean_square_wins_less(sign):
    squares = np.linspace(0.09, 0.3, 50)
    for edge in (0.1, 0.3, 0.8):
        side = Bounded.at(sign, edge)
        won = np.array([wealth(side, Sums(*np.array([[1.0], [0.3], [square]]))) for square in squares])
        assert (np.diff(won, axis=0) < 0).all()


def test_sums_of_nothing_but_zeros_or_ones_and_an_impossible_side():
    for y, low in (([0.0] * 5, 0.0), ([1.0] * 5, 1.0)):
        assert known(y).against(1).values.tolist() == known(y).against(-1).values.tolist() == [low]
        assert known(y).against(1).counts.tolist() == [5]
        assert np.isposinf(wealth(Bounded(1 if low else -1, 0.0), known(y))).all()
        assert np.isfinite(wealth(Bounded(-1 if low else 1, 0.0), known(y))).all()
    assert np.isposinf(wealth(Bounded(1, -math.inf), known([0.0, 0.5]))).all()


def test_who_needs_single_outcomes_learns_nothing():
    look = known([0.0, 0.2, 0.9], [1.0])
    assert Mixture.open(Spread(0.5, 0.01), Bets.equal(FRACTIONS)).update(look).log_evidence == pytest.approx(0)
    assert look.values.size == look.few.values.size == 0


# -- outcomes and a trial -------------------------------------------------------------------------


def test_moments_are_exact_and_tallies_those_of_each_sign():
    y = np.random.default_rng(1).random((6, 20))
    parts = [Outcomes().update(known(*group)) for group in (y[:2], y[2:])]
    mixed = parts[0].merge(parts[1]).update(Batch.of(y[0]))
    exact = Batch.of(np.concatenate([y.ravel(), y[0]])).moments
    assert mixed.moments.total == exact.total
    assert (mixed.moments.mean, mixed.moments.squares) == pytest.approx((exact.mean, exact.squares))
    for sign in (1, -1):
        values, law = mixed.law_against(sign)
        assert law.sum() == pytest.approx(1)
        assert values @ law == pytest.approx(exact.mean)
        once = Batch.of(np.concatenate([known(*y).against(sign).values, y[0]]))
        assert np.array_equal(values, once.values)
    assert Outcomes().update(Batch.of(y[0])).below is None


def target(**changes):
    means = {"pixel": "p", "channel": None, "true_mean": Fraction(1, 4), "tolerance": Fraction(0)}
    return Target(**(means | {"range": (Fraction(0), Fraction(1)), "slack": Fraction(1, 10**9)} | changes))


def test_without_a_bias_false_alarms_are_as_rare_as_said_and_intervals_hold_the_truth():
    rng, alarms, missed = np.random.default_rng(5), 0, 0
    for _ in range(400):
        trial = Trial.open(target(), LEVELS, method="mixture", sums=True)
        for _ in range(4):
            trial = trial.observe_sums(sums_of(*rng.beta(0.5, 1.5, (5, 100))))
        alarms += trial.verdict is Verdict.BIASED
        low, high = trial.interval()
        missed += not low <= 0 <= high
    assert alarms <= 40
    assert missed <= 40


@pytest.mark.parametrize("shift", [0.0, 0.05])
def test_the_interval_of_sums_holds_that_of_the_replicates(shift):
    y = np.random.default_rng(7).beta(0.5, 1.5, (10, 200)) * (1 - shift) + shift
    bets = hybrid(0.3, 0.05, 10_000)
    ends = {}
    for name, look in (("sums", known(*y)), ("single", Batch.of(y.ravel())), ("means", Batch.of(y.mean(axis=1)))):
        seen = Outcomes().update(look)
        ends[name] = [
            edge_of(seen, lambda m, sign=sign: Bounded.at(sign, m), bets, 0.05, 0.5 - sign / 2) for sign in (1, -1)
        ]
    assert ends["sums"][0] <= ends["single"][0] <= y.mean() <= ends["single"][1] <= ends["sums"][1]
    widths = {name: high - low for name, (low, high) in ends.items()}
    assert widths["sums"] < 1.1 * widths["single"]
    assert widths["means"] > 5 * widths["sums"]


def test_other_ranges_are_scaled_and_costs_are_of_a_replicate():
    y = np.random.default_rng(3).random((8, 50))
    far = target(true_mean=Fraction(-7, 4), range=(Fraction(-2), Fraction(-1)))
    trials = [
        Trial.open(each, LEVELS, method="mixture", sums=True).observe_sums(sums_of(*values), 800.0)
        for each, values in ((target(), y), (far, y - 2))
    ]
    assert trials[0].biased.log_evidence == pytest.approx(trials[1].biased.log_evidence, rel=1e-5)
    case = trials[1].case("the budget is spent")
    assert (case.replicates, case.cost, case.mean) == (400, 2, pytest.approx(y.mean() - 2))
    assert case.std == pytest.approx(y.std(ddof=1))
    assert case.predicted is None or case.predicted > 400


def test_a_slack_keeps_rounded_sums_from_winning_more():
    rng, loose = np.random.default_rng(11), target(slack=Fraction(1, 1000))
    y = rng.random((5, 100)) * 0.02 + 0.3
    rounded = np.clip(y + rng.uniform(-1e-3, 1e-3, y.shape), 0, 1)
    sums = sums_of(*rounded)
    sums[2] = np.maximum(sums[1] ** 2, sums[2] - 6e-4)
    kept, exact = loose.sums(sums), Batch.of(rounded.ravel())
    for sign, edge in ((1, 0.28), (-1, 0.33)):
        assert (wealth(Bounded.at(sign, edge), kept) <= wealth(Bounded.at(sign, edge), exact)).all()


@pytest.mark.parametrize(
    ("counts", "mean", "square"),
    [(9, 0.5, 0.6), (9, 0.5, 0.2), (0, 0.5, 0.3), (math.inf, 0.5, 0.3), (9, 0.5, math.nan), (9, 0.5, math.inf)],
)
def test_sums_that_none_can_have_are_a_fault(counts, mean, square):
    sums = np.array([[9, 0.5, 0.3], [counts, mean, square]], dtype=float).T
    fault = target().fault_of_sums(sums, np.array([3, 8]))
    assert fault.startswith(f"returned {counts:g} estimates of mean {mean!r} and mean square {square!r} for seed 8, ")
    assert target().fault_of_sums(sums[:, :1], np.array([3])) is None
    assert "outside its range" in target().fault_of_sums(sums + np.array([[0], [1], [0]]), np.array([3, 8]))


# -- a judgement ----------------------------------------------------------------------------------


def test_frames_show_a_bias_that_their_means_do_not():
    report = judge(Summed(darker), pixels=EIGHTH, tolerance="1%")
    case = only(report)
    assert (report.verdict, case.replicates) == (Verdict.BIASED, 5000)
    assert report.arguments["method"] == "mixture"
    assert any(note.startswith("only sums of many replicates are known") for note in report.notes)
    assert case.bias_interval[0] <= -1 / 32 <= case.bias_interval[1]
    assert judge(means_alone(Summed(darker)), pixels=EIGHTH, tolerance="1%").verdict is Verdict.INCONCLUSIVE


def test_frames_conform_where_their_means_are_too_few():
    subject = Summed(frames=2000)
    assert judge(subject, pixels=EIGHTH, tolerance="2%").verdict is Verdict.CONFORMS
    assert judge(means_alone(subject), pixels=EIGHTH, tolerance="2%").verdict is Verdict.INCONCLUSIVE
    undecided = only(judge(Summed(frames=50), pixels=EIGHTH, tolerance="1%"))
    assert undecided.reason.startswith("all 10 sums of replicates are used, ")
    assert undecided.predicted > 500


def test_many_pixels_and_colours_at_once():
    class Together(Summed):
        def run_many(self, pixels, seeds):
            return np.stack([self.run(pixel, seeds) for pixel in pixels], axis=1)

    report = judge(Together(darker, frames=2000), pixels=EIGHTH | COLOUR, tolerance="1%")
    assert [(case.name, case.verdict) for case in report.cases] == [
        (name, Verdict.BIASED) for name in ("eighth", "colour[0]", "colour[1]", "colour[2]")
    ]
    assert check_subject(Together(darker, frames=8, replicates=200), pixels=EIGHTH | COLOUR)


@pytest.mark.parametrize("method", ["mixture", "up", "hoeffding"])
def test_constant_bets_may_be_chosen(method):
    report = judge(Summed(darker, frames=4000), pixels=EIGHTH, tolerance="1%", method=method)
    assert (report.verdict, report.arguments["method"]) == (Verdict.BIASED, method)


def test_what_can_not_be_done_with_sums_is_refused():
    with pytest.raises(InputError, match=r"method='agrapa' needs single estimates.*take one of mixture, up, hoeffding"):
        judge(Summed(), pixels=EIGHTH, tolerance="1%", method="agrapa")
    with pytest.raises(InputError, match=r"pixel 'eighth' have no finite range.*declare a range"):
        judge(Summed(), pixels=EIGHTH, tolerance="1%", range=("-inf", "inf"), variance=1)


def test_impossible_sums_are_broken():
    class Wrong(Summed):
        def sums(self, pixels, seeds):
            counts, means, squares = super().sums(pixels, seeds)
            return counts, means, np.where(np.asarray(seeds)[:, None] == 3, 0.9, squares)

    case = only(judge(Wrong(), pixels=EIGHTH, tolerance="1%"))
    assert case.verdict is Verdict.BROKEN
    assert "and mean square 0.9 for seed 3, which none in the range" in case.reason
    promise = "sums are those of the estimates"
    for subject, words in (
        (Wrong(), "eighth returned 500 estimates of mean .* and mean square 0.9 for seed 3, "),
        (Summed(run=lambda pixel, seeds: np.asarray(seeds) % 2 / 2), "eighth: mean .* and estimate .* for seed "),
    ):
        seen = {check.promise: check.seen for check in check_subject(subject, pixels=EIGHTH, strict=False)}
        assert re.match(words, seen[promise])
    two = only(judge(Summed(sums=lambda pixels, seeds: (1, 2)), pixels=EIGHTH, tolerance="1%"))
    assert two.reason == "sums(pixels, seeds) returned 2 arrays, expected counts, means, mean squares"
    flat = only(judge(Summed(sums=lambda pixels, seeds: [np.ones(len(seeds))] * 3), pixels=EIGHTH, tolerance="1%"))
    assert flat.reason == "returned ndarray of shape (10,) for 10 seeds, expected (10, 1)"


def test_what_is_declared_is_compared_by_its_mean():
    plan = ("fixed", {"n": 8})
    right = judge(Summed(), pixels=EIGHTH, tolerance="2%", declares=plan)
    wrong = judge(Summed(darker), pixels=EIGHTH, tolerance="2%", declares=plan)
    noisier = judge(
        Summed(lambda pixel, seeds: draws(pixel, seeds, 1)[:, 0]), pixels=EIGHTH, tolerance="5%", declares=plan
    )
    assert [report.plan_check for report in (right, noisier)] == [PlanCheck.FOLLOWS] * 2
    assert wrong.plan_check is PlanCheck.DEVIATES
    assert "the estimates have another mean than declared" in only(wrong).reason
    trial = Trial.open(
        target(), LEVELS, Declared(Fraction(0), law={Fraction(1, 4): Fraction(1)}), method="mixture", sums=True
    )
    assert isinstance(trial.fit, Blend)


def test_suspects_and_independent_pixels():
    kirk_arvo = judge(Summed(darker), pixels=EIGHTH, tolerance="1%", suspects=[("kirk-arvo", {"n": 4})])
    assert kirk_arvo.verdict is Verdict.BIASED
    pixels = {str(i): Pixel.two(f"{i}/16") for i in range(1, 5)}
    assert judge(Summed(darker), pixels=pixels, tolerance="1%", independent=True).verdict is Verdict.BIASED
    assert judge(Summed(), pixels=pixels, tolerance="4%", independent=True).verdict is not Verdict.BIASED
