"""Mitsuba: exact where it must be, unbiased with every sampler, and biased as the plan built on it says.

Means over fixed seeds are compared with predictions at 4.5 standard errors in up to 24 numbers: right code
would fail one such test in 6,000. Mitsuba's random numbers at these seeds are part of its version.
"""

from __future__ import annotations

import sys

import numpy as np
import pytest
from tests.adapters.scenes import ARROW, STRIP, WEDGE, assert_means, scene

from truemean.adapters import load
from truemean.adapters.mitsuba import Streams, triangles
from truemean.errors import InputError, MissingExtra, UnknownName, Unsupported
from truemean.oracle import derive
from truemean.oracle.pixel import Pixel
from truemean.oracle.plans import catalogue

mi = pytest.importorskip("mitsuba", reason="needs the extra: pip install 'truemean[mitsuba]'")
POOLED = "mitsuba?pilot=4&sample_count=12"
RED, TEAL, DARK = [1, 0, 0], [0, "1/2", "3/4"], ["1/8", "1/8", 0]


def mitsuba(scene, **options):
    from truemean.adapters.mitsuba import Mitsuba

    return Mitsuba(scene, **options)


def grey(**options):
    """Grey background, concave and overlapping polygons of both orientations, reaching out of the image."""
    return mitsuba(scene(3, 2, ("0.3", ARROW), (2, STRIP), (0, WEDGE), background="1/8"), **options)


def colour(**options):
    return mitsuba(scene(3, 2, (RED, ARROW), (TEAL, STRIP), ([0, 0, 0], WEDGE), background=DARK), **options)


def assert_as_declared(subject, seeds):
    """Means and costs are what the oracle derives for the plan that the subject declares."""
    pixels = list(subject.pixels().values())
    plan, params = subject.declares
    derived = [derive(catalogue[plan], X, **params) for X in pixels]
    assert_means(subject.run_many(pixels, seeds), [d.expectation for d in derived])
    costs = np.column_stack([subject.costs(X, seeds) for X in pixels])
    assert_means(costs, [d.cost for d in derived])
    return costs


@pytest.fixture(scope="module", params=["mitsuba", POOLED, "mitsuba:fig5?sampler=multijitter"])
def subject(request):
    return load(request.param)


def test_brings_the_partly_covered_pixels_and_two_controls():
    pixels = load("mitsuba").pixels()
    assert list(pixels) == [*(f"tile#{x},{y}" for x in (1, 4) for y in range(8)), "tile#0,0", "tile#2,0"]
    assert [X.mean * 16 for X in pixels.values()] == [*range(15, 0, -2), *range(1, 16, 2), 0, 16]


def test_a_replicate_depends_on_its_seed_alone(subject):
    pixels = list(subject.pixels().values())
    together = subject.run_many(pixels, np.arange(20))
    again = np.concatenate([subject.run_many(pixels, [seed]) for seed in reversed(range(20))])[::-1]
    assert np.array_equal(together, again)
    assert len({tuple(row) for row in together}) == 20
    beyond = 2**53 - 1
    estimates = subject.run_many(pixels, [beyond, 0])[0]
    assert np.array_equal(subject.run_many(pixels, [beyond % 2**subject.seed_bits])[0], estimates)


def test_control_pixels_are_exact(subject):
    pixels = list(subject.pixels().values())[-2:]
    assert [X.values for X in pixels] == [(0,), (1,)]
    assert np.array_equal(subject.run_many(pixels, np.arange(500)), [[0, 1]] * 500)


def test_independent_samples_have_the_true_mean_and_a_binomial_variance():
    subject = load("mitsuba")
    pixels = list(subject.pixels().values())
    assert subject.declares == ("fixed", {"n": 4})
    assert subject.predicts is None
    means = np.array([float(X.mean) for X in pixels])
    estimates = subject.run_many(pixels, np.arange(5000))
    assert_means(estimates, means)
    assert_means((estimates - means) ** 2, means * (1 - means) / 4)
    assert_means((estimates - means)[1:] * (estimates - means)[:-1], 0 * means)
    assert set(subject.costs(pixels[0], np.arange(5000))) == {4}


