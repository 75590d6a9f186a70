"""Proofs: what is proved is true, what is refuted is shown by the smallest pixel, and certificates can't be forged."""

import copy
import inspect
import json
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sympy import Symbol
from tests.oracle.brute_force import brute

from truemean.errors import InputError, PlanError
from truemean.oracle import Pixel, certificate, check_certificate, derive, prove
from truemean.oracle.plans import catalogue

POOLS_OR_KEEPS = ("kirk-arvo", "two-stage-pooled", "sequential")
LOOKS_AT_A_PLACE = ("centre-first", "centre-and-grid")


def midrange(X, n=2):
    """Of two draws the mean, of more not, and biased on two values for n > 2."""
    S = X.draw(n)
    return (S.min() + S.max()) / 2


def median_of_three(X):
    return np.median(X.draw(3))


def crossed(X):
    S = X.draw(2)
    return np.where(S[0] > S[1], S[0], S[1]) / 2 + np.where(S[0] > S[1], S[1], S[0]) / 2


def beyond_five(X):
    S = X.draw(2)
    return S.mean() if S.max() <= 5 else X.draw(2).mean()


def only_three_values_show_it(X):
    """The bias needs a draw of each of three values."""
    S = X.draw(3)
    return S.mean() if S.statistic(lambda values: len(set(values))) < 3 else X.true_mean() + S.min()


# -- the catalogue ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", LOOKS_AT_A_PLACE)
def test_of_a_plan_that_looks_at_a_place_nothing_is_proved(name):
    proof = prove(catalogue[name])
    assert proof.status == "unknown"
    assert "needs a scene" in proof.reason


@pytest.mark.parametrize("name", [name for name in catalogue if name not in LOOKS_AT_A_PLACE])
def test_what_pools_or_keeps_is_refuted_and_the_rest_proved_by_structure(name):
    proof = prove(catalogue[name])
    assert proof.status == ("biased" if name in POOLS_OR_KEEPS else "unbiased")
    assert (proof.status == "unbiased") is bool(catalogue[name].unbiased)


@pytest.mark.parametrize("name", POOLS_OR_KEEPS)
def test_a_counterexample_has_the_bias_it_says(name):
    params = {"most": 6, "eps": "1/5"} if name == "sequential" else {}
    proof = prove(catalogue[name], **params)
    assert proof.bias == derive(catalogue[name], proof.counterexample, **params).bias != 0
    if name != "two-stage-pooled":  # whose 16 draws are too many for a brute force
        assert proof.bias == brute(catalogue[name], proof.counterexample, **catalogue[name].bind(params)).bias
    assert not check_certificate(proof.certificate)


def test_a_counterexample_is_the_smallest():
    proof = prove(catalogue["kirk-arvo"], n=4)
    assert proof.counterexample.law == {0: Fraction(2, 3), 1: Fraction(1, 3)}
    assert derive(catalogue["kirk-arvo"], Pixel.two("1/2"), n=4).bias == 0


# -- identities ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("plan", [midrange, crossed])
def test_an_identity_for_all_values_and_weights(plan):
    proof = prove(plan)
    assert proof.status == "unbiased at these values"
    assert "whatever they are" in proof.reason
    assert check_certificate(proof.certificate)


def test_an_identity_at_given_values_only():
    proof = prove(beyond_five, values=(0, 1, 2))
    assert proof.status == "unbiased at these values"
    assert "0, 1, 2" in proof.reason
    assert check_certificate(proof.certificate)
    assert prove(beyond_five, values=(0, 6)).status == "biased"
    assert prove(beyond_five, values=(0, 6)).counterexample.values == (0, 6)


@pytest.mark.parametrize(("plan", "k"), [(median_of_three, 2), (only_three_values_show_it, 3)])
def test_a_bias_is_found_with_as_few_values_as_show_it(plan, k):
    proof = prove(plan)
    assert proof.status == "biased"
    assert len(proof.counterexample.values) == k
    assert proof.bias == brute(plan, proof.counterexample).bias


def test_thresholds_are_crossed():
    proof = prove(catalogue["kirk-arvo"], n=3, eps=9)
    assert proof.status == "biased"
    assert max(proof.counterexample.values) - min(proof.counterexample.values) > 9


def test_colours_are_judged_by_channel():
    """On one channel the bias is the opposite of the other's: their sum is zero, and proves nothing."""
    proof = prove(catalogue["kirk-arvo"], n=3, values=((0, 1), (1, 0)))
    assert proof.status == "biased"
    assert sum(proof.bias) == 0 != proof.bias[0]


def test_what_is_not_decided_says_so():
    proof = prove(catalogue["kirk-arvo"], n=Symbol("n"))
    assert proof.status == "unknown"
    assert "give n a number" in proof.reason


# -- certificates -------------------------------------------------------------------------------------


def certified():
    return prove(midrange).certificate


def test_a_certificate_survives_json():
    assert check_certificate(json.loads(json.dumps(certified())))


@settings(max_examples=40)
@given(st.data())
def test_a_tampered_certificate_is_refused(data):
    forged = copy.deepcopy(certified())
    path = data.draw(st.sampled_from([p for p in forged["paths"] if p["terms"]]))
    term = data.draw(st.sampled_from(path["terms"]))
    if data.draw(st.booleans()):
        term[1] += data.draw(st.integers(-5, 5).filter(bool))
    else:
        place = data.draw(st.integers(0, len(term[0]) - 1))
        term[0][place] += data.draw(st.integers(1, 3))
    assert not check_certificate(forged)


@pytest.mark.parametrize("wrong", [{"denominator": 0}, {"weights": 9}])
def test_a_certificate_of_another_shape_is_refused(wrong):
    assert not check_certificate({**certified(), **wrong})


def test_the_checker_is_short_and_uses_nothing_of_the_engine():
    source = inspect.getsource(certificate)
    assert "truemean" not in source
    assert "Fraction" not in source
    code = inspect.getsource(certificate.check_certificate).split('"""')
    assert (code[0] + code[2]).count("\n") < 40


@settings(max_examples=20)
@given(st.integers(2, 4), st.fractions(0, 1, max_denominator=30))
def test_the_paths_of_a_certificate_are_those_of_the_derivation(n, w):
    """Evaluated at a pixel, each path's terms are what that path adds to the bias there."""
    X = Pixel({0: 1 - w, 1: w})
    proof = prove(catalogue["kirk-arvo"], n=n)
    unit = proof.certificate["denominator"]
    shares = [
        sum(Fraction(c, unit) * (1 - w) ** e[0] * w ** e[1] for e, c in path["terms"])
        for path in proof.certificate["paths"]
    ]
    assert sum(shares) == derive(catalogue["kirk-arvo"], X, n=n).bias


# -- bad input ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("k", [0, -1, 2.0, True])
def test_a_wrong_number_of_values(k):
    with pytest.raises(InputError, match=f"k={k}"):
        prove(catalogue["fixed"], k=k)


def test_no_plan_no_proof():
    with pytest.raises(PlanError, match="return a number"):
        prove(lambda X: None)


def test_a_plan_that_needs_a_scene_is_unknown_not_broken():
    def corner(X):
        return X.at(0, 0)

    assert prove(corner).status == "unknown"
