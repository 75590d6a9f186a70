"""GSL's integrators: plain and MISER have the true mean, VEGAS where it does not weight its iterations.

Means over fixed seeds are compared with predictions at 4.5 standard errors in up to 4 pixels: right code would
fail one such test in 36,000. The stream at these seeds is that of GSL's mt19937.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from truemean.adapters import load
from truemean.adapters.gsl import installed
from truemean.conformance import Verdict, judge
from truemean.errors import InputError, MissingExtra, SubjectError, UnknownName, Unsupported
from truemean.oracle.pixel import Pixel
from truemean.oracle.scene import Scene

pytestmark = pytest.mark.skipif(installed() is None, reason="needs GSL: apt-get install libgsl27")
BISECTING = "gsl?method=miser&calls=100&min_calls=8&min_calls_per_bisection=32"
SUBJECTS = ["gsl?calls=100", "gsl?calls=100&weighted=0", "gsl?method=plain&calls=50", BISECTING]


def z(estimates, expected):
    """How many standard errors the mean is off."""
    return (estimates.mean() - float(expected)) / (estimates.std() / np.sqrt(len(estimates)) + 1e-12)


@pytest.fixture(scope="module", params=SUBJECTS)
def subject(request):
    return load(request.param)


def test_brings_the_partly_covered_pixels_and_two_controls(subject):
    pixels = subject.pixels()
    assert list(pixels) == [*(f"tile#{x},{y}" for x in (1, 4) for y in range(8)), "tile#0,0", "tile#2,0"]
    assert subject.versions == {"gsl": installed()}
    assert installed().startswith("2.")


def test_a_replicate_depends_on_its_seed_alone(subject):
    pixel = subject.pixels()["tile#4,3"]
    together = subject.run(pixel, np.arange(20))
    assert np.array_equal(together, np.concatenate([subject.run(pixel, [k]) for k in reversed(range(20))])[::-1])
    assert len(set(together)) > 5
    assert subject.run(pixel, []).shape == (0,)


def test_seeds_of_32_bits_are_all_different(subject):
    pixel = subject.pixels()["tile#4,3"]
    assert subject.seed_bits == 32
    estimates = subject.run(pixel, [0, 4356, 4357, 2**32 - 1])
    assert np.array_equal(estimates, subject.run(pixel, [0, 4356, 4357, 2**32 - 1]))
    assert len(set(estimates)) > 1


@pytest.mark.parametrize("options", ["calls=100", "calls=1250", "calls=100&mode=importance-only", "calls=30&alpha=0"])
def test_control_pixels_of_vegas_are_exact_where_weighted(options):
    subject = load(f"gsl?{options}")
    pixels = subject.pixels()
    assert set(subject.run(pixels["tile#0,0"], np.arange(50))) == {0}
    assert subject.range(pixels["tile#0,0"]) == (0, 0)
    estimates = subject.run(pixels["tile#2,0"], np.arange(50))
    assert (np.abs(estimates - 1) < 1e-9).mean() > 0.5


@pytest.mark.parametrize("subject", ["gsl?method=plain&calls=50", "gsl?method=miser", f"{BISECTING}&dither=0.1"])
def test_control_pixels_are_exact(subject):
    subject = load(subject)
    pixels = subject.pixels()
    assert set(subject.run(pixels["tile#0,0"], np.arange(30))) == {0}
    assert np.abs(subject.run(pixels["tile#2,0"], np.arange(30)) - 1).max() < 1e-12


@pytest.mark.parametrize(
    "options",
    ["method=plain&calls=16", "method=miser&calls=16", "calls=16&mode=importance-only&iterations=1"],
)
def test_independent_samples_are_declared(options):
    subject = load(f"gsl?{options}")
    assert subject.declares == ("fixed", {"n": 16})
    pixel = subject.pixels()["tile#4,1"]
    estimates = subject.run(pixel, np.arange(3000)) * 16
    assert np.abs(estimates - estimates.round()).max() < 1e-9
    assert abs(z(estimates / 16, pixel.mean)) < 4.5
    assert abs(z((estimates / 16 - 3 / 16) ** 2, Fraction(3 * 13, 16**3))) < 4.5
    assert set(subject.costs(pixel, np.arange(3000))) == {16}
    assert subject.range(pixel) == (0, 1)


def test_miser_bisects_from_its_threshold_on():
    assert load("gsl?method=miser&calls=1023").declares == ("fixed", {"n": 1023})
    subject = load("gsl?method=miser&calls=1024")
    assert subject.declares is None
    pixel = subject.pixels()["tile#4,1"]
    bisected, plain = (load(f"gsl?method=miser&calls={n}").run(pixel, np.arange(100)).std() for n in (1024, 1023))
    assert bisected < 0.7 * plain


@pytest.mark.parametrize(
    "options",
    [
        "method=miser&calls=100&min_calls=8&min_calls_per_bisection=32",
        "method=miser&calls=200&min_calls=10&min_calls_per_bisection=40&dither=0.2&alpha=0&estimate_frac=0.3",
        "method=vegas&calls=100&weighted=0",
        "method=vegas&calls=200&weighted=0&mode=importance-only&alpha=0.5&iterations=3",
        "method=vegas&calls=100&iterations=1",
    ],
)
def test_adaptive_without_weighting_it_has_the_true_mean(options):
    subject = load(f"gsl?{options}")
    assert subject.declares is None
    for name in ("tile#4,0", "tile#4,4", "tile#1,1", "tile#2,0"):
        pixel = subject.pixels()[name]
        assert subject.predicts(pixel) == {"mean": pixel.mean}
        assert abs(z(subject.run(pixel, np.arange(1000)), pixel.mean)) < 4.5


@pytest.mark.parametrize(("options", "least"), [("calls=50", 20), ("calls=500", 10), ("calls=1250", 6)])
def test_the_weighted_mean_of_vegas_is_biased(options, least):
    subject = load(f"gsl?{options}")
    assert subject.predicts is None
    pixel = subject.pixels()["tile#4,0"]
    assert z(subject.run(pixel, np.arange(500)), pixel.mean) < -least


def test_the_range_of_vegas_follows_from_its_bins_and_boxes():
    ranges = {
        "calls=2": 2500,  # one box
        "calls=8": 625,  # two boxes an axis, 25 bins each
        "calls=500": Fraction(100, 15) ** 2,
        "calls=500&mode=importance-only": 2500,
        "calls=1249": Fraction(100, 24) ** 2,
        "calls=1250": 1,
        "calls=500&iterations=1": 1,
    }
    pixel = load("gsl").pixels()["tile#4,0"]
    assert {options: load(f"gsl?{options}").range(pixel) for options in ranges} == {
        options: (0, high) for options, high in ranges.items()
    }
    noisy = load("gsl?calls=8&weighted=0&iterations=20")
    estimates = noisy.run(noisy.pixels()["tile#1,0"], np.arange(500))
    assert 1 < estimates.max() < 625
    assert "625 times" in noisy.notes[-1]
    assert load("gsl?calls=1250").notes == ()


def test_costs_are_the_samples_drawn():
    pixel = load("gsl").pixels()["tile#4,3"]
    assert set(load("gsl").costs(pixel, [0, 1])) == {5 * 2 * 15**2}
    assert set(load("gsl?weighted=0").costs(pixel, [0, 1])) == {5 * 2 * 15**2}
    subject = load(BISECTING)
    costs = subject.costs(pixel, np.arange(40))
    assert 90 < costs.min() < costs.max() <= 100
    assert np.array_equal(subject.costs(pixel, [7]), costs[7:8])


def test_any_scene_is_integrated_as_the_oracle_covers_it():
    """Grey background, concave and overlapping polygons of both orientations, reaching out of the image."""
    from truemean.adapters.gsl import Gsl

    outlines = [
        ("0.3", [["1/4", "1/4"], ["11/4", 1], ["1/4", "7/4"], ["5/4", 1]]),
        (2, [["3/2", "-1/2"], ["5/3", "5/2"], [2, "5/2"]]),
        (0, [[1, "1/2"], ["5/2", 1], [1, 2]]),
    ]
    plain = {"schema": "truemean-scene/1", "width": 3, "height": 2, "background": "1/8"}
    polygons = [{"value": value, "vertices": vertices} for value, vertices in outlines]
    subject = Gsl(Scene.from_dict(plain | {"polygons": polygons}), method="miser", min_calls=8, calls=200)
    pixels = subject.pixels()
    assert max(len(X.values) for X in pixels.values()) == 4
    for pixel in pixels.values():
        assert abs(z(subject.run(pixel, np.arange(500)), pixel.mean)) < 4.5


def test_a_pixel_of_equal_law_is_integrated_and_another_is_unsupported(subject):
    assert subject.run(Pixel({0: "13/16", 1: "3/16"}), np.arange(5)).shape == (5,)
    with pytest.raises(Unsupported, match=r"no pixel of scene 'tile' is Pixel\(\{0: 7/8, 1: 1/8\}\)"):
        subject.run(Pixel.two("1/8"), np.arange(3))


def test_judged_plain_follows_its_plan_and_vegas_is_biased_in_a_range_of_the_readers_own():
    plain, weighted = load("gsl?method=plain&calls=64"), load("gsl?calls=50")
    pixels = {"edge": plain.pixels()["tile#4,0"]}
    report = judge(plain, pixels=pixels, tolerance="1%", budget=20_000)
    assert (report.verdict, report.cases[0].plan_check) == (Verdict.CONFORMS, "FOLLOWS")
    assert judge(weighted, pixels=pixels, tolerance="1%", budget=5000, range=(0, 2)).verdict is Verdict.BIASED


def test_an_error_of_gsl_is_told_in_its_words_and_ends_nothing():
    subject = load("gsl?method=miser&calls=2")
    subject.calls = 1
    with pytest.raises(SubjectError, match="gsl_monte_miser_integrate failed: generic failure"):
        subject.run(subject.pixels()["tile#4,0"], [1])


def test_an_interrupt_is_not_lost_in_c(monkeypatch):
    from truemean.adapters import integrands

    def interrupted(self):
        def at(x, y):
            raise KeyboardInterrupt

        return at

    subject = load("gsl?method=plain&calls=5")
    monkeypatch.setattr(integrands.Integrand, "at_one", interrupted)
    with pytest.raises(KeyboardInterrupt):
        subject.run(subject.pixels()["tile#4,0"], [1])


def test_without_the_library_the_way_to_get_it_is_told(monkeypatch):
    from truemean.adapters import gsl

    monkeypatch.setattr(gsl, "_library", lambda: None)
    assert gsl.installed() is None
    with pytest.raises(MissingExtra, match="apt-get install libgsl27"):
        load("gsl")


@pytest.mark.parametrize(
    ("subject", "error", "words"),
    [
        ("gsl?method=suave", InputError, ["method='suave'", "plain, miser and vegas"]),
        ("gsl?calls=0", InputError, ["calls='0'", "from 1 up"]),
        ("gsl?calls=1", InputError, ["calls='1'", "2 or more"]),
        ("gsl?iterations=0", InputError, ["iterations='0'", "from 1 up"]),
        ("gsl?mode=stratified", InputError, ["mode='stratified'", "by itself"]),
        ("gsl?weighted=2", InputError, ["weighted='2'", "0 for the plain one"]),
        ("gsl?alpha=-1", InputError, ["alpha='-1'", "from 0 up"]),
        ("gsl?dither=0.1", InputError, ["dither='0.1'", "means nothing to vegas", "iterations"]),
        ("gsl?method=plain&alpha=1", InputError, ["alpha='1'", "means nothing to plain", "calls only"]),
        ("gsl?method=miser&dither=1", InputError, ["dither='1'", "[0, 0.5)"]),
        ("gsl?method=miser&estimate_frac=1", InputError, ["estimate_frac='1'", "[0, 0.5]"]),
        ("gsl?method=miser&min_calls=2", InputError, ["min_calls='2'", "from 8 up"]),
        ("gsl?method=miser&min_calls_per_bisection=3", InputError, ["min_calls_per_bisection='3'", "from 32 up"]),
        ("gsl?method=miser&min_calls_per_bisection=100", InputError, ["=100", "min_calls=32", "4 times"]),
        ("gsl:tiles", InputError, ["'tiles'", "tile"]),
        ("gsl?neval=4", UnknownName, ["option of adapter gsl", "'neval'"]),
    ],
)
def test_bad_options(subject, error, words):
    with pytest.raises(error) as raised:
        load(subject)
    assert [word for word in words if word not in str(raised.value)] == []
