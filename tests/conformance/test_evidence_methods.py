"""Every kind of evidence is a fair bet at every state, exactly, and what it says of one side it says of the other."""

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.conformance.test_evidence import LAWS, OPENINGS, at, fed, law, opened

from truemean.conformance.evidence import (
    METHODS,
    Batch,
    Bets,
    Bounded,
    Focus,
    Heavy,
    Mixture,
    Spread,
    heavy,
    hybrid,
)

PASTS = {
    "no past": [],
    "a far outcome": [[0.25], [1.0]],
    "black and white": [[0.0, 1.0], [0.0, 0.0, 1.0, 0.0]],
    "noise": np.random.default_rng(1).random((3, 12)).tolist(),
    "nearly constant": [[0.31], [0.32, 0.31], [0.3, 0.315, 0.32] * 8],
    "against": [[1.0, 0.8], [0.9] * 10],
    "for": [[0.0, 0.1], [0.05] * 10],
}
FAIR = ["focus", "mixture", "up", "agrapa", "hoeffding", "empirical-bernstein"]  # klinf is below one, not one
HOPELESS = [-math.inf, -0.1, 0.0, 1e-300, 1e-12, 1 - 1e-12, 1.0, 1.5, math.inf]
eighths = st.integers(0, 64).map(lambda i: i / 64)


def two_points(edge):
    """Laws on two values, of mean exactly ``edge``."""
    lows, highs = (0.0, edge / 2, edge * 0.999), (1.0, (1 + edge) / 2, edge + (1 - edge) * 0.001)
    for low, high in product(lows, highs):
        p = (edge - low) / (high - low)
        yield (low, high), (1 - p, p)


def gain(process, values, probabilities, number):
    """E[exp(increment)] over all batches of ``number`` outcomes."""
    terms = []
    for ranks in product(range(len(values)), repeat=number):
        after = fed(process, [values[i] for i in ranks])
        probability = math.prod(probabilities[i] for i in ranks)
        terms.append(probability * math.exp(after.log_evidence - process.log_evidence))
    return math.fsum(terms)


@pytest.mark.parametrize("past", PASTS)
@pytest.mark.parametrize("method", FAIR)
def test_no_law_of_the_null_wins_at_any_state(method, past):
    for sides in OPENINGS.values():
        edges = [m if sign > 0 else 1 - m for sign, m in sides]
        for distance in (0.0, 0.01):
            process = fed(opened(method, *sides, distance=distance), *PASTS[past])
            for edge in edges:
                for values, probabilities in two_points(edge):
                    assert gain(process, values, probabilities, 1) <= 1 + 1e-12
            constant = sum(edges) / len(edges)
            assert gain(process, (constant,), (1.0,), 2) <= 1 + 1e-12


@pytest.mark.parametrize("method", FAIR)
def test_no_law_of_the_null_wins_in_a_batch_of_two(method):
    sides = OPENINGS["two sides"]
    process = fed(opened(method, *sides), *PASTS["nearly constant"])
    for edge in (0.45, 0.41):
        for values, probabilities in two_points(edge):
            assert gain(process, values, probabilities, 2) <= 1 + 1e-12


@pytest.mark.parametrize("name", LAWS)
def test_every_bet_is_exactly_fair_when_the_mean_is_the_edge(name):
    values, probabilities = law(name)
    mean = float(values @ probabilities)
    for fraction in hybrid(mean, 0.01, 1000).fractions:
        one = Mixture.open(Bounded(1, mean), Bets.equal([fraction]))
        assert math.isclose(gain(one, values, probabilities, 1), 1, rel_tol=1e-12)


def test_the_mixture_is_exactly_fair_over_all_sequences_of_three():
    values, probabilities = np.array([0.0, 0.25, 1.0]), np.array([0.5, 0.3, 0.2])
    start = Mixture.open(Bounded(1, float(values @ probabilities)), hybrid(0.3, 0.01, 100))
    assert math.isclose(gain(start, values, probabilities, 3), 1, rel_tol=1e-12)


