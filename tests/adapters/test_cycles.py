"""Cycles: exact where it must be, its mean off by the sample at the centre, biased further when adaptive.

Means over fixed seeds are compared with predictions at 4.5 standard errors in up to 18 pixels: right code
would fail one such test in 8,000. The stream of Cycles at these seeds is part of its version.
"""

from __future__ import annotations

import sys
from fractions import Fraction

import numpy as np
import pytest
from tests.adapters.scenes import ARROW, STRIP, WEDGE, assert_means, scene

from truemean.adapters import load
from truemean.errors import InputError, MissingExtra, SubjectError, UnknownName, Unsupported
from truemean.oracle.derivation import derive
from truemean.oracle.pixel import Pixel
from truemean.oracle.plans import catalogue

bpy = pytest.importorskip("bpy", reason="needs the extra: pip install 'truemean[cycles]' under Python 3.13")
SEEDS = np.arange(2000)
SIDES = [Fraction(side, 8) for side in (1, 2, 4, 7)]


def rectangle(left, top, right, bottom):
    return [[str(x), str(y)] for x, y in ((left, top), (right, top), (right, bottom), (left, bottom))]


def squares():
    """White squares of ``SIDES``, each in a pixel among black ones, the larger two over its centre."""
    corners = [(4 * i + 1 + Fraction(1, 32), 1 + Fraction(1, 32), side) for i, side in enumerate(SIDES)]
    return scene(4 * len(SIDES), 3, *((1, rectangle(x, y, x + side, y + side)) for x, y, side in corners))


def cycles(scene, **options):
    from truemean.adapters.cycles import Cycles

    return Cycles(scene, **options)


def z_scores(estimates, expected):
    return (estimates.mean(axis=0) - np.array(expected, dtype=float)) / (estimates.std(axis=0) / len(estimates) ** 0.5)


def means(pixels):
    return np.array([float(X.mean) for X in pixels])


@pytest.fixture(scope="module", params=["", "?sample_offset=1", "?samples=64&adaptive_threshold=0.1"])
def subject(request):
    return load(f"cycles{request.param}")


def test_brings_the_partly_covered_pixels_and_two_controls(subject):
    pixels = subject.pixels()
    assert list(pixels) == [*(f"tile#{x},{y}" for x in (1, 4) for y in range(8)), "tile#0,0", "tile#2,0"]
    assert subject.versions == {"bpy": bpy.app.version_string.split()[0]}


def test_a_replicate_depends_on_its_seed_alone(subject):
    pixels = list(subject.pixels().values())
    together = subject.run_many(pixels, np.arange(20))
    again = np.concatenate([subject.run_many(pixels, [seed]) for seed in reversed(range(20))])[::-1]
    assert np.array_equal(together, again)
    assert len({tuple(row) for row in together}) == 20
    assert np.array_equal(subject.run(pixels[3], [2**31 - 1]), subject.run(pixels[3], [2**31 - 1]))


@pytest.mark.parametrize("seed", [-1, 2**31])
def test_seeds_have_31_bits(subject, seed):
    assert subject.seed_bits == 31
    with pytest.raises(InputError, match=rf"seed={seed}: Cycles has seeds from 0 to 2147483647"):
        subject.run(subject.pixels()["tile#1,0"], [seed])


def test_control_pixels_are_exact(subject):
    black, white = list(subject.pixels().values())[-2:]
    assert set(subject.run(black, np.arange(100))) == {0}
    assert set(subject.run(white, np.arange(100))) == {1}


def test_instances_do_not_disturb_each_other():
    tile, other, same = load("cycles"), cycles(squares()), load("cycles?samples=4")
    alone = [tile.frame(seed)[0] for seed in range(5)]
    others = [other.frame(seed)[0] for seed in range(5)]
    for seed in range(5):
        assert np.array_equal(tile.frame(seed)[0], alone[seed])
        assert np.array_equal(other.frame(seed)[0], others[seed])
        assert same.frame(seed)[0].max() == 1
        assert not np.array_equal(same.frame(seed)[0], alone[seed])


def test_nothing_is_printed(subject, capfd):
    subject.frame(7)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("options", ["", "?samples=99&adaptive_threshold=0.1", "?sample_offset=1&samples=20"])
