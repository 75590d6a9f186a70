"""Planted faults in code that asks for its samples: each is found with its exact bias, and its cure passes."""

from __future__ import annotations

import time
from fractions import Fraction

import numpy as np
import pytest

from truemean.adapters import asking
from truemean.conformance import Verdict, judge
from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue

SLACK = Fraction(1, 10**9)  # of a pixel of scale 1
EIGHTH = {"eighth": Pixel.two("1/8")}


def judged(code, tolerance=0):
    (case,) = judge(asking(code), tolerance=tolerance, pixels=EIGHTH).cases
    return case


def mean(draw):
    return draw(4).mean()


def discard_pilot(draw):
    return draw(4 if np.ptp(draw(2)) else 2).mean()


def keep_pilot(draw):
    S = draw(2)
    return np.concatenate([S, draw(4)]).mean() if np.ptp(S) else S.mean()


def off_by_one(draw):
    return draw(4).sum() / 5


def clamped(draw):
    return draw(4).clip(0, 0.75).mean()


def roulette(draw, factor=0.75, survival="3/4"):
    light = 0.5 * draw()
    return light + 0.5 / factor * draw() if draw.coin(survival) else light


def first_when_equal(draw):
    """A stopping rule that looks at the estimate."""
    samples = [draw()]
    while len(samples) < 4 and not samples[-1]:
        samples.append(draw())
    return sum(samples) / len(samples)


def fixed_in_advance(draw):
    return sum(draw() for _ in range(4)) / 4


FAULTS = {  # code, its cure, and its bias on the pixel of 1/8
    "pilot kept": (keep_pilot, discard_pilot, derive(catalogue["two-stage-pooled"], EIGHTH["eighth"], n=2, m=4).bias),
    "off by one": (off_by_one, mean, Fraction(-1, 40)),
    "clamp": (clamped, mean, Fraction(-1, 32)),
    "no renormalisation": (lambda draw: roulette(draw, factor=1.0), roulette, Fraction(-1, 64)),
    "stops when it likes": (
        first_when_equal,
        fixed_in_advance,
        sum(Fraction(7, 8) ** (n - 1) / 8 / n for n in range(1, 5)) - Fraction(1, 8),
    ),
    "one in a thousand": (lambda draw: mean(draw) + 0.001 * draw.coin("1/1000"), mean, Fraction(1, 10**6)),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_planted_fault_is_found_with_its_exact_bias_and_its_cure_passes(name):
    fault, cure, bias = FAULTS[name]
    case = judged(fault)
    assert case.verdict is Verdict.BIASED
    assert abs(case.exact_bias - bias) < Fraction(1, 10**15)
    assert judged(cure).verdict is Verdict.CONFORMS
    # It is not found where it is allowed.
    assert judged(fault, abs(bias) + SLACK).verdict is Verdict.CONFORMS


def fig_1(pixel, draw):
    values, weights = pixel.arrays()
    samples = draw(4)
    return samples[0] if np.ptp(samples) == 0 else float(values @ weights)


def test_regions_and_discoveries_count_what_is_exactly_biased():
    pixels = EIGHTH | {"half": Pixel.two("1/2")}
    report = judge(asking(fig_1), tolerance="1%", pixels=pixels, regions={"left": ["eighth"], "right": ["half"]})
    assert report.discoveries == ("eighth",)
    assert [(region.name, region.biased) for region in report.regions] == [("left", True), ("right", False)]


def test_a_timeout_or_an_interrupt_ends_exact_runs_too():
    def slow(draw):
        time.sleep(0.05)
        return draw()

    report = judge(asking(slow), tolerance="1%", timeout=0.01)
    assert {case.replicates for case in report.cases[1:]} <= {0, 16}
    assert "stopped by timeout=0.01" in report.cases[-1].reason

    def interrupted(draw):
        raise KeyboardInterrupt

    report = judge(asking(interrupted), tolerance="1%")
    assert (report.interrupted, report.verdict) == (True, Verdict.INCONCLUSIVE)
