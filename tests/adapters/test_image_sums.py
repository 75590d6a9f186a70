"""Files of sums of many frames: each frame counts, and what sums can't tell is on the safe side."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from tests.adapters.image_writers import rendered, save
from tests.adapters.test_images import COLOUR

from truemean.adapters.images import Images
from truemean.conformance import Verdict, check_subject, judge
from truemean.errors import SubjectError
from truemean.oracle.scene import Scene, load_scene

FRAMES = 400


def save_sums(path, frames):
    np.savez(path, sum=frames.sum(axis=0), squares=(frames**2).sum(axis=0), count=len(frames))


def save_samples(path, frames):
    count = np.full(frames.shape[1:3], len(frames))
    np.savez(path, sum=frames.sum(axis=0), squares=(frames**2).sum(axis=0), count=count)


def tiled(images):
    """Means of tiles of 4 x 4 pixels."""
    return images.reshape(*images.shape[:-2], 2, 4, 2, 4).mean(axis=(-3, -1))


@pytest.fixture(scope="module")
def tile():
    return load_scene("tile")


@pytest.fixture(scope="module")
def frames(tile):
    """Frames ``[files, frames, height, width]`` of one sample a pixel."""
    return rendered(tile, 8 * FRAMES, samples=1).reshape(8, FRAMES, 8, 8)


@pytest.fixture(scope="module")
def place(frames, tmp_path_factory):
    return save(tmp_path_factory.mktemp("sums") / "a", frames, save_sums, "npz")


def test_sums_are_those_of_the_frames(frames, place):
    subject = pickle.loads(pickle.dumps(Images(place, scene="tile")))
    pixels = list(subject.pixels().values())
    counts, means, squares = subject.sums(pixels[4:9], [6, 2, 2])
    chosen = frames.reshape(8, FRAMES, 64)[[6, 2, 2], :, 4:9]
    assert np.array_equal(counts, np.full((3, 5), FRAMES))
    assert means == pytest.approx(chosen.mean(axis=1))
    assert squares == pytest.approx((chosen**2).mean(axis=1))
    assert "each file is the sum of many frames, and a replicate is a frame" in subject.notes
    assert check_subject(subject)


def test_the_mean_square_of_a_tile_is_bounded_from_above(frames, place):
    subject = Images(place, scene="tile", tile=4)
    counts, means, squares = subject.sums(list(subject.pixels().values()), np.arange(8))
    shown = tiled(frames).reshape(8, FRAMES, 4)
    assert counts.shape == (8, 4)
    assert means == pytest.approx(shown.mean(axis=1))
    exact, loosest = (shown**2).mean(axis=1), tiled((frames**2).mean(axis=1)).reshape(8, 4)
    assert (exact < squares).all()
    assert (squares < loosest - 0.02).all()
    assert subject.notes[1].endswith("whose squares tell how noisy a tile is at most")
    assert check_subject(subject)


def test_the_bound_is_reached_where_the_pixels_of_a_tile_move_together(tmp_path):
    rng = np.random.default_rng(3)
    shown = np.kron(rng.random((8, 50, 2, 2)), rng.random((4, 4)))
    subject = Images(save(tmp_path / "a", shown, save_sums, "npz"), scene="tile", tile=4)
    squares = subject.sums(list(subject.pixels().values()), np.arange(8))[2]
    assert squares == pytest.approx((tiled(shown) ** 2).mean(axis=1).reshape(8, 4), rel=1e-4)
    still = save(tmp_path / "b", np.ones((2, 5, 8, 8)) * np.array([1.0, 0.5])[:, None, None, None], save_sums, "npz")
    subject = Images(still, scene="tile", tile=4)
    assert subject.sums(list(subject.pixels().values()), [0, 1])[2][:, 0] == pytest.approx([1, 0.25], rel=1e-5)


def test_colours_by_channel(tmp_path):
    scene = Scene.from_dict(COLOUR)
    frames = rendered(scene, 60, samples=1).reshape(3, 20, 2, 3, 3)
    subject = Images(save(tmp_path / "a", frames, save_sums, "npz"), scene=scene)
    counts, means, squares = subject.sums(list(subject.pixels().values()), [0, 1, 2])
    assert counts.shape == means.shape == (3, 6, 3)
    assert squares == pytest.approx((frames**2).mean(axis=1).reshape(3, 6, 3))
    assert len(judge(subject, tolerance="5%").cases) == 18


def test_a_bias_that_the_files_alone_would_not_show(frames, tmp_path):
    darker = np.where(frames.mean(axis=(0, 1)) == 1, frames, 0.75 * frames)
    dark = save(tmp_path / "a", darker, save_sums, "npz")
    options = {"scene": "tile", "tile": 2}
    report = judge(Images(dark, **options), tolerance="1%")
    assert report.verdict is Verdict.BIASED
    assert max(case.replicates for case in report.cases) == 8 * FRAMES
    samples = Images(save(tmp_path / "b", darker, save_samples, "npz"), **options)
    assert samples.sums is None
    assert (
        "each file of sums is one replicate, its mean: single frames need one count a file and no other set"
        in samples.notes
    )
    assert judge(samples, tolerance="1%").verdict is Verdict.INCONCLUSIVE


def test_frames_conform_where_the_files_alone_are_too_few(frames, place):
    assert judge(Images(place, scene="tile"), tolerance="20%").verdict is Verdict.CONFORMS
    numbers = [case.replicates for case in judge(Images(place, scene="tile"), tolerance="5%").cases]
    assert max(numbers) == 8 * FRAMES


def test_pairs_of_sets_and_other_files_count_as_before(frames, place, tmp_path):
    other = save(tmp_path / "b", frames[:, ::-1] * 0.5, save_sums, "npz")
    pairs = Images(place, against=str(other), range="0,1")
    assert pairs.sums is None
    assert any(note.startswith("each file of sums is one replicate") for note in pairs.notes)
    assert judge(pairs, tolerance="30%").verdict in (Verdict.INCONCLUSIVE, Verdict.BIASED)
    assert Images(save(tmp_path / "c", frames[:, 0]), scene="tile").sums is None


def test_frames_beyond_the_range_are_broken_though_their_mean_is_not(frames, tmp_path):
    wild = frames * 1.0
    wild[3, :2] = [np.full((8, 8), 9.0), np.full((8, 8), -8.0)]
    case = judge(Images(save(tmp_path / "a", wild, save_sums, "npz"), scene="tile"), tolerance="5%").cases[4]
    assert case.verdict is Verdict.BROKEN
    assert f"returned {FRAMES} estimates of mean" in case.reason
    assert "for seed 3, which none in the range [0.0, 1.0] have" in case.reason


def test_counts_of_frames_and_of_samples_are_not_mixed(frames, tmp_path):
    place = save(tmp_path / "a", frames[:2], save_sums, "npz")
    save_samples(place / "r0002.npz", frames[2])
    with pytest.raises(
        SubjectError, match=r"r0002.npz: 8 x 8 pixels of Y, but .*r0000.npz: 8 x 8 pixels of Y, sums of frames"
    ):
        Images(place, scene="tile")