def test_a_frame_is_what_blender_saves(tmp_path, options):
    stage = load(f"cycles{options}")._blender
    stage.cycles.seed = 11
    stage.render.filepath = str(tmp_path / "frame.exr")
    stage.render.image_settings.file_format = "OPEN_EXR"
    stage.render.image_settings.color_depth = "32"
    bpy.ops.render.render(scene=stage.name, write_still=True)
    saved = bpy.data.images.load(stage.render.filepath)
    saved.colorspace_settings.name = "Non-Color"
    width, height = saved.size
    pixels = np.reshape(saved.pixels, (height, width, -1))[::-1, :8, 0]
    assert np.array_equal(pixels, load(f"cycles{options}").frame(11)[0])


def test_a_sample_on_the_edge_of_a_pixel_sees_what_begins_there():
    stripes = scene(64, 1, *((1, rectangle(x, -1, x + 1, 2)) for x in range(1, 64, 2)), background="1/2")
    subject = cycles(stripes, samples=8192)
    half, one = subject.pixels().values()
    assert subject.range(half) == subject.range(one) == ([Fraction(1, 2)], [1])
    strayed = np.rint(np.abs(subject.frames(np.arange(8))[0][:, 0] - np.where(np.arange(64) % 2, 1, 0.5)) * 2 * 8192)
    assert set(strayed.flat) == {0, 1}


def test_the_range_of_a_constant_pixel_is_its_value_unless_another_begins_at_its_edge():
    shown = scene(9, 9, (1, rectangle(4, 4, "9/2", 5)), (1, rectangle(8, -1, 10, 10)))
    adaptive, plain = cycles(shown, adaptive_threshold=1), cycles(shown)
    ranges = {name: [subject.range(X) for subject in (plain, adaptive)] for name, X in adaptive.pixels().items()}
    assert ranges["scene#0,0"] == [([0], [0])] * 2
    assert ranges["scene#4,4"] == [([0], [1])] * 2
    assert ranges["scene#8,0"] == [([0], [1])] * 2
    covered = cycles(scene(9, 9, (1, rectangle(-1, -1, 10, 10))))
    assert covered.range(covered.frame_pixels[0, 0]) == ([1], [1])


def test_it_predicts_the_mean_of_the_plan_centre_first():
    subject = load("cycles?samples=5")
    for X in subject.pixels().values():
        assert subject.predicts(X)["mean"] == derive(catalogue["centre-first"], X, n=5).expectation


@pytest.mark.parametrize("n", [1, 4, 16])
def test_the_sample_at_the_centre_biases_the_mean_as_predicted(n):
    subject = load(f"cycles?samples={n}")
    pixels = list(subject.pixels().values())
    predicted = [subject.predicts(X) for X in pixels]
    c = means(pixels)
    assert {known["cost"] for known in predicted} == {n}
    assert np.allclose([float(known["mean"]) for known in predicted], c + ((c > 0.5) - c) / n, atol=1e-12)
    estimates = subject.run_many(pixels, SEEDS)
    assert_means(estimates, [known["mean"] for known in predicted])
    if n == 1:
        assert (estimates == (c > 0.5)).all()
    else:
        assert (np.abs(z_scores(estimates[:, 3:5], c[3:5])) > 15).all()
    assert set(subject.costs(pixels[0], SEEDS)) == {n}


def test_without_the_sample_at_the_centre_the_mean_is_true_and_the_variance_small():
    subject = load("cycles?samples=4&sample_offset=1")
    pixels = list(subject.pixels().values())
    c = means(pixels)
    assert [subject.predicts(X) for X in pixels] == [{"cost": 4, "mean": X.mean} for X in pixels]
    estimates = subject.run_many(pixels, SEEDS)
    assert_means(estimates, c)
    assert (estimates.var(axis=0)[:16] < 0.97 * (c * (1 - c) / 4)[:16]).all()
    assert set(np.unique(estimates * 4)) == {0, 1, 2, 3, 4}


def test_nothing_is_said_of_the_mean_where_the_table_is_finite_or_an_edge_is_at_the_centre():
    tabulated = load("cycles?sampling_pattern=TABULATED_SOBOL")
    assert tabulated.predicts(tabulated.pixels()["tile#1,0"]) == {"cost": 16}
    assert any("256 sequences" in note for note in tabulated.notes)
    assert load("cycles").notes == ()
    half = cycles(scene(2, 1, (1, rectangle(0, 0, "1023/2044", 1))))
    assert half.predicts(half.pixels()["scene#0,0"]) == {"cost": 16}
    below = cycles(scene(2, 1, (1, rectangle(0, 0, "0.5004", 1)), (1, rectangle(1, 0, "1.5006", 1))), samples=1)
    assert [below.predicts(X)["mean"] for X in below.pixels().values()][:2] == [0, 1]
    assert below.frame(3)[0].tolist() == [[0, 1]]
    high = cycles(scene(1, 2, (1, rectangle(0, 0, 1, "0.4994")), (1, rectangle(0, 1, 1, "1.4996"))), samples=1)
    assert [high.predicts(X)["mean"] for X in high.pixels().values()][:2] == [0, 1]
    assert high.frame(3)[0].tolist() == [[0], [1]]


