"""Many cases: each rule against its definition in exact fractions, its error rate and its power in simulations."""

import math
from fractions import Fraction
from itertools import chain, combinations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from truemean.conformance.many import (
    Group,
    aggregate,
    average,
    check_regions,
    common_fractions,
    e_bh,
    fractions_at,
    holm,
    holm_level,
    least_common,
    sparse_common,
    tiles,
)
from truemean.errors import InputError, InputTypeError, UnknownName

ALPHA = Fraction(1, 20)
# No half-integer is a threshold of either test for up to six cases: rounding can't decide.
E_VALUES = st.lists(st.integers(0, 400).map(lambda n: Fraction(2 * n + 1, 2)), min_size=1, max_size=6)
LOGS = st.lists(st.floats(-1e4, 1e4) | st.sampled_from([-math.inf, math.inf]), min_size=1, max_size=12)
TESTS = pytest.mark.parametrize("rejects", [holm, e_bh])


def log(number):
    """The logarithm of a fraction of any size."""
    return math.log(number.numerator) - math.log(number.denominator) if number else -math.inf


def mean(numbers):
    return sum(numbers, Fraction(0)) / len(numbers)


def closed_test(e_values):
    """Holm's test by its definition: a case is rejected if every set of cases with it is, by Bonferroni."""
    places = range(len(e_values))
    sets = list(chain.from_iterable(combinations(places, size) for size in range(1, len(places) + 1)))
    kept = [members for members in sets if max(e_values[i] for i in members) < len(members) / ALPHA]
    return [all(i not in members for members in kept) for i in places]


def e_bh_by_definition(e_values):
    def reach(k):
        return [e >= len(e_values) / ALPHA / k for e in e_values]

    return next((reach(k) for k in range(len(e_values), 0, -1) if sum(reach(k)) >= k), [False] * len(e_values))


def sparse_common_by_definition(wealths):
    pixels, nodes = len(wealths), range(len(wealths[0][0]))
    shares = [Fraction(2**j, pixels) for j in range(pixels.bit_length())]
    mixes = [math.prod(1 - s + s * (up[k] + down[k]) / 2 for up, down in wealths) for s in shares for k in nodes]
    signed = [mean([math.prod(pixel[sign][k] for pixel in wealths) for k in nodes]) for sign in (0, 1)]
    return mean([mean(mixes), *signed])


@given(E_VALUES)
def test_the_average_is_that_of_the_fractions(e_values):
    assert math.isclose(average([log(e) for e in e_values]), log(mean(e_values)), abs_tol=1e-14)


@given(st.lists(st.integers(-14_427, 14_427), min_size=1, max_size=12))
def test_the_average_is_stable_where_e_values_overflow(powers):
    exact = log(mean([Fraction(2) ** power for power in powers]))
    assert math.isclose(average([power * math.log(2) for power in powers]), exact, abs_tol=1e-11)


def test_a_proof_anywhere_is_a_proof_and_lost_bets_are_none():
    assert average([-math.inf, 0, math.inf]) == math.inf
    assert average([-math.inf, -math.inf]) == -math.inf
    assert average([-math.inf, 0]) == -math.log(2)


@given(E_VALUES)
def test_holm_is_the_closure_of_bonferroni(e_values):
    assert holm([log(e) for e in e_values], 0.05).tolist() == closed_test(e_values)


@given(E_VALUES)
def test_e_bh_is_its_definition(e_values):
    assert e_bh([log(e) for e in e_values], 0.05).tolist() == e_bh_by_definition(e_values)


@TESTS
@given(LOGS, st.data())
def test_more_evidence_loses_no_rejection(rejects, logs, data):
    before = rejects(logs, 0.05)
    place = data.draw(st.integers(0, len(logs) - 1))
    logs[place] = data.draw(st.floats(logs[place], math.inf))
    assert (rejects(logs, 0.05) >= before).all()


