"""Figs. 1 and 2 in NumPy against Eq. 6, derived here once more with fractions.

Means of 200,000 replicates at fixed seeds are compared with the exact expectation at 5 standard errors:
a right implementation would fail one such comparison in 1.7 million.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from truemean.adapters.reference import KirkArvo, KirkArvoUnbiased, uniforms
from truemean.oracle.pixel import Pixel

SEEDS = np.arange(1000, 201_000)
PIXELS = {
    "thin": Pixel.two("1/8"),
    "thick": Pixel.two("7/8"),
    "tones": Pixel({0: "1/2", "1/3": "1/3", 1: "1/6"}),
    "colour": Pixel({(1, 0, 0): "5/8", (0, 1, "1/2"): "1/4", (0, 0, 1): "1/8"}),
    "constant": Pixel({"1/4": 1}),
}
SUBJECTS = [KirkArvo(), KirkArvo(n=2), KirkArvoUnbiased(), KirkArvoUnbiased(area=0.5, p=2, n1=1, n2=3)]


def channels(pixel):
    return [list(column) for column in zip(*pixel.values, strict=True)] if pixel.channels else [list(pixel.values)]


def eq1(pixel):
    """I by channel: the sum of omega_i I_i."""
    return [sum(w * v for w, v in zip(pixel.weights, column, strict=True)) for column in channels(pixel)]


def eq6(pixel, n):
    """E[xi] of Fig. 1 by channel: I + sum of omega_i^n (I_i - I)."""
    return [
        mean + sum(w**n * (v - mean) for w, v in zip(pixel.weights, column, strict=True))
        for mean, column in zip(eq1(pixel), channels(pixel), strict=True)
    ]


def assert_mean(estimates, expected):
    """Each channel's mean lies within 5 standard errors of the exact expectation, and 1e-12 for rounding."""
    by_channel = np.reshape(estimates, (len(estimates), -1))
    error = by_channel.std(axis=0) / np.sqrt(len(by_channel))
    assert (np.abs(by_channel.mean(axis=0) - np.array(expected, dtype=float)) <= 5 * error + 1e-12).all()


@pytest.mark.parametrize("n", [1, 2, 4, 9])
@pytest.mark.parametrize("name", PIXELS)
def test_fig1_has_the_expectation_of_eq6(name, n):
    assert_mean(KirkArvo(n=n).run(PIXELS[name], SEEDS), eq6(PIXELS[name], n))


@pytest.mark.parametrize("name", PIXELS)
@pytest.mark.parametrize("subject", SUBJECTS[2:], ids=repr)
def test_fig2_has_the_true_mean(name, subject):
    assert_mean(subject.run(PIXELS[name], SEEDS), eq1(PIXELS[name]))


def test_fig1_takes_a_range_up_to_eps_for_easy():
    """All sequences of three tones: with eps 1/2 a range of 1/2 is still accepted."""
    X = Pixel({0: "1/2", "1/2": "1/4", 1: "1/4"})
    law = dict(zip(X.values, X.weights, strict=True))
    expected = Fraction(0)
    for sample in product(law, repeat=3):
        probability = law[sample[0]] * law[sample[1]] * law[sample[2]]
        expected += probability * (sum(sample) / 3 if max(sample) - min(sample) <= Fraction(1, 2) else X.mean)
    assert_mean(KirkArvo(n=3, eps=0.5).run(X, SEEDS), [expected])
    assert abs(expected - X.mean) > Fraction(1, 100)


def test_fig2_has_the_cost_and_the_variance_of_its_two_branches():
    """P = 1/2 and p = 2 samples: easy with probability 1/2, then 1 sample of the rest, else 3."""
    X, subject = Pixel.two("1/2"), KirkArvoUnbiased(area=0.5, p=2, n1=1, n2=3)
    assert_mean(subject.costs(X, SEEDS), [2 + (1 + 3) / 2])
    squares = (subject.run(X, SEEDS) - 0.5) ** 2
    rest = (Fraction(1, 4) + Fraction(1, 12)) / 2
    assert_mean(squares, [Fraction(1, 4) * (Fraction(1, 8) + rest)])


@pytest.mark.parametrize("name", PIXELS)
@pytest.mark.parametrize("subject", SUBJECTS, ids=repr)
def test_a_replicate_depends_on_its_seed_alone(name, subject):
    seeds = np.array([2**53 - 1, 5, 0, 17, 123_456_789])
    together = subject.run(PIXELS[name], seeds)
    apart = np.concatenate([subject.run(PIXELS[name], [seed]) for seed in seeds])
    assert together.shape == (5, 3)[: 1 + (name == "colour")]
    assert np.array_equal(together, apart)
    assert np.array_equal(together[::-1], subject.run(PIXELS[name], seeds[::-1]))


def test_uniforms_are_uniform_in_seed_and_draw():
    """Chi-squared over 256 cells, of 2 consecutive draws and of 2 consecutive seeds: 5 sigma, one in 1.7 million each."""
    u = uniforms(np.arange(100_000), 0, 4)
    assert ((u >= 0) & (u < 1)).all()
    for first, second in ((u[:, 0], u[:, 1]), (u[:, 2], u[:, 3]), (u[:-1:2, 0], u[1::2, 0]), (u[:-1:2, 3], u[1::2, 3])):
        counts = np.histogram2d(first, second, bins=16, range=[[0, 1]] * 2)[0]
        expected = len(first) / 256
        chi2 = ((counts - expected) ** 2 / expected).sum()
        assert abs(chi2 - 255) < 5 * np.sqrt(2 * 255)


@pytest.mark.parametrize("subject", SUBJECTS, ids=repr)
def test_declares_a_plan_with_its_own_parameters(subject):
    plan, params = subject.declares
    assert plan == {"KirkArvo": "kirk-arvo", "KirkArvoUnbiased": "kirk-arvo-unbiased"}[type(subject).__name__]
    assert type(subject)(**params) == subject
