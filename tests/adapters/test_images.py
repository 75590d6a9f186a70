"""Renders in files: a directory is judged as its renderer would be.

Means over fixed seeds are compared with predictions at 4.5 standard errors in up to 16 pixels: right code
would fail one such test in 9,000.
"""

from __future__ import annotations

import pickle
from fractions import Fraction

import numpy as np
import pytest
from tests.adapters.image_writers import rendered, save, write_exr, write_pfm

from truemean.adapters import load
from truemean.adapters.images import Images, TilePixel
from truemean.conformance import Verdict, judge
from truemean.errors import InputError, SubjectError, UnknownName, Unsupported
from truemean.oracle.pixel import Pixel
from truemean.oracle.scene import Scene, load_scene

COLOUR = {
    "schema": "truemean-scene/1",
    "width": 3,
    "height": 2,
    "background": ["1/4", 0, "1/2"],
    "polygons": [
        {"value": [1, "1/2", 0], "vertices": [["1/4", "1/4"], ["11/4", 1], ["1/4", "7/4"], ["5/4", 1]]},
        {"value": [0, 1, 1], "vertices": [["3/2", "-1/2"], ["5/3", "5/2"], [2, "5/2"]]},
    ],
}


@pytest.fixture(scope="module")
def tile():
    return load_scene("tile")


@pytest.fixture(scope="module")
def renders(tile, tmp_path_factory):
    return save(tmp_path_factory.mktemp("images") / "renders", rendered(tile, 400))


def test_a_pixel_a_tile_of_a_small_scene(renders, tile):
    subject = Images(renders, scene="tile")
    pixels = subject.pixels()
    assert list(pixels)[:2] == ["tile#0,0", "tile#1,0"]
    assert {name: dict(zip(X.values, X.weights, strict=True)) for name, X in pixels.items()} == {
        f"tile#{x},{y}": dict(X.law) for (x, y), X in tile.pixels().items()
    }
    assert (subject.replicates, subject.tile, subject.range(pixels["tile#4,0"])) == (400, 1, None)
    assert "400 NPY images of 8 x 8 pixels, channel Y" in subject.notes[0]
    assert subject.notes[1:] == ("cut into tiles of 1 x 1 pixels, 64 in all, at most 256 if tile= is not given",)


def test_tiles_average_their_pixels_exactly_also_where_the_image_ends(renders, tile):
    subject = load(f"images:{renders}?scene=tile&tile=5")
    pixels = subject.pixels()
    assert list(pixels) == ["tile#0,0+5", "tile#5,0+5", "tile#0,5+5", "tile#5,5+5"]
    inside = [X.mean for (x, y), X in tile.pixels().items() if x < 5 and y >= 5]
    X = pixels["tile#0,5+5"]
    assert (X.values, sum(X.weights)) == ((0, 1), 1)
    assert X.weights[1] == sum(inside) / 15
    image = np.load(renders / "r0007.npy").astype(float)
    assert subject.run(X, [7]) == pytest.approx(image[5:, :5].mean())
    assert X.arrays()[1].tolist() == [float(w) for w in X.weights]


def test_means_are_those_of_the_scene_and_replicates_those_of_their_seed(renders):
    subject = Images(renders, scene="tile")
    pixels = list(subject.pixels().values())
    together = subject.run_many(pixels, np.arange(400))
    error = together.std(axis=0) / 20
    assert (np.abs(together.mean(axis=0) - [float(X.weights[-1] * X.values[-1]) for X in pixels]) <= 4.5 * error).all()
    again = Images(renders, scene="tile")
    assert np.array_equal(again.run(pixels[4], [399, 0, 0]), together[[399, 0, 0], 4])
    assert np.array_equal(
        pickle.loads(pickle.dumps(again)).run(pickle.loads(pickle.dumps(pixels[12])), [5]), together[5, [12]]
    )


def test_a_pixel_of_equal_law_is_found_and_another_is_unsupported(renders, tile):
    subject = Images(renders, scene="tile")
    assert subject.run(tile.pixel(1, 6), [3]) == subject.run(subject.pixels()["tile#4,1"], [3])
    with pytest.raises(Unsupported, match="no tile of"):
        subject.run(Pixel.two("1/8"), [3])
    with pytest.raises(Unsupported, match="no tile of"):
        subject.run(TilePixel((Fraction(2),), (Fraction(1),), 3), [3])
    with pytest.raises(InputError, match="seed 400 is no image: there are 400, from 0 to 399"):
        subject.run(tile.pixel(4, 1), [3, 400])


def test_a_colour_scene_needs_the_three_channels(tmp_path):
    scene = Scene.from_dict(COLOUR)
    images = rendered(scene, 400, samples=4).astype(np.float32)
    place = save(tmp_path / "a", images, write_pfm, "pfm")
    subject = Images(place, scene=scene)
    pixels = list(subject.pixels().values())
    found = subject.run_many(pixels, np.arange(400))
    assert found.shape == (400, 6, 3)
    means = np.array([scene.pixel(x, y).mean for y in (0, 1) for x in (0, 1, 2)], dtype=float)
    assert (np.abs(found.mean(axis=0) - means) <= 4.5 * found.std(axis=0) / 20 + 1e-9).all()
    with pytest.raises(InputError, match="R, G and B are needed"):
        Images(place, scene=scene, channel="R")


