"""Knowledge goes into bets: what it may win, what it may cost, and what it catches."""

import math
from fractions import Fraction

import numpy as np
import pytest

from truemean.conformance.declared import Declared
from truemean.conformance.evidence import METHODS, Batch, Blend, Bounded, Heavy, Mixture, hybrid
from truemean.conformance.fit import LawFit
from truemean.conformance.openings import Levels, end_bets, open_biased, open_fit, open_within, scaled_law
from truemean.conformance.target import Target

LEVELS = Levels(biased=0.01, deviates=0.01, conforms=0.01, budget=10_000)
ASKED = math.log(100)
KIRK_ARVO = {Fraction(0): Fraction(1, 3), Fraction(1, 8): Fraction(5, 8), Fraction(1): Fraction(1, 24)}


def target(**changes):
    given = {
        "pixel": "eighth",
        "channel": None,
        "true_mean": Fraction(1, 8),
        "tolerance": Fraction(1, 50),
        "range": (Fraction(0), Fraction(1)),
        "slack": Fraction(1, 10**9),
    }
    return Target(**(given | changes))


def declared(law=None, bias=None, variance=None):
    if law is None:
        return Declared(bias, variance)
    mean = sum(value * mass for value, mass in law.items())
    return Declared(mean - Fraction(1, 8), sum((v - mean) ** 2 * p for v, p in law.items()), None, law)


def shifted(step):
    """A coarse law of mean 1/8 + ``step``."""
    p = Fraction(1, 4) + 2 * step
    return {Fraction(0): 1 - p, Fraction(1, 2): p}


def fed(process, y, looks=40):
    for batch in np.array_split(np.asarray(y), looks):
        process = process.update(Batch.of(batch))
    return process


def shares(blend):
    return {name: math.exp(share) for name, share in zip(blend.names, blend.log_shares, strict=True)}


def noisy(mean, deviation, number=4000, seed=31):
    """Outcomes of this mean and deviation, uniform about it."""
    half = math.sqrt(3) * deviation
    return np.random.default_rng(seed).uniform(mean - half, mean + half, number)


def test_suspects_share_half_of_the_money():
    suspects = {"brighter": declared(shifted(Fraction(1, 20))), "darker": declared(shifted(-Fraction(1, 20)))}
    process = open_biased(target(), LEVELS, "focus", suspects)
    assert shares(process) == pytest.approx({"rest": 0.5, "brighter": 0.25, "darker": 0.25})
    assert [part.side.sign for part in process.parts[1:]] == [1, -1]
    assert process.parts[0].names == open_biased(target(), LEVELS, "focus", {}).names


def test_a_suspect_within_the_tolerance_or_unknown_is_given_nothing():
    suspects = {"honest": declared(shifted(Fraction(1, 100))), "unknown": Declared(note="too large")}
    assert "rest" not in open_biased(target(), LEVELS, "mixture", suspects).names
    brighter = {"brighter": declared(shifted(Fraction(1, 20)))}
    assert not isinstance(open_biased(target(), LEVELS, "welch", brighter), Blend)


@pytest.mark.parametrize("method", [name for name, method in METHODS.items() if method.valid])
@pytest.mark.parametrize("step", [-0.1, 0.0, 0.2])
def test_a_wrong_suspect_costs_at_most_log_2(method, step):
    wrong = {"brighter": declared(shifted(Fraction(1, 20))), "brightest": declared(shifted(Fraction(1, 3)))}
    y = np.clip(noisy(0.125 + step, 0.1, 800), 0, 1)
    plain, suspicious = open_biased(target(), LEVELS, method, {}), open_biased(target(), LEVELS, method, wrong)
    for batch in np.array_split(y, 20):
        plain, suspicious = plain.update(Batch.of(batch)), suspicious.update(Batch.of(batch))
        assert suspicious.log_evidence >= plain.log_evidence - math.log(2) - 1e-9
    assert suspicious.peak >= plain.peak - math.log(2) - 1e-9


