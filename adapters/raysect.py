"""raysect, a ray tracer whose camera samples adaptively, as an estimator of the pixels of a scene.

How its `MonoAdaptiveSampler2D`, and `RGBAdaptiveSampler2D` on the worst of X, Y and Z, decide (raysect 0.9.1, ``optical/observer/sampler2d.pyx``): in each pass
a pixel gets ``pixel_samples`` more samples if it has fewer than ``max(min_samples, most / ratio)``, ``most``
being the number in the most sampled pixel, or if its standard error over its mean exceeds
``max(cutoff, percentile)``, the percentile of that quotient in the frame at ``1 - fraction``. The quotient is
0 where the mean is <= 0 or the samples are all equal: such a pixel is never looked at again. All samples are
pooled, so with ``cutoff`` 0 and the other terms out of play each pixel of a black and white scene has the
law of one two-stage plan, which `Raysect.declares`. Meshes are single precision: a vertex that is no such
number moves by some 1e-7 of the width.
"""

from __future__ import annotations

import math
import random
from importlib import import_module
from importlib.metadata import version
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from truemean.adapters.frames import Floats, Number, SceneRenderer, layers, read_count, untested
from truemean.adapters.registry import read_number
from truemean.errors import InputError, MissingExtra

__all__ = ["Raysect"]

TESTED = ("0.9.1",)
BAND = (500.0, 501.0)  # nm, so that radiance 1 is read as 1


class Raysect(SceneRenderer):
    """A frame of raysect is one replicate of every pixel of a scene, its seed the replicate's seed.

    ``min_samples`` (with ``cutoff``, ``ratio`` and ``fraction``) makes the camera adaptive: their meaning is
    raysect's, their defaults let no pixel depend on another, where raysect's own are ratio=10 and fraction=0.2.
    ``sampler`` is mono or rgb, ``pixel_samples`` are drawn in a pass, of which there are ``passes``: 1, or 4 when
    adaptive. MissingExtra without raysect, InputError for options that raysect refuses.
    """

    name = "raysect"
    package: ClassVar[str] = "raysect"

    def __init__(
        self,
        scene: Any = "tile",
        sampler: str = "mono",
        pixel_samples: Number = 4,
        passes: Number | None = None,
        # Of the adaptive camera.
        min_samples: Number | None = None,
        cutoff: Number = 0,
        ratio: Number = 1e9,
        fraction: Number = 1,
    ) -> None:
        try:
            import_module("raysect.optical")
        except ImportError as error:
            raise MissingExtra(f"raysect can't be imported ({error}): pip install 'truemean[raysect]'") from error
        super().__init__(scene)
        self.notes = untested("raysect", version("raysect"), TESTED)
        if sampler not in ("mono", "rgb"):
            raise InputError(f"sampler={sampler!r}: raysect has mono (MonoAdaptiveSampler2D) and rgb")
        default_passes = 1 if min_samples is None else 4
        self.passes = read_count("passes", default_passes if passes is None else passes)
        self.options: dict[str, Any] = {
            "pixel_samples": read_count("pixel_samples", pixel_samples),
            "min_samples": None if min_samples is None else read_count("min_samples", min_samples),
            "cutoff": read_number(cutoff),
            "ratio": read_number(ratio),
            "fraction": read_number(fraction),
        }
        if min_samples is None and [self.options[name] for name in ("cutoff", "ratio", "fraction")] != [0, 1e9, 1]:
            raise InputError(
                f"cutoff={cutoff!r}, ratio={ratio!r}, fraction={fraction!r} steer the adaptive sampler: give min_samples too"
            )
        self._pipeline, self._camera = _camera(self.scene.to_dict(), sampler, **self.options)
        self._white = _luminance() if sampler == "rgb" else None

    @property
    def declares(self) -> tuple[str, dict[str, int]] | None:
        """The plan whose law every pixel of the frame has, None when the options or the scene leave it open."""
        batch, least = self.options["pixel_samples"], self.options["min_samples"]
        most = batch * self.passes
        pilot = most if least is None else batch * math.ceil(least / batch)
        if pilot >= most:
            return "fixed", {"n": most}
        populations = [set(X.values) for X in self.frame_pixels.values()]
        percentile_is_zero = self.options["fraction"] == 1 and any(len(values) == 1 for values in populations)
        topped_up = most / self.options["ratio"] > pilot
        black_and_white = all(values <= {0, 1} for values in populations)
        if self.options["cutoff"] == 0 and percentile_is_zero and not topped_up and black_and_white:
            return "two-stage-pooled", {"n": pilot, "m": most - pilot, "eps": 0}
        return None

    def frames(self, seeds: NDArray[np.int64]) -> tuple[Any, Any]:
        """Frames of many seeds; Python's own random numbers go on as if unused."""
        state = random.getstate()
        try:
            return super().frames(seeds)
        finally:
            random.setstate(state)

    def frame(self, seed: int) -> tuple[Any, Any]:
        """One frame: raysect's random numbers, and Python's for the order of the pixels, come from the seed."""
        from raysect.core.math.random import seed as seed_rays

        seed_rays(seed + 1)  # by 0 raysect means the system's entropy
        random.seed(seed)
        for done in range(self.passes):
            self._pipeline.accumulate = done > 0
            self._camera.observe()
            if self._camera.render_complete:
                break
        if self._white is None:
            found = self._pipeline.frame
            return found.mean.T.copy(), found.samples.T.copy()
        found = self._pipeline.xyz_frame
        return found.mean[..., 1].T / self._white, found.samples[..., 1].T.copy()