@pytest.mark.parametrize(
    ("sampler", "count"), [("stratified", 4), ("multijitter", 6), ("orthogonal", 25), ("ldsampler", 16)]
)
def test_strata_have_the_true_mean_and_less_variance(sampler, count):
    subject = load(f"mitsuba?sampler={sampler}&sample_count={count}")
    pixels = list(subject.pixels().values())
    assert subject.declares is None
    assert [subject.predicts(X) for X in pixels] == [{"mean": X.mean, "cost": count} for X in pixels]
    means = np.array([float(X.mean) for X in pixels])
    estimates = subject.run_many(pixels, np.arange(3000))
    assert_means(estimates, means)
    assert estimates.var(axis=0).mean() < (means * (1 - means) / count).mean() * 0.8


def test_two_pooled_stages_have_the_bias_of_the_formula():
    subject = load(POOLED)
    assert subject.declares == ("two-stage-pooled", {"n": 4, "m": 12, "eps": 0})
    costs = assert_as_declared(subject, np.arange(4000))
    assert set(np.unique(costs)) == {4, 16}
    pixels = list(subject.pixels().values())
    c = np.array([float(X.mean) for X in pixels])
    bias = (c**4 * (1 - c) - (1 - c) ** 4 * c) * 12 / 16
    estimates = subject.run_many(pixels, np.arange(4000))
    assert_means(estimates, c + bias)
    assert np.abs(estimates.mean(axis=0) - c).max() > 0.05


def test_a_discarded_pilot_leaves_no_bias_and_is_paid():
    subject = load("mitsuba?pilot=4&sample_count=12&pooled=0")
    assert subject.declares == ("discard-pilot", {"p": 4, "n1": 4, "n2": 12, "eps": 0})
    costs = assert_as_declared(subject, np.arange(4000))
    assert set(np.unique(costs)) == {8, 16}
    pixels = list(subject.pixels().values())
    assert_means(subject.run_many(pixels, np.arange(4000)), [X.mean for X in pixels])


def test_strata_in_two_stages_declare_and_predict_nothing():
    subject = load("mitsuba?sampler=stratified&pilot=4&sample_count=16")
    assert (subject.declares, subject.predicts) == (None, None)
    assert set(subject.costs(subject.pixels()["tile#4,3"], np.arange(50))) == {4, 20}


@pytest.mark.parametrize("make", [grey, colour])
def test_any_scene_is_rendered_as_the_oracle_covers_it(make):
    subject = make(sample_count=9)
    names, pixels = zip(*subject.pixels().items(), strict=True)
    assert names[0] == "scene#0,0"
    assert max(len(X.values) for X in pixels) == 4
    estimates = subject.run_many(pixels, np.arange(3000))
    assert estimates.shape == (3000, len(pixels), 3)[: 3 if make is colour else 2]
    assert_means(estimates, [X.mean for X in pixels])


@pytest.mark.parametrize("make", [grey, colour])
def test_a_pilot_of_any_values_is_mixed_where_two_of_them_differ(make):
    subject = make(pilot=3, sample_count=5)
    assert set(np.unique(assert_as_declared(subject, np.arange(3000)))) == {3, 8}


@pytest.mark.parametrize("values", [[0, "1/2", 1], [1, "4194305/4194304", "2097153/2097152"]])
def test_a_pilot_tells_samples_apart_by_more_than_mean_and_variance(values):
    """0 and 1 have the mean of 1/2 and 1/2; single precision can't square 1 + 2^-22."""
    left, right = [[0, 0], ["1/3", 0], ["1/3", 1], [0, 1]], [["2/3", 0], [1, 0], [1, 1], ["2/3", 1]]
    subject = mitsuba(scene(1, 1, (values[0], left), (values[2], right), background=values[1]), pilot=2)
    [X] = subject.pixels().values()
    costs = subject.costs(X, np.arange(4000))
    assert set(costs) == {2, 6}
    assert_means(costs, 2 + 4 * 2 / 3)


