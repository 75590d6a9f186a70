"""POV-Ray: every pixel has the law that its rules give under a uniform jitter, and the copies of a scene are apart.

Means over positions are compared with predictions at 4.5 standard errors in up to 18 pixels: right code would fail one
such test in 8,000, if positions were independent. All else is exact, but for the rounding of 16-bit images.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from tests.adapters.scenes import ARROW, STRIP, WEDGE, scene

from truemean.adapters import load
from truemean.adapters.povray import Povray, installed, read_ppm
from truemean.conformance import Verdict, check_subject, judge
from truemean.conformance.verdict import PlanCheck
from truemean.errors import InputError, MissingExtra, SubjectError, UnknownName, Unsupported
from truemean.oracle import derive
from truemean.oracle.pixel import Pixel
from truemean.oracle.plans import catalogue
from truemean.oracle.scene import load_scene

pytestmark = pytest.mark.skipif(installed() is None, reason="needs povray: apt-get install povray")
ROUNDING = 8e-6


GREY = scene(3, 2, ("0.3", ARROW), (1, STRIP), (0, WEDGE), background="1/8")
COLOURED = scene(3, 2, ([1, 0, "1/4"], ARROW), ([0, 1, 1], STRIP), ([0, 0, 0], WEDGE), background=["1/8", "1/2", 0])


def parts(value):
    return value if isinstance(value, tuple) else (value,)


def matrix(values):
    """Outcomes ``[outcomes, channels]`` as floats."""
    return np.array([[float(part) for part in parts(value)] for value in values])


def assert_as_predicted(subject, looked=None):
    """Outcomes are among those predicted, their frequencies and the costs as predicted; returns the largest bias."""
    seeds = np.arange(subject.replicates or 1)
    pixels = list(subject.pixels().values()) if looked is None else looked
    estimates, biases = subject.run_many(pixels, seeds), []
    for i, X in enumerate(pixels):
        predicted = subject.predicts(X)
        outcomes, chances = matrix(predicted["law"]), np.array([float(p) for p in predicted["law"].values()])
        far = np.abs(estimates[:, i].reshape(seeds.size, 1, -1) - outcomes).max(axis=-1)
        assert far.min(axis=1).max() <= subject.rounding * float(X.scale)
        seen = np.bincount(far.argmin(axis=1), minlength=len(chances))
        error = np.sqrt(seeds.size * chances * (1 - chances))
        assert (np.abs(seen - seeds.size * chances) <= 4.5 * error + 2).all()
        if subject.costs is not None:
            costs = subject.costs(X, seeds)
            assert abs(costs.mean() - float(predicted["cost"])) <= 4.5 * costs.std() / np.sqrt(seeds.size) + 0.05
        biases.append(np.abs(chances @ outcomes - matrix([X.mean])).max())
    return max(biases)


@pytest.fixture(scope="module", params=["povray?method=1", "povray?method=2"])
def jittered(request):
    return load(request.param)


# -- replicates ------------------------------------------------------------------------------------


def test_brings_the_partly_covered_pixels_and_two_controls(jittered):
    pixels = jittered.pixels()
    assert list(pixels) == [*(f"tile#{x},{y}" for x in (1, 4) for y in range(8)), "tile#0,0", "tile#2,0"]
    assert [X.mean * 16 for X in pixels.values()] == [*range(15, 0, -2), *range(1, 16, 2), 0, 16]


def test_a_replicate_is_a_position(jittered):
    pixels = list(jittered.pixels().values())
    assert (jittered.replicates, jittered.deterministic) == (4096, False)
    together = jittered.run_many(pixels, np.arange(40))
    again = np.concatenate([jittered.run_many(pixels, [seed]) for seed in reversed(range(40))])[::-1]
    assert np.array_equal(together, again)
    assert len({tuple(row) for row in together}) == 40
    assert any("mean over them of its hash" in note for note in jittered.notes)


@pytest.mark.parametrize("seed", [-1, 4096, 2**40])
def test_a_seed_that_is_no_position_is_answered_with_those_there_are(jittered, seed):
    with pytest.raises(InputError, match="give positions, 0 to 4095"):
        jittered.run(jittered.pixels()["tile#0,0"], [3, seed])


def test_it_keeps_the_promises_of_an_estimator(jittered):
    check_subject(jittered)
    check_subject(load("povray"))


def test_two_renderings_are_one():
    once, again = (load("povray:wedge?method=1&positions=100") for _ in range(2))
    pixels = list(once.pixels().values())
    assert np.array_equal(once.run_many(pixels, np.arange(100)), again.run_many(pixels, np.arange(100)))


@pytest.mark.parametrize("options", ["method=0", "method=1&jitter=0", "method=2&jitter=0"])
def test_without_jitter_seeds_make_no_difference(options):
    subject = load(f"povray?{options}")
    assert (subject.deterministic, subject.replicates) == (True, None)
    seeds = np.array([0, 7, 2**53 - 1])
    for X in subject.pixels().values():
        (value,), (cost,) = set(subject.run(X, seeds)), set(subject.costs(X, seeds))
        ((predicted, chance),) = subject.predicts(X)["law"].items()
        assert (abs(value - predicted) <= ROUNDING, chance, cost) == (True, 1, subject.predicts(X)["cost"])


# -- laws --------------------------------------------------------------------------------------------


def test_method_0_shows_what_the_centre_shows():
    subject = load("povray?method=0")
    assert subject.declares == ("centre-first", {"n": 1})
    for X in subject.pixels().values():
        assert subject.run(X, [5]).tolist() == [X.at("1/2", "1/2")]
        assert subject.costs(X, [5]).tolist() == [1]


@pytest.mark.parametrize("depth", [1, 3, 4])
def test_method_1_has_the_bias_the_variance_and_the_cost_of_its_plan(depth):
    subject = load(f"povray?method=1&depth={depth}&positions=2000")
    assert subject.declares == ("centre-and-grid", {"grid": depth})
    seeds, largest = np.arange(2000), 0.0
    for X in subject.pixels().values():
        plan = derive(catalogue["centre-and-grid"], X, grid=depth)
        x, spread = subject.run(X, seeds), float(plan.variance)
        assert abs(x.mean() - float(plan.expectation)) <= 4.5 * (spread / seeds.size) ** 0.5 + ROUNDING
        assert x.var() == pytest.approx(spread, rel=0.1, abs=1e-9)
        assert set(subject.costs(X, seeds)) == {plan.cost}
        assert subject.predicts(X) == {"law": plan.distribution(), "cost": plan.cost}
        largest = max(largest, abs(x.mean() - float(X.mean)) / ((spread / seeds.size) ** 0.5 + ROUNDING))
    assert largest > 10


@pytest.mark.parametrize("options", ["", "&jitter=0.5", "&depth=2", "&threshold=1", "&depth=4"])
def test_method_2_has_the_law_that_is_predicted(options):
    subject = load(f"povray?method=2{options}&positions=2000")
    assert subject.declares is None
    known = [X for X in subject.pixels().values() if "law" in subject.predicts(X)]
    assert len(known) >= 16
    assert assert_as_predicted(subject, known) > 0.005


def test_method_2_has_the_mean_that_is_predicted_where_its_law_takes_too_many_paths():
    subject = load("povray?method=2&depth=4")
    known = [(X, subject.predicts(X)["mean"]) for X in subject.pixels().values() if "law" not in subject.predicts(X)]
    assert known
    for X, mean in known:
        x = subject.run(X, np.arange(4096))
        assert abs(x.mean() - float(mean)) <= 4.5 * x.std() / 64
    unknown = load("povray?method=2&depth=7")
    assert unknown.predicts(X) == {"mean": None, "cost": None}


def test_method_2_sees_beyond_its_pixels_and_tells_no_costs():
    subject = load("povray?method=2")
    black, white = (subject.pixels()[name] for name in ("tile#0,0", "tile#2,0"))
    assert subject.range(black) == ([0], [1])
    assert subject.range(white) == ([0], [1])
    assert load("povray?method=1").range(black) == ([0], [0])
    assert subject.run(black, np.arange(4096)).max() > 0
    assert set(subject.run(white, np.arange(4096))) == {1}
    assert subject.costs is None
    assert any("no costs" in note for note in subject.notes)


def test_method_1_shows_control_pixels_as_they_are():
    subject = load("povray?method=1")
    for name, value in (("tile#0,0", 0), ("tile#2,0", 1)):
        assert set(subject.run(subject.pixels()[name], np.arange(4096))) == {value}


def test_a_small_feature_beside_the_centre_is_never_seen_unless_all_is_supersampled():
    corner = scene(3, 3, (1, [["1.1", "1.1"], ["1.4", "1.1"], ["1.4", "1.4"], ["1.1", "1.4"]]))
    blind, seeing = (Povray(corner, method=1, threshold=t, positions=1000) for t in ("0.3", 0))
    for subject in (blind, seeing):
        assert_as_predicted(subject)
    X = blind.pixels()["scene#1,1"]
    assert set(blind.run(X, np.arange(1000))) == {0}
    assert set(blind.costs(X, np.arange(1000))) == {1}
    assert (seeing.declares, blind.declares) == (("centre-and-grid", {"grid": 3}), None)


def test_a_pixel_may_be_compared_with_a_random_value():
    """Supersampled where 2 or more of the 9 samples on the left are black, for white and 0.8 are alike."""
    black = [["1/4", "3/10"], ["3/4", "3/10"], ["3/4", "7/10"], ["1/4", "7/10"]]
    subject = Povray(
        scene(2, 1, (0, black), (0, [["8/5", "3/5"], [2, "3/5"], [2, 1], ["8/5", 1]]), background=1), method=1
    )
    left, right = subject.pixels().values()
    law = derive(catalogue["centre-and-grid"], left).distribution()
    chance = sum(p for value, p in law.items() if value < Fraction(3, 4))
    assert 0 < chance < 1
    assert subject.predicts(right)["cost"] == 1 + 9 * chance
    assert_as_predicted(subject)
    assert subject.declares is None
    assert set(subject.costs(right, np.arange(4096))) == {1, 10}


def test_where_neighbours_depend_on_the_same_pixel_nothing_is_predicted():
    subject = load("povray:fig5?method=1")
    predicted = [subject.predicts(X) for X in subject.pixels().values()]
    assert [each for each in predicted if each["law"] is None] == [{"law": None, "cost": None}] * 2


@pytest.mark.parametrize("any_scene", [GREY, COLOURED], ids=["grey", "coloured"])
@pytest.mark.parametrize(
    "options",
    [
        {"method": 0},
        {"method": 1, "threshold": 0},
        {"method": 1, "threshold": 0.1, "jitter": "1/2", "depth": 2},
        {"method": 1, "threshold": 1},
        {"method": 2, "threshold": 0, "depth": 2},
        {"method": 2, "jitter": 0, "depth": 5},
    ],
)
def test_any_scene_is_rendered_as_the_oracle_covers_it(any_scene, options):
    """Overlapping concave polygons of both orientations, reaching out of the image."""
    subject = Povray(any_scene, positions=1500, **options)
    assert max(len(X.values) for X in subject.pixels().values()) == 4
    assert_as_predicted(subject)


def test_the_finer_the_grid_the_closer_to_the_true_mean():
    subject = Povray(COLOURED, method=1, threshold=0, depth=9, positions=100)
    pixels = list(subject.pixels().values())
    means = subject.run_many(pixels, np.arange(100)).mean(axis=0)
    assert np.abs(means - matrix([X.mean for X in pixels])).max() < 2 / 82


def test_values_above_1_are_rendered_as_shares_of_the_largest():
    subject = load("povray:isolated-pixel?method=1&threshold=0")
    assert assert_as_predicted(subject) > 0.02
    assert any("shares of the largest, 8" in note for note in subject.notes)
    assert set(np.rint(subject.run(subject.pixels()["isolated-pixel#1,1"], np.arange(4096)) / 0.8)) > {0, 1}


@pytest.mark.parametrize("method", [1, 2])
def test_copies_do_not_see_each_other(method):
    """A polygon that reaches over the places of many copies."""
    subject = Povray(scene(3, 2, (1, [[-50, -50], ["1/2", -50], ["5/8", 50], [-50, 50]])), method=method, positions=900)
    assert_as_predicted(subject)
    assert set(subject.run(subject.pixels()["scene#1,0"], np.arange(900))) == {0}


def test_a_scene_without_polygons_is_its_background():
    subject = Povray(scene(2, 1, background=["1/2", 0, 1]), method=1, positions=4)
    assert subject.run(subject.pixels()["scene#0,0"], np.arange(4)) == pytest.approx(
        np.tile([0.5, 0, 1], (4, 1)), abs=1e-5
    )


# -- judged ------------------------------------------------------------------------------------------


def test_judged_it_is_biased_as_declared():
    report = judge(load("povray?method=2"), tolerance="2%", budget=4000)
    assert report.verdict is Verdict.BIASED
    assert {case.plan_check for case in report.cases} == {PlanCheck.FOLLOWS}
    assert max(case.replicates for case in report.cases) <= 4096


def test_a_pixel_of_equal_law_is_rendered_and_another_is_unsupported(jittered):
    other = Pixel({0: "13/16", 1: "3/16"})
    assert jittered.run(other, np.arange(50)).shape == (50,)
    with pytest.raises(Unsupported, match=r"no pixel of scene 'tile' is Pixel\(\{0: 7/8, 1: 1/8\}\)"):
        jittered.run(Pixel.two("1/8"), np.arange(3))


# -- what can go wrong --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("subject", "error", "words"),
    [
        ("povray?method=3", InputError, ["method='3'", "0, 1 and 2"]),
        ("povray?method=fast", InputError, ["method='fast'", "0, 1 and 2"]),
        ("povray?method=1&depth=0", InputError, ["depth='0'", "from 1 up"]),
        ("povray?method=1&depth=10", InputError, ["depth='10'", "up to 9"]),
        ("povray?method=1&threshold=1.5", InputError, ["threshold='1.5'", "from 0 to 1"]),
        ("povray?method=1&threshold=-0.1", InputError, ["threshold='-0.1'", "from 0 to 1"]),
        ("povray?method=1&threshold=low", InputError, ["threshold='low'", "from 0 to 1"]),
        ("povray?method=1&jitter=2", InputError, ["jitter='2'", "from 0 to 1"]),
        ("povray?method=1&jitter=nan", InputError, ["jitter='nan'", "from 0 to 1"]),
        ("povray?method=1&positions=0", InputError, ["positions='0'", "from 1 up"]),
        ("povray?method=1&positions=1000000", InputError, ["positions=1000000", "8 x 8", "give fewer"]),
        ("povray:tiles", InputError, ["'tiles'", "tile"]),
        ("povray?radius=3", UnknownName, ["option of adapter povray", "'radius'"]),
    ],
)
def test_bad_options(subject, error, words):
    with pytest.raises(error) as raised:
        load(subject)
    assert [word for word in words if word not in str(raised.value)] == []


def test_a_scene_of_negative_values_has_no_light():
    with pytest.raises(InputError, match="is no radiance: povray"):
        Povray(scene(1, 1, (-1, [[0, 0], [1, 0], [0, 1]])))


def test_without_povray_it_says_how_to_get_it(monkeypatch):
    monkeypatch.setenv("PATH", "")
    assert installed() is None
    with pytest.raises(MissingExtra, match="apt-get install povray"):
        load("povray")


def test_another_version_is_noted(monkeypatch):
    assert load("povray").versions == {"povray": installed()}
    monkeypatch.setattr("truemean.adapters.povray.TESTED", ("3.6",))
    assert load("povray").notes[0] == f"povray {installed()} is untested, its rules may have changed; tested: 3.6"


def test_what_povray_complains_of_is_told():
    subject = load("povray")
    subject._source += "\npolygon{nonsense}"
    with pytest.raises(SubjectError, match=r"exit code 1 and wrote: .*nonsense"):
        subject.run(subject.pixels()["tile#0,0"], [0])


def test_a_rendering_that_takes_too_long_is_ended(monkeypatch):
    monkeypatch.setattr("truemean.adapters.povray.LIMIT", 0.001)
    subject = load("povray")
    with pytest.raises(SubjectError, match=r"did not end well.*timed out"):
        subject.run(subject.pixels()["tile#0,0"], [0])


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"P5\n1 1\n65535\n" + bytes(6),
        b"P6\n1 1\n255\n" + bytes(3),
        b"P6\n2 1\n65535\n" + bytes(12),
        b"P6\n1 1\n65535\n" + bytes(5),
    ],
)
def test_an_image_that_is_none_is_refused(data):
    with pytest.raises(SubjectError, match="no image of 1 x 1 pixels"):
        read_ppm(data, (1, 1))


def test_an_image_is_read_with_its_comments():
    data = b"P6\n# by\n#hand\n2 1 # here\n65535\n" + bytes([0, 0, 255, 255, 128, 0, 0, 1, 10, 10, 35, 35])
    expected = [[[0, 65535, 32768], [1, 2570, 8995]]]
    assert np.array_equal(np.rint(read_ppm(data, (2, 1)) * 65535), expected)


def test_the_tile_is_the_default():
    assert load("povray").scene.to_dict() == load_scene("tile").to_dict()
