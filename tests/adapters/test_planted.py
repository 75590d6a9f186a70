"""The planted faults against their exact expectations, derived here by enumeration with fractions.

Means of 200,000 replicates at fixed seeds are compared with the exact expectation at 6 standard errors:
a right implementation would fail one such comparison in 500 million.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import accumulate, pairwise, product

import numpy as np
import pytest

from truemean.adapters import load
from truemean.adapters.planted import (
    FAULTS,
    SUBJECTS,
    FixedMean,
    ImportanceSampling,
    RussianRoulette,
    TwoStage,
    UnbiasedEstimateMean,
)
from truemean.adapters.reference import KirkArvoUnbiased
from truemean.errors import InputError, UnknownName
from truemean.oracle.pixel import Pixel

SEEDS = np.arange(1000, 201_000)
PIXELS = {
    "thin": Pixel.two("1/8"),
    "thick": Pixel.two("7/8"),
    "tones": Pixel({0: "1/2", "1/3": "1/3", 1: "1/6"}),
    "bright": Pixel({"-1/2": "1/4", "3/4": "1/2", 4: "1/4"}),
    "colour": Pixel({(1, 0, 0): "5/8", (0, 1, "1/2"): "1/4", (0, 0, 3): "1/8"}),
    "constant": Pixel({"1/3": 1}),
}
ALL = [(subject, fault) for subject in SUBJECTS for fault in ("", *subject.faults)]


def name_of(argument):
    return getattr(argument, "__name__", argument or "no fault")


def columns(pixel):
    return list(zip(*pixel.values, strict=True)) if pixel.channels else [pixel.values]


def dot(weights, values):
    return sum((w * v for w, v in zip(weights, values, strict=True)), Fraction(0))


def true_mean(subject, values, omega):
    return dot(omega, values)


def divided_by_one_more(subject, values, omega):
    return dot(omega, values) * subject.n / (subject.n + 1)


def clamped(subject, values, omega):
    return dot(omega, [min(max(v, Fraction(0)), Fraction(1)) for v in values])


def by_modulo(subject, values, omega):
    """Each of 256 bytes is one of 100 strata: how much of a stratum lies in the interval of each value."""
    ends = list(accumulate(omega, initial=Fraction(0)))
    total = Fraction(0)
    for byte in range(256):
        low = Fraction(byte % 100, 100)
        high = low + Fraction(1, 100)
        parts = [max(Fraction(0), min(high, b) - max(low, a)) for a, b in pairwise(ends)]
        total += dot(parts, values) * 100 / 256
    return total


def in_float32(subject, values, omega):
    """No pixel of this file is so large that single precision shows at 6 standard errors."""
    return dot(omega, values)


def unweighted(subject, values, omega):
    return dot([(w + Fraction(1, len(omega))) / 2 for w in omega], values)


def path(subject, values, omega, most, kept):
    """Every length that a path may have, up to ``most`` bounces; ``kept``: the throughput's factor of a bounce."""
    a, s = Fraction(subject.albedo), Fraction(subject.survival)
    total = Fraction(0)
    for length in range(1, most + 1):
        probability = s ** (length - 1) * (1 if length == most else 1 - s)
        total += probability * sum((1 - a) * kept**bounce for bounce in range(length))
    return total * dot(omega, values)


def truncated(subject, values, omega):
    return path(subject, values, omega, subject.depth, Fraction(subject.albedo) / Fraction(subject.survival))


def not_divided_by_survival(subject, values, omega):
    return path(subject, values, omega, 100, Fraction(subject.albedo))


EXPECTED = {
    (FixedMean, "off-by-one-weight"): divided_by_one_more,
    (FixedMean, "clamp"): clamped,
    (FixedMean, "modulo-bias"): by_modulo,
    (FixedMean, "float32-accumulation"): in_float32,
    (ImportanceSampling, "missing-renormalisation"): unweighted,
    (RussianRoulette, "truncated-path"): truncated,
    (RussianRoulette, "missing-renormalisation"): not_divided_by_survival,
} | {(subject, ""): true_mean for subject in SUBJECTS}