def test_a_right_suspect_is_found_sooner():
    law = shifted(Fraction(1, 25))
    y = np.random.default_rng(32).choice([0.0, 0.5], 2000, p=[float(p) for p in law.values()])
    found = fed(open_biased(target(), LEVELS, "focus", {"brighter": declared(law)}), y)
    assert found.log_evidence > fed(open_biased(target(), LEVELS, "focus", {}), y).log_evidence + 1
    assert (found.leading, found.lean) == ("brighter", 1)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_declared_law_has_eight_tenths_of_the_money(sign):
    known = declared(shifted(Fraction(0)))
    assert shares(open_within(target(), LEVELS, "focus", known, sign)) == pytest.approx({"declared": 0.8, "rest": 0.2})
    moments = declared(bias=Fraction(0), variance=Fraction(1, 100))
    assert shares(open_within(target(), LEVELS, "focus", moments, sign))["declared"] == pytest.approx(0.8)
    for nothing in (None, Declared(), declared(bias=-sign * Fraction(1, 10), variance=Fraction(1, 100))):
        assert "declared" not in open_within(target(), LEVELS, "focus", nothing, sign).names
    assert not isinstance(open_within(target(), LEVELS, "welch", known, sign), Blend)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_wrong_declared_law_costs_at_most_log_5(sign):
    wrong = declared({Fraction(1, 8): Fraction(1)})
    y = np.random.default_rng(33).choice([0.0, 1.0], 3000, p=[0.875, 0.125])
    plain, fooled = (open_within(target(), LEVELS, "focus", known, sign) for known in (None, wrong))
    for batch in np.array_split(y, 30):
        plain, fooled = plain.update(Batch.of(batch)), fooled.update(Batch.of(batch))
        assert fooled.log_evidence >= plain.log_evidence - math.log(5) - 1e-9


def test_an_edge_that_the_range_implies_is_shown_by_any_look():
    asked = target(tolerance=Fraction(1, 8))  # E[ξ] >= 0 is E[ξ] >= I - tolerance
    y = np.random.default_rng(34).beta(0.2, 5, 5000)
    certain, open_question = (fed(open_within(asked, LEVELS, "focus", None, sign), y, 3) for sign in (1, -1))
    assert certain.log_evidence == certain.peak == math.inf
    assert open_question.peak > ASKED


def test_a_tolerance_below_rounding_is_never_shown():
    asked = target(tolerance=Fraction(0))
    for sign in (1, -1):
        for y in (np.full(1000, 0.125), np.zeros(1000), np.ones(1000), np.random.default_rng(34).random(1000)):
            assert fed(open_within(asked, LEVELS, "focus", None, sign), y).peak <= 1e-9


@pytest.mark.parametrize("method", METHODS)
def test_evidence_within_is_for_a_mean_at_the_true_mean(method):
    y = noisy(0.125, 0.02, 12_000)
    for sign in (1, -1):
        assert fed(open_within(target(), LEVELS, method, None, sign), y).peak > ASKED
    above, below = (fed(open_within(target(), LEVELS, method, None, sign), y + 0.05) for sign in (1, -1))
    assert above.peak > ASKED > 1 > below.peak


def test_without_a_range_evidence_is_of_outcomes_of_a_known_variance():
    asked = target(range=None, deviation=Fraction(1, 2), tolerance=Fraction(1, 10))
    y = (noisy(0.125, 0.4, 8000) - 0.125) / 0.5
    known = declared(bias=Fraction(0), variance=Fraction(1, 5))
    for sign in (1, -1):
        assert fed(open_within(asked, LEVELS, "focus", known, sign), y).peak > ASKED
        assert isinstance(open_within(asked, LEVELS, "focus", known, sign).side, Heavy)
        assert end_bets(asked, LEVELS, known, sign).fractions.max() == 2
    assert fed(open_biased(asked, LEVELS, "focus", {"known": known}), y).peak < 1
    found = fed(open_biased(asked, LEVELS, "focus", {}), y + 0.6)
    assert (found.peak > ASKED, found.lean) == (True, 1)


def test_a_law_is_compared_in_full_and_nothing_where_nothing_is_known():
    fit = open_fit(target(), declared(KIRK_ARVO), LEVELS)
    assert isinstance(fit, LawFit)
    assert fit.atoms.tolist() == [0.0, 0.125, 1.0]
    assert fed(fit, np.full(50, 0.126)).log_evidence == math.inf
    assert open_fit(target(), Declared(note="too large"), LEVELS) is None


