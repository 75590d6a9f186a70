"""The e-processes are fair bets, exactly; what they reach in simulations keeps Ville's bound."""

import math
from itertools import pairwise, product

import numpy as np
import pytest

from truemean.conformance.evidence import (
    Bets,
    Evidence,
    Outcomes,
    best_fraction,
    growth,
    hybrid,
    lower_end,
    variance_fraction,
)

LAWS = {
    "mean of 16, coverage 1/8": (
        np.arange(17) / 16,
        [math.comb(16, i) * 0.125**i * 0.875 ** (16 - i) for i in range(17)],
    ),
    "mean of 16, coverage 1/100": (
        np.arange(17) / 16,
        [math.comb(16, i) * 0.01**i * 0.99 ** (16 - i) for i in range(17)],
    ),
    "rare bright": (np.array([0.0, 1.0]), [0.999, 0.001]),
    "firefly": (np.array([0.2, 1.0]), [0.999, 0.001]),
    "coin": (np.array([0.0, 1.0]), [0.5, 0.5]),
    "nearly equal": (np.array([0.499, 0.501]), [0.5, 0.5]),
    "dark, tone, rare white": (np.array([0.0, 0.125, 1.0]), [0.5, 0.49, 0.01]),
}


def law(name):
    values, probabilities = LAWS[name]
    return values, np.array(probabilities) / np.sum(probabilities)


def ever_reached(start, values, probabilities, runs, looks, asked, rng):
    """How many of ``runs`` streams have a peak of at least ``asked`` after looks at 16 outcomes each."""
    fired = 0
    for _ in range(runs):
        process = start
        for counts in rng.multinomial(16, probabilities, size=looks):
            process = process.update(values, counts.astype(float))
            if process.peak >= asked:
                fired += 1
                break
    return fired


@pytest.mark.parametrize("name", LAWS)
def test_every_bet_is_fair_when_the_mean_is_the_null_mean(name):
    values, probabilities = law(name)
    mean = float(values @ probabilities)
    for fraction in hybrid(mean, 0.01, 1000).fractions:
        one = Bets(np.array([fraction]), np.array([0.0]))
        after = [Evidence.against(mean, one).update(np.array([y]), np.ones(1)).log_evidence for y in values]
        assert math.isclose(probabilities @ np.exp(after), 1, rel_tol=1e-12)


def test_the_mixture_is_fair_over_all_sequences_of_three():
    values, probabilities = np.array([0.0, 0.25, 1.0]), np.array([0.5, 0.3, 0.2])
    start = Evidence.against(float(values @ probabilities), hybrid(0.3, 0.01, 100))
    total = 0.0
    for places in product(range(3), repeat=3):
        after = start.update(values[list(places)], np.ones(3))
        total += math.prod(probabilities[list(places)]) * math.exp(after.log_evidence)
    assert math.isclose(total, 1, rel_tol=1e-12)


@pytest.mark.parametrize("name", LAWS)
def test_ville_under_continuous_looks(name):
    # At most 5 % may ever fire. With 400 streams more than 44 fire with probability < 1e-5 (binomial) if 5 % do.
    values, probabilities = law(name)
    mean = float(values @ probabilities)
    rng = np.random.default_rng(20)
    start = Evidence.against(mean, hybrid(mean, 0.05, 1600))
    assert ever_reached(start, values, probabilities, 400, 100, math.log(20), rng) <= 44


def test_a_z_test_with_the_same_looks_breaks_that_bound():
    values, probabilities = law("mean of 16, coverage 1/8")
    mean, rng, fired = float(values @ probabilities), np.random.default_rng(20), 0
    deviation = math.sqrt(probabilities @ (values - mean) ** 2)
    for _ in range(400):
        counts = rng.multinomial(16, probabilities, size=100).cumsum(axis=0)
        number = 16 * np.arange(1, 101)
        fired += bool(np.any((counts @ values / number - mean) * np.sqrt(number) > 1.645 * deviation))
    assert fired > 44


def test_order_and_batches_do_not_matter():
    rng = np.random.default_rng(3)
    y = rng.choice([0.0, 0.2, 0.7, 1.0], 500)
    start = Evidence.against(0.4, hybrid(0.4, 0.01, 500))
    at_once = start.update(*map(np.asarray, np.unique(y, return_counts=True))).log_evidence
    one_by_one = start
    for value in rng.permutation(y):
        one_by_one = one_by_one.update(np.array([value]), np.ones(1))
    assert math.isclose(at_once, one_by_one.log_evidence, abs_tol=1e-9)
    assert one_by_one.peak >= one_by_one.log_evidence


def test_evidence_falls_with_the_null_mean_and_grows_with_the_outcomes():
    bets = hybrid(0.3, 0.01, 1000)
    y, counts = np.array([0.1, 0.5, 0.9]), np.array([30.0, 50.0, 20.0])
    against = [Evidence.against(m, bets).update(y, counts).log_evidence for m in np.linspace(0.01, 1.2, 60)]
    assert all(later <= earlier for earlier, later in pairwise(against))
    brighter = Evidence.against(0.3, bets).update(y + 0.05, counts).log_evidence
    assert brighter > Evidence.against(0.3, bets).update(y, counts).log_evidence


def test_nulls_at_and_beyond_the_ends_of_the_range():
    bets = hybrid(0.0, 0.01, 1000)
    black, any_light = np.array([0.0]), np.array([0.0, 1e-6])
    assert Evidence.against(-0.1, bets).update(black, np.ones(1)).log_evidence == math.inf
    assert Evidence.against(0.0, bets).update(any_light, np.ones(2)).log_evidence == math.inf
    assert Evidence.against(0.0, bets).update(black, np.ones(1)).log_evidence < 0
    for null in (1.0, 1.5, math.inf):
        assert Evidence.against(null, hybrid(null, 0.01, 1000)).update(np.array([1.0]), np.array([1e4])).peak <= 1e-9