def pooled(subject, pixel):
    """E of the pooled mean by channel: over every pilot, the fresh samples having the true mean."""
    total = [Fraction(0)] * len(columns(pixel))
    for pilot in product(range(len(pixel.weights)), repeat=subject.p):
        probability = np.prod([pixel.weights[i] for i in pilot])
        n = subject.n1 if len(set(pilot)) == 1 else subject.n2
        for channel, values in enumerate(columns(pixel)):
            drawn = sum(values[i] for i in pilot)
            total[channel] += probability * (drawn + n * dot(pixel.weights, values)) / (subject.p + n)
    return total


def assert_mean(estimates, expected):
    """Each channel's mean lies within 6 standard errors of the exact expectation, and 1e-6 for rounding."""
    by_channel = np.reshape(estimates, (len(estimates), -1))
    error = by_channel.std(axis=0) / np.sqrt(len(by_channel))
    assert (np.abs(by_channel.mean(axis=0) - np.array(expected, dtype=float)) <= 6 * error + 1e-6).all()


@pytest.mark.parametrize("name", PIXELS)
@pytest.mark.parametrize(("subject", "fault"), EXPECTED, ids=name_of)
def test_the_expectation_is_as_derived(subject, fault, name):
    pixel, subject = PIXELS[name], subject(fault=fault)
    expected = [EXPECTED[type(subject), fault](subject, values, pixel.weights) for values in columns(pixel)]
    assert_mean(subject.run(pixel, SEEDS), expected)


@pytest.mark.parametrize("name", PIXELS)
def test_a_kept_pilot_has_the_expectation_of_all_its_outcomes(name):
    pixel, subject = PIXELS[name], TwoStage(p=3, n1=1, n2=4, fault="pilot-kept")
    assert_mean(subject.run(pixel, SEEDS), pooled(subject, pixel))


@pytest.mark.parametrize("name", PIXELS)
def test_a_kept_pilot_of_the_region_biases_the_rest_alone(name):
    pixel, subject = PIXELS[name], UnbiasedEstimateMean(area=0.25, p=3, n1=1, n2=4, fault="pilot-kept")
    means = [dot(pixel.weights, values) for values in columns(pixel)]
    expected = [mean / 4 + rest * 3 / 4 for mean, rest in zip(means, pooled(subject, pixel), strict=True)]
    assert_mean(subject.run(pixel, SEEDS), expected)


def test_every_fault_has_its_expectation_here():
    kept = {(subject, "pilot-kept") for subject in (TwoStage, UnbiasedEstimateMean)}
    assert EXPECTED.keys() | kept == set(ALL)


def test_float32_does_not_see_1_on_top_of_1e8():
    """Floats of 24 bits lie 8 apart there, and the sums of eight values of 10^8 are exact."""
    offset = Pixel({10**8: "7/8", 10**8 + 1: "1/8"})
    assert set(FixedMean(fault="float32-accumulation").run(offset, SEEDS[:1000])) == {1e8}
    assert_mean(FixedMean().run(offset, SEEDS) - 1e8, [Fraction(1, 8)])


@pytest.mark.parametrize("name", PIXELS)
@pytest.mark.parametrize(("subject", "fault"), ALL, ids=name_of)
def test_every_estimate_lies_in_the_range(subject, fault, name):
    pixel, subject = PIXELS[name], subject(fault=fault)
    low, high = [min(column) for column in columns(pixel)], [max(column) for column in columns(pixel)]
    if hasattr(subject, "range"):
        low, high = subject.range(pixel)
    estimates = np.reshape(subject.run(pixel, SEEDS[:20_000]), (20_000, -1))
    assert (estimates >= np.array(low, dtype=float) - 1e-12).all()
    assert (estimates <= np.array(high, dtype=float) + 1e-12).all()


