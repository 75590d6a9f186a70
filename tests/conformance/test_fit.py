"""Departures from a declared law: fair under the law, sharp against others."""

import math
from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from truemean.conformance.evidence import Batch
from truemean.conformance.fit import LawFit

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
        after = start.update(Batch.of(atoms[list(places)]))
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
            fit = fit.update(Batch(atoms[counts > 0], counts[counts > 0].astype(float)))
        fired += fit.peak >= math.log(20)
    assert fired <= 28


def test_a_pilot_of_seven_instead_of_eight_is_noticed():
    atoms, probabilities = arrays(kirk_arvo(7))
    rng, fit = np.random.default_rng(23), LawFit.to(kirk_arvo(8), SLACK, 0.01, 10_000)
    for counts in rng.multinomial(100, probabilities, size=40):
        fit = fit.update(Batch(atoms, counts.astype(float)))
    assert fit.peak >= math.log(100)


@pytest.mark.parametrize("name", LAWS)
def test_order_batches_and_merging_do_not_matter(name):
    atoms, probabilities = arrays(LAWS[name])
    start = LawFit.to(LAWS[name], SLACK, 0.01, 1000)
    y = np.random.default_rng(25).choice(atoms, 400, p=probabilities)
    at_once = start.update(Batch.of(y))
    one_by_one = start
    for outcome in y[::-1]:
        one_by_one = one_by_one.update(Batch.of(np.array([outcome])))
    merged = start.update(Batch.of(y[:150])).merge(start.update(Batch.of(y[150:])))
    for other in (one_by_one, merged):
        assert math.isclose(at_once.log_evidence, other.log_evidence, rel_tol=1e-9, abs_tol=1e-9)
        assert other.lean == at_once.lean
        assert other.peak >= other.log_evidence
    assert at_once.merge(start).log_evidence == at_once.log_evidence


def test_it_leans_to_where_the_mean_went():
    fit = LawFit.to(LAWS["coin"], SLACK, 0.01, 1000)
    dark, bright = (fit.update(Batch(np.array([0.0, 1.0]), np.array(n))) for n in ([40.0, 10.0], [10.0, 40.0]))
    assert (dark.lean, bright.lean) == (-1, 1)


def test_an_outcome_off_the_atoms_settles_it_and_rounding_does_not():
    fit = LawFit.to(kirk_arvo(8), SLACK, 0.01, 1000)
    assert fit.update(Batch.of(np.array([0.125 + SLACK / 2]))).log_evidence < 1
    assert fit.update(Batch.of(np.array([0.0, 0.126]))).peak == math.inf


def test_what_is_settled_stays_so_after_good_outcomes_and_after_merging():
    start = LawFit.to(kirk_arvo(8), SLACK, 0.01, 1000)
    good = start.update(Batch.of(np.array([0.0, 0.125])))
    off = good.update(Batch.of(np.array([0.125, 0.5])))
    for fit in (off, off.update(Batch.of(np.array([0.125]))), off.merge(good), good.merge(off), off.merge(off)):
        assert fit.log_evidence == fit.peak == math.inf
        assert fit.update(Batch.of(np.zeros(9))).log_evidence == math.inf
        assert fit.lean in (-1, 1)
    assert good.merge(good).peak < math.inf


def test_a_hundred_million_outcomes_stay_finite():
    fit = LawFit.to(LAWS["rare atom"], SLACK, 0.01, 10**8)
    followed = fit.update(Batch(np.array([0.0, 1.0]), np.array([9.999e7, 1e4])))
    left = fit.update(Batch(np.array([0.0, 1.0]), np.array([5e7, 5e7])))
    assert followed.log_evidence < 0
    assert 1e7 < left.log_evidence < math.inf


def test_atoms_that_rounding_cannot_tell_apart_are_one():
    third = Fraction(1, 3)
    law = {third: Fraction(1, 4), third + Fraction(1, 10**12): Fraction(1, 4), Fraction(1): Fraction(1, 2)}
    fit = LawFit.to(law, SLACK, 0.01, 1000)
    assert fit.atoms.size == 2
    assert np.allclose(np.exp(fit.log_law), 0.5)
    assert fit.update(Batch(np.array([float(third), 1.0]), np.array([50.0, 50.0]))).log_evidence < 0


def test_a_law_of_one_atom_is_followed_or_left():
    fit = LawFit.to({Fraction(1, 2): Fraction(1)}, SLACK, 0.01, 1000)
    assert abs(fit.update(Batch(np.array([0.5]), np.array([1000.0]))).log_evidence) < 1e-6
    assert fit.update(Batch.of(np.array([0.6]))).log_evidence == math.inf
