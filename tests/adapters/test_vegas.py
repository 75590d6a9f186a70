"""vegas: its plain mean of iterations is unbiased, its own weighted one biased, exactly as computed where samples are independent.

Means over fixed seeds are compared with predictions at 4.5 standard errors in up to 18 pixels: right code would
fail one such test in 8,000. The stream at these seeds is NumPy's.
"""

from __future__ import annotations

from collections import Counter
from fractions import Fraction

import numpy as np
import pytest
from tests.adapters.scenes import ARROW, STRIP, WEDGE, scene

from truemean.adapters import load
from truemean.conformance import Verdict, judge
from truemean.errors import InputError, UnknownName, Unsupported
from truemean.oracle.pixel import Pixel

pytest.importorskip("vegas", reason="needs the extra: pip install 'truemean[vegas]'")
INDEPENDENT = "vegas?alpha=0&nstrat=1,1&nitn=3&neval=8"


def vegas(scene, **options):
    from truemean.adapters.vegas import Vegas

    return Vegas(scene, **options)


def z(estimates, expected):
    """How many standard errors the mean is off."""
    return (estimates.mean() - float(expected)) / (estimates.std() / np.sqrt(len(estimates)) + 1e-12)


@pytest.fixture(scope="module", params=["vegas", "vegas?weighted=0", INDEPENDENT])
def subject(request):
    return load(request.param)


def test_brings_the_partly_covered_pixels_and_two_controls(subject):
    pixels = subject.pixels()
    assert list(pixels) == [*(f"tile#{x},{y}" for x in (1, 4) for y in range(8)), "tile#0,0", "tile#2,0"]
    assert [X.mean * 16 for X in pixels.values()] == [*range(15, 0, -2), *range(1, 16, 2), 0, 16]
    assert subject.versions.keys() == {"vegas"}


def test_a_replicate_depends_on_its_seed_alone(subject):
    pixel = subject.pixels()["tile#4,3"]
    together = subject.run(pixel, np.arange(20))
    assert np.array_equal(together, np.concatenate([subject.run(pixel, [k]) for k in reversed(range(20))])[::-1])
    assert np.array_equal(subject.run(pixel, [2**53 - 1]), subject.run(pixel, [2**53 - 1]))
    assert len(set(together)) > 5
    assert subject.run(pixel, []).shape == (0,)


def test_gvars_own_random_numbers_go_on_undisturbed():
    import gvar

    gvar.ranseed(3)
    expected = np.random.default_rng(3).random()
    subject = load("vegas?nitn=1")
    subject.run(subject.pixels()["tile#4,3"], [12345])
    assert gvar.RNG.random() == expected


def test_control_pixels_are_exact(subject):
    pixels = subject.pixels()
    assert set(subject.run(pixels["tile#0,0"], np.arange(50))) == {0}
    assert np.abs(subject.run(pixels["tile#2,0"], np.arange(50)) - 1).max() < 1e-12


@pytest.mark.parametrize("options", ["nitn=5&neval=100", "nitn=3&neval=20&alpha=2", "nitn=2&neval=40&beta=0"])
def test_the_plain_mean_of_iterations_has_the_true_mean_however_the_map_adapts(options):
    subject = load(f"vegas?weighted=0&{options}")
    assert subject.declares is None
    for y in (0, 3, 6):
        pixel = subject.pixels()[f"tile#4,{y}"]
        assert subject.predicts(pixel) == {"mean": pixel.mean}
        assert abs(z(subject.run(pixel, np.arange(800)), pixel.mean)) < 4.5


def test_the_weighted_mean_is_biased():
    subject = load("vegas")
    assert subject.declares is None
    assert subject.predicts is None
    for name in ("tile#4,0", "tile#1,3"):
        pixel = subject.pixels()[name]
        assert z(subject.run(pixel, np.arange(700)), pixel.mean) < -7