def test_tabulated_sequences_have_few_outcomes():
    subject = load("cycles?sampling_pattern=TABULATED_SOBOL&samples=256")
    estimates = subject.run(subject.pixels()["tile#4,1"], np.arange(300))
    assert len(np.unique(estimates)) < 20


@pytest.mark.parametrize(
    ("options", "first"),
    [
        ("adaptive_threshold=0.1&adaptive_min_samples=1", 16),
        ("adaptive_threshold=0.1&adaptive_min_samples=15", 32),
        ("adaptive_threshold=0.1", 48),
        ("adaptive_threshold=0.01", 80),
        ("adaptive_threshold=0.01&sample_offset=1", 80),
        ("adaptive_threshold=0", 96),
    ],
)
def test_adaptive_it_stops_after_multiples_of_16_samples_and_predicts_nothing(options, first):
    subject = load(f"cycles?samples=256&{options}")
    assert (subject.first_look, subject.predicts) == (first, None)
    frames, counts = subject.frames(np.arange(50))
    assert set(np.unique(counts)) <= {*range(first, 257, 16)}
    assert counts.min() == first < counts.max()
    assert np.abs(frames * counts - np.rint(frames * counts)).max() < 1e-4


def test_adaptive_it_is_biased_low_where_a_black_draw_stops_early():
    subject = cycles(squares(), samples=256, adaptive_threshold="0.01", adaptive_min_samples=1, sample_offset=1)
    pixels = list(subject.pixels().values())[: len(SIDES)]
    estimates = subject.run_many(pixels, SEEDS)
    z = z_scores(estimates, means(pixels))
    assert (z[:2] < -4.5).all()
    assert z[0] < -20
    counts = np.column_stack([subject.costs(X, SEEDS) for X in pixels])
    black = (counts[:, 0] == 16) & (estimates[:, 0] == 0)
    assert 0.7 < black.mean() < 0.85
    again = cycles(squares(), samples=256, adaptive_threshold="0.01", adaptive_min_samples=4, sample_offset=1)
    assert np.array_equal(again.frame(5)[0], subject.frame(5)[0])


def test_adaptive_it_is_biased_high_where_a_bright_draw_stops_early():
    subject = cycles(squares(), samples=256, adaptive_threshold="0.05", adaptive_min_samples=1, sample_offset=1)
    pixels = list(subject.pixels().values())[: len(SIDES)]
    assert z_scores(subject.run_many(pixels, SEEDS), means(pixels))[2] > 4.5


def test_a_threshold_that_is_looked_at_too_late_changes_nothing():
    late, plain = load("cycles?samples=40&adaptive_threshold=0.1"), load("cycles?samples=40")
    assert late.first_look == 40
    for found, expected in zip(late.frames(np.arange(30)), plain.frames(np.arange(30)), strict=True):
        assert np.array_equal(found, expected)
    assert all(late.predicts(X) == plain.predicts(X) for X in plain.pixels().values())


@pytest.mark.parametrize("options", [{}, {"adaptive_threshold": 1}])
def test_any_scene_is_rendered_as_the_oracle_covers_it(options):
    """Grey background, concave and overlapping polygons of both orientations, reaching out of the image."""
    shown = scene(3, 2, ("0.3", ARROW), (2, STRIP), (0, WEDGE), background="1/8")
    subject = cycles(shown, samples=16, sample_offset=1, **options)
    names, pixels = zip(*subject.pixels().items(), strict=True)
    assert names[0] == "scene#0,0"
    assert max(len(X.values) for X in pixels) == 4
    assert_means(subject.run_many(pixels, SEEDS), [X.mean for X in pixels])
    assert [subject.predicts(X)["mean"] for X in pixels] == [X.mean for X in pixels]