def test_channels_and_layers_of_exr_files(tmp_path, tile):
    image = rendered(tile, 2).astype(np.float32)

    def write(path, rgb):
        write_exr(path, RGBA=rgb, dif_R=rgb[..., 0] + 4, dif_G=rgb[..., 1], dif_B=rgb[..., 2])

    rgb = np.stack([image, 2 * image, 3 * image, image + 1], axis=-1)
    place = save(tmp_path / "a", rgb, write, "exr")
    with pytest.raises(InputError, match="no channel= is given: one is needed"):
        Images(place, scene="tile")
    one = Images(place, scene="tile", channel="G", range=(0, 2))
    assert list(one.versions) == ["OpenEXR"]
    X = one.pixels()["tile#4,3"]
    assert one.run(X, [1]) == 2 * image[1, 3, 4]
    assert Images(place, scene="tile", channel="A").run(X, [1]) == image[1, 3, 4] + 1
    layer = Images(place, constant=(1, 1, 1), range="0,7", channel="dif")
    assert layer.run(layer.pixels()["4,3"], [1])[0] == pytest.approx(rgb[1, 3, 4, :3] + [4, 0, 0])
    with pytest.raises(UnknownName, match=r"'Z'.*known: A, B, G, R, dif.B"):
        Images(place, scene="tile", channel="Z")


def test_judged_against_the_scene(renders, tile, tmp_path):
    assert judge(Images(renders, scene="tile", tile=8), tolerance="5%").verdict is Verdict.CONFORMS
    dark = save(tmp_path / "dark", rendered(tile, 400) * 0.8)
    report = judge(Images(dark, scene="tile", tile=8, range="0,1"), tolerance="1%")
    assert (report.verdict, report.cases[0].pixel) == (Verdict.BIASED, "tile#0,0+8")


def test_judged_against_other_renders(renders, tile, tmp_path):
    other = save(tmp_path / "other", rendered(tile, 410, samples=4, seed=2))
    subject = Images(renders, against=other, range="0,1", tile=8)
    X = subject.pixels()["0,0+8"]
    assert (X.values, subject.range(X), subject.replicates) == ((0,), (-1, 1), 400)
    assert "400 pairs of images are compared, sorted by name; 10 are left over" in subject.notes
    pair = [np.load(place / "r0009.npy").mean() for place in (renders, other)]
    assert subject.run(X, [9]) == pytest.approx(pair[0] - pair[1], abs=1e-7)
    assert judge(subject, tolerance=0.05).verdict is Verdict.CONFORMS
    dark = save(tmp_path / "dark", rendered(tile, 400, seed=3) * 0.5)
    report = judge(Images(renders, against=dark, range="0,1", tile=8), tolerance=0.05)
    assert report.verdict is Verdict.BIASED


def test_judged_against_a_constant(tmp_path):
    place = save(tmp_path / "furnace", np.random.default_rng(1).uniform(0, 1, (300, 20, 20)))
    subject = load(f"images:{place}?constant=1/2&range=0,1")
    assert (len(subject.pixels()), subject.tile) == (100, 2)
    assert subject.pixels()["18,18+2"].values == (Fraction(1, 2),)
    assert judge(subject, tolerance=0.1).verdict is Verdict.CONFORMS
    assert judge(load(f"images:{place}?constant=0.8&range=0,1"), tolerance=0.1).verdict is Verdict.BIASED


def test_one_render_twice_is_no_two_replicates(tmp_path, tile):
    images = rendered(tile, 20, samples=64)
    images[7] = images[3]
    subject = Images(save(tmp_path / "a", images), scene="tile")
    X = subject.pixels()["tile#4,3"]
    assert subject.run(X, np.arange(7)).shape == (7,)
    for _ in range(2):
        with pytest.raises(
            SubjectError, match=r"r0003.npy and r0007.npy are identical: renders must differ by their seed"
        ):
            subject.run(X, np.arange(20))
    report = judge(Images(tmp_path / "a", scene="tile"), tolerance="5%")
    assert (report.verdict, "are identical" in report.reason) == (Verdict.BROKEN, True)


def test_renders_of_few_samples_may_be_equal_by_chance(tmp_path, tile):
    subject = Images(save(tmp_path / "a", rendered(tile, 300, samples=1)), scene="tile")
    subject.run(subject.pixels()["tile#4,3"], np.arange(300))
    assert "equal another, such as r0" in subject.notes[-1]
    still = Images(save(tmp_path / "b", np.ones((30, 8, 8))), constant=1, range=(0, 2))
    assert set(still.run(still.pixels()["0,0"], np.arange(30))) == {1}
    assert "29 of the 30 images" in still.notes[-1]


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_pixel_that_is_no_number_breaks_the_subject(tmp_path, tile, value):
    images = rendered(tile, 20)
    images[3, 5, 2] = value
    subject = Images(save(tmp_path / "a", images), scene="tile")
    with pytest.raises(SubjectError, match=rf"r0003.npy has {value} at pixel \(2, 5\), Y"):
        subject.run(subject.pixels()["tile#4,3"], np.arange(20))