def test_stages_replicates_and_pixels_share_no_random_numbers():
    for width, height, stages in [(8, 8, 1), (5, 3, 2), (33, 12, 2), (1000, 700, 2)]:
        streams = Streams(width, height, stages)
        seeds = np.arange(min(2**streams.bits, 2000))
        starts = np.concatenate([streams.starts(seeds, stage) for stage in range(stages)]).astype(np.int64)
        places = np.sort(starts * (width * height) % 2**32)
        assert np.diff(places).min() >= streams.places
        assert places[-1] + streams.places <= 2**32


def test_a_seed_of_mitsuba_begins_at_the_seed_times_the_pixels():
    """Else `Streams` rests on nothing: place 9 of seed 0, in column 1 of row 2, is place 0 of seed 1."""
    halves = [(1, [[x, y], [x + 1, y], [x, y + 1]]) for x in range(3) for y in range(3)]
    subject = mitsuba(scene(3, 3, *halves), sample_count=50)
    images = [subject._values.render(seed, 50) for seed in range(2)]
    assert images[0][2, 1, 0] == images[1][0, 0, 0]
    assert len(np.unique(images)) > 5


def test_a_sample_on_the_edge_of_its_pixel_is_in_range():
    """Single precision puts some 1 in 10^5 samples there."""
    subject = mitsuba(scene(32, 1, (1, [[28, -1], [30, -1], [30, 2], [28, 2]])), sample_count=100_000)
    black, white = subject.pixels().values()
    assert [subject.range(X) for X in (black, white)] == [([0], [0]), ([0], [1])]
    [[row]], _ = subject.frames(np.array([1]))
    assert 0 < np.abs(row - np.isin(np.arange(32), [28, 29])).max() < 1e-4


def test_no_ray_slips_through_between_triangles():
    star = [[0, 0], [4, "1/3"], [8, 0], ["23/3", 4], [8, 8], [4, "22/3"], [0, 8], ["1/3", 4]]
    subject = mitsuba(scene(8, 8, (1, star)), sample_count=30_000)
    image = subject.frames(np.array([1]))[0][0]
    assert (image[1:7, 1:7] == 1).all()


@pytest.mark.parametrize(
    "outline",
    [
        [(0, 0), (4, 0), (4, 4), (2, 1)],
        [(0, 0), (0, 4), (4, 4), (4, 0), (3, 0), (3, 3), (1, 3), (1, 0)],
        [(0, 0), (1, 0), (2, 0), (3, 0), (3, 3), (2, 0.5), (1.5, 0.5), (1, 0.5)],
        [(0.1, 0.1), (0.1 + 2**-50, 5), (0.3, 0.7)],
    ],
)
def test_triangles_cover_the_polygon_once(outline):
    def twice_area(points):
        x, y = np.array(points, dtype=float).T
        return x @ np.roll(y, -1) - y @ np.roll(x, -1)

    cut = triangles(outline)
    parts = [twice_area([outline[i] for i in corners]) for corners in cut]
    assert len(cut) == len(outline) - 2
    assert min(parts) > 0
    assert sum(parts) == pytest.approx(abs(twice_area(outline)))


def test_the_variant_of_others_is_left_alone():
    mi.set_variant("scalar_spectral")
    try:
        subject = load("mitsuba")
        assert subject.run(subject.pixels()["tile#2,0"], [1]) == [1]
        assert mi.variant() == "scalar_spectral"
    finally:
        mi.set_variant("scalar_rgb")