def test_values_are_rendered_within_the_rounding_that_it_states():
    values = ["0.3", "1/3", 1000, "1/100000", 12345678]
    shown = scene(5, 1, *((value, rectangle(i, 0, i + 1, 1)) for i, value in enumerate(values)))
    exact = np.array([float(Fraction(value)) for value in values])
    for samples in (1, 16, 4096):
        subject = cycles(shown, samples=samples)
        assert np.abs(subject.frame(3)[0][0] / exact - 1).max() <= subject.rounding
    assert (cycles(shown).rounding, load("cycles?samples=4096").rounding) == (1e-6, 1e-6)


def test_colours_have_a_channel_each():
    blue = ([0, "1/2", 8], [[0, 0], ["1/4", 0], ["1/4", 1], [0, 1]])
    subject = cycles(scene(1, 1, blue, background=[1, 0, 0]), samples=4)
    (X,) = subject.pixels().values()
    estimates = subject.run(X, SEEDS)
    assert estimates.shape == (2000, 3)
    predicted = subject.predicts(X)["mean"]
    assert predicted == tuple(mean + (first - mean) / 4 for first, mean in zip((1, 0, 0), X.mean, strict=True))
    assert_means(estimates, predicted)


def test_a_pixel_of_equal_law_is_rendered_and_another_is_unsupported():
    subject = load("cycles")
    same = Pixel({0: "13/16", 1: "3/16"})
    assert set(subject.run(same, np.arange(50))) <= set(np.arange(17) / 16)
    assert subject.predicts(same)["mean"] == Fraction(3, 16) * Fraction(15, 16)
    with pytest.raises(Unsupported, match=r"no pixel of scene 'tile' is Pixel\(\{0: 7/8, 1: 1/8\}\)"):
        subject.run(Pixel.two("1/8"), np.arange(3))


def test_a_render_that_fails_is_no_frame(monkeypatch, capfd):
    def fail(self, depsgraph):
        raise ZeroDivisionError

    subject = load("cycles")
    expected = subject.frame(1)[0]
    with monkeypatch.context() as patched:
        patched.setattr(sys.modules["cycles"].CyclesRender, "render", fail)
        with pytest.raises(SubjectError, match="rendered no frame of scene 'tile'"):
            subject.frame(1)
    assert "ZeroDivisionError" in capfd.readouterr().err
    assert np.array_equal(subject.frame(1)[0], expected)


@pytest.mark.parametrize(
    ("subject", "error", "words"),
    [
        ("cycles?samples=0", InputError, ["samples='0'", "from 1 up"]),
        ("cycles?samples=1.5", InputError, ["samples='1.5'", "from 1 up"]),
        ("cycles?samples=99999999", InputError, ["samples=99999999", "1 to 16777216"]),
        ("cycles?adaptive_threshold=low", InputError, ["adaptive_threshold='low'", "Cycles refuses"]),
        ("cycles?adaptive_threshold=2", InputError, ["adaptive_threshold=2", "0.0 to 1.0"]),
        ("cycles?adaptive_threshold=-1", InputError, ["adaptive_threshold=-1", "0.0 to 1.0"]),
        ("cycles?adaptive_min_samples=4", InputError, ["adaptive_min_samples='4'", "give adaptive_threshold too"]),
        ("cycles?adaptive_threshold=0.1&adaptive_min_samples=5000", InputError, ["5000", "0 to 4096"]),
        ("cycles?adaptive_threshold=0.1&adaptive_min_samples=1.5", InputError, ["=1.5", "Cycles refuses"]),
        ("cycles?sample_offset=-1", InputError, ["sample_offset=-1", "0 to 16777216"]),
        ("cycles?sample_offset=9999999999", InputError, ["sample_offset=9999999999", "Cycles refuses"]),
        ("cycles?sampling_pattern=PMJ", InputError, ["'PMJ'", "TABULATED_SOBOL", "BLUE_NOISE"]),
        ("cycles:tiles", InputError, ["'tiles'", "tile"]),
        ("cycles?spp=4", UnknownName, ["option of adapter cycles", "'spp'"]),
    ],
)
def test_bad_options(subject, error, words):
    with pytest.raises(error) as raised:
        load(subject)
    assert [word for word in words if word not in str(raised.value)] == []


def test_a_negative_value_is_no_radiance():
    with pytest.raises(InputError, match="value -1 of scene is no radiance: Cycles"):
        cycles(scene(1, 1, (-1, [[0, 0], [1, 0], [0, 1]])))


def test_without_bpy_the_extra_and_its_python_are_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "bpy", None)
    with pytest.raises(MissingExtra, match=r"pip install 'truemean\[cycles\]' under Python 3\.13"):
        load("cycles")