@pytest.mark.parametrize("p", [0.5, 0.1, 0.9, 1e-3, 1 - 1e-3, 1e-9])
@pytest.mark.parametrize("deviation", [1.0, 0.3])
def test_no_law_of_variance_1_wins_without_a_range(p, deviation):
    # The rarer value lies the further out; a mean within the null makes the bets worse.
    for shift in (0.0, 0.5, 3.0, 100.0):
        values = deviation * np.array([-math.sqrt(p / (1 - p)), math.sqrt((1 - p) / p)])
        for sign in (1, -1):
            start = heavy([Heavy(sign, 2.0)], 0.01, 1000)
            assert gain(start, 2 + sign * (values - shift), (1 - p, p), 1) <= 1 + 1e-12
        if not shift:
            sides = [Heavy(1, 2.1), Heavy(-1, 1.9)]
            assert gain(heavy(sides, 0.01, 1000), 2 + values, (1 - p, p), 2) <= 1 + 1e-12


@pytest.mark.parametrize("p", [1.0, 0.5, 0.01, 1e-6])
def test_no_law_as_noisy_as_declared_wins(p):
    # E[(y - centre)^2] = variance, from rare outcomes far off.
    start = Mixture.open(Spread(0.3, 0.04), hybrid(0.04, 0.01, 1000))
    far = math.sqrt(0.04 / p)
    for values in ((0.3, 0.3 + far), (0.3, 0.3 - far)):
        assert math.isclose(gain(start, values, (1 - p, p), 1), 1, rel_tol=1e-9)
    assert gain(start, (0.3, 0.3 + far / 2), (1 - p, p), 1) < 1


@pytest.mark.parametrize(("method", "name"), [("mixture", "mean of 16"), ("focus", "mean of 16"), ("focus", "firefly")])
def test_ville_under_continuous_looks(method, name):
    # At most 5 % may ever fire. With 150 streams more than 20 fire with probability < 1e-4 (binomial) if 5 % do.
    values, probabilities = law(name)
    mean = float(values @ probabilities)
    rng, fired = np.random.default_rng(20), 0
    for _ in range(150):
        process = opened(method, (1, mean), (-1, 1 - mean), level=0.05, budget=640)
        for y in rng.choice(values, (40, 16), p=probabilities):
            process = process.update(Batch.of(y))
        fired += process.peak >= math.log(20)
    assert fired <= 20


def test_a_z_test_with_the_same_looks_breaks_that_bound():
    values, probabilities = law("mean of 16")
    mean, rng, fired = float(values @ probabilities), np.random.default_rng(20), 0
    deviation = math.sqrt(probabilities @ (values - mean) ** 2)
    number = 16 * np.arange(1, 41)
    for _ in range(150):
        sums = rng.choice(values, (40, 16), p=probabilities).sum(axis=1).cumsum()
        fired += bool(np.any(np.abs(sums / number - mean) * np.sqrt(number) > 1.96 * deviation))
    assert fired > 20


@pytest.mark.parametrize("method", METHODS)
@given(st.lists(st.lists(eighths, min_size=1, max_size=9), min_size=1, max_size=5), st.data())
@settings(max_examples=25)
def test_a_mirrored_stream_is_the_same_evidence_for_the_other_side(method, batches, data):
    up, down = (data.draw(st.integers(1, 63)) / 64 for _ in range(2))
    mirrored = [[1 - y for y in batch] for batch in batches]
    for sides, swapped in ([((1, up),), ((-1, up),)], [((1, up), (-1, down)), ((1, down), (-1, up))]):
        for distance in (0.0, 1 / 128):
            there = fed(opened(method, *sides, distance=distance), *batches)
            back = fed(opened(method, *swapped, distance=distance), *mirrored)
            assert math.isclose(there.log_evidence, back.log_evidence, rel_tol=1e-9, abs_tol=1e-9)
            assert math.isclose(there.peak, back.peak, rel_tol=1e-9, abs_tol=1e-9)


