"""raysect: exact where it must be, unbiased without its adaptive sampler, biased as its plan says with it.

Means over fixed seeds are compared with predictions at 4.5 standard errors in up to 16 pixels: right code
would fail one such test in 9,000. Raysect's stream at these seeds is part of its pinned version.
"""

from __future__ import annotations

import random

import numpy as np
import pytest
from tests.adapters.scenes import ARROW, STRIP, WEDGE, assert_means, scene

from truemean.adapters import load
from truemean.conformance import check_subject
from truemean.errors import InputError, SubjectError, UnknownName, Unsupported
from truemean.oracle.pixel import Pixel

pytest.importorskip("raysect", reason="needs the extra: pip install 'truemean[raysect]'")
ADAPTIVE = "raysect?min_samples=4&cutoff=0&ratio=1e9&fraction=1"


def raysect(scene, **options):
    from truemean.adapters.raysect import Raysect

    return Raysect(scene, **options)


@pytest.fixture(scope="module", params=["raysect", ADAPTIVE])
def subject(request):
    return load(request.param)


def test_brings_the_partly_covered_pixels_and_two_controls(subject):
    pixels = subject.pixels()
    assert list(pixels) == [*(f"tile#{x},{y}" for x in (1, 4) for y in range(8)), "tile#0,0", "tile#2,0"]
    assert [X.mean * 16 for X in pixels.values()] == [*range(15, 0, -2), *range(1, 16, 2), 0, 16]


def test_a_replicate_depends_on_its_seed_alone(subject):
    pixels = list(subject.pixels().values())
    together = subject.run_many(pixels, np.arange(20))
    again = np.concatenate([subject.run_many(pixels, [seed]) for seed in reversed(range(20))])[::-1]
    assert np.array_equal(together, again)
    assert np.array_equal(subject.run(pixels[3], [2**53 - 1]), subject.run(pixels[3], [2**53 - 1]))
    assert len({tuple(row) for row in together}) == 20


def test_pythons_own_random_numbers_go_on_undisturbed(subject):
    random.seed(3)
    expected = random.Random(3).random()
    subject.run_many(list(subject.pixels().values()), [12345])
    assert random.random() == expected


def test_control_pixels_are_exact(subject):
    black, white = list(subject.pixels().values())[-2:]
    assert set(subject.run(black, np.arange(100))) == {0}
    assert set(subject.run(white, np.arange(100))) == {1}


def test_not_adaptive_it_has_the_true_mean_and_a_binomial_variance():
    subject = load("raysect?pixel_samples=2&passes=2")
    pixels = list(subject.pixels().values())
    assert subject.declares == ("fixed", {"n": 4})
    estimates = subject.run_many(pixels, np.arange(2000))
    means = np.array([float(X.mean) for X in pixels])
    assert_means(estimates, means)
    assert_means((estimates - means) ** 2, means * (1 - means) / 4)
    assert set(subject.costs(pixels[0], np.arange(2000))) == {4}


@pytest.mark.parametrize(
    ("options", "n", "m"), [("min_samples=4", 4, 12), ("min_samples=3&pixel_samples=2&passes=5", 4, 6)]
)
def test_adaptive_it_has_the_bias_and_the_cost_of_the_plan_it_declares(options, n, m):
    subject = load(f"raysect?{options}")
    pixels = list(subject.pixels().values())
    assert subject.declares == ("two-stage-pooled", {"n": n, "m": m, "eps": 0})
    seeds = np.arange(2000)
    c = np.array([float(X.mean) for X in pixels])
    bias = (c**n * (1 - c) - (1 - c) ** n * c) * m / (n + m)
    estimates = subject.run_many(pixels, seeds)
    assert_means(estimates, c + bias)
    costs = np.column_stack([subject.costs(X, seeds) for X in pixels])
    assert_means(costs, n + m * (1 - c**n - (1 - c) ** n))
    assert set(np.unique(costs)) == {n, n + m}
    assert (estimates[:, 0].mean() - c[0]) / (estimates[:, 0].std() / np.sqrt(2000)) > 10


@pytest.mark.parametrize(
    "options",
    ["cutoff=0.3", "fraction=0.2", "ratio=1.5&passes=8", "scene=fig5&cutoff=0.01"],
)
def test_declares_nothing_where_pixels_depend_on_each_other_or_stop_early(options):
    assert load(f"raysect?min_samples=4&{options}").declares is None


def test_declares_nothing_where_no_pixel_is_constant_or_values_are_grey():
    everywhere = (1, [[0, 0], [2, 0], [0, 2]])
    assert raysect(scene(1, 1, (1, [[0, 0], [1, 0], [0, 1]])), min_samples=4).declares is None
    assert raysect(scene(2, 2, everywhere), min_samples=4).declares is not None
    assert raysect(scene(2, 2, everywhere, background="1/2"), min_samples=4).declares is None
    assert raysect(scene(2, 2, everywhere), min_samples=99).declares == ("fixed", {"n": 16})