@TESTS
@given(LOGS, st.randoms())
def test_the_order_of_cases_does_not_matter(rejects, logs, random):
    places = list(range(len(logs)))
    random.shuffle(places)
    assert (rejects(np.take(logs, places), 0.05) == rejects(logs, 0.05)[places]).all()


@given(LOGS, st.floats(0.001, 0.5))
def test_e_bh_rejects_what_holm_does_and_holm_what_bonferroni_does(logs, alpha):
    step_down = holm(logs, alpha)
    assert (step_down >= (np.array(logs) >= math.log(len(logs) / alpha) + 1e-9)).all()
    assert (e_bh(logs, alpha) >= holm(np.subtract(logs, 1e-9), alpha)).all()


@TESTS
def test_proofs_are_rejected_and_lost_bets_are_not(rejects):
    assert rejects([math.inf, -math.inf, 0.0, math.inf], 0.01).tolist() == [True, False, False, True]
    assert not rejects([-math.inf, -math.inf], 0.01).any()


@given(st.lists(st.lists(st.floats(-5, 9), min_size=5, max_size=5), min_size=1, max_size=12))
def test_holm_may_be_used_one_case_at_a_time(looks):
    peaks, named = np.zeros(5), []
    for logs in looks:
        waiting = [i for i in range(5) if i not in named]
        peaks[waiting] = np.maximum(peaks, logs)[waiting]  # what is named draws no more
        while found := [i for i in waiting if peaks[i] >= -math.log(holm_level(0.05, 5, len(named)))]:
            named.append(found[0])
            waiting.remove(found[0])
    assert np.flatnonzero(holm(np.max([np.zeros(5), *looks], axis=0), 0.05)).tolist() == sorted(named)


WEALTHS = st.integers(1, 3).flatmap(
    lambda nodes: st.lists(
        st.lists(
            st.lists(st.fractions(0, 50, max_denominator=9), min_size=nodes, max_size=nodes), min_size=2, max_size=2
        ),
        min_size=1,
        max_size=6,
    )
)


@given(WEALTHS)
@settings(max_examples=40)
@example([[[Fraction(0)], [Fraction(0)]]])
def test_the_sparse_mixture_is_its_formula(wealths):
    logs = [[[log(e) for e in nodes] for nodes in signs] for signs in wealths]
    assert math.isclose(sparse_common(logs), log(sparse_common_by_definition(wealths)), rel_tol=1e-11, abs_tol=1e-12)


@pytest.mark.parametrize("height", [-1e4, -1e-9, 0.0, 1e4, math.inf, -math.inf])
def test_the_sparse_mixture_of_one_pixel_is_its_average(height):
    assert math.isclose(sparse_common([[[height] * 3] * 2]), height, rel_tol=1e-6, abs_tol=1e-14)


@pytest.mark.parametrize("pixels", [3, 4])
def test_the_sparse_mixture_where_e_values_overflow(pixels):
    logs = np.full((pixels, 2, 3), 1e4)
    assert math.isclose(sparse_common(logs), 1e4 * pixels, rel_tol=1e-3)
    logs[:, 1] = -1e4
    assert math.isclose(sparse_common(logs), 1e4 * pixels, rel_tol=1e-3)
    logs[:, 0] = -1e4
    kept = [(1 - 2**j / pixels) ** pixels for j in range(pixels.bit_length())]  # what no bet puts at stake
    assert math.isclose(sparse_common(logs), math.log(np.mean(kept) / 3), rel_tol=1e-12)


def test_a_proof_at_one_pixel_outweighs_lost_bets_at_others_as_long_as_something_is_kept():
    logs = np.full((4, 2, 2), -math.inf)
    logs[0] = math.inf
    assert sparse_common(logs) == math.inf
    assert sparse_common(logs[1:2]) == -math.inf


