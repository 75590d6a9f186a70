"""Tiles of an image: which there are, what they should show, what they do, and how many frames a file of sums is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np

from truemean.adapters.frames import Floats, Number, read_count
from truemean.adapters.image_files import Layout
from truemean.subject import Value

__all__ = ["Box", "Law", "average_law", "boxes", "read_frames", "read_tile", "tile_means", "told_of_sums"]

MOST_TILES = 256
ROUNDED = 4e-6  # of a mean square, where sum and squares are of single precision
Box = tuple[int, int, int, int]  # left, top, right and bottom, the latter two outside
Law = dict[Value, Fraction]


def read_tile(tile: Number | None, layout: Layout) -> tuple[int, str]:
    """The side of a tile, and why."""
    if tile is not None:
        return read_count("tile", tile), "as asked"
    side = 1
    while -(-layout.width // side) * -(-layout.height // side) > MOST_TILES:
        side *= 2
    return side, f"at most {MOST_TILES} if tile= is not given"


def boxes(size: tuple[int, int], tile: int) -> Iterator[Box]:
    """Tiles row by row; those at the right and bottom end with the image."""
    width, height = size
    for y in range(0, height, tile):
        for x in range(0, width, tile):
            yield x, y, min(x + tile, width), min(y + tile, height)


def average_law(laws: Mapping[tuple[int, int], Law], box: Box) -> Law:
    """The law of a box of pixels, all of them equally probable."""
    left, top, right, bottom = box
    count = (right - left) * (bottom - top)
    law: Law = {}
    for x, y in ((x, y) for y in range(top, bottom) for x in range(left, right)):
        for value, weight in laws[x, y].items():
            law[value] = law.get(value, Fraction(0)) + weight / count
    return law


def tile_means(light: Floats, cut: int) -> Floats:
    """Means ``[tiles, channels]`` of an image ``[height, width, channels]`` over tiles of side ``cut``, row by row.

    >>> tile_means(np.arange(6.0).reshape(2, 3, 1), 2).ravel()
    array([2. , 3.5])
    """
    rows, columns = (np.arange(0, size, cut) for size in light.shape[:2])
    sums = np.add.reduceat(np.add.reduceat(light, rows, axis=0), columns, axis=1)
    areas = np.outer(*(np.diff([*starts, size]) for starts, size in zip((rows, columns), light.shape, strict=False)))
    means: Floats = (sums / areas[..., np.newaxis]).reshape(-1, light.shape[2])
    return means


def read_frames(file: Path, channels: Sequence[int], cut: int) -> tuple[float, Floats]:
    """How many frames an NPZ file of sums stands for, and their mean squares ``[tiles, channels]`` as `tile_means`.

    What a tile of several pixels shows is their mean, of whose squares the pixels' own tell an upper bound alone: its
    deviation is at most the mean of their deviations, as it is where they move together. Roundings count as noise.
    """
    with np.load(file, allow_pickle=False) as arrays:
        count = float(arrays["count"])
        parts = [np.asarray(arrays[name], dtype=np.float64) / count for name in ("sum", "squares")]
    means, squares = (part.reshape(*part.shape[:2], -1)[..., list(channels)] for part in parts)
    if cut == 1:
        return count, tile_means(squares, cut)
    deviations = np.sqrt(np.maximum(squares - means**2, 0.0) + ROUNDED * squares)
    together = tile_means(means, cut) ** 2 + tile_means(deviations, cut) ** 2
    return count, np.minimum(together, tile_means(squares, cut))


def told_of_sums(*, frames: bool, cut: int) -> str:
    """A sentence on what files of sums count for."""
    if not frames:
        return "each file of sums is one replicate, its mean: single frames need one count a file and no other set"
    bound = ", whose squares tell how noisy a tile is at most" if cut > 1 else ""
    return f"each file is the sum of many frames, and a replicate is a frame{bound}"
