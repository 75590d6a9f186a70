"""Evidence equals its twin in plain Python, whatever the order, the batches and the places of the edges."""

import math
from functools import reduce
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.conformance import brute_evidence as brute

from truemean.conformance.evidence import (
    METHODS,
    Batch,
    Bets,
    Bounded,
    Focus,
    Heavy,
    LikelihoodRatio,
    Mixture,
    Outcomes,
    Question,
    best_fraction,
    edge_of,
    growth,
    hybrid,
    scales,
    universal,
    variance_fraction,
)

LAWS = {
    "mean of 16": (np.arange(17) / 16, [math.comb(16, i) * 0.125**i * 0.875 ** (16 - i) for i in range(17)]),
    "rare bright": (np.array([0.0, 1.0]), [0.999, 0.001]),
    "firefly": (np.array([0.2, 1.0]), [0.999, 0.001]),
    "coin": (np.array([0.0, 1.0]), [0.5, 0.5]),
    "nearly equal": (np.array([0.499, 0.501]), [0.5, 0.5]),
    "dark, tone, rare white": (np.array([0.0, 0.125, 1.0]), [0.5, 0.49, 0.01]),
}
OPENINGS = {
    "one side": ((1, 0.25),),
    "the other side": ((-1, 0.6),),
    "two sides": ((1, 0.45), (-1, 0.59)),
    "a null of one mean": ((1, 0.4), (-1, 0.6)),
    "near 0": ((1, 0.002), (-1, 0.999)),
    "near 1": ((1, 0.998), (-1, 0.003)),
}
places = st.sampled_from([0.0, 0.25, 0.5, 1.0]) | st.floats(0.0, 1.0).map(lambda y: round(y, 6))
streams = st.lists(places, min_size=1, max_size=60)
means = st.floats(0.01, 0.99)
orders = st.randoms(use_true_random=False)
several = settings(max_examples=40)


def law(name):
    values, probabilities = LAWS[name]
    return values, np.array(probabilities) / np.sum(probabilities)


def stream(kind, number=120):
    rng = np.random.default_rng(7)
    return {
        "discrete": lambda: rng.choice([0.0, 0.2, 0.7, 1.0], number),
        "continuous": lambda: rng.beta(2, 5, number),
        "black or white": lambda: rng.choice([0.0, 1.0], number, p=[0.7, 0.3]),
        "rare white": lambda: rng.choice([0.1, 1.0], number, p=[0.97, 0.03]),
        "rare ends": lambda: rng.choice([0.0, 0.3, 0.4, 1.0], number, p=[0.02, 0.5, 0.46, 0.02]),
        "dark": lambda: rng.beta(0.2, 20, number),
        "bright": lambda: 1 - rng.beta(0.2, 20, number),
        "constant": lambda: np.full(number, 0.3),
    }[kind]()