def place_of(directory, kind):
    """A directory with a fault of the given kind."""
    grey = np.zeros((8, 8), dtype=np.float32)
    files = {
        "small": [("a.npy", grey[:4]), ("b.npy", grey[:4])],
        "unlike": [("a.npy", grey), ("b.npy", grey[:4])],
        "single": [("a.npy", grey)],
        "whole": [("a.npy", grey.astype(int)), ("b.npy", grey.astype(int))],
        "flat": [("a.npy", grey[0]), ("b.npy", grey[0])],
        "pickled": [("a.npy", np.array([[None]])), ("b.npy", grey)],
        "codes": [("a.npy", grey.astype(np.uint16)), ("b.npy", grey.astype(np.uint16))],
        "fine": [("a.npy", grey), ("b.npy", grey + 1)],
    }
    place = directory / "renders"
    place.mkdir()
    for name, array in files.get(kind, []):
        np.save(place / name, array)
    if kind == "mixed":
        np.save(place / "a.npy", grey)
        write_pfm(place / "b.pfm", grey)
    if kind == "other":
        (place / "a.tif").write_bytes(b"")
    return place


@pytest.mark.parametrize(
    ("kind", "options", "words"),
    [
        ("fine", {}, "compared with nothing: give one of scene=NAME, constant=0.5 and against=DIR"),
        ("fine", {"scene": "tile", "constant": "1"}, "compared with scene=tile and constant=1"),
        ("fine", {"constant": "1"}, "constant=1 has no range of its own"),
        ("fine", {"constant": "1,2", "range": "0,1"}, "constant='1,2' has 2 numbers"),
        ("fine", {"constant": "white", "range": "0,1"}, "constant='white' has what is no number"),
        ("fine", {"constant": "1", "range": "1,0"}, "range='1,0' is no range: write lo,hi"),
        ("fine", {"constant": "1", "range": "0,inf"}, "range='0,inf' has what is no number"),
        ("fine", {"against": "nowhere", "range": "0,1"}, "no directory is called 'nowhere'"),
        ("fine", {"scene": "tiles"}, "'tiles'"),
        ("fine", {"scene": "tile", "tile": "0"}, "tile='0' is no count"),
        ("fine", {"scene": "fig5"}, "a.npy has 8 x 8 pixels, scene has 32 x 32"),
        ("fine", {"scene": "tile", "transfer": "srgb"}, "transfer='srgb': files of floats hold linear"),
        ("codes", {"scene": "tile"}, "16-bit files store encoded values: say transfer=linear or transfer=srgb"),
        ("codes", {"scene": "tile", "transfer": "log"}, "transfer='log' is none: say how 16-bit files store values"),
        (
            "codes",
            {"constant": "2", "range": "0,2", "transfer": "linear"},
            "value 2 is beyond what NPY codes stand for",
        ),
        ("none", {"scene": "tile"}, "has 0 images: give at least 2"),
        ("single", {"scene": "tile"}, "has 1 images: give at least 2"),
        ("small", {"scene": "tile"}, "a.npy has 8 x 4 pixels, scene has 8 x 8"),
        ("unlike", {"scene": "tile"}, "b.npy: 8 x 4 pixels of Y, but .*a.npy: 8 x 8 pixels"),
        ("whole", {"scene": "tile"}, "a.npy: has numbers of type int64"),
        ("flat", {"scene": "tile"}, r"a.npy: has shape \(8,\)"),
        ("pickled", {"scene": "tile"}, "a.npy: has numbers of type object"),
        ("mixed", {"scene": "tile"}, "has 1 NPY and 1 PFM files: give a glob of one kind"),
        ("other", {"scene": "tile"}, "a.tif in .* ends in '.tif': images end in .exr"),
    ],
)
def test_bad_input(tmp_path, kind, options, words):
    broken = kind not in ("fine", "codes", "none", "single", "mixed", "other") or options == {"scene": "fig5"}
    with pytest.raises(SubjectError if broken else InputError, match=words):
        Images(str(place_of(tmp_path, kind)), **options)


def test_globs_and_files_that_are_no_images(renders, tmp_path):
    assert Images(f"{renders}/r000?.npy", scene="tile").replicates == 10
    place = place_of(tmp_path, "fine")
    (place / "log.txt").write_text("done")
    assert "1 files of" in Images(place, scene="tile").notes[-1]
    with pytest.raises(InputError, match=r"log.txt in .* ends in '.txt'"):
        Images(f"{place}/*", scene="tile")
    with pytest.raises(InputError, match=r"r0000.npy is on both sides"):
        Images(renders, against=f"{renders}/r00*.npy", range="0,1")
    with pytest.raises(InputError, match=r"has 0 images"):
        Images(f"{place}/*.pfm", scene="tile")