def test_ten_million_outcomes_stay_finite():
    process = Evidence.against(0.5, hybrid(0.5, 0.01, 10**7)).update(np.array([0.0, 1.0]), np.array([4e6, 6e6]))
    assert 1e5 < process.log_evidence < 1e6


@pytest.mark.parametrize(("mean", "budget"), [(1e-9, 10**5), (0.001, 10**3), (0.5, 10**5), (0.999, 10**5), (0.5, 1)])
def test_hybrid_bets_are_safe_spend_everything_and_reach_what_the_budget_needs(mean, budget):
    bets = hybrid(mean, 0.01, budget)
    assert math.isclose(np.exp(bets.log_weights).sum(), 1)
    assert 0 < bets.fractions.min() <= bets.fractions.max() < 1
    least = min(0.1, math.sqrt(2 * math.log(100) * mean / ((1 - mean) * budget)))
    assert bets.fractions[-1] <= 1.7 * least
    assert bets.fractions[-1] == 0.1 or bets.fractions[-2] > 1.7 * least


def test_a_favoured_bet_takes_its_share():
    bets = hybrid(0.5, 0.01, 1000)
    assert bets.favouring(0.0, 0.8) is bets
    both = bets.favouring(0.3, 0.8)
    assert math.isclose(np.exp(both.log_weights).sum(), 1)
    assert math.isclose(math.exp(both.log_weights[-1]), 0.8)


@pytest.mark.parametrize("name", LAWS)
def test_best_fraction_is_the_best_of_a_grid(name):
    values, probabilities = law(name)
    null = float(values @ probabilities) * 0.9
    grid = np.geomspace(1e-6, 0.99, 5000)
    gains = np.log1p(grid[:, None] * (values / null - 1)) @ probabilities
    best = best_fraction(values, probabilities, null)
    assert math.isclose(best, grid[gains.argmax()], rel_tol=1e-2)
    assert math.isclose(growth(values, probabilities, null), gains.max(), rel_tol=1e-3)
    assert best_fraction(values, probabilities, null / 0.9 + 1e-9) == 0


def test_a_variance_gives_nearly_the_bet_of_the_law():
    values, probabilities = law("mean of 16, coverage 1/8")
    mean = float(values @ probabilities)
    variance = float(probabilities @ (values - mean) ** 2)
    by_law = growth(values, probabilities, mean - 0.01)
    bet = variance_fraction(0.01, variance, mean - 0.01)
    assert np.log1p(bet * (values / (mean - 0.01) - 1)) @ probabilities > 0.95 * by_law


def test_outcomes_keep_mean_and_squares_of_close_values():
    rng = np.random.default_rng(5)
    y = 0.123456 + 1e-7 * rng.random(5000)
    outcomes = Outcomes(limit=100)
    for batch in np.array_split(y, 7):
        outcomes = outcomes.update(*map(np.asarray, np.unique(batch, return_counts=True)))
    assert math.isclose(outcomes.mean, y.mean(), rel_tol=1e-15)
    assert math.isclose(outcomes.squares / (y.size - 1), y.var(ddof=1), rel_tol=1e-6)
    assert outcomes.values.size <= 100
    assert math.isclose(outcomes.counts.sum(), y.size)


@pytest.mark.parametrize("shape", [(2, 5), (0.2, 5), (60, 20)])
def test_a_coarse_grid_only_understates(shape):
    rng = np.random.default_rng(6)
    y = rng.beta(*shape, size=20_000)
    bets = hybrid(float(y.mean()), 0.01, y.size)
    exact, coarse = Outcomes(limit=10**6), Outcomes()
    for batch in np.array_split(y, 20):
        values, counts = np.unique(batch, return_counts=True)
        exact, coarse = exact.update(values, counts.astype(float)), coarse.update(values, counts.astype(float))
    fine, rough = lower_end(exact, bets, 0.01), lower_end(coarse, bets, 0.01)
    assert coarse.values.size <= 4096 < exact.values.size
    assert fine - 1e-3 * (y.mean() - fine) <= rough <= fine + 1e-12


@pytest.mark.parametrize("name", LAWS)
def test_lower_ends_cover_at_every_look(name):
    # The end may ever pass the mean in 5 % of streams; more than 22 of 150 has probability < 1e-5 then.
    values, probabilities = law(name)
    mean, rng, missed = float(values @ probabilities), np.random.default_rng(21), 0
    bets = hybrid(mean, 0.05, 800)
    for _ in range(150):
        ends, outcomes = [], Outcomes()
        for counts in rng.multinomial(80, probabilities, size=10):
            outcomes = outcomes.update(values[counts > 0], counts[counts > 0].astype(float))
            ends.append(lower_end(outcomes, bets, 0.05))
        missed += max(ends) > mean
    assert missed <= 22


def test_the_lower_end_is_where_the_evidence_reaches_the_level():
    outcomes = Outcomes().update(np.array([0.0, 0.3, 1.0]), np.array([20.0, 60.0, 20.0]))
    bets = hybrid(0.4, 0.01, 100)
    end = lower_end(outcomes, bets, 0.01)
    at = [Evidence.against(m, bets).update(outcomes.values, outcomes.counts).log_evidence for m in (end, end + 1e-9)]
    assert at[0] >= math.log(100) > at[1]
    assert lower_end(Outcomes().update(np.array([0.0]), np.array([50.0])), bets, 0.01) == 0