def cut(y, size):
    """Batches of one size; without one, each a third of what came before."""
    if size:
        return [y[i : i + size].tolist() for i in range(0, len(y), size)]
    ends = [0, 1]
    while ends[-1] < len(y):
        ends.append(max(ends[-1] + 1, ends[-1] * 4 // 3))
    return [y[a:b].tolist() for a, b in pairwise(ends)]


def fed(process, *batches):
    return reduce(lambda state, batch: state.update(Batch.of(np.array(batch))), batches, process)


def followed(process, batches):
    """The log evidence after each batch."""
    logs = []
    for batch in batches:
        process = fed(process, batch)
        logs.append(process.log_evidence)
    return logs


def at(sides):
    return tuple(Bounded(*side) for side in sides)


def opened(method, *sides, level=0.01, budget=5000, distance=0.0):
    return METHODS[method].open(Question(at(sides), level, budget, distance))


@pytest.mark.parametrize("size", [1, 7, None])
@pytest.mark.parametrize("place", OPENINGS)
@pytest.mark.parametrize(
    "kind", ["discrete", "continuous", "black or white", "rare white", "rare ends", "dark", "bright", "constant"]
)
def test_the_evidence_is_that_of_its_twin(kind, place, size):
    batches, sides = cut(stream(kind, 120 if size != 1 else 40), size), OPENINGS[place]
    for process, twin in (
        (opened("mixture", *sides), brute.static),
        (Focus.open(at(sides), 0.01, 5000), brute.focus),
        (opened("focus", *sides), brute.reserved),
    ):
        assert np.allclose(followed(process, batches), list(twin(batches, sides, 0.01, 5000)), rtol=1e-11, atol=1e-9)


@pytest.mark.parametrize("distance", [0.1, 0.001])
@pytest.mark.parametrize("side", [(1, 0.25), (-1, 0.6), (1, 0.002)])
@pytest.mark.parametrize("kind", ["discrete", "continuous", "black or white", "rare white", "constant"])
def test_evidence_at_a_known_distance_is_that_of_its_twin(kind, side, distance):
    batches = cut(stream(kind), None)
    found = followed(opened("focus", side, distance=distance), batches)
    assert np.allclose(found, list(brute.conforming(batches, side, 0.01, 5000, distance)), rtol=1e-11, atol=1e-9)


@given(streams, means, st.sampled_from([1, -1]))
@several
def test_klinf_is_never_above_the_universal_portfolio(y, m, sign):
    batches = cut(np.array(y), 5)
    found = followed(LikelihoodRatio(Bounded(sign, m)), batches)
    portfolio = list(brute.constant_bets(batches, (sign, m), brute.portfolio_prior(40)))
    assert all(a <= b + 1e-9 for a, b in zip(found, portfolio, strict=True))


@given(streams, means, orders, st.sampled_from(["mixture", "up", "klinf"]))
@several
def test_order_and_batches_do_not_matter(y, m, order, method):
    start = opened(method, (1, m), (-1, 1 - m))
    shuffled = list(y)
    order.shuffle(shuffled)
    by_one = fed(start, *([x] for x in shuffled))
    assert math.isclose(fed(start, y).log_evidence, by_one.log_evidence, rel_tol=1e-9, abs_tol=1e-9)
    assert by_one.peak >= by_one.log_evidence


@given(streams, means, st.booleans(), st.integers(1, 9))
@several
def test_no_order_takes_more_than_the_reserve_allows(y, m, ascending, size):
    sides = ((1, m), (-1, 1 - m))
    batches = cut(np.array(sorted(y, reverse=not ascending) * 8), size)
    kept, reserve = followed(opened("focus", *sides), batches), followed(opened("mixture", *sides), batches)
    assert all(a >= b + math.log(0.15) - 1e-9 for a, b in zip(kept, reserve, strict=True))


@given(streams, streams, means)
@several
def test_a_merged_mixture_saw_all_and_a_merged_focus_multiplies(first, second, m):
    for method in ("mixture", "up", "klinf"):
        a, b = (fed(opened(method, (1, m), (-1, 1 - m)), y) for y in (first, second))
        together = fed(a, second)
        assert math.isclose(a.merge(b).log_evidence, together.log_evidence, rel_tol=1e-9, abs_tol=1e-9)
    a, b = (fed(Focus.open(at(((1, m), (-1, 1 - m))), 0.01, 5000), y) for y in (first, second))
    assert math.isclose(a.merge(b).log_evidence, a.log_evidence + b.log_evidence, rel_tol=1e-12, abs_tol=1e-12)
    scores = (np.maximum(process.scores, -1e6) for process in (a.merge(b), fed(a, second)))  # beyond, a score is gone
    assert np.allclose(*scores, rtol=1e-9, atol=1e-9)


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=200), means, st.integers(8, 64))
@several
def test_sharing_out_on_a_grid_keeps_number_and_mean_and_only_understates(y, m, limit):
    exact = Batch.of(np.array(y))
    short = exact.shortened(limit)
    assert short.values.size <= max(limit, 2)
    assert (short.counts > 0).all()
    assert math.isclose(short.counts.sum(), len(y), rel_tol=1e-12)
    assert math.isclose(short.moments.mean, exact.moments.mean, rel_tol=1e-9, abs_tol=1e-12)
    for sign in (1, -1):
        start = Mixture.open(Bounded(sign, m), hybrid(m, 0.01, 1000))
        assert start.update(short).log_evidence <= start.update(exact).log_evidence + 1e-9