@given(WEALTHS, st.randoms())
@settings(max_examples=20)
def test_the_sparse_mixture_knows_neither_order_nor_sign(wealths, random):
    logs = np.log1p(np.array(wealths, dtype=float))
    shuffled = list(range(len(wealths)))
    random.shuffle(shuffled)
    assert math.isclose(sparse_common(logs[shuffled]), sparse_common(logs), abs_tol=1e-10)
    assert math.isclose(sparse_common(logs[:, ::-1]), sparse_common(logs), abs_tol=1e-10)


def test_a_hundred_thousand_pixels():
    logs = np.zeros((100_000, 2, 12))
    assert abs(sparse_common(logs)) < 1e-9
    logs[:, 0], logs[:, 1] = 0.001, -0.001
    assert math.isclose(sparse_common(logs), 100 - math.log(3), rel_tol=1e-9)


def test_nodes_go_down_to_what_the_budget_can_show():
    least = least_common([0.5] * 64, 0.01, 1000)
    nodes = common_fractions(least)
    assert nodes[0] == 0.99
    assert nodes[-1] <= least < nodes[-2]
    assert (nodes[1:] * 2 == nodes[:-1]).all()
    assert common_fractions(0.99).tolist() == [0.99]
    m = 0.2  # one pixel: the bet that the budget needs
    c_min = math.sqrt(2 * math.log(100) * m / ((1 - m) * 1000))
    assert math.isclose(fractions_at(np.array([least_common([m], 0.01, 1000)]), m)[0], c_min)


def test_a_node_bets_the_same_amount_on_each_sign_and_never_more_than_is_safe():
    nodes, m = common_fractions(0.001), 0.3
    up, down = fractions_at(nodes, m) / m, fractions_at(nodes, 1 - m) / (1 - m)
    assert np.allclose(up[2:], down[2:])
    assert (fractions_at(nodes, 1.0) == 0.99).all()


class Coins:
    """Pixels whose outcomes are 0 or 1, and every common bet on them; ``shared`` gives all the same seeds."""

    def __init__(self, rng, nulls, biases=0.0, *, shared=False, nodes=8, batch=16):
        self.rng, self.batch, self.shared = rng, batch, shared
        self.truths = np.clip(nulls + biases, 0, 1)
        grid = common_fractions(0.99 / 2 ** (nodes - 1))
        sides = [[(m, 1 - m) for m in nulls], [(1 - m, m) for m in nulls]]
        bets = np.array([[fractions_at(grid, m) for m, _ in side] for side in sides])
        wins = np.array([[rest / m for m, rest in side] for side in sides])
        self.win = np.log1p(bets * wins[:, :, None]).transpose(1, 0, 2)
        self.lose = np.log1p(-bets).transpose(1, 0, 2)

    def looks(self, number):
        """The log wealths ``[pixels, 2, nodes]`` after each look."""
        logs = np.zeros_like(self.win)
        for _ in range(number):
            size = (self.batch, 1 if self.shared else self.truths.size)
            heads = (self.rng.random(size) < self.truths).sum(axis=0)
            tosses = np.stack([heads, self.batch - heads], axis=1)[:, :, None]
            logs = logs + tosses * self.win + tosses[:, ::-1] * self.lose
            yield logs


def each(logs):
    """The current log e-value of each pixel."""
    return np.logaddexp.reduce(logs.reshape(len(logs), -1), axis=1) - math.log(logs[0].size)


# Of 400 runs at most 5 % may reject; if 5 % do, more than 44 do with probability < 1e-5 (binomial).
RUNS, MOST = 400, 44
NULLS = np.linspace(0.05, 0.95, 12)


@pytest.mark.parametrize("shared", [False, True], ids=["independent", "same seeds"])
def test_the_error_rate_of_the_average_and_of_holm_under_looks(shared):
    rng, anywhere, named = np.random.default_rng(1), 0, 0
    for _ in range(RUNS):
        logs = np.array([each(logs) for logs in Coins(rng, NULLS, shared=shared).looks(25)])
        anywhere += max(average(now) for now in logs) >= math.log(20)
        named += bool(holm(logs.max(axis=0), 0.05).any())
    assert anywhere <= MOST
    assert named <= MOST