@pytest.mark.parametrize("bias", [Fraction(0), Fraction(1, 20)])
def test_a_mean_alone_is_compared_with_the_mean_that_is_declared(bias):
    fit = open_fit(target(), declared(bias=bias), LEVELS)
    mean = 0.125 + float(bias)
    assert fed(fit, noisy(mean, 0.03)).peak < ASKED
    assert fed(fit, noisy(mean, 0.07)).peak < ASKED
    for sign in (1, -1):
        found = fed(fit, noisy(mean + sign * 0.01, 0.03))
        assert (found.peak > ASKED, found.lean) == (True, sign)


@pytest.mark.parametrize("width", [1, 3])
def test_mean_and_spread_are_compared_where_both_are_declared(width):
    asked = target(range=(Fraction(0), Fraction(width)))
    fit = open_fit(asked, declared(bias=Fraction(0), variance=Fraction(3, 100) ** 2), LEVELS)
    as_declared, quieter, noisier = (fed(fit, noisy(0.125, s) / width) for s in (0.03, 0.02, 0.036))
    assert as_declared.peak < ASKED
    assert quieter.peak < ASKED
    assert noisier.peak > ASKED
    assert noisier.leading == "noisier"
    brighter, darker = (fed(fit, noisy(0.125 + step, 0.02) / width) for step in (0.01, -0.01))
    assert brighter.peak > ASKED
    assert darker.peak > ASKED
    assert (brighter.leading, brighter.lean, darker.leading, darker.lean) == ("mean", 1, "mean", -1)


def test_an_estimator_declared_without_noise_may_only_round():
    fit = open_fit(target(), declared(bias=Fraction(0), variance=Fraction(0)), LEVELS)
    assert fed(fit, 0.125 + 1e-9 * np.random.default_rng(35).uniform(-1, 1, 400)).peak < ASKED
    assert fed(fit, noisy(0.125, 1e-6, 400)).peak > ASKED


def test_spread_is_compared_without_a_range_too():
    asked = target(range=None, deviation=Fraction(1, 10))
    fit = open_fit(asked, declared(bias=Fraction(0), variance=Fraction(3, 100) ** 2), LEVELS)
    same, noisier = (fed(fit, (noisy(0.125, s) - 0.125) / 0.1) for s in (0.03, 0.036))
    assert same.peak < ASKED < noisier.peak
    assert noisier.leading == "noisier"


def test_the_interval_is_made_with_the_declared_bet():
    plain, known = (end_bets(target(), LEVELS, what, 1) for what in (None, declared(shifted(Fraction(0)))))
    assert plain.fractions.size == hybrid(0.105, 0.005, 10_000).fractions.size == known.fractions.size - 1
    assert math.isclose(math.exp(known.log_weights[-1]), 0.8)


def test_a_law_is_scaled_to_the_range_and_stays_in_it():
    wide = target(range=(Fraction(0), Fraction(1, 2)))
    y, law = scaled_law(
        wide, {Fraction(0): Fraction(1, 4), Fraction(1, 4): Fraction(1, 4), Fraction(1): Fraction(1, 2)}
    )
    assert y.tolist() == [0.0, 0.5, 1.0]
    assert law.tolist() == [0.25, 0.25, 0.5]
    unbounded = target(range=None, deviation=Fraction(1, 8))
    assert scaled_law(unbounded, {Fraction(1): Fraction(1)})[0].tolist() == [7.0]


def test_a_pixel_at_an_end_of_the_range_is_judged_on_one_side():
    black = target(true_mean=Fraction(0))
    process = open_biased(black, LEVELS, "focus", {"grey": declared(bias=Fraction(1, 8), variance=Fraction(1, 10))})
    assert fed(process, np.zeros(100)).peak < 1
    assert fed(process, np.full(100, 0.05)).peak > ASKED
    certain = open_within(black, LEVELS, "focus", None, 1)
    assert isinstance(certain, Mixture)
    assert certain.side == Bounded(1, -math.inf)