@pytest.mark.parametrize("null", [0.45, 0.49])
def test_a_short_grid_costs_next_to_nothing(null):
    y = np.random.default_rng(6).random(10_000)
    exact = Mixture.open(Bounded(1, null), hybrid(null, 0.01, 10_000)).update(Batch.of(y))
    wealths = np.log1p(exact.bets.fractions[:, None] * (y / null - 1)).sum(axis=1)
    loss = np.logaddexp.reduce(exact.bets.log_weights + wealths) - exact.log_evidence
    assert -1e-9 <= loss < 1e-2


def test_evidence_falls_with_the_null_mean_and_grows_with_the_outcomes():
    bets, batch = hybrid(0.3, 0.01, 1000), Batch(np.array([0.1, 0.5, 0.9]), np.array([30.0, 50.0, 20.0]))
    against = [Mixture.open(Bounded(1, m), bets).update(batch).log_evidence for m in np.linspace(0.01, 1.2, 60)]
    assert all(later <= earlier for earlier, later in pairwise(against))
    start = Mixture.open(Bounded(1, 0.3), bets)
    brighter = start.update(Batch(batch.values + 0.05, batch.counts))
    assert brighter.log_evidence > start.update(batch).log_evidence


def test_nulls_at_and_beyond_the_ends_of_the_range():
    bets = hybrid(0.0, 0.01, 1000)
    black, any_light = Batch.of(np.zeros(1)), Batch.of(np.array([0.0, 1e-6]))
    assert Mixture.open(Bounded(1, -0.1), bets).update(black).log_evidence == math.inf
    assert Mixture.open(Bounded(1, 0.0), bets).update(any_light).log_evidence == math.inf
    assert Mixture.open(Bounded(1, 0.0), bets).update(black).log_evidence < 0
    for null in (1.0, 1.5, math.inf):
        white = Batch(np.ones(1), np.array([1e4]))
        assert Mixture.open(Bounded(1, null), hybrid(null, 0.01, 1000)).update(white).peak <= 1e-9


@pytest.mark.parametrize("values", [[0.0], [1.0], [0.0, 1.0], [0.0, 0.3, 1.0], [0.3]])
def test_a_hundred_million_outcomes_count_as_a_hundred_times_a_million(values):
    start = opened("mixture", (1, 0.4), (-1, 0.6), budget=10**8)
    at_once, many = start, start
    at_once = start.update(Batch(np.array(values), np.full(len(values), 1e8)))
    for _ in range(100):
        many = many.update(Batch(np.array(values), np.full(len(values), 1e6)))
    assert math.isfinite(at_once.log_evidence)
    assert math.isclose(at_once.log_evidence, many.log_evidence, rel_tol=1e-9)


@pytest.mark.parametrize(("mean", "budget"), [(1e-9, 10**5), (0.001, 10**3), (0.5, 10**5), (0.999, 10**5), (0.5, 1)])
def test_hybrid_bets_are_safe_spend_everything_and_reach_what_the_budget_needs(mean, budget):
    bets, twin = hybrid(mean, 0.01, budget), brute.hybrid_prior(mean, 0.01, budget)
    assert np.allclose(bets.fractions, [c for c, _ in twin], rtol=1e-12)
    assert np.allclose(np.exp(bets.log_weights), [weight for _, weight in twin], rtol=1e-12)
    assert math.isclose(np.exp(bets.log_weights).sum(), 1)
    assert 0 < bets.fractions.min() <= bets.fractions.max() < 1


