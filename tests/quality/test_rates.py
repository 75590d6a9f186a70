"""The error rates of the judge itself, measured, and that it is not slower than was promised.

Each law has |E - I| exactly at the tolerance, where both wrong verdicts are as likely as they can be.
"""

from collections import Counter

import numpy as np
import pytest
from tests.quality.rates import limit

from truemean.conformance import Verdict, judge
from truemean.oracle.pixel import Pixel

LEVEL = 0.1
RUNS = 16  # on each law
RARELY = 1e-6  # how often a test fails if the judge keeps its levels

EDGES = {
    "coin": (Pixel.two("1/2"), "1/10", [(0.0, 0.4), (1.0, 0.6)]),
    "dark coin": (Pixel.two("1/8"), "1/16", [(0.0, 15 / 16), (1.0, 1 / 16)]),
    "rare bright": (Pixel.two("1/1000"), "1/1000", [(0.0, 0.998), (1.0, 0.002)]),
    "no noise": (Pixel({0: "0.1", "0.2": "0.89", 1: "0.01"}), "0.012", [(0.2, 1.0)]),
    "three values": (Pixel.two("1/2"), "1/20", [(0.25, 0.2), (0.5, 0.6), (1.0, 0.2)]),
}


def subject_of(law):
    values, probabilities = np.array(law).T

    def draws(pixel, seeds):
        return np.random.default_rng(int(seeds[0])).choice(values, seeds.size, p=probabilities)

    return draws


def verdict_of(name, tolerance, **arguments):
    pixel, _, law = EDGES[name]
    # A law of one atom ignores its seed, rightly.
    report = judge(subject_of(law), pixels=pixel, tolerance=tolerance, deterministic=len(law) == 1 or None, **arguments)
    return report.verdict


def test_wrong_verdicts_on_the_edge_are_as_rare_as_promised():
    verdicts = [
        (verdict_of(name, edge, alpha=LEVEL, beta=LEVEL, budget=1500, seed=seed), name)
        for name, (_, edge, _) in EDGES.items()
        for seed in range(RUNS)
    ]
    counts = Counter(verdict for verdict, _ in verdicts)
    assert set(counts) <= {Verdict.BIASED, Verdict.CONFORMS, Verdict.INCONCLUSIVE}, Counter(verdicts)
    most = limit(len(verdicts), RARELY, LEVEL)
    assert counts[Verdict.BIASED] <= most, Counter(verdicts)
    assert counts[Verdict.CONFORMS] <= most, Counter(verdicts)


def test_a_run_over_many_pixels_raises_one_false_alarm_rate():
    pixels = {str(i): Pixel.two("1/2") for i in range(4)}
    coin = subject_of([(0.0, 0.5), (1.0, 0.5)])
    reports = [
        judge(coin, pixels=pixels, tolerance=0, alpha=LEVEL, beta=LEVEL, budget=150, seed=seed) for seed in range(40)
    ]
    assert sum(report.verdict is Verdict.BIASED for report in reports) <= limit(40, RARELY, LEVEL)


@pytest.mark.parametrize("name", EDGES)
def test_five_times_the_tolerance_is_found_and_half_of_it_excused(name):
    pixel, _, law = EDGES[name]
    bias = abs(sum(v * p for v, p in law) - float(pixel.mean))
    found = verdict_of(name, bias / 5, seed=5)
    excused = verdict_of(name, bias * 2, seed=5)
    assert (found, excused) == (Verdict.BIASED, Verdict.CONFORMS)
