"""POV-Ray, a ray tracer with adaptive anti-aliasing and without a seed: a replicate is a copy of the scene in one large image.

How it decides (POV-Ray 3.7.0.10, ``source/backend/render/tracetask.cpp``), values encoded with ``Antialias_Gamma`` 2.5
and compared by the sum of the differences of red, green and blue, so that a grey counts three times:

- Method 1: in reading order, the sample at the pixel's centre is compared with what the left and the upper pixel have
  *by now*. At a distance of ``threshold`` or more the pixel is supersampled: its value is the mean of the centre and
  ``depth`` x ``depth`` cells, one jittered sample each, all weighed alike. So is that neighbour, unless it has been
  already. A pixel that differs from its neighbour on the right or below is therefore supersampled for certain; one that
  differs from the left or upper one alone is compared with a random value where that one has been supersampled before.
- Method 2: four corners. Where two of the six pairs differ and a level is left, five points more, in the middle of the
  square and of its sides, jittered by up to jitter/2 of 1/(2^depth + 1), and the same for each quarter; else the mean of the
  four. Of ``depth`` levels the last never divides: depth 1 is the mean of four corners, depth 3 a grid of 5 x 5 points at most.

Jitter is a hash of the sample's place in the image (``source/backend/support/jitter.h``) of 256 steps, from -1/2 to 127/256
of a cell. What is said here is therefore about positions, the mean over them, and the laws are those of a uniform and
independent jitter (`Povray.predicts`). They hold: on ``tile`` with method 1 and depth 3, at 65,536 positions, the largest
difference of a mean was 0.0007 (2.4 standard errors), standard deviations agreed to 0.8 %, and replicates side by side
were correlated by less than 0.012.

Every copy has the background around it, of at least a pixel, and the image is one block: at the borders of POV-Ray's own
blocks of 32 pixels method 1 would take neighbours for sampled that are not. All lies 2^-20 pixels left of where it is said
to be and 2^-26 above: a sample on an edge, such as a corner of ``tile``, then sees what the oracle's geometry says, and no
tie is left to POV-Ray's rounding. The option ``+A1.0`` is refused by POV-Ray's command line, ``Antialias_Threshold=1`` is not.
"""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truemean.adapters.frames import Floats, Number, SceneRenderer, layers, read_count, untested
from truemean.adapters.povray_rules import Centre, Method1, Method2, peak
from truemean.adapters.registry import read_number
from truemean.errors import InputError, MissingExtra, SubjectError
from truemean.subject import PixelLike

__all__ = ["Povray", "installed", "read_ppm"]

TESTED = ("3.7.0.10",)
SHIFT = (2.0**-20, 2.0**-26)  # pixels: more than any rounding, less than an image of 16 bits shows
BEFORE = 2.0**-12  # pixels that a copy reaches out on the left and above: less than the width of what no jitter reaches
STEP = 1 / 65535
MOST_PIXELS = 2**25
LIMIT = 900.0  # seconds
LAST_LINES = 8  # of what POV-Ray writes, where it says what was wrong


def installed() -> str | None:
    """The version of POV-Ray on this machine, None where there is none."""
    program = shutil.which("povray")
    if program is None:
        return None
    try:
        done = subprocess.run([program, "--version"], capture_output=True, timeout=60, check=False)  # noqa: S603
    except (OSError, subprocess.TimeoutExpired):
        return None
    found = re.search(rb"POV-Ray (\d+(?:\.\d+)*)", done.stdout + done.stderr)
    return found[1].decode() if found else None