def test_the_error_rate_of_holm_beside_planted_biases():
    rng, wrong, found = np.random.default_rng(2), 0, 0
    biases = np.where(np.arange(12) % 3, 0, np.where(NULLS < 0.5, 0.3, -0.3))
    for _ in range(RUNS):
        named = holm(np.max([each(logs) for logs in Coins(rng, NULLS, biases).looks(15)], axis=0), 0.05)
        wrong += bool(named[biases == 0].any())
        found += int(named[biases != 0].sum())
    assert wrong <= MOST
    assert found > 0.9 * RUNS * np.count_nonzero(biases)


def test_the_error_rate_of_the_sparse_mixture_under_looks():
    rng, fired = np.random.default_rng(3), 0
    for _ in range(RUNS):
        fired += any(sparse_common(logs) >= math.log(20) for logs in Coins(rng, NULLS).looks(25))
    assert fired <= MOST


def test_the_sparse_mixture_is_wrong_for_pixels_that_share_seeds():
    rng, fired = np.random.default_rng(4), 0
    for _ in range(100):
        fired += any(sparse_common(logs) >= math.log(20) for logs in Coins(rng, NULLS, shared=True).looks(25))
    assert fired > 25  # of 100, where 5 are allowed


def test_the_false_discovery_rate_of_e_bh():
    # The share lies in [0, 1], its mean is at most 5 %: the standard error of 400 is below 1.1 %.
    rng, shares, sharp = np.random.default_rng(5), [], []
    nulls, biases = np.linspace(0.1, 0.7, 32), np.repeat([0.25, 0], [8, 24])
    for _ in range(RUNS):
        *_, logs = Coins(rng, nulls, biases).looks(12)
        named = e_bh(each(logs), 0.05)
        assert named[:8].sum() > 0
        shares.append(named[8:].sum() / named.sum())
        # Null e-values that are the height of one threshold or 0: 0.05 * 24/32 is nearly reached.
        height = 32 / 9 / 0.05 * (1 + 1e-9)
        lucky = rng.random(24) < 1 / height
        named = e_bh(
            np.where(np.arange(32) < 8, math.inf, np.append(np.zeros(8), np.where(lucky, np.log(height), -9))), 0.05
        )
        sharp.append(named[8:].sum() / named.sum())
    assert np.mean(shares) <= 0.05
    assert 0.02 < np.mean(sharp) < 0.05


SCENES = {"8 of 256": (np.repeat([0.3, 0.0], [8, 248]), 0.7), "all slightly": (np.full(256, 0.02), 0.5)}


@pytest.mark.parametrize("name", SCENES)
def test_the_sparse_mixture_finds_what_the_average_finds_later_or_never(name):
    biases, ratio = SCENES[name]
    rng, looks = np.random.default_rng(6), {"average": [], "sparse": []}
    for _ in range(7):
        coins = Coins(rng, rng.permutation(np.linspace(0.1, 0.6, 256)), biases, nodes=12, batch=8)
        evidence = {"average": lambda logs: average(each(logs)), "sparse": sparse_common}
        for number, logs in enumerate(coins.looks(40), 1):
            for rule in list(evidence):
                if evidence[rule](logs) >= math.log(100):
                    looks[rule].append(number)
                    del evidence[rule]
            if not evidence:
                break
        for rule in evidence:
            looks[rule].append(math.inf)
    assert np.median(looks["sparse"]) <= ratio * np.median(looks["average"])
    assert max(looks["sparse"]) < math.inf