def _camera(scene: dict[str, Any], kind: str, pixel_samples: Any, min_samples: Any, **adaptive: Any) -> tuple[Any, Any]:
    """Pipeline and camera, looking at the scene from the front; one unit is one pixel, x to the left, y upwards."""
    from raysect.core import translate
    from raysect.core.workflow import SerialEngine
    from raysect.optical.observer import (
        FullFrameSampler2D,
        MonoAdaptiveSampler2D,
        OrthographicCamera,
        RadiancePipeline2D,
        RGBAdaptiveSampler2D,
        RGBPipeline2D,
    )

    width, height = scene["width"], scene["height"]
    pipeline_of, adaptive_of = {
        "mono": (RadiancePipeline2D, MonoAdaptiveSampler2D),
        "rgb": (RGBPipeline2D, RGBAdaptiveSampler2D),
    }[kind]
    pipeline = pipeline_of(display_progress=False)
    try:
        if min_samples is None:
            sampler = FullFrameSampler2D()
        else:
            sampler = adaptive_of(pipeline, min_samples=min_samples, **adaptive)
        camera = OrthographicCamera((width, height), width=width, pipelines=[pipeline], frame_sampler=sampler)
        camera.pixel_samples = pixel_samples
    except (TypeError, ValueError, OverflowError) as error:
        given = {"pixel_samples": pixel_samples, "min_samples": min_samples, **adaptive}
        raise InputError(f"raysect refuses {', '.join(f'{k}={v!r}' for k, v in given.items())}: {error}") from None
    camera.parent, camera.transform = _world(scene), translate(0, 0, -2)
    camera.max_wavelength, camera.min_wavelength = BAND[::-1]
    camera.spectral_bins = camera.spectral_rays = 1
    camera.render_engine, camera.quiet = SerialEngine(), True
    return pipeline, camera


def _luminance() -> float:
    """What a pipeline of X, Y and Z reads as Y where radiance is 1 all over the band."""
    from raysect.optical import Spectrum
    from raysect.optical.colour import resample_ciexyz, spectrum_to_ciexyz

    spectrum = Spectrum(*BAND, 1)
    spectrum.samples[:] = 1.0
    return float(spectrum_to_ciexyz(spectrum, resample_ciexyz(*BAND, 1))[1])


def _world(scene: dict[str, Any]) -> Any:
    """The polygons as glowing prisms, the last one nearest to the camera, before the background."""
    from raysect.optical import ConstantSF, World
    from raysect.optical.material import UniformSurfaceEmitter
    from raysect.primitive import Mesh

    middle = np.array([scene["width"], scene["height"]]) / 2
    world = World()
    for depth, (value, vertices) in enumerate(reversed(layers(scene, "raysect"))):
        if isinstance(value, tuple):
            raise InputError(f"value {value} of scene is no radiance: raysect scenes have numbers from 0 up")
        material = UniformSurfaceEmitter(ConstantSF(value))
        Mesh(*_prism(middle - vertices, 2 * depth), smoothing=False, parent=world, material=material)
    return world


def _prism(outline: Floats, front: float) -> tuple[Floats, NDArray[np.int32]]:
    """Vertices and triangles of a closed prism of thickness 1: a flat mesh would leak rays."""
    from raysect.core.math.polygon import triangulate2d

    x, y = outline.T
    twice_area = x @ np.roll(y, -1) - y @ np.roll(x, -1)
    clockwise = outline[::-1].copy() if twice_area > 0 else outline
    count = len(clockwise)
    vertices = [np.column_stack([clockwise, np.full(count, z)]) for z in (front, front + 1.0)]
    faces = triangulate2d(clockwise)
    here = np.arange(count)
    there = np.roll(here, -1)
    sides = [np.column_stack([here, here + count, there]), np.column_stack([there, here + count, there + count])]
    return np.concatenate(vertices), np.concatenate([faces, faces[:, ::-1] + count, *sides]).astype(np.int32)
