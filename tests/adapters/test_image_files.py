"""Reading renders: each format gives back what was written, and a broken file is named."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from tests.adapters.image_writers import EXTRA, rendered, save, write_exr, write_pfm, write_png, write_pnm

from truemean.adapters.image_files import read_planes, survey
from truemean.adapters.images import Images
from truemean.errors import MissingExtra, SubjectError
from truemean.oracle.scene import load_scene


@pytest.fixture(scope="module")
def tile():
    return load_scene("tile")


def stored(path):
    layout = survey([path])
    return np.stack(read_planes(path, layout, layout.channels), axis=-1), layout


def test_floats_are_read_as_they_were_written(tmp_path):
    colour = np.random.default_rng(1).normal(size=(3, 4, 3)).astype(np.float32)
    for name, image in (("colour", colour), ("grey", colour[..., 0])):
        for order in "<>":
            write_pfm(tmp_path / f"{name}.pfm", image, order)
            found, layout = stored(tmp_path / f"{name}.pfm")
            assert np.array_equal(found.squeeze(), image)
            assert (layout.width, layout.height, layout.levels) == (4, 3, 0)
        np.save(tmp_path / f"{name}.npy", np.asfortranarray(image))
        assert np.array_equal(stored(tmp_path / f"{name}.npy")[0].squeeze(), image)


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_exr_channels_are_read_by_name(tmp_path, dtype):
    image = np.random.default_rng(1).random((3, 4, 4)).astype(dtype)
    write_exr(tmp_path / "a.exr", RGBA=image, diffuse_R=image[..., 3])
    found, layout = stored(tmp_path / "a.exr")
    assert layout.channels == ("A", "B", "G", "R", "diffuse.R")
    assert found.dtype == dtype
    assert np.array_equal(found[..., 3::-1], image)
    assert np.array_equal(found[..., 4], image[..., 3])


def test_a_channel_of_two_parts_of_an_exr_has_two_names(tmp_path):
    library = pytest.importorskip("OpenEXR", reason=EXTRA)
    plane = np.ones((2, 2), dtype=np.float32)
    planes = {"beauty": plane, "light": 2 * plane}
    parts = [library.Part({"type": library.scanlineimage}, {"Y": Y}, name) for name, Y in planes.items()]
    library.File(parts).write(str(tmp_path / "a.exr"))
    found, layout = stored(tmp_path / "a.exr")
    assert layout.channels == ("Y", "light.Y")
    assert found[0, 0].tolist() == [1, 2]


@pytest.mark.parametrize("most", [255, 65535])
@pytest.mark.parametrize("suffix", ["ppm", "png", "npy"])
def test_codes_keep_all_their_bits(tmp_path, most, suffix):
    codes = np.random.default_rng(1).integers(0, most + 1, (5, 4, 3)).astype(np.uint8 if most == 255 else np.uint16)
    for name, image in (("colour", codes), ("grey", codes[..., 0])):
        write = {"ppm": lambda path, image: write_pnm(path, image, most), "png": write_png, "npy": np.save}[suffix]
        path = tmp_path / f"{name}.{suffix}"
        write(path, image)
        found, layout = stored(path)
        assert layout.levels == most
        assert np.array_equal(found.squeeze(), image)


@pytest.mark.parametrize(
    ("transfer", "encode", "step"),
    [
        ("linear", lambda light: light, 1),
        ("srgb", lambda light: np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055), 2.275),
        ("gamma2.2", lambda light: light ** (1 / 2.2), 2.2),
    ],
)
def test_codes_mean_what_the_transfer_says(tmp_path, transfer, encode, step):
    light = np.random.default_rng(1).random((2, 4, 4))
    place = save(tmp_path / "a", np.rint(encode(light) * 65535).astype(np.uint16), np.save)
    subject = Images(place, constant="0.5", range="0,1", transfer=transfer)
    found = subject.run_many(list(subject.pixels().values()), [0, 1])
    assert subject.rounding == pytest.approx(step / 65535, rel=1e-3)
    assert np.abs(found - light.reshape(2, -1)).max() <= subject.rounding


@pytest.mark.parametrize(
    ("dtype", "rounding"), [(np.float16, 2**-11 + 1e-6), (np.float32, 1e-6), (np.float64, 1e-6), (np.uint8, 1 / 255)]
)
def test_rounding_is_that_of_the_format(tmp_path, tile, dtype, rounding):
    images = rendered(tile, 2) * (255 if dtype == np.uint8 else 1)
    transfer = "linear" if dtype == np.uint8 else None
    subject = Images(save(tmp_path / "a", images.astype(dtype), np.save), scene="tile", transfer=transfer)
    assert subject.rounding == pytest.approx(rounding)


def save_sums(path, samples):
    np.savez(path, sum=samples.sum(axis=0), squares=(samples**2).sum(axis=0), count=len(samples))


def test_sums_stand_for_images_that_were_not_kept(tmp_path, tile):
    samples = rendered(tile, 60, samples=1).reshape(6, 10, 8, 8)
    place = save(tmp_path / "a", samples, save_sums, "npz")
    subject = Images(place, scene="tile")
    found = subject.run_many(list(subject.pixels().values()), np.arange(6))
    assert found == pytest.approx(samples.mean(axis=1).reshape(6, -1))
    tiles = save(tmp_path / "tiles", samples.reshape(6, 10, 2, 4, 2, 4).mean(axis=(3, 5)), save_sums, "npz")
    by_tile = Images(tiles, scene="tile", tile=4)
    found = [Images(place, scene="tile", tile=4).run(X, np.arange(6)) for X in by_tile.pixels().values()]
    assert pytest.approx(np.array(found)) == by_tile.run_many(list(by_tile.pixels().values()), np.arange(6)).T


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"sum": np.ones((8, 8)), "count": 4}, "has no array squares among sum, count"),
        ({"sum": np.ones((8, 8)), "squares": np.ones((8, 7)), "count": 4}, r"squares of shape \(8, 7\)"),
        (
            {"sum": 4 * np.ones((8, 8)), "squares": np.ones((8, 8)), "count": 4},
            r"squares \* count < sum\^2 at pixel \(0, 0\)",
        ),
        ({"sum": np.zeros((8, 8)), "squares": np.ones((8, 8)), "count": np.eye(8)}, r"count < 1 at pixel \(1, 0\)"),
        ({"sum": np.ones((8, 8)), "squares": np.ones((8, 8)), "count": np.array([None])}, "count of shape"),
    ],
)
def test_sums_that_are_none(tmp_path, arrays, words):
    place = save(tmp_path / "a", [arrays, arrays], lambda path, arrays: np.savez(path, **arrays), "npz")
    with pytest.raises(SubjectError, match=words):
        Images(place, scene="tile")


@pytest.mark.parametrize("suffix", ["npy", "pfm", "pgm", "png", "exr", "npz"])
def test_a_file_that_is_cut_short(tmp_path, tile, suffix):
    codes = np.arange(64, dtype=np.uint16).reshape(8, 8) * 1000
    write = {
        "npy": np.save,
        "pfm": write_pfm,
        "pgm": lambda path, image: write_pnm(path, codes, 65535),
        "png": lambda path, image: write_png(path, codes),
        "exr": lambda path, image: write_exr(path, Y=image.astype(np.float32)),
        "npz": lambda path, image: save_sums(path, np.array([image])),
    }[suffix]
    place = save(tmp_path / "a", rendered(tile, 2), write, suffix)
    options = {"scene": "tile", "transfer": "linear" if suffix in ("pgm", "png") else None}
    whole = (place / f"r0001.{suffix}").read_bytes()
    (place / f"r0001.{suffix}").write_bytes(whole[:-80])
    with pytest.raises(SubjectError, match=rf"r0001.{suffix}: (can't be read as|is cut short|is broken)"):
        Images(place, **options).run(tile.pixel(4, 3), [0, 1])
    (place / f"r0001.{suffix}").write_bytes(b"text")
    with pytest.raises(SubjectError, match=rf"r0001.{suffix}: "):
        Images(place, **options)


def test_without_the_package_the_line_that_installs_it(tmp_path, monkeypatch):
    place = tmp_path / "a"
    save(place, np.zeros((2, 8, 8)), lambda path, image: path.write_bytes(b""), "exr")
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    with pytest.raises(MissingExtra, match=r"pip install 'truemean\[images\]'"):
        Images(place, scene="tile")