class Povray(SceneRenderer):
    """A copy of the scene, at one position of a large image, is one replicate of every pixel.

    ``method`` is POV-Ray's: 0 for one sample at the centre, 1 or 2 for its anti-aliasing, with ``depth`` (R),
    ``threshold`` (A) and ``jitter`` (J, 0 for none). Seeds are 0 to ``positions`` - 1; without jitter one copy is
    rendered, which all replicates are. Where a value is above 1 all are rendered as shares of the largest.
    MissingExtra without POV-Ray, InputError for options that it has not, or would clip.
    """

    name = "povray"

    def __init__(
        self,
        scene: Any = "tile",
        method: Number = 0,
        # Of the methods 1 and 2.
        depth: Number = 3,
        threshold: Number = "0.3",
        jitter: Number = "1.0",
        positions: Number = 4096,
    ) -> None:
        found = installed()
        if found is None:
            raise MissingExtra("povray can't be started: apt-get install povray")
        super().__init__(scene)
        if read_number(method) not in (0, 1, 2):
            raise InputError(f"method={method!r}: POV-Ray has 0, 1 and 2")
        self.method, self.depth = int(read_number(method)), read_count("depth", depth)
        if self.depth > 9:
            raise InputError(f"depth={depth!r}: POV-Ray goes up to 9")
        self.threshold, self.jitter = _share("threshold", threshold), _share("jitter", jitter)
        self.positions = read_count("positions", positions)
        self.deterministic = self.method == 0 or self.jitter == 0
        self.replicates = None if self.deterministic else self.positions
        if self.method == 2 and not self.deterministic:
            self.costs = None  # type: ignore[assignment, method-assign] # POV-Ray does not tell
        self._version = found
        self._layout = _Layout.of(self.scene, 1 if self.deterministic else self.positions)
        rule = {0: Centre, 1: Method1, 2: Method2}[self.method]
        self._rule = rule(self, self.depth, self.threshold, self.jitter)
        self._source = _source(self.scene, self._layout, float(rule.margin))
        self.rounding = max(2e-5, float(STEP * self._rule.peak / min(X.scale for X in self.frame_pixels.values())))
        self.notes = (*untested("povray", found, TESTED), *self._said())
        self._copies: tuple[Floats, Floats] | None = None

    @property
    def versions(self) -> dict[str, str]:
        """The version of POV-Ray."""
        return {"povray": self._version}

    @property
    def declares(self) -> tuple[str, dict[str, int]] | None:
        """The plan whose law every pixel has: where all are supersampled for certain, in grey, or none is ever."""
        if not self.method:
            return "centre-first", {"n": 1}
        rule = self._rule
        if not isinstance(rule, Method1) or rule.colour or self.jitter != 1:
            return None
        whole = all(rule.chance(*place) == 1 for place in self.places)
        return ("centre-and-grid", {"grid": self.depth}) if whole else None

    def predicts(self, pixel: PixelLike) -> dict[str, Any]:
        """What the rule makes of a pixel under a uniform, independent jitter: law and cost.

        Of method 2 mean and cost alone where the law takes too many paths; numbers are None where they are not
        worked out: where two neighbours that a decision of method 1 looks at depend on the same third pixel.
        """
        return self._rule.predicts(*self.places[self._column(pixel)])

    def range(self, pixel: PixelLike) -> tuple[list[Fraction], list[Fraction]]:
        """The least and the largest value, by channel, in reach of the samples of ``pixel``: those of method 2 leave it."""
        channels = self._rule.reached(*self.places[self._column(pixel)])
        return [min(channel) for channel in channels], [max(channel) for channel in channels]

    def frames(self, seeds: NDArray[np.int64]) -> tuple[Any, Any]:
        """The copies at these positions, and samples drawn; InputError for a seed that is no position."""
        if not self.deterministic and not ((seeds >= 0) & (seeds < self.positions)).all():
            raise InputError(f"seeds {seeds.min()} to {seeds.max()}: give positions, 0 to {self.positions - 1}")
        if self._copies is None:
            image = _rendered(self._source, self._layout, self._options())
            shares = self._layout.cut(image)
            values = shares * float(self._rule.peak)
            self._copies = (values if self._rule.colour else values[..., 0]), self._rule.costs(shares)
        chosen = seeds * 0 if self.deterministic else seeds
        return self._copies[0][chosen], self._copies[1][chosen]

    def _options(self) -> list[str]:
        given = {
            "Antialias": "on" if self.method else "off",
            "Sampling_Method": self.method or 1,
            "Antialias_Depth": self.depth,
            "Antialias_Threshold": f"{self.threshold:.17f}",
            "Antialias_Gamma": 2.5,
            "Jitter": "on" if self.jitter else "off",
            "Jitter_Amount": f"{self.jitter:.17f}",
        }
        return [f"{name}={value}" for name, value in given.items()]

    def _said(self) -> Iterator[str]:
        if self.deterministic:
            yield "without jitter every copy is the same: one was rendered, and seeds make no difference"
        else:
            yield (
                f"POV-Ray has no seed: a replicate is one of {self.positions} positions, and what is said is about the "
                "mean over them of its hash of the position; that they are independent is not"
            )
        if self._rule.peak > 1:
            yield f"values were rendered as shares of the largest, {self._rule.peak}, and compared with the threshold as such"
        if self.costs is None:
            yield "POV-Ray does not tell how many samples a pixel took with method 2, so no costs were measured"


