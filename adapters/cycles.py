"""Cycles, the path tracer of Blender, as an estimator of the pixels of a scene.

How it samples (bpy 5.2.3; files of the Cycles repository, branch release/5.2): sample 0 of a pixel goes through the
middle of its filter whatever the seed (``kernel/integrator/init_from_camera.h``), the others are a scrambled Sobol set.
Hence the mean of the plan centre-first, off the true c by (value at the centre - c) / samples, with less variance than
that plan's. Measured with 16 samples, 5,000 seeds: -0.0278 +- 0.0006 at c = 7/16, where -0.0273 is predicted. The
middle is 1023/2044 in the table of the box filter (``scene/film.cpp``), 0.0005 right of and above the centre. With
``sample_offset`` 1, which skips sample 0, the mean is true: at 256 samples off by at most 0.0002 +- 0.0001 in 8 pixels.

TABULATED_SOBOL has 256 sequences that no seed changes, it only chooses (``scene/integrator.cpp``), as long as the
samples or 256 if they are fewer: its mean over all seeds is up to 0.0004 +- 0.0001 off the plan's (256 samples, 5,000
seeds). AUTOMATIC, which is BLUE_NOISE, is not: |z| < 1.6 in 16 pixels.

Positions in the frame are single precision: about once in 2^24 / x samples, one of column or row x lands on an edge of
its pixel and sees what begins there (measured in 16 million samples each of 8, 64 and 1024 columns), which
`Cycles.range` therefore includes.

How adaptive Cycles decides (``kernel/film/adaptive_sampling.h``, ``scene/integrator.cpp``): a pixel stops when
e < 5 * threshold, e = sum |I - A| / (0.0001 + N) over red, green and blue; I is its mean, A that of the half of its
samples whose index has an odd number of ones among bits 1, 3, 5, ..., N the sum of I, or its root where that is below
1. With ``sample_offset`` the threshold is scaled by sqrt(samples / (samples + offset)). Pixels are looked at every 16
samples, first after ``(max(4, min_samples) + 1 | 15) + 1``, so that min_samples from 1 to 14 are alike; 0 means
ceil(16 / threshold^0.3). A black pixel has e = 0 and stops; one that goes on takes its eight neighbours along. All
samples are pooled, which gives a bias on top of the centre's; of it nothing is predicted. Measured with sample 0
skipped, 2,500 seeds, squares in pixels among black ones, at most 256 samples: threshold 0.01 with min_samples 1 gives
-0.0095 +- 0.0003 at c = 1/64, -0.0053 +- 0.0007 at 1/16, +0.0042 +- 0.0010 at 49/64; threshold 0.05 gives
+0.0065 +- 0.0009 at 1/4, +0.0053 +- 0.0016 at 49/64; threshold 0.01 with min_samples 0 at most 0.0008 +- 0.0004.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from fractions import Fraction
from importlib import import_module
from importlib.metadata import version
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from truemean.adapters.frames import Number, Point, SinglePrecisionRenderer, layers, read_count, untested
from truemean.adapters.registry import read_number
from truemean.errors import InputError, MissingExtra, SubjectError
from truemean.subject import PixelLike, Value

__all__ = ["Cycles"]

TESTED = ("5.2.3",)
SMALLEST = 4  # pixels, of a frame that Blender renders
FIRST = (Fraction(1023, 2044), Fraction(1021, 2044))  # where the filter's table puts (1/2, 1/2) of a pixel
NEAR = Fraction(1, 10**5)  # an edge this near to that place may lie on either side of it
FINITE_TABLE = (
    "TABULATED_SOBOL draws from 256 sequences that are the same for every seed: "
    "means over seeds are off by up to some 0.0005 of the scale, with any number of samples up to 256"
)


class Cycles(SinglePrecisionRenderer):
    """A frame of Cycles is one replicate of every pixel of a scene, its seed the replicate's seed.

    Options mean what they do in Blender: ``samples`` a pixel, at most that many where ``adaptive_threshold`` (with
    ``adaptive_min_samples``) makes it adaptive; ``sample_offset=1`` skips the sample at the centre and draws as many
    others; ``sampling_pattern`` is AUTOMATIC, TABULATED_SOBOL or BLUE_NOISE. Each instance has a Blender scene of its
    own, no other is touched. ``first_look`` is the number of samples after which pixels may stop.
    MissingExtra without bpy, InputError for options that Blender refuses or would change.
    """

    name = "cycles"
    package: ClassVar[str] = "bpy"
    seed_bits = 31

    def __init__(
        self,
        scene: Any = "tile",
        samples: Number = 16,
        adaptive_threshold: Number | None = None,
        adaptive_min_samples: Number = 0,
        sample_offset: Number = 0,
        sampling_pattern: str = "AUTOMATIC",
    ) -> None:
        try:
            import_module("bpy")
        except ImportError as error:
            raise MissingExtra(
                f"bpy can't be imported ({error}): pip install 'truemean[cycles]' under Python 3.13"
            ) from error
        super().__init__(scene)
        self.samples = read_count("samples", samples)
        self.adaptive = adaptive_threshold is not None
        if read_number(adaptive_min_samples) != 0 and not self.adaptive:
            raise InputError(
                f"adaptive_min_samples={adaptive_min_samples!r} is of adaptive sampling: give adaptive_threshold too"
            )
        options = {
            "sampling_pattern": sampling_pattern,
            "use_adaptive_sampling": self.adaptive,
            "adaptive_threshold": read_number(adaptive_threshold) if self.adaptive else 0.01,
            "adaptive_min_samples": read_number(adaptive_min_samples),
            "sample_offset": read_number(sample_offset),
        }
        self._blender = _stage(self.scene.to_dict() | {"name": self.scene.name}, room=2 if self.adaptive else 0)
        settings = self._blender.cycles
        for option, value in options.items():
            _set(settings, option, value)
        _set(settings, "samples", self.samples + settings.sample_offset)
        settings.use_sample_subset = settings.sample_offset > 0
        settings.sample_subset_length = self.samples
        self.rounding = max(type(self).rounding, 0 if _whole(self.frame_pixels.values()) else self.samples / 2**25)
        self.first_look = _first_look(settings, self.samples) if self.adaptive else self.samples
        tabulated = sampling_pattern == "TABULATED_SOBOL"
        self.notes = untested("bpy", version("bpy"), TESTED) + ((FINITE_TABLE,) if tabulated else ())

    @property
    def predicts(self) -> Callable[[PixelLike], Mapping[str, Any]] | None:
        """What is known of a pixel of the scene: cost and, but for TABULATED_SOBOL, the mean; None when adaptive."""
        return None if self.first_look < self.samples else self._prediction

    def _prediction(self, pixel: PixelLike) -> Mapping[str, Any]:
        own = self.frame_pixels[self.places[self._column(pixel)]]
        known: dict[str, Any] = {"cost": self.samples}
        if self._blender.cycles.sampling_pattern == "TABULATED_SOBOL":
            return known
        if self._blender.cycles.sample_offset > 0:
            return known | {"mean": own.mean}
        x, y = FIRST
        first, *others = (own.at(x + dx, y + dy) for dx in (-NEAR, NEAR) for dy in (-NEAR, NEAR))
        if any(other != first for other in others):
            return known
        return known | {"mean": _mixed(first, own.mean, Fraction(1, self.samples))}

    def in_reach(self, place: tuple[int, int]) -> set[Value]:
        """The values in a pixel or on its edge; where adaptive, the columns beside the frame are black."""
        values = super().in_reach(place)
        if self.adaptive and (place[0] == self.scene.width - 1 or place[1] == self.scene.height - 1):
            one = next(iter(values))
            values.add((Fraction(0),) * len(one) if isinstance(one, tuple) else Fraction(0))
        return values

    def frame(self, seed: int) -> tuple[Any, Any]:
        """One frame, read from the result of the render before Blender converts it; InputError for a seed beyond 31 bits."""
        import bpy

        if seed not in range(1 << self.seed_bits):
            raise InputError(f"seed={seed}: Cycles has seeds from 0 to {(1 << self.seed_bits) - 1}")
        self._blender.cycles.seed = seed
        self._blender.update_tag()  # else persistent data keep the old seed
        with _read_passes() as passes:
            bpy.ops.render.render(scene=self._blender.name)
        if not passes:
            raise SubjectError(f"Cycles rendered no frame of scene {self.scene.name!r}; standard error says why")
        means = passes["Combined"].astype(np.float64)
        counts = (
            self._counts(passes["Debug Sample Count"][..., 0])
            if self.adaptive
            else np.full(means.shape[:2], self.samples)
        )
        place = np.s_[: self.scene.height, : self.scene.width]
        return means[place][..., :3] if isinstance(self.scene.background, tuple) else means[place][..., 0], counts[
            place
        ]

    def _counts(self, parts: NDArray[np.float32]) -> Any:
        """Samples drawn: Cycles tells them as parts of an unknown most, and a black pixel stops at the first look."""
        return np.rint(parts / parts[0, self.scene.width + 1] * self.first_look)


def _set(settings: Any, name: str, value: Any) -> None:
    """A setting of Cycles; InputError for what Blender refuses, and for what it would silently change."""
    try:
        setattr(settings, name, value)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"Cycles refuses {name}={value!r}: {error}") from None
    if isinstance(value, str) or value == getattr(settings, name) or np.float32(value) == getattr(settings, name):
        return
    bounds = settings.bl_rna.properties[name]
    raise InputError(f"{name}={value!r} is outside what Cycles has, {bounds.hard_min} to {bounds.hard_max}")


def _first_look(settings: Any, samples: int) -> int:
    """Samples after which Cycles first asks whether a pixel may stop (``scene/integrator.cpp``), or all of them."""
    threshold = settings.adaptive_threshold or max(0.001, 1 / settings.samples)
    scaled = threshold * math.sqrt(samples / settings.samples)
    least = settings.adaptive_min_samples or math.ceil(16 / scaled**0.3)
    return int(min(((max(4, least) + 1) | 15) + 1, samples))


def _whole(pixels: Iterable[PixelLike]) -> bool:
    """Whether all values are whole numbers, whose sums are exact in the single precision of Cycles."""
    return all(part.denominator == 1 for X in pixels for value in X.values for part in _parts(value))


def _parts(value: Value) -> tuple[Fraction, ...]:
    return value if isinstance(value, tuple) else (value,)


def _mixed(first: Value, others: Value, part: Fraction) -> Value:
    """A value and a mean, the first with weight ``part``."""
    mixed = tuple(a * part + b * (1 - part) for a, b in zip(_parts(first), _parts(others), strict=True))
    return mixed if isinstance(first, tuple) else mixed[0]


@contextmanager
def _read_passes() -> Iterator[dict[str, NDArray[np.float32]]]:
    """The passes of what is rendered meanwhile, top row first: Cycles hands them over before Blender converts them."""
    engine = import_module("cycles").CyclesRender
    own, passes = engine.render, {}

    def render(self: Any, depsgraph: Any) -> None:
        own(self, depsgraph)
        result = self.get_result()
        for found in result.layers[0].passes:
            values = np.empty(len(found.rect) * found.channels, np.float32)
            found.rect.foreach_get(values)
            passes[found.name] = values.reshape(result.resolution_y, result.resolution_x, found.channels)[::-1]

    engine.render = render
    try:
        yield passes
    finally:
        engine.render = own


def _stage(data: Mapping[str, Any], room: int) -> Any:
    """A new Blender scene, one unit a pixel, ``room`` columns to the right; the later layers are nearer.

    With such room, all that Blender renders beyond the scene is black, so that it stops at the first look.
    """
    import bpy

    width, height = data["width"], data["height"]
    wide, high = max(SMALLEST, width + room), max(SMALLEST, height)
    sheets = layers(data, "Cycles")
    for left, top in ((width, -1), (-1, height)) if room else ():
        sheets.append((0.0, [(left, top), (wide + 1, top), (wide + 1, high + 1), (left, high + 1)]))
    scene = bpy.data.scenes.new(data["name"])
    for depth, (value, outline) in enumerate(sheets):
        scene.collection.objects.link(_sheet(value, outline, float(depth)))

    # The camera
    camera = bpy.data.cameras.new("front")
    camera.type, camera.ortho_scale, camera.clip_end = "ORTHO", max(wide, high), len(sheets) + 1
    seen_from = bpy.data.objects.new("front", camera)
    seen_from.location = (wide / 2, -high / 2, len(sheets))
    scene.collection.objects.link(seen_from)
    scene.camera = seen_from

    # What differs from the factory settings
    render, settings = scene.render, scene.cycles
    render.engine = "CYCLES"
    for option, value in (("resolution_x", wide), ("resolution_y", high)):
        _set(render, option, value)
    render.threads_mode, render.threads = "FIXED", 1
    render.use_compositing = render.use_sequencer = False
    render.use_persistent_data = True
    settings.pixel_filter_type = "BOX"
    settings.use_denoising = False
    settings.sample_clamp_indirect = settings.max_bounces = 0
    scene.view_layers[0].cycles.pass_debug_sample_count = room > 0
    return scene


def _sheet(value: Any, outline: list[Point], depth: float) -> Any:
    """A flat mesh that shines with a colour, or with a grey."""
    import bpy

    mesh = bpy.data.meshes.new("sheet")
    mesh.from_pydata([(x, -y, depth) for x, y in outline], [], [range(len(outline))])
    material = bpy.data.materials.new("sheet")
    material.cycles.emission_sampling = "NONE"
    nodes = material.node_tree.nodes
    nodes.clear()
    emission = nodes.new("ShaderNodeEmission")
    colour = value if isinstance(value, tuple) else (value,) * 3
    emission.inputs["Color"].default_value = (*colour, 1.0)
    material.node_tree.links.new(emission.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    mesh.materials.append(material)
    return bpy.data.objects.new("sheet", mesh)