def test_independent_samples_weighted_have_the_law_that_is_computed():
    """Every estimate is an outcome of the law, up to rounding, and occurs as often."""
    subject = load(INDEPENDENT)
    for y in (0, 3):
        pixel = subject.pixels()[f"tile#4,{y}"]
        prediction = subject.predicts(pixel)
        law = prediction["law"]
        assert sum(law.values()) == 1
        assert prediction["cost"] == 24
        estimates = subject.run(pixel, np.arange(2000))
        outcomes = np.sort([float(x) for x in law])
        place = np.clip(np.searchsorted(outcomes, estimates - 1e-12), 0, len(outcomes) - 1)
        assert np.abs(outcomes[place] - estimates).max() < 1e-12
        mean = sum(x * p for x, p in law.items())
        assert abs(z(estimates, mean)) < 4.5
        assert abs(z((estimates - float(mean)) ** 2, sum((x - mean) ** 2 * p for x, p in law.items()))) < 4.5
        dark = float(sum(p for x, p in law.items() if x < 1e-200))
        assert dark == pytest.approx(1 - (1 - (1 - float(pixel.mean)) ** 8) ** 3)
        assert abs(np.mean(estimates < 1e-200) - dark) < 4.5 * np.sqrt(dark * (1 - dark) / 2000)
        assert (mean < pixel.mean - Fraction(1, 50)) == (y == 0)


def test_the_law_is_that_of_a_brute_force_twin():
    """All sequences of samples of a pixel of three values, weighted in floats as vegas does."""
    from itertools import product

    from truemean.adapters.vegas import weighted_law

    pixel = Pixel({0: "1/2", "1/2": "1/3", 1: "1/6"})
    parts = list(zip(map(float, pixel.values), pixel.weights, strict=True))
    expected: Counter[float] = Counter()
    for drawn in product(parts, repeat=4):
        samples = np.array([value for value, _ in drawn]).reshape(2, 2)
        means = samples.mean(axis=1)
        variances = np.maximum(samples.var(axis=1), (np.finfo(float).eps * 1e4 * means) ** 2)
        weights = 1 / np.maximum(variances, 1e-257)
        probability = np.prod([float(weight) for _, weight in drawn])
        expected[round(float(weights @ means / weights.sum()), 9)] += probability
    found: Counter[float] = Counter()
    for outcome, probability in weighted_law(pixel, 2, 2).items():
        found[round(float(outcome), 9)] += float(probability)
    assert found == pytest.approx(expected)


def test_a_law_of_too_many_outcomes_is_not_computed():
    subject = load("vegas?alpha=0&nstrat=1,1&nitn=5&neval=100")
    assert subject.predicts(subject.pixels()["tile#4,0"]) == {"cost": 500}


@pytest.mark.parametrize("options", ["alpha=0&nstrat=1,1&nitn=2&neval=8&weighted=0", "nstrat=1,1&nitn=1&neval=16"])
def test_independent_samples_unweighted_are_declared(options):
    subject = load(f"vegas?{options}")
    assert subject.declares == ("fixed", {"n": 16})
    pixel = subject.pixels()["tile#4,1"]
    estimates = subject.run(pixel, np.arange(1000)) * 16
    assert np.abs(estimates - estimates.round()).max() < 1e-9
    assert abs(z((estimates / 16 - 3 / 16) ** 2, Fraction(3 * 13, 16**3))) < 4.5
    assert set(subject.costs(pixel, np.arange(1000))) == {16}


def test_the_range_holds_and_is_that_of_the_values_where_the_map_stays():
    subject = load("vegas?nitn=2&neval=30&alpha=2&nstrat=1,1")
    pixel = subject.pixels()["tile#1,0"]
    low, high = subject.range(pixel)
    estimates = subject.run(pixel, np.arange(500))
    assert (low, high) == (0, subject.magnification) == (0, 9)
    assert 1 < estimates.max() < high
    assert "9 times" in subject.notes[-1]
    assert load("vegas?alpha=0").range(pixel) == (0, 1)
    aligned = load("vegas?neval=32&nstrat=2,2")
    assert (aligned.range(pixel), aligned.notes) == ((0, 1), ())
    assert aligned.predicts is None
    assert load("vegas?neval=10&nitn=2").predicts(pixel)["cost"] == 20  # one increment an axis: no map to adapt