def _share(name: str, value: Number) -> float:
    number = read_number(value)
    if isinstance(number, str) or not 0 <= number <= 1:
        raise InputError(f"{name}={value!r}: POV-Ray takes a number from 0 to 1")
    return float(number)


# -- rendering -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Layout:
    """Copies of a frame in an image, ``pitch`` pixels apart, which is odd: the hash has a period of 4096 pixels."""

    frame: tuple[int, int]
    copies: int
    across: int

    @classmethod
    def of(cls, scene: Any, copies: int) -> _Layout:
        """As square a number of copies as can be; InputError for an image that is too large."""
        layout = cls((scene.width, scene.height), copies, math.isqrt(copies - 1) + 1)
        width, height = layout.size
        if width * height > MOST_PIXELS:
            raise InputError(
                f"positions={copies} of a scene of {scene.width} x {scene.height} pixels make an image of {width} x {height}: "
                f"give fewer, it may have {MOST_PIXELS} pixels"
            )
        return layout

    @property
    def pitch(self) -> tuple[int, int]:
        """Of columns and rows."""
        return (self.frame[0] + 1) | 1, (self.frame[1] + 1) | 1

    @property
    def down(self) -> int:
        """How many rows of copies there are."""
        return -(-self.copies // self.across)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the image."""
        return self.pitch[0] * self.across, self.pitch[1] * self.down

    def cut(self, image: Floats) -> Floats:
        """The copies ``[copies, height, width, 3]``."""
        (width, height), (x, y) = self.frame, self.pitch
        parts = image.reshape(self.down, y, self.across, x, 3).swapaxes(1, 2).reshape(-1, y, x, 3)
        return parts[: self.copies, :height, :width]


def _source(scene: Any, layout: _Layout, margin: float) -> str:
    """What POV-Ray reads: polygons in front of each other, clipped to the frame, and copied; y upwards, z away.

    POV-Ray's bounding boxes are single precision: the sheet behind the polygons keeps them clear of every edge.
    """
    (everywhere, _), *polygons = layers(scene.to_dict(), "povray")
    (width, height), (x, y), (wide, high) = layout.frame, layout.pitch, layout.size
    brightest, depth = float(peak(scene)), len(polygons)
    beyond = [(-0.5, -0.5), (width + 0.5, -0.5), (width + 0.5, height + 0.5), (-0.5, height + 0.5)]
    stack = [(everywhere, beyond), *polygons]
    sheets = [_polygon(outline, depth + 1 - i, _glow(value, brightest)) for i, (value, outline) in enumerate(stack)]
    near, right, bottom = _text(-margin - BEFORE), _text(width + margin), _text(-height - margin)
    frame = f"box{{<{near},{bottom},0.99>,<{right},{_text(margin + BEFORE)},{depth + 1.01}>}}"
    copy = f"object{{Copy translate<{x}*mod(N,{layout.across}),-{y}*div(N,{layout.across}),0>}}"
    return "\n".join(
        [
            "#version 3.7; global_settings{assumed_gamma 1.0}",
            f"camera{{orthographic location<{_text(wide / 2 + SHIFT[0])},{_text(-high / 2 - SHIFT[1])},-9>",
            f"direction z right x*{wide} up y*{high}}}",
            f"plane{{-z,-{depth + 2} {_glow(everywhere, brightest)}}}",
            f"#declare Copy=union{{{' '.join(sheets)} clipped_by{{{frame}}}}}" if polygons else "",
            f"#for(N,0,{layout.copies - 1}) {copy} #end" if polygons else "",
        ]
    )


def _polygon(outline: Sequence[tuple[float, float]], z: int, look: str) -> str:
    corners = ",".join(f"<{_text(x)},{_text(-y)},{z}>" for x, y in [*outline, outline[0]])
    return f"polygon{{{len(outline) + 1},{corners} {look}}}"


def _glow(value: float | tuple[float, ...], peak: float) -> str:
    parts = value if isinstance(value, tuple) else (value,) * 3
    colour = ",".join(_text(part / peak) for part in parts)
    return f"pigment{{rgb<{colour}>}} finish{{ambient 0 diffuse 0 emission 1}}"


def _text(number: float) -> str:
    return f"{number:.17g}"


def _rendered(source: str, layout: _Layout, options: list[str]) -> Floats:
    """The image ``[height, width, 3]`` that POV-Ray makes; SubjectError with its own words where it makes none."""
    width, height = layout.size
    size = [f"+W{width}", f"+H{height}", f"+BS{max(width, height)}", "+WT1"]
    quiet = ["-D", "-V", "-P", "-GD", "-GR", "-GS", "-UA", "+Q9", "Dither=off"]
    environment = {name: value for name, value in os.environ.items() if name != "POVINI"}
    with TemporaryDirectory() as folder:
        Path(folder, "scene.pov").write_text(source, encoding="ascii")
        command = [
            shutil.which("povray") or "povray",
            "+Iscene.pov",
            "+Oimage.ppm",
            "+FP16",
            "File_Gamma=1.0",
            *size,
            *quiet,
            *options,
        ]
        try:
            done = subprocess.run(  # noqa: S603 - a fixed program, without a shell
                command, cwd=folder, env=environment, capture_output=True, timeout=LIMIT, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise SubjectError(f"povray did not end well: {error}") from error
        image = Path(folder, "image.ppm")
        if done.returncode or not image.is_file():
            lines = done.stderr.decode(errors="replace").split("\n")
            words = " ".join(line.strip() for line in lines[-LAST_LINES:] if not line.startswith("====")).strip()
            raise SubjectError(f"povray ended with exit code {done.returncode} and wrote: {words}")
        return read_ppm(image.read_bytes(), (width, height))


def read_ppm(data: bytes, size: tuple[int, int]) -> Floats:
    r"""The values in [0, 1] of a binary PPM of 16 bits, ``[height, width, 3]``; SubjectError for any other file.

    >>> read_ppm(b"P6\n# a comment\n1 1\n65535\n" + bytes([255, 255, 0, 0, 0, 0]), (1, 1)).tolist()
    [[[1.0, 0.0, 0.0]]]
    """
    header = re.match(rb"P6\s(?:#[^\n]*\n|\s)*(\d+)\s(?:#[^\n]*\n|\s)*(\d+)\s(?:#[^\n]*\n|\s)*65535\s", data)
    width, height = size
    found = header and (int(header[1]), int(header[2]))
    if not header or found != size or len(data) - header.end() != 6 * width * height:
        raise SubjectError(
            f"povray wrote {data[:40]!r}..., {len(data)} bytes, and no image of {width} x {height} pixels"
        )
    return np.frombuffer(data, ">u2", offset=header.end()).reshape(height, width, 3) * STEP