def test_any_scene_is_rendered_as_the_oracle_covers_it():
    """Grey background, concave and overlapping polygons of both orientations, reaching out of the image."""
    subject = raysect(scene(3, 2, ("0.3", ARROW), (2, STRIP), (0, WEDGE), background="1/8"), passes=4)
    names, pixels = zip(*subject.pixels().items(), strict=True)
    assert names[0] == "scene#0,0"
    assert max(len(X.values) for X in pixels) == 4
    assert_means(subject.run_many(pixels, np.arange(2000)), [X.mean for X in pixels])


def test_a_pixel_of_equal_law_is_rendered_and_another_is_unsupported(subject):
    own = subject.pixels()["tile#4,1"]
    other = Pixel({0: "13/16", 1: "3/16"})
    assert set(subject.run(other, np.arange(50))) <= set(np.arange(17) / 16)
    assert subject.run(own, np.arange(50)).shape == (50,)
    with pytest.raises(Unsupported, match=r"no pixel of scene 'tile' is Pixel\(\{0: 7/8, 1: 1/8\}\)"):
        subject.run(Pixel.two("1/8"), np.arange(3))


@pytest.mark.parametrize("options", ["", "min_samples=4", "sampler=rgb&min_samples=4&pixel_samples=2"])
def test_keeps_the_promises_of_an_estimator(options):
    check_subject(load(f"raysect?{options}"))


def test_a_seed_that_changes_nothing_or_too_much_is_noticed(monkeypatch):
    subject = load("raysect")
    draw = type(subject).frame
    monkeypatch.setattr(type(subject), "frame", lambda self, seed: draw(self, 1))
    with pytest.raises(SubjectError, match="different seeds give different estimates: all are one"):
        check_subject(subject)
    counter = iter(range(10**6))
    monkeypatch.setattr(type(subject), "frame", lambda self, seed: draw(self, next(counter)))
    with pytest.raises(SubjectError, match="the same seeds give the same estimates: tile#"):
        check_subject(load("raysect"))


def test_a_camera_that_is_off_is_noticed():
    from raysect.core import translate

    subject = load("raysect")
    subject._camera.transform *= translate(2, 0, 0)
    with pytest.raises(SubjectError, match=r"those of a pixel of one value exact: tile#\d,\d returned"):
        check_subject(subject)


def test_the_sampler_of_colours_decides_as_the_other_does():
    mono, colour = (load(f"raysect?sampler={kind}&min_samples=4") for kind in ("mono", "rgb"))
    pixels = [list(each.pixels().values()) for each in (mono, colour)]
    assert colour.declares == mono.declares == ("two-stage-pooled", {"n": 4, "m": 12, "eps": 0})
    estimates = [each.run_many(own, np.arange(200)) for each, own in zip((mono, colour), pixels, strict=True)]
    assert np.allclose(*estimates, atol=1e-9)


@pytest.mark.parametrize(
    ("subject", "error", "words"),
    [
        ("raysect?passes=0", InputError, ["passes='0'", "from 1 up"]),
        ("raysect?passes=1.5", InputError, ["passes='1.5'", "from 1 up"]),
        ("raysect?pixel_samples=0", InputError, ["pixel_samples='0'", "from 1 up"]),
        ("raysect?pixel_samples=many", InputError, ["pixel_samples='many'", "from 1 up"]),
        ("raysect?min_samples=0", InputError, ["min_samples='0'", "from 1 up"]),
        ("raysect?min_samples=4.5", InputError, ["min_samples='4.5'", "from 1 up"]),
        ("raysect?min_samples=4&fraction=0", InputError, ["fraction=0", "(0, 1]"]),
        ("raysect?min_samples=4&ratio=1/2", InputError, ["ratio=0.5", ">= 1"]),
        ("raysect?min_samples=4&cutoff=2", InputError, ["cutoff=2", "[0, 1]"]),
        ("raysect?min_samples=4&cutoff=low", InputError, ["cutoff='low'", "raysect refuses"]),
        ("raysect?min_samples=9999999999", InputError, ["min_samples=9999999999", "raysect refuses"]),
        ("raysect?sampler=bayer", InputError, ["sampler='bayer'", "mono", "rgb"]),
        ("raysect?cutoff=0.1", InputError, ["cutoff='0.1'", "give min_samples too"]),
        ("raysect:tiles", InputError, ["'tiles'", "tile"]),
        ("raysect?spp=4", UnknownName, ["option of adapter raysect", "'spp'"]),
    ],
)
def test_bad_options(subject, error, words):
    with pytest.raises(error) as raised:
        load(subject)
    assert [word for word in words if word not in str(raised.value)] == []


@pytest.mark.parametrize("value", [-1, [1, 0, 0]])
def test_scenes_that_raysect_has_no_radiance_for(value):
    background = 0 if value == -1 else [0, 0, 0]
    with pytest.raises(InputError, match="is no radiance"):
        raysect(scene(1, 1, (value, [[0, 0], [1, 0], [0, 1]]), background=background))