@pytest.mark.parametrize("place", ["one side", "two sides"])
@pytest.mark.parametrize("method", METHODS)
def test_every_method_opens_updates_and_merges_and_its_peak_never_falls(method, place):
    start = opened(method, *OPENINGS[place], distance=0.05)
    assert start.log_evidence == start.peak == 0
    assert start.lean in (-1, 0, 1)
    rng, process, peaks = np.random.default_rng(9), start, [0.0]
    for y in rng.beta(3, 2, (30, 20)):
        process = process.update(Batch.of(y))
        peaks.append(process.peak)
        assert process.lean in (-1, 1)
        assert process.peak >= process.log_evidence
    merged = process.merge(fed(start, [0.0] * 20))
    assert [*peaks, merged.peak] == sorted([*peaks, merged.peak])
    assert process.peak > math.log(100)
    assert process.lean == 1
    assert process.merge(start).log_evidence == pytest.approx(process.log_evidence, rel=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_a_large_bias_is_found_with_its_sign(method):
    for sign in (1, -1):
        process = opened(method, (1, 0.5), (-1, 0.5), level=0.01, budget=2000)
        for y in 0.5 + sign * np.random.default_rng(4).uniform(-0.1, 0.4, (40, 25)):
            process = process.update(Batch.of(y))
        assert process.peak > math.log(100)
        assert process.lean == sign


def test_every_method_says_what_it_guarantees_and_only_welch_is_not_valid():
    assert all(method.guarantee.strip() for method in METHODS.values())
    assert [name for name, method in METHODS.items() if not method.valid] == ["welch"]
    assert "NOT valid" in METHODS["welch"].guarantee
    assert set(METHODS) == {*FAIR, "klinf", "welch"}


@pytest.mark.parametrize("null", [0.3, 0.5, 0.62])
def test_welch_is_the_two_sided_t_test(null):
    from scipy.stats import ttest_1samp

    y = np.random.default_rng(3).beta(2, 3, 40)
    process = fed(opened("welch", (1, null), (-1, 1 - null)), y[:1], y[1:15], y[15:])
    assert math.isclose(process.log_evidence, -math.log(ttest_1samp(y, null).pvalue), rel_tol=1e-9)
    assert process.lean == (1 if y.mean() > null else -1)


@pytest.mark.parametrize("values", [[0.0], [1.0], [0.0, 1.0], [0.3], [0.0, 1e-17, 1e-3, 0.7, 1 - 1e-16, 1.0]])
@pytest.mark.parametrize("method", METHODS)
def test_a_hundred_million_outcomes_stay_finite(method, values):
    batch = Batch(np.array(values), np.full(len(values), 1e8))
    for place in OPENINGS.values():
        for distance in (0.0, 0.001):
            process = opened(method, *place, budget=10**8, distance=distance).update(batch).update(batch)
            assert math.isfinite(process.log_evidence)
            assert math.isfinite(process.merge(process).peak)


@pytest.mark.parametrize("mean", HOPELESS)
@pytest.mark.parametrize("method", METHODS)
def test_an_edge_at_or_beyond_an_end_of_the_range_is_no_trouble(method, mean):
    many = np.random.default_rng(2).beta(0.2, 5, 1000)  # on the grid of few values some points have no outcome near
    for sides in ([(1, mean)], [(-1, mean)], [(1, mean), (-1, mean)], [(1, 0.5), (-1, mean)]):
        start = opened(method, *sides, distance=0.01)
        process = start.merge(start)
        for y in ([0.0], [1.0] * 5, many, [0.0, 1.0], [0.3]):
            process = process.update(Batch.of(np.array(y)))
            assert not math.isnan(process.log_evidence)
            assert process.lean in (-1, 0, 1)
    if mean >= 1:
        assert fed(opened(method, (1, mean)), [1.0] * 50).peak <= 1e-9
    if mean < 0 and method not in ("focus", "welch"):
        assert fed(opened(method, (1, mean)), [0.0] * 50).peak > 0


def test_a_focus_without_a_side_that_can_be_left_says_nothing():
    process = fed(Focus.open(at(((1, 1.0), (-1, 1.2))), 0.01, 1000), [0.0, 1.0])
    assert (process.log_evidence, process.peak, process.lean) == (0, 0, 0)
