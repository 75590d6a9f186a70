"""Renders that lie as files, one per seed, as an estimator of what they should show on average.

Image i of the sorted files is the replicate of seed i, the mean of a tile of it an estimate. What that should be on average
is told by a scene (the mean of the tile's pixels), by a constant (a furnace test) or by other renders: image i minus
image i of the other set has mean 0 if both renderers have one mean, a two-sample test that is valid at every look.

What files round off, ``rounding``: single precision and the arithmetic before it, 1e-6 of the largest value; half
floats, another 2^-11, half a unit in the last place; codes, which may be rounded, cut off or dithered, one step: the largest
difference between the intensities of neighbouring codes, 1/255 or 1/65535 if linear, some 2.27 times that if srgb. It is one
number for all tiles, as a part of a tile's scale: the largest that any of them needs.

Two files of equal pixels are one render twice, hence no two replicates; but renders of few samples can be equal by
chance. Deal the pixels of each into three hands: where all other files differ in each hand, equal files are a
SubjectError, elsewhere a note. If hands are independent and agree with probability q, chance makes one of n pairs equal and
none in a single hand with probability n q^3 exp(-3 n q): for many files, in about one of e^3 n^2 directories at the worst q.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from hashlib import blake2b
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from truemean.adapters.frames import Floats, Number
from truemean.adapters.image_files import (
    KINDS,
    Kind,
    Layout,
    choose_channels,
    find_images,
    read_planes,
    read_transfer,
    survey,
)
from truemean.adapters.image_tiles import Box, Law, average_law, boxes, read_frames, read_tile, tile_means, told_of_sums
from truemean.adapters.registry import LOAD_SCENE, resolve
from truemean.errors import InputError, SubjectError, Unsupported
from truemean.subject import PixelLike, PlainPixel, Value

__all__ = ["Images", "TilePixel"]

HANDS = 3
SINGLE, HALF = 1e-6, 2.0**-11


@dataclass(frozen=True, slots=True)
class TilePixel(PlainPixel):
    """What a tile shows: the average law of its pixels, as values with exact weights; and which tile it is."""

    number: int = -1


class Images:
    """Renders in the files of a directory or glob; they are compared with exactly one of the following three.

    ``scene`` is a shipped one by name, a scene file, or a scene; ``constant`` a number, or three for a colour; ``against``
    another directory or glob. ``range="lo,hi"`` bounds the tiles of all images, else their own values do; the latter two need it.
    ``tile`` is the side of a tile in pixels, by default 1 for up to 256 pixels, else the least power of 2 that makes
    at most 256 tiles. ``channel`` is one by name, or a layer of R, G and B; ``transfer`` is linear, srgb or gamma2.2, for
    files of codes. Raises InputError for options that don't fit, SubjectError for files that are no such renders,
    MissingExtra without what reads the files.
    """

    name = "images"

    def __init__(
        self,
        place: str,
        /,
        scene: Any = None,
        constant: Any = None,
        against: str | None = None,
        # How the files are read.
        tile: Number | None = None,
        channel: str | None = None,
        transfer: str | None = None,
        range: Any = None,  # noqa: A002 - the word that estimators use too
    ) -> None:
        given = {"scene": scene, "constant": constant, "against": against}
        named = [f"{name}={value}" for name, value in given.items() if value is not None]
        if len(named) != 1:
            what = " and ".join(named) or "nothing"
            raise InputError(f"{place!r} is compared with {what}: give one of scene=NAME, constant=0.5 and against=DIR")
        self._ends = () if range is None else _read_ends(range)
        if scene is None and not self._ends:
            raise InputError(f"{named[0]} has no range of its own: say what all pixels lie between, range=0,1")
        # The images.
        truth = _Truth.of(scene, constant)
        self._renders = _Renders(place, channel, transfer, truth.colour)
        self._others = None if against is None else _Renders(against, channel, transfer, self._renders.colour)
        self._check_others()
        self.replicates = min(len(each.files) for each in self._sets)
        # The tiles.
        self.tile, self._why = read_tile(tile, self._renders.layout)
        self._cut = self._cut_of(truth.size or self._renders.size, asked=tile is not None)
        self._pixels = self._tiles(truth)
        self._has_scale = truth.size is not None
        self._own = {X.number: X for X in self._pixels.values()}
        self._columns = {_law(X): X.number for X in reversed(self._own.values())}
        self.rounding = self._rounding()

    def pixels(self) -> dict[str, TilePixel]:
        """The tiles, row by row: by the column and row of their first pixel, and ``+`` their side if that is not 1."""
        return dict(self._pixels)

    def range(self, pixel: PixelLike) -> tuple[Fraction, Fraction] | None:
        """Bounds of the estimates as declared, of differences if those are the estimates; None for a tile's own values."""
        if not self._ends:
            return None
        low, high = self._ends
        return (low - high, high - low) if self._others else (low, high)

    def run(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Estimates of one tile ``[seeds]`` or ``[seeds, channels]``; see `run_many`."""
        return self.run_many([pixel], seeds)[:, 0]

    def run_many(self, pixels: Sequence[PixelLike], seeds: ArrayLike) -> Floats:
        """Estimates ``[seeds, pixels]`` or ``[seeds, pixels, channels]``.

        Unsupported for a pixel that is no tile and has the law of none, InputError for a seed that is no image,
        SubjectError for an image that can't be read, is not finite, or is another one again.
        """
        columns = [self._column(pixel) for pixel in pixels]
        return self._shown(self._means(self._numbers(seeds)), columns)

    @property
    def sums(self) -> Callable[[Sequence[PixelLike], ArrayLike], tuple[Floats, Floats, Floats]] | None:
        """Counts, means and mean squares of the frames that each file is the sum of, as `run_many`; None for other files.

        None as well for pairs of sets, whose differences have sums that nobody knows. The mean square of a tile of several
        pixels is a bound from above, see `read_frames`.
        """
        return self._sums if self._renders.layout.frames and not self._others else None

    def _sums(self, pixels: Sequence[PixelLike], seeds: ArrayLike) -> tuple[Floats, Floats, Floats]:
        columns, numbers = [self._column(pixel) for pixel in pixels], self._numbers(seeds)
        means = self._means(numbers)
        counts, squares = self._renders.frames(numbers, self._cut)
        each = np.broadcast_to(counts[:, np.newaxis, np.newaxis], means.shape), means, np.maximum(squares, means**2)
        found = [self._shown(part, columns) for part in each]
        return found[0], found[1], found[2]

    def _numbers(self, seeds: ArrayLike) -> list[int]:
        numbers: list[int] = np.asarray(seeds, dtype=np.int64).tolist()
        if strange := [seed for seed in numbers if not 0 <= seed < self.replicates]:
            raise InputError(
                f"seed {strange[0]} is no image: there are {self.replicates}, from 0 to {self.replicates - 1}"
            )
        return numbers

    def _means(self, numbers: Sequence[int]) -> Floats:
        means = self._renders.means(numbers, self._cut)
        return means - self._others.means(numbers, self._cut) if self._others else means

    def _shown(self, tiles: Floats, columns: Sequence[int]) -> Floats:
        return tiles[:, columns] if self._renders.colour else tiles[:, columns, 0]

    @property
    def notes(self) -> tuple[str, ...]:
        """How many images of which kind, what tiles, what was left out, and which images read so far are equal."""
        sets = self._sets
        found = [f"{each}; seed 0 is {each.files[0].name}" for each in sets]
        if self._others:
            over = abs(len(sets[0].files) - len(sets[1].files))
            found.append(f"{self.replicates} pairs of images are compared, sorted by name; {over} are left over")
        if self._renders.kind.name == "NPZ":
            found.append(told_of_sums(frames=self.sums is not None, cut=self._cut))
        if not self._has_scale:
            found.append(
                f"a {'difference' if self._others else 'constant'} has no scale: a tolerance in percent is of 1"
            )
        found.append(f"cut into tiles of {self.tile} x {self.tile} pixels, {len(self._pixels)} in all, {self._why}")
        return (*found, *filter(None, (note for each in sets for note in (each.ignored, each.twins))))

    @property
    def versions(self) -> dict[str, str]:
        """The versions of what read the files."""
        return {package: version(package) for each in self._sets for package in each.kind.packages(each.layout)}

    @property
    def _sets(self) -> list[_Renders]:
        return [self._renders, self._others] if self._others else [self._renders]

    def _column(self, pixel: PixelLike) -> int:
        if isinstance(pixel, TilePixel) and pixel == self._own.get(pixel.number):
            return pixel.number
        column = self._columns.get(_law(pixel))
        if column is None:
            raise Unsupported(f"no tile of {self._renders.place!r} has the law of {pixel!r}: take one of pixels()")
        return column

    def _check_others(self) -> None:
        if self._others:
            mine, other = self._renders, self._others
            if common := set(mine.files) & set(other.files):
                raise InputError(f"{min(common)} is on both sides: give two sets of independent renders")
            if (mine.size, mine.channels) != (other.size, other.channels):
                raise InputError(f"{mine} can't be paired with {other}: give renders of one size and the same channels")

    def _cut_of(self, wanted: tuple[int, int], *, asked: bool) -> int:
        """The side of a tile in the images: 1 where files of sums hold a tile a number."""
        width, height = self._renders.size
        if wanted == (width, height):
            return self.tile
        if asked and self._renders.kind.name == "NPZ" and (width, height) == tuple(-(-n // self.tile) for n in wanted):
            return 1
        raise SubjectError(
            f"{self._renders.files[0]} has {width} x {height} pixels, scene has {wanted[0]} x {wanted[1]}"
        )

    def _tiles(self, truth: _Truth) -> dict[str, TilePixel]:
        prefix, side = truth.prefix, f"+{self.tile}" if self.tile > 1 else ""
        law = truth.law or (lambda box: {(Fraction(0),) * 3 if self._renders.colour else Fraction(0): Fraction(1)})
        found = {}
        for number, box in enumerate(boxes(truth.size or self._renders.size, self.tile)):
            values, weights = zip(*law(box).items(), strict=True)
            found[f"{prefix}{box[0]},{box[1]}{side}"] = TilePixel(values, weights, number)
        numbers = [number for X in found.values() for number in _flat(X.values)]
        if self._renders.layout.levels and not 0 <= min(numbers) <= max(numbers) <= 1:
            far = next(number for number in numbers if not 0 <= number <= 1)
            raise InputError(f"value {far} is beyond what {self._renders.kind.name} codes stand for, 0 to 1")
        return found

    def _rounding(self) -> float:
        relative = sum(each.relative for each in self._sets)
        step = sum(each.step for each in self._sets)
        worst = 0.0
        for X in {_law(X): X for X in self._pixels.values()}.values():
            values = _flat(X.values)
            largest = max(abs(value) for value in (*values, *self._ends))
            worst = max(worst, (relative * float(largest) + step) / float((max(values) - min(values)) or 1))
        return worst


@dataclass(frozen=True, slots=True)
class _Truth:
    """The law of a box of pixels, None where images are compared with others; whether in colour, None where both will do.

    A scene has a size, and a prefix for the names of its tiles.
    """

    law: Callable[[Box], Law] | None = None
    colour: bool | None = None
    size: tuple[int, int] | None = None
    prefix: str = ""

    @classmethod
    def of(cls, scene: Any, constant: Any) -> _Truth:
        """What a scene or a constant says, whichever is given."""
        if constant is not None:
            numbers = _read_numbers("constant", constant)
            if len(numbers) not in (1, 3):
                raise InputError(f"constant={constant!r} has {len(numbers)} numbers: give one, or red,green,blue")
            value = numbers if len(numbers) == 3 else numbers[0]
            return cls(lambda box: {value: Fraction(1)}, len(numbers) == 3)
        if scene is None:
            return cls()
        shown = scene if hasattr(scene, "to_dict") else resolve(LOAD_SCENE)(scene)
        laws = {place: dict(zip(X.values, X.weights, strict=True)) for place, X in shown.pixels().items()}
        colour = isinstance(shown.background, tuple)
        return cls(lambda box: average_law(laws, box), colour, (shown.width, shown.height), f"{shown.name}#")


class _Renders:
    """The images of one directory or glob; tile means of those read are kept, their pixels are not.

    ``relative`` and ``step`` are the parts of a value, and the absolute amount, that the files round off.
    """

    def __init__(self, place: str, channel: str | None, transfer: str | None, colour: bool | None) -> None:
        self.place = str(place)
        self.files, self.ignored = find_images(self.place)
        self.layout: Layout = survey(self.files)
        self.size = self.layout.width, self.layout.height
        self.channels = choose_channels(self.layout, channel, colour)
        self.colour = len(self.channels) == 3
        self._table = read_transfer(transfer, self.layout, self.channels)
        self._types = [plane.dtype for plane in read_planes(self.files[0], self.layout, self.channels)]
        half = any(dtype == np.float16 for dtype in self._types)
        self.relative = 0.0 if self.layout.levels else SINGLE + half * HALF
        self.step = 0.0 if self._table is None else float(np.diff(self._table).max())
        self.twins = self._fault = ""
        self._means: dict[int, Floats] = {}
        self._frames: dict[int, tuple[float, Floats]] = {}
        self._first: dict[tuple[bytes, ...], int] = {}

    def __str__(self) -> str:
        kind = f"{self.kind.name} (half)" if self.relative > HALF else self.kind.name
        return (
            f"{self.place}: {len(self.files)} {kind} images of {self.size[0]} x {self.size[1]} pixels, "
            f"channel{'s' * self.colour} {', '.join(self.channels)}"
        )

    @property
    def kind(self) -> Kind:
        """What kind of files they are."""
        return KINDS[self.files[0].suffix.lower()]

    def means(self, numbers: Sequence[int], cut: int) -> Floats:
        """Tile means ``[numbers, tiles, channels]``, row by row."""
        twins = [pair for number in numbers if number not in self._means and (pair := self._read(number, cut))]
        if twins:
            self._tell(twins)
        if self._fault:
            raise SubjectError(self._fault)
        return np.stack([self._means[number] for number in numbers])

    def frames(self, numbers: Sequence[int], cut: int) -> tuple[Floats, Floats]:
        """How many frames each file is the sum of, and their mean squares ``[numbers, tiles, channels]``."""
        places = [self.layout.channels.index(channel) for channel in self.channels]
        for number in set(numbers) - self._frames.keys():
            self._frames[number] = read_frames(self.files[number], places, cut)
        counts, squares = zip(*(self._frames[number] for number in numbers), strict=True)
        return np.array(counts), np.stack(squares)

    def _read(self, number: int, cut: int) -> tuple[int, int] | None:
        """Read an image; it and an equal one read before, if there is one."""
        file = self.files[number]
        planes = read_planes(file, self.layout, self.channels)
        if (types := [plane.dtype for plane in planes]) != self._types:
            raise SubjectError(f"{file} stores {types[0]}, {self.files[0]} {self._types[0]}: renders are alike")
        image = np.stack(planes, axis=-1)
        light = image.astype(np.float64) if self._table is None else self._table[image]
        _check_finite(light, self.channels, file)
        self._means[number] = tile_means(light, cut)
        pixels = image.reshape(-1, len(planes))
        hands = tuple(blake2b(pixels[start::HANDS].tobytes()).digest() for start in range(HANDS))
        first = self._first.setdefault(hands, number)
        return None if first == number else (first, number)

    def _tell(self, twins: Sequence[tuple[int, int]]) -> None:
        """A fault where equal images can't be chance, else a note."""
        first, second = (self.files[number].name for number in sorted(twins[0]))
        distinct = len(self._first)
        if distinct > 1 and all(len(set(hand)) == distinct for hand in zip(*self._first, strict=True)):
            self._fault = f"{first} and {second} are identical: renders must differ by their seed"
        self.twins = (
            f"{len(self._means) - distinct} of the {len(self._means)} images read from {self.place} equal another, "
            f"such as {first} and {second}: that can be chance if samples are few; see that no seed is used twice"
        )


def _check_finite(light: Floats, channels: Sequence[str], file: Path) -> None:
    strange = np.argwhere(~np.isfinite(light))
    if strange.size:
        row, column, channel = strange[0]
        raise SubjectError(f"{file} has {light[row, column, channel]} at pixel ({column}, {row}), {channels[channel]}")


def _read_ends(text: Any) -> tuple[Fraction, ...]:
    ends = _read_numbers("range", text)
    if len(ends) != 2 or ends[0] >= ends[1]:
        raise InputError(f"range={text!r} is no range: write lo,hi with lo < hi, such as range=0,1")
    return ends


def _read_numbers(name: str, value: Any) -> tuple[Fraction, ...]:
    parts = value.split(",") if isinstance(value, str) else value if isinstance(value, tuple | list) else [value]
    try:
        return tuple(map(Fraction, parts))
    except (TypeError, ValueError, ZeroDivisionError, OverflowError):
        raise InputError(f"{name}={value!r} has what is no number: write 0.5 or 1/2, commas between several") from None


def _flat(values: Sequence[Value]) -> list[Fraction]:
    return [number for value in values for number in (value if isinstance(value, tuple) else (value,))]


def _law(pixel: PixelLike) -> frozenset[tuple[Value, Fraction]]:
    return frozenset(zip(pixel.values, pixel.weights, strict=True))