def test_every_set_of_bets_spends_everything():
    few, many = scales(0.01, 1), scales(0.01, 10**6)
    for bets in (universal(), few, many, Bets.equal([0.1, 0.2]), hybrid(0.5, 0.01, 10).favouring(2.0, 0.8)):
        assert math.isclose(np.exp(bets.log_weights).sum(), 1)
        assert bets.fractions.min() > 0
    assert universal().fractions.max() < 1
    assert few.fractions.max() == many.fractions.max() == 2
    assert many.fractions.min() <= 4 / 3 * math.sqrt(2 * math.log(100) / 10**6)


def test_a_favoured_bet_takes_its_share():
    bets = hybrid(0.5, 0.01, 1000)
    assert bets.favouring(0.0, 0.8) is bets
    assert math.isclose(math.exp(bets.favouring(0.3, 0.8).log_weights[-1]), 0.8)


@pytest.mark.parametrize("name", LAWS)
def test_best_fraction_is_the_best_of_a_grid(name):
    values, probabilities = law(name)
    null = float(values @ probabilities) * 0.9
    grid = np.geomspace(1e-6, 0.99, 5000)
    gains = np.log1p(grid[:, None] * (values / null - 1)) @ probabilities
    assert math.isclose(best_fraction(values, probabilities, null), grid[gains.argmax()], rel_tol=1e-2)
    assert math.isclose(growth(values, probabilities, null), gains.max(), rel_tol=1e-3)
    assert best_fraction(values, probabilities, null / 0.9 + 1e-9) == 0
    assert growth(values, probabilities, 0.0) == math.inf


def test_a_variance_gives_nearly_the_bet_of_the_law():
    values, probabilities = law("mean of 16")
    mean = float(values @ probabilities)
    variance = float(probabilities @ (values - mean) ** 2)
    bet = variance_fraction(0.01, variance, mean - 0.01)
    assert np.log1p(bet * (values / (mean - 0.01) - 1)) @ probabilities > 0.95 * growth(
        values, probabilities, mean - 0.01
    )


def test_outcomes_keep_mean_and_squares_of_close_values():
    y = 0.123456 + 1e-7 * np.random.default_rng(5).random(5000)
    outcomes, merged = Outcomes(limit=100), Outcomes(limit=100)
    for batch in np.array_split(y, 7):
        outcomes = outcomes.update(Batch.of(batch))
        merged = Outcomes(limit=100).update(Batch.of(batch)).merge(merged)
    for seen in (outcomes, merged):
        assert math.isclose(seen.moments.mean, y.mean(), rel_tol=1e-15)
        assert math.isclose(seen.moments.squares / (y.size - 1), y.var(ddof=1), rel_tol=1e-6)
        assert seen.tally.values.size <= 100
        assert math.isclose(seen.tally.counts.sum(), y.size)
        assert math.isclose(seen.law[1].sum(), 1)


def low_end(outcomes, bets, level):
    return edge_of(outcomes, lambda m: Bounded.at(1, m), bets, level, 0.0)


@pytest.mark.parametrize("shape", [(2, 5), (0.2, 5), (60, 20)])
def test_a_coarse_grid_only_widens_the_interval(shape):
    y = np.random.default_rng(6).beta(*shape, size=20_000)
    exact, coarse = Outcomes(limit=None), Outcomes()
    for batch in np.array_split(y, 20):
        exact, coarse = exact.update(Batch.of(batch)), coarse.update(Batch.of(batch))
    bets = hybrid(float(y.mean()), 0.01, y.size)
    fine, rough = low_end(exact, bets, 0.01), low_end(coarse, bets, 0.01)
    assert coarse.tally.values.size <= 4096 < exact.tally.values.size
    assert fine - 1e-3 * (y.mean() - fine) <= rough <= fine + 1e-12