@pytest.mark.parametrize("name", PIXELS)
@pytest.mark.parametrize(("subject", "fault"), ALL, ids=name_of)
def test_a_replicate_depends_on_its_seed_alone(subject, fault, name):
    subject, pixel = subject(fault=fault), PIXELS[name]
    seeds = np.array([2**53 - 1, 5, 0, 17, 123_456_789])
    together = subject.run(pixel, seeds)
    apart = np.concatenate([subject.run(pixel, [seed]) for seed in seeds])
    assert together.shape == (5, 3)[: 1 + (name == "colour")]
    assert together.dtype == np.float64
    assert np.array_equal(together, apart)
    assert np.array_equal(together[::-1], subject.run(pixel, seeds[::-1]))
    assert name == "constant" or len(np.unique(subject.run(pixel, SEEDS[:200]), axis=0)) > 1


@pytest.mark.parametrize("name", PIXELS)
def test_without_a_fault_fig2_is_that_of_the_reference(name):
    ours, reference = UnbiasedEstimateMean(area=0.5, p=2), KirkArvoUnbiased(area=0.5, p=2)
    assert np.array_equal(ours.run(PIXELS[name], SEEDS[:500]), reference.run(PIXELS[name], SEEDS[:500]))
    assert ours.declares == reference.declares


def test_a_twin_declares_the_plan_and_costs_what_its_original_does():
    pixel = PIXELS["tones"]
    for subject, fault in ALL:
        twin, original = subject(fault=fault), subject()
        assert getattr(twin, "declares", None) == getattr(original, "declares", None)
        if hasattr(original, "costs"):
            assert np.array_equal(twin.costs(pixel, SEEDS[:99]), original.costs(pixel, SEEDS[:99]))
    assert FixedMean(n=5).costs(pixel, [1, 2]).tolist() == [5, 5]
    assert ImportanceSampling(n=5).costs(pixel, [1, 2]).tolist() == [5, 5]
    assert_mean(TwoStage(p=2, n1=1, n2=3).costs(Pixel.two("1/2"), SEEDS), [2 + (1 + 3) / 2])


@pytest.mark.parametrize("subject", SUBJECTS)
def test_an_unknown_fault_is_named_with_those_there_are(subject):
    with pytest.raises(UnknownName) as caught:
        subject(fault="rounding")
    message = str(caught.value)
    assert f"no fault of {subject.__name__} is called 'rounding'" in message
    assert all(f"{fault} ({FAULTS[fault]})" in message for fault in subject.faults)


@pytest.mark.parametrize(
    ("subject", "words"),
    [
        ("FixedMean?n=0", ["n=0", "from 1 up"]),
        ("FixedMean?fault=3", ["FixedMean", "'3'", "clamp"]),
        ("TwoStage?n2=few", ["n2='few'", "whole number"]),
        ("TwoStage?fault=clamp", ["TwoStage", "'clamp'", "pilot-kept"]),
        ("UnbiasedEstimateMean?area=1", ["area=1", "between 0 and 1"]),
        ("ImportanceSampling?n=1.5", ["n=1.5", "whole number"]),
        ("RussianRoulette?depth=0", ["depth=0", "from 1 up"]),
        ("RussianRoulette?albedo=0.75", ["albedo=0.75", "albedo < survival"]),
        ("RussianRoulette?survival=much", ["survival='much'", "albedo < survival"]),
    ],
)
def test_an_option_that_cannot_be_meant_is_refused(subject, words):
    with pytest.raises(InputError) as caught:
        load(f"python:truemean.adapters.planted:{subject}")
    assert all(word in str(caught.value) for word in words)


def test_a_fault_is_chosen_in_the_subject():
    assert load("python:truemean.adapters.planted:TwoStage?fault=pilot-kept&p=2") == TwoStage(p=2, fault="pilot-kept")
