"""Departures from a declared law: fair under the law, sharp against others."""

import math
from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from truemean.conformance.fit import LawFit, MeanFit

SLACK = 1e-9


def kirk_arvo(n, white=Fraction(1, 8)):
    """The law of Fig. 1 on the two-value pixel: black or white when all draws agree, else the true mean."""
    return {Fraction(0): (1 - white) ** n, Fraction(1): white**n, white: 1 - (1 - white) ** n - white**n}


LAWS = {
    "three atoms": kirk_arvo(8),
    "coin": {Fraction(0): Fraction(1, 2), Fraction(1): Fraction(1, 2)},
    "rare atom": {Fraction(0): Fraction(9999, 10000), Fraction(1): Fraction(1, 10000)},
    "mean of 16": {Fraction(i, 16): Fraction(math.comb(16, i) * 7 ** (16 - i), 8**16) for i in range(17)},
}


def arrays(law):
    return np.array([float(a) for a in law]), np.array([float(p) for p in law.values()])


@pytest.mark.parametrize("name", LAWS)
def test_the_evidence_is_fair_over_all_sequences_of_three(name):
    atoms, probabilities = arrays(LAWS[name])
    start = LawFit.to(LAWS[name], SLACK, 0.01, 1000)
    total = 0.0
    for places in product(range(atoms.size), repeat=3):
        after = start.update(atoms[list(places)], np.ones(3))
        total += math.prod(probabilities[list(places)]) * math.exp(after.log_evidence)
    assert math.isclose(total, 1, rel_tol=1e-9)


@pytest.mark.parametrize("name", LAWS)
def test_ville_under_many_looks(name):
    # At most 5 % of 200 streams may ever fire; more than 28 has probability < 1e-5 then.
    atoms, probabilities = arrays(LAWS[name])
    rng, fired = np.random.default_rng(22), 0
    start = LawFit.to(LAWS[name], SLACK, 0.05, 1000)
    for _ in range(200):
        fit = start
        for counts in rng.multinomial(50, probabilities, size=20):
            fit = fit.update(atoms[counts > 0], counts[counts > 0].astype(float))
        fired += fit.peak >= math.log(20)
    assert fired <= 28


def test_a_pilot_of_seven_instead_of_eight_is_noticed():
    atoms, probabilities = arrays(kirk_arvo(7))
    rng, fit = np.random.default_rng(23), LawFit.to(kirk_arvo(8), SLACK, 0.01, 10_000)
    for counts in rng.multinomial(100, probabilities, size=40):
        fit = fit.update(atoms, counts.astype(float))
    assert fit.peak >= math.log(100)


def test_an_outcome_off_the_atoms_settles_it_and_rounding_does_not():
    fit = LawFit.to(kirk_arvo(8), SLACK, 0.01, 1000)
    assert fit.update(np.array([0.125 + SLACK / 2]), np.ones(1)).log_evidence < 1
    assert fit.update(np.array([0.0, 0.126]), np.ones(2)).peak == math.inf


def test_atoms_that_rounding_cannot_tell_apart_are_one():
    third = Fraction(1, 3)
    law = {third: Fraction(1, 4), third + Fraction(1, 10**12): Fraction(1, 4), Fraction(1): Fraction(1, 2)}
    fit = LawFit.to(law, SLACK, 0.01, 1000)
    assert fit.atoms.size == 2
    assert np.allclose(np.exp(fit.log_law), 0.5)
    assert fit.update(np.array([float(third), 1.0]), np.array([50.0, 50.0])).log_evidence < 0


def test_a_law_of_one_atom_is_followed_or_left():
    fit = LawFit.to({Fraction(1, 2): Fraction(1)}, SLACK, 0.01, 1000)
    assert abs(fit.update(np.array([0.5]), np.array([1000.0])).log_evidence) < 1e-6
    assert fit.update(np.array([0.6]), np.ones(1)).log_evidence == math.inf


def test_the_mean_alone_is_compared_where_the_law_is_too_large():
    rng = np.random.default_rng(24)
    same = MeanFit.to(0.3, SLACK, 0.01, 10_000)
    other = MeanFit.to(0.35, SLACK, 0.01, 10_000)
    for batch in rng.beta(3, 7, size=(20, 500)):
        same, other = (fit.update(batch, np.ones(batch.size)) for fit in (same, other))
    assert same.peak < math.log(100) <= other.peak