def ends(outcomes, low_bets, high_bets, side_at, limits):
    signs = zip((1, -1), (low_bets, high_bets), limits, strict=True)
    return [edge_of(outcomes, lambda m, s=sign: side_at(s, m), bets, 0.05, limit) for sign, bets, limit in signs]


@pytest.mark.parametrize("name", LAWS)
def test_both_ends_cover_the_mean_at_every_look(name):
    # Each end may ever pass the mean in 5 % of streams; more than 12 of 60 has probability < 1e-5 then.
    values, probabilities = law(name)
    mean, rng, missed = float(values @ probabilities), np.random.default_rng(21), np.zeros(2)
    bets = hybrid(mean, 0.05, 400), hybrid(1 - mean, 0.05, 400)
    for _ in range(60):
        outcomes, found = Outcomes(), []
        for y in rng.choice(values, (4, 80), p=probabilities):
            outcomes = outcomes.update(Batch.of(y))
            found.append(ends(outcomes, *bets, Bounded.at, (0.0, 1.0)))
            assert found[-1][0] <= outcomes.moments.mean + 1e-12
            assert found[-1][1] >= outcomes.moments.mean - 1e-12
        low, high = np.array(found).T
        missed += low.max() > mean, high.min() < mean
    assert missed.max() <= 12


@pytest.mark.parametrize("p", [0.5, 0.1, 0.002])
def test_ends_without_a_range_cover_the_mean_at_every_look(p):
    # Two values of mean 0 and variance 1, one the rarer the further out.
    values, probabilities = np.array([-math.sqrt(p / (1 - p)), math.sqrt((1 - p) / p)]), [1 - p, p]
    rng, bets, missed = np.random.default_rng(22), scales(0.05, 400), np.zeros(2)
    for _ in range(60):
        outcomes, found = Outcomes(limit=None), []
        for y in rng.choice(values, (4, 80), p=probabilities):
            outcomes = outcomes.update(Batch.of(y))
            found.append(ends(outcomes, bets, bets, Heavy, (-1e6, 1e6)))
        low, high = np.array(found).T
        missed += low.max() > 0, high.min() < 0
        assert -0.5 < low[-1] < high[-1] < 0.5
    assert missed.max() <= 12


@given(
    st.lists(places, min_size=1, max_size=300),
    st.sampled_from([0.2, 0.05, 1e-6]),
    st.sampled_from([1, -1]),
    st.booleans(),
)
@several
def test_an_end_is_that_of_a_bisection_and_is_rejected(y, level, sign, bounded):
    outcomes = Outcomes().update(Batch.of(np.array(y)))
    side_at, bets = (Bounded.at, hybrid(0.4, level, 300)) if bounded else (Heavy, scales(level, 300))
    limit = (0.0 if sign > 0 else 1.0) if bounded else -sign * 1e6

    def rejected(edge):
        return Mixture.open(side_at(sign, edge), bets).update(outcomes.tally).peak >= -math.log(level)

    out, near = limit, outcomes.moments.mean
    for _ in range(60):
        middle = (out + near) / 2
        out, near = (middle, near) if rejected(middle) else (out, middle)
    end = edge_of(outcomes, lambda edge: side_at(sign, edge), bets, level, limit)
    assert math.isclose(end, out, rel_tol=0, abs_tol=2.0**-46 * abs(limit - outcomes.moments.mean) + 1e-13)
    assert end == limit or rejected(end - sign * 1e-15 * abs(end))


def test_an_end_is_where_the_evidence_reaches_the_level():
    batch = Batch(np.array([0.0, 0.3, 1.0]), np.array([20.0, 60.0, 20.0]))
    bets = hybrid(0.4, 0.01, 100)
    end = low_end(Outcomes().update(batch), bets, 0.01)
    near = [Mixture.open(Bounded(1, m), bets).update(batch).log_evidence for m in (end, end + 1e-9)]
    assert near[0] >= math.log(100) > near[1]
    assert low_end(Outcomes().update(Batch.of(np.zeros(50))), bets, 0.01) == 0