def test_tiles_are_read_off_the_names():
    names = ["s#12,7", "s#0,0", "s#7,7", "s#8,7", "s#3,8"]
    assert tiles(names, 8) == {
        "tile 0,0": ("s#0,0", "s#7,7"),
        "tile 1,0": ("s#12,7", "s#8,7"),
        "tile 0,1": ("s#3,8",),
    }
    assert tiles(["10,0", "9,0"], 10) == {"tile 0,0": ("9,0",), "tile 1,0": ("10,0",)}
    assert list(tiles(["a#0,0", "b#0,0", "0,0"], 4)) == ["#tile 0,0", "a#tile 0,0", "b#tile 0,0"]
    assert tiles(["a#b#1,2"], 1) == {"tile 1,2": ("a#b#1,2",)}
    assert tiles([], 8) == {}


@pytest.mark.parametrize("name", ["edge", "s#1", "s#-1,2", "1,2,3", "s#1, 2", "s#1,2\n", "s#1.5,2"])
def test_a_pixel_without_a_place_has_no_tile(name):
    with pytest.raises(InputError, match="has no place: tiles need names like '12,7'"):
        tiles(["0,0", name], 8)


@pytest.mark.parametrize("size", [0, -8, 1.5, "8"])
def test_a_tile_has_a_size(size):
    with pytest.raises(InputError, match="must be a positive number of pixels"):
        tiles(["0,0"], size)


def test_regions_are_of_known_pixels():
    assert check_regions({"lamp": iter(["b", "a", "b"])}, ["a", "b"]) == {"lamp": ("b", "a")}
    assert check_regions({}, ["a"]) == {}
    with pytest.raises(UnknownName, match="no pixel is called 'edge2'; did you mean edge1"):
        check_regions({"lamp": ["edge2"]}, ["edge1"])
    with pytest.raises(InputError, match="region 'lamp' has no pixels"):
        check_regions({"lamp": []}, ["a"])
    with pytest.raises(InputTypeError, match="region 'lamp' is the text 'a'"):
        check_regions({"lamp": "a"}, ["a"])


def test_groups_average_their_cases_and_are_tested_together():
    logs = {"a": math.log(300), "b": [math.log(3), 0.0, -math.inf], "c": 0.0}
    all_of_it, right = aggregate({"all": ["a", "b", "c"], "right": ["b"]}, logs, 0.05)
    assert all_of_it == Group("all", 5, average([math.log(300), math.log(3), 0, -math.inf, 0]), biased=True)
    assert right == Group("right", 3, average([math.log(3), 0, -math.inf]), biased=False)
    assert not aggregate({"all": ["a", "b", "c"], "right": ["b"], "left": ["c"], "c": ["c"]}, logs, 0.05)[0].biased
    assert aggregate({}, logs, 0.05) == ()
    with pytest.raises(UnknownName, match="no pixel is called 'd'"):
        aggregate({"all": ["d"]}, logs, 0.05)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: average([]), r"log e-values of shape \(0,\): give an array of 1 dim"),
        (lambda: holm([[0.0]], 0.1), r"log e-values of shape \(1, 1\)"),
        (lambda: e_bh([0.0, math.nan], 0.1), r"log e-values hold NaN at \[1\]"),
        (lambda: holm([0.0], 1), r"alpha=1 must lie strictly between 0 and 1"),
        (lambda: e_bh([0.0], 0.0), r"alpha=0.0 must lie"),
        (lambda: holm_level(1.5, 2, 0), r"alpha=1.5 must lie"),
        (lambda: holm_level(0.1, 2, 2), r"rejected=2 of cases=2: ask only while"),
        (lambda: sparse_common(np.zeros((2, 2))), r"log_wealths of shape \(2, 2\): give an array of 3 dim"),
        (lambda: sparse_common(np.zeros((2, 3, 1))), r"log_wealths has shape \(2, 3, 1\): give \[pixels, 2"),
        (lambda: common_fractions(0), r"least=0 must lie above 0 and be at most 0.99"),
        (lambda: least_common([0.5, 1.0], 0.1, 9), r"means=array\(\[0.5, 1. \]\) must lie strictly"),
    ],
)
def test_what_can_not_be_meant_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()