def test_costs_are_those_of_the_estimates():
    subject = load("vegas")
    pixel = subject.pixels()["tile#4,3"]
    costs = subject.costs(pixel, np.arange(30))
    assert 400 < costs.min() < costs.max() <= 500
    assert np.array_equal(subject.costs(pixel, [7]), costs[7:8])
    assert set(load("vegas?beta=0&neval=50&nitn=2").costs(pixel, [0, 1])) == {80}


def test_any_scene_is_integrated_as_the_oracle_covers_it():
    """Grey background, concave and overlapping polygons of both orientations, reaching out of the image."""
    subject = vegas(scene(3, 2, ("0.3", ARROW), (2, STRIP), (0, WEDGE), background="1/8"), nitn=2, neval=50, weighted=0)
    pixels = subject.pixels()
    assert max(len(X.values) for X in pixels.values()) == 4
    for pixel in pixels.values():
        assert abs(z(subject.run(pixel, np.arange(400)), pixel.mean)) < 4.5


def test_the_function_of_a_pixel_agrees_with_the_oracle_at_each_place():
    from truemean.adapters.frames import layers
    from truemean.adapters.integrands import integrand

    picture = scene(3, 2, ("0.3", ARROW), (2, STRIP), (0, WEDGE), background="1/8")
    numbers = layers(picture.to_dict(), "vegas")
    points = np.random.default_rng(1).random((60, 2))
    for (x, y), pixel in picture.pixels().items():
        function = integrand(numbers, x, y)
        expected = [float(pixel.at(Fraction(u), Fraction(v))) for u, v in points]
        assert function(points).tolist() == expected
        assert [function.at_one()(u, v) for u, v in points] == expected


def test_a_pixel_of_equal_law_is_integrated_and_another_is_unsupported(subject):
    assert subject.run(Pixel({0: "13/16", 1: "3/16"}), np.arange(5)).shape == (5,)
    with pytest.raises(Unsupported, match=r"no pixel of scene 'tile' is Pixel\(\{0: 7/8, 1: 1/8\}\)"):
        subject.run(Pixel.two("1/8"), np.arange(3))


def test_judged_it_is_biased_when_weighted_and_follows_its_law():
    subject = load("vegas?alpha=0&nstrat=1,1&nitn=2&neval=8")
    pixels = {"light": subject.pixels()["tile#4,0"]}
    report = judge(subject, pixels=pixels, tolerance="1%", budget=3000)
    assert report.verdict is Verdict.BIASED
    assert report.cases[0].plan_check == "FOLLOWS"


@pytest.mark.parametrize(
    ("subject", "error", "words"),
    [
        ("vegas?nitn=0", InputError, ["nitn='0'", "from 1 up"]),
        ("vegas?neval=many", InputError, ["neval='many'", "from 1 up"]),
        ("vegas?neval=1", InputError, ["vegas refuses", "neval=1", "neval>2 required"]),
        ("vegas?neval=7&nstrat=1,1", InputError, ["vegas refuses", "nstrat=[1, 1]", "too small"]),
        ("vegas?alpha=-1", InputError, ["alpha='-1'", "0 for no adaptation"]),
        ("vegas?beta=nan", InputError, ["beta='nan'", "from 0 up"]),
        ("vegas?nstrat=2", InputError, ["nstrat='2'", "such as 1,1"]),
        ("vegas?nstrat=2,0", InputError, ["nstrat='2,0'", "from 1 up"]),
        ("vegas?weighted=2", InputError, ["weighted='2'", "0 for the plain one"]),
        ("vegas:tiles", InputError, ["'tiles'", "tile"]),
        ("vegas?iterations=4", UnknownName, ["option of adapter vegas", "nitn"]),
    ],
)
def test_bad_options(subject, error, words):
    with pytest.raises(error) as raised:
        load(subject)
    assert [word for word in words if word not in str(raised.value)] == []


@pytest.mark.parametrize("value", [-1, [1, 0, 0]])
def test_scenes_that_vegas_has_no_radiance_for(value):
    background = 0 if value == -1 else [0, 0, 0]
    with pytest.raises(InputError, match="is no radiance"):
        vegas(scene(1, 1, (value, [[0, 0], [1, 0], [0, 1]]), background=background))
