"""Reading renders from files: EXR, PFM, NPY, PNG and PPM images, and NPZ sums of images that were not kept.

EXR, PFM and NPY files of floats hold intensities. PNG, PPM, PGM and NPY files of uint8 or uint16 hold codes from 0 to
the largest, which a transfer function turns into intensities in [0, 1]; the file does not tell which one. An NPZ file
has the arrays ``sum`` and ``squares`` ``[h, w]`` or ``[h, w, c]``, and ``count``: its image is ``sum / count``. A ``count`` that
is one number is of whole frames, renders with a seed each; one of ``[h, w]`` is of the samples of a single render.
"""

from __future__ import annotations

import re
import struct
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from importlib import import_module
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truemean.errors import InputError, MissingExtra, SubjectError, UnknownName

__all__ = ["KINDS", "Kind", "Layout", "choose_channels", "find_images", "read_planes", "read_transfer", "survey"]

Planes = dict[str, NDArray[Any]]
HEAD = 4096  # bytes, enough for what PFM and PPM files begin with
GAP = rb"(?:\s|#[^\n]*\n)+"
PFM = re.compile(rb"(PF|Pf)\s+(\d+)\s+(\d+)\s+([-+]?[\d.]+(?:[eE][-+]?\d+)?)(?:\r\n|\s)")
PNM = re.compile(rb"(P[56])" + 3 * (GAP + rb"(\d+)") + rb"\s")
PNG = b"\x89PNG\r\n\x1a\n"
PNG_CHANNELS = {0: ("Y",), 2: ("R", "G", "B"), 4: ("Y", "A"), 6: ("R", "G", "B", "A")}
ARRAY_CHANNELS = {1: ("Y",), 3: ("R", "G", "B"), 4: ("R", "G", "B", "A")}
SUMS = ("sum", "squares", "count")
SLACK = 1e-4  # by which sums of many numbers in single precision may be off
LINEAR, SRGB = "linear", "srgb"