def test_a_pixel_of_equal_law_is_rendered_and_another_is_unsupported():
    subject = load("mitsuba")
    assert set(subject.run(Pixel({0: "13/16", 1: "3/16"}), np.arange(50))) <= set(np.arange(5) / 4)
    with pytest.raises(Unsupported, match=r"no pixel of scene 'tile' is Pixel\(\{0: 7/8, 1: 1/8\}\)"):
        subject.run(Pixel.two("1/8"), np.arange(3))


def test_rounding_grows_with_the_samples_that_single_precision_adds():
    assert load("mitsuba?sample_count=5000").rounding == 1e-6
    triangle = [[0, 0], [1, 0], [0, 1]]
    subject = mitsuba(scene(2, 2, ("0.7", triangle), background="0.3"), sample_count=5000)
    assert subject.rounding == pytest.approx(5000 * 0.7 / 0.4 / 2**24)
    background = subject.pixels()["scene#1,0"]
    assert 0 < abs(subject.run(background, [1])[0] - 0.3) < subject.rounding


def test_what_is_missing_is_named(monkeypatch):
    def start(variant):
        raise ImportError("no libLLVM")

    monkeypatch.setattr(mi, "set_variant", start)
    with pytest.raises(MissingExtra, match=r"llvm_ad_rgb.*no libLLVM.*scalar_rgb"):
        load("mitsuba?variant=llvm_ad_rgb")
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    with pytest.raises(MissingExtra, match=r"pip install 'truemean\[mitsuba\]'"):
        load("mitsuba")


def test_scenes_that_are_too_much():
    with pytest.raises(InputError, match=r"value -1 of scene is no radiance: mitsuba"):
        mitsuba(scene(1, 1, (-1, [[0, 0], [1, 0], [0, 1]])))
    with pytest.raises(InputError, match="pilot=8388608 on a scene of 4 values"):
        grey(pilot=2**23)
    with pytest.raises(InputError, match="65536 x 65536 pixels takes all seeds"):
        Streams(2**16, 2**16).starts([0], 0)
    touching = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 0.0), (-1.0, 1.0), (-1.0, 0.0)]
    with pytest.raises(InputError, match="a polygon of 6 vertices touches itself"):
        triangles(touching)


@pytest.mark.parametrize(
    ("subject", "error", "words"),
    [
        ("mitsuba?sample_count=0", InputError, ["sample_count='0'", "from 1 up"]),
        ("mitsuba?sample_count=1.5", InputError, ["sample_count='1.5'", "from 1 up"]),
        ("mitsuba?sample_count=many", InputError, ["sample_count='many'", "from 1 up"]),
        ("mitsuba?sample_count=99999999", InputError, ["sample_count='99999999'", "16777216"]),
        ("mitsuba?sampler=stratified&sample_count=5", InputError, ["sample_count='5'", "stratified draws 9"]),
        ("mitsuba?sampler=orthogonal&sample_count=16", InputError, ["sample_count='16'", "orthogonal draws 25"]),
        ("mitsuba?sampler=ldsampler&sample_count=16&pilot=2", InputError, ["pilot='2'", "ldsampler draws 4"]),
        ("mitsuba?sampler=stratifed", UnknownName, ["sampler of mitsuba", "'stratifed'", "stratified"]),
        ("mitsuba?variant=scalar_spectral", UnknownName, ["variant of mitsuba", "'scalar_spectral'", "scalar_rgb"]),
        ("mitsuba?pilot=0", InputError, ["pilot='0'", "from 1 up"]),
        ("mitsuba?pilot=4&pooled=2", InputError, ["pooled='2'", "0 discards it"]),
        ("mitsuba?pooled=0", InputError, ["pooled='0'", "give pilot too"]),
        ("mitsuba:tiles", InputError, ["'tiles'", "tile"]),
        ("mitsuba?spp=4", UnknownName, ["option of adapter mitsuba", "'spp'"]),
    ],
)
def test_bad_options(subject, error, words):
    with pytest.raises(error) as raised:
        load(subject)
    assert [word for word in words if word not in str(raised.value)] == []
