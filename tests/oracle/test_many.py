"""Many pixels at once against each pixel by itself."""

import random
from fractions import Fraction

import numpy as np
import pytest

from truemean.errors import InputError, PlanError
from truemean.oracle import Pixel, derive, derive_many
from truemean.oracle.plans import catalogue

RESULTS = ("bias", "expectation", "variance", "mse", "cost")


def pixels(values, count=12):
    generator = random.Random(0)
    weights = [[generator.randint(1, 9) for _ in values] for _ in range(count)]
    return [Pixel({v: Fraction(w, sum(row)) for v, w in zip(values, row, strict=True)}) for row in weights]


@pytest.mark.parametrize("name", ["kirk-arvo", "kirk-arvo-unbiased", "discard-pilot", "two-stage-pooled", "fixed"])
@pytest.mark.parametrize(
    "population",
    [
        [*pixels([0, 1]), *pixels([0, Fraction(1, 3), 5]), *pixels([1, 0])],
        pixels([(0, 1, 0), (1, 0, 0), (Fraction(1, 2), 1, 1)]),
    ],
    ids=["scalars of three sets of values", "colours"],
)
@pytest.mark.parametrize("eps", [0, Fraction(1, 2)])
def test_every_pixel_has_its_own_results(name, population, eps):
    params = {} if name == "fixed" else {"eps": eps}
    many = derive_many(catalogue[name], population, **params)
    for result in RESULTS:
        exact = np.array([getattr(derive(catalogue[name], p, **params), result) for p in population], dtype=float)
        assert np.abs(getattr(many, result) - exact).max() < 1e-13


def test_a_loop_has_its_own_results_on_every_pixel():
    population = pixels([0, 1, 3])
    many = derive_many(catalogue["sequential"], population, most=12, eps="1/3")
    exact = [derive(catalogue["sequential"], p, most=12, eps="1/3") for p in population]
    assert np.abs(many.bias - [float(d.bias) for d in exact]).max() < 1e-13
    assert np.abs(many.cost - [float(d.cost) for d in exact]).max() < 1e-12


def test_moments_have_their_own_results_on_every_pixel():
    def by_variance(X):
        S = X.draw(5)
        return S.mean() if S.variance() <= 2 else X.draw(2).mean() * S.max()

    population = pixels([0, 1, 2, 5])
    many = derive_many(by_variance, population)
    assert np.abs(many.bias - [float(derive(by_variance, p).bias) for p in population]).max() < 1e-13
    assert np.abs(many.variance - [float(derive(by_variance, p).variance) for p in population]).max() < 1e-12


def test_what_cannot_be_done_for_many_says_so():
    with pytest.raises(InputError, match="empty"):
        derive_many(catalogue["fixed"], [])
    with pytest.raises(InputError, match="mix"):
        derive_many(catalogue["fixed"], [Pixel.two("1/2"), Pixel({(0, 1): 1})])
    with pytest.raises(PlanError, match="other weights"):
        _ = derive_many(lambda X: X.draw(2).mean() * X.weights[0], pixels([0, 1])).bias