@dataclass(frozen=True, slots=True)
class Layout:
    """What a file's head says: size in pixels, names of the channels, and the largest code, 0 for intensities.

    ``frames``: it holds the sums of whole frames.
    """

    width: int
    height: int
    channels: tuple[str, ...]
    levels: int = 0
    frames: bool = False

    def __str__(self) -> str:
        codes = f", codes up to {self.levels}" if self.levels else ", sums of frames" if self.frames else ""
        return f"{self.width} x {self.height} pixels of {', '.join(self.channels)}{codes}"


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of files: how the head is read, and the planes ``[height, width]`` by channel; which packages do it."""

    name: str
    head: Callable[[Path], Layout]
    planes: Callable[[Path, Layout], Planes]
    packages: Callable[[Layout], tuple[str, ...]] = lambda layout: ()


def find_images(place: str) -> tuple[tuple[Path, ...], str]:
    """The images of a directory or glob, sorted by name, and a sentence on files of a directory that are no images.

    InputError unless they are two or more, of one kind.
    """
    path = Path(place).expanduser()
    if path.is_dir():
        files = sorted(file for file in path.iterdir() if file.is_file() and not file.name.startswith("."))
    elif any(sign in place for sign in "*?["):
        files = sorted(file for file in Path(path.anchor).glob(str(path.relative_to(path.anchor))) if file.is_file())
    else:
        raise InputError(f"no directory is called {place!r}: give one with renders, or a glob such as 'renders/*.exr'")
    images = [file for file in files if file.suffix.lower() in KINDS]
    others = [file.name for file in files if file.suffix.lower() not in KINDS]
    if others and not (images and path.is_dir()):
        suffix = Path(others[0]).suffix
        raise InputError(f"{others[0]} in {place!r} ends in {suffix!r}: images end in {', '.join(KINDS)}")
    counts: dict[str, int] = {}
    for file in images:
        name = KINDS[file.suffix.lower()].name
        counts[name] = counts.get(name, 0) + 1
    if len(counts) > 1:
        listed = " and ".join(f"{count} {name}" for name, count in counts.items())
        raise InputError(f"{place!r} has {listed} files: give a glob of one kind, such as '*{images[0].suffix}'")
    if len(images) < 2:
        raise InputError(f"{place!r} has {len(images)} images: give at least 2 renders with different seeds")
    ignored = f"{len(others)} files of {place} are no images and left out, such as {others[0]}" if others else ""
    return tuple(images), ignored


def survey(files: Sequence[Path]) -> Layout:
    """The layout that all files have; SubjectError names the first that has another."""
    layouts = map(_layout, files)
    first = next(layouts)
    for file, layout in zip(files[1:], layouts, strict=True):
        if layout != first:
            raise SubjectError(f"{file}: {layout}, but {files[0]}: {first}; the renders of one scene are alike")
    return first


def choose_channels(layout: Layout, channel: str | None, colour: bool | None) -> tuple[str, ...]:
    """One channel, or R, G and B of a colour; ``colour`` says which it must be, None leaves it to the file.

    ``channel`` names a channel, or a layer that has R, G and B. UnknownName where there is none.

    >>> choose_channels(Layout(1, 1, ("A", "B", "G", "R", "Z")), None, colour=True)
    ('R', 'G', 'B')
    """
    names = layout.channels
    needed = {False: "one is needed", True: "R, G and B are needed", None: "one, or R, G and B, are needed"}[colour]
    layers = {
        name[:-1]: tuple(name[:-1] + letter for letter in "RGB") for name in names if re.search(r"(^|\.)R$", name)
    }
    layers = {layer.rstrip("."): three for layer, three in layers.items() if set(three) <= set(names)}
    known = (*names, *filter(None, layers))
    if channel is not None:
        found = (channel,) if channel in names else layers.get(channel, ())
        if not (channel and found):
            raise UnknownName("channel of these images", channel, known)
    else:
        opaque = tuple(name for name in names if not _is_alpha(name))
        grey = opaque if len(opaque) == 1 else ("Y",) * ("Y" in names)
        found = layers.get("", ()) if colour else grey if colour is False else layers.get("", grey)
    if not found or (colour is not None and len(found) != (3 if colour else 1)):
        which = f"channel={channel!r}" if channel else "no channel= is given"
        raise InputError(f"the images have channels {', '.join(known)}, and {which}: {needed}")
    return found


def read_transfer(transfer: str | None, layout: Layout, channels: Sequence[str]) -> NDArray[np.float64] | None:
    """Intensity by code, None where the files hold intensities; InputError where ``transfer`` is missing or unknown.

    >>> read_transfer("gamma2", Layout(1, 1, ("Y",), levels=2), ["Y"])
    array([0.  , 0.25, 1.  ])
    """
    if not layout.levels:
        if transfer not in (None, LINEAR):
            raise InputError(f"transfer={transfer!r}: files of floats hold linear intensities, leave it out")
        return None
    codes = np.arange(layout.levels + 1) / layout.levels
    gamma = re.fullmatch(r"gamma(\d+(?:\.\d*)?|\.\d+)", str(transfer))
    power = float(gamma[1]) if gamma else 0.0
    if transfer == LINEAR or all(map(_is_alpha, channels)):
        return codes
    if transfer == SRGB:
        return np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
    if power > 0:
        table: NDArray[np.float64] = codes**power
        return table
    bits = {255: "8-bit files", 65535: "16-bit files"}.get(layout.levels, f"files of codes up to {layout.levels}")
    if transfer is None:
        raise InputError(
            f"{bits} store encoded values: say transfer=linear or transfer=srgb, or a power, transfer=gamma2.2"
        )
    raise InputError(
        f"transfer={transfer!r} is none: say how {bits} store values, linear, srgb or a power such as gamma2.2"
    )


def read_planes(path: Path, layout: Layout, channels: Sequence[str]) -> list[NDArray[Any]]:
    """The chosen channels of a file, ``[height, width]`` each, as they are stored; SubjectError names the file."""
    kind = KINDS[path.suffix.lower()]
    with _reading(path, kind):
        planes = kind.planes(path, layout)
        return [planes[channel] for channel in channels]


def _layout(path: Path) -> Layout:
    kind = KINDS[path.suffix.lower()]
    with _reading(path, kind):
        layout = kind.head(path)
        if not (layout.width and layout.height and layout.channels):
            raise InputError(f"has {layout.width} x {layout.height} pixels of {len(layout.channels)} channels: nothing")
        return layout


@contextmanager
def _reading(path: Path, kind: Kind) -> Iterator[None]:
    try:
        yield
    except MissingExtra:
        raise
    except InputError as error:
        raise SubjectError(f"{path}: {error}") from None
    except Exception as error:
        raise SubjectError(f"{path}: can't be read as {kind.name} ({error}): render it again") from error


def _is_alpha(name: str) -> bool:
    return name.rpartition(".")[2] == "A"


def _library(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        raise MissingExtra(f"{name} can't be imported ({error}): pip install 'truemean[images]'") from error


def _by_channel(pixels: NDArray[Any], layout: Layout) -> Planes:
    planes = np.moveaxis(pixels.reshape(layout.height, layout.width, -1), 2, 0)
    return dict(zip(layout.channels, planes, strict=True))


# -- EXR ------------------------------------------------------------------------------------------


@contextmanager
def _exr(path: Path, **options: Any) -> Iterator[tuple[dict[str, tuple[int, Any]], Sequence[Any]]]:
    """Part and head of each channel by name, and the parts; what the library prints is what went wrong."""
    told = StringIO()
    with redirect_stdout(told), _library("OpenEXR").File(str(path), separate_channels=True, **options) as file:
        if not file.parts:
            raise InputError(f"is broken or cut short: {told.getvalue().strip()}")
        named: dict[str, tuple[int, Any]] = {}
        for number, part in enumerate(file.parts):
            for channel in part.header["channels"]:
                if channel.xSampling == channel.ySampling == 1:
                    name = f"{part.name()}.{channel.name}" if channel.name in named else channel.name
                    named[name] = number, channel
        yield named, file.parts


def _exr_head(path: Path) -> Layout:
    with _exr(path, header_only=True) as (named, parts):
        frames = [np.ravel(part.header[key]).tolist() for part in parts for key in ("displayWindow", "dataWindow")]
        if any("deep" in str(part.type()) for part in parts):
            raise InputError("is deep: flatten it")
        if any(frame != frames[0] for frame in frames):
            raise InputError(f"has data window {frames[1]} in display window {frames[0]}: render the whole frame")
        left, top, right, bottom = frames[0]
        return Layout(right - left + 1, bottom - top + 1, tuple(named))


def _exr_planes(path: Path, layout: Layout) -> Planes:
    with _exr(path) as (named, parts):
        pixels = {name: parts[number].channels[channel.name].pixels for name, (number, channel) in named.items()}
        return {name: plane.reshape(layout.height, layout.width) for name, plane in pixels.items()}


# -- PFM, PPM and PGM -----------------------------------------------------------------------------


def _begins(start: bytes, pattern: re.Pattern[bytes], form: str) -> re.Match[bytes]:
    found = pattern.match(start)
    if found is None:
        raise InputError(f"begins with {start[:12]!r}, not as {form} do")
    return found


def _start(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(HEAD)


def _numbers(data: bytes, offset: int, layout: Layout, dtype: str) -> NDArray[Any]:
    count = layout.width * layout.height * len(layout.channels)
    due, there = count * np.dtype(dtype).itemsize, len(data) - offset
    if there < due:
        raise InputError(f"is cut short: {there} bytes of pixels where {due} are due")
    return np.frombuffer(data, dtype, count, offset).reshape(layout.height, layout.width, -1)


def _pfm_head(path: Path) -> Layout:
    mark, width, height, _ = _begins(_start(path), PFM, "PFM files").groups()
    return Layout(int(width), int(height), ARRAY_CHANNELS[3 if mark == b"PF" else 1])


def _pfm_planes(path: Path, layout: Layout) -> Planes:
    data = path.read_bytes()
    found = _begins(data[:HEAD], PFM, "PFM files")
    scale = float(found[4])
    rows = _numbers(data, found.end(), layout, "<f4" if scale < 0 else ">f4")[::-1]
    return _by_channel(rows if abs(scale) in (0, 1) else rows * np.float32(abs(scale)), layout)


def _pnm_head(path: Path) -> Layout:
    mark, width, height, most = _begins(_start(path), PNM, "binary PPM (P6) and PGM (P5) files").groups()
    if not 1 <= int(most) <= 65535:
        raise InputError(f"has codes up to {int(most)}: PPM and PGM allow 1 to 65535")
    return Layout(int(width), int(height), ARRAY_CHANNELS[3 if mark == b"P6" else 1], int(most))


def _pnm_planes(path: Path, layout: Layout) -> Planes:
    data = path.read_bytes()
    found = _begins(data[:HEAD], PNM, "binary PPM (P6) and PGM (P5) files")
    codes = _numbers(data, found.end(), layout, ">u2" if layout.levels > 255 else "u1")
    if codes.max() > layout.levels:
        raise InputError(f"has code {codes.max()}, beyond its own largest, {layout.levels}")
    return _by_channel(codes, layout)


# -- PNG ------------------------------------------------------------------------------------------


def _png_head(path: Path) -> Layout:
    start = _start(path)
    if len(start) < 26 or not start.startswith(PNG):
        raise InputError(f"begins with {start[:12]!r}, not as PNG files do")
    width, height, depth, colours = struct.unpack(">IIBB", start[16:26])
    if depth not in (8, 16) or colours not in PNG_CHANNELS:
        raise InputError(f"has {depth} bits of PNG colour type {colours}: write grey or colour of 8 or 16 bits")
    return Layout(width, height, PNG_CHANNELS[colours], 2**depth - 1)


def _png_planes(path: Path, layout: Layout) -> Planes:
    if layout.levels == 255:
        with _library("PIL.Image").open(path) as image:
            return _by_channel(np.asarray(image), layout)
    with path.open("rb") as file:
        rows = _library("png").Reader(file=file).read()[2]  # Pillow would keep 8 of the 16 bits of a colour
        return _by_channel(np.array([np.asarray(row) for row in rows], dtype=np.uint16), layout)


# -- NPY and NPZ ----------------------------------------------------------------------------------


def _array_head(stream: Any) -> tuple[tuple[int, ...], np.dtype[Any]]:
    major = np.lib.format.read_magic(stream)[0]
    read = np.lib.format.read_array_header_1_0 if major == 1 else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(stream)
    return shape, dtype


def _array_layout(shape: tuple[int, ...], levels: int = 0, *, frames: bool = False) -> Layout:
    if len(shape) not in (2, 3):
        raise InputError(f"has shape {shape}: an image is [height, width] or [height, width, channels]")
    count = shape[2] if len(shape) == 3 else 1
    return Layout(shape[1], shape[0], ARRAY_CHANNELS.get(count, tuple(map(str, range(count)))), levels, frames)


def _npy_head(path: Path) -> Layout:
    with path.open("rb") as file:
        shape, dtype = _array_head(file)
    levels = {"f": 0, "u1": 255, "u2": 65535}.get(dtype.kind if dtype.kind == "f" else dtype.str[1:])
    if levels is None:
        raise InputError(f"has numbers of type {dtype}: save floats, or codes as uint8 or uint16")
    return _array_layout(shape, levels)


def _npy_planes(path: Path, layout: Layout) -> Planes:
    return _by_channel(np.load(path, allow_pickle=False), layout)


def _npz_head(path: Path) -> Layout:
    with zipfile.ZipFile(path) as archive:
        names = [name.removesuffix(".npy") for name in archive.namelist()]
        if missing := [name for name in SUMS if name not in names]:
            raise InputError(f"has no array {', '.join(missing)} among {', '.join(names)}: save sum, squares and count")
        heads = {}
        for name in SUMS:
            with archive.open(f"{name}.npy") as stream:
                heads[name] = _array_head(stream)
    for name, (shape, dtype) in heads.items():
        fitting = (heads["sum"][0],) if name != "count" else ((), heads["sum"][0][:2])
        if dtype.kind not in "iuf" or shape not in fitting:
            raise InputError(f"has {name} of shape {shape} and type {dtype} beside sum of shape {heads['sum'][0]}")
    return _array_layout(heads["sum"][0], frames=heads["count"][0] == ())


def _npz_planes(path: Path, layout: Layout) -> Planes:
    with np.load(path, allow_pickle=False) as arrays:
        total, squares, count = (np.asarray(arrays[name], dtype=np.float64) for name in SUMS)
    count = count if count.ndim == total.ndim else count[..., np.newaxis]
    impossible = {
        "count < 1": ~(count >= 1) & np.isfinite(total),
        "squares * count < sum^2": squares * count < total**2 * (1 - SLACK),
    }
    for fault, places in impossible.items():
        if places.any():
            row, column = np.argwhere(places)[0][:2]
            raise InputError(f"has {fault} at pixel ({column}, {row}): sum and squares are over the same count samples")
    return _by_channel(total / count, layout)


KINDS: Mapping[str, Kind] = {
    ".exr": Kind("EXR", _exr_head, _exr_planes, lambda layout: ("OpenEXR",)),
    ".pfm": Kind("PFM", _pfm_head, _pfm_planes),
    ".npy": Kind("NPY", _npy_head, _npy_planes),
    ".npz": Kind("NPZ", _npz_head, _npz_planes),
    ".png": Kind("PNG", _png_head, _png_planes, lambda layout: ("pillow" if layout.levels == 255 else "pypng",)),
    **dict.fromkeys((".ppm", ".pgm", ".pnm"), Kind("PPM", _pnm_head, _pnm_planes)),
}
