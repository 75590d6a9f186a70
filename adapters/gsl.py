"""The Monte Carlo integrators of the GNU Scientific Library, as estimators of the pixels of a scene.

How they decide (GSL 2.7.1, ``monte/plain.c``, ``miser.c``, ``vegas.c``):

- ``plain`` takes the mean of ``calls`` samples.
- ``miser`` does the same with fewer calls than ``min_calls_per_bisection``, 1024 by default. With more it spends
  ``estimate_frac`` of them on which half of the square needs more of the rest, throws these away, and integrates both
  halves the same way: no sample that enters the estimate had a say in the numbers, so its mean is the true one.
- ``vegas`` goes ``iterations`` times through the boxes of a lattice with some ``calls`` samples, two a box while they
  last, through a grid of up to 50 bins an axis that is refined by what the last iteration saw. It weights an iteration by
  the inverse of the variance found in it: biased, since a sample's mean and variance go together. Where that variance is 0 the
  weight is the average of the earlier ones, and 0 when there are none: iterations that saw one value only are
  forgotten when a later one sees two. With ``alpha`` 0 the grid still drops bins that saw nothing but 0, and on a constant
  value it follows the noise in the number of samples a bin.

The range of vegas is proved: bins add up to 1 along an axis and each meets at most two boxes there (one where boxes
divide them), so no iteration exceeds the largest value times (2 bins / boxes)^2, nor bins^2, and no weighting
does; it is no luxury, the plain mean of 5 iterations of 50 calls came out at 8 in a pixel of mean 1/16. From 1250
calls on boxes lie within bins, and estimates between the values.
"""

from __future__ import annotations

import ctypes as c
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from ctypes.util import find_library
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truemean.adapters.frames import Floats, Number, read_count, untested
from truemean.adapters.integrands import Integrand, SceneIntegrator, true_mean
from truemean.adapters.registry import read_number
from truemean.errors import InputError, MissingExtra, SubjectError
from truemean.subject import PixelLike

__all__ = ["Gsl", "installed"]

TESTED = ("2.7.1",)
LIBRARIES = ("libgsl.so.27", "libgsl.so.28", "libgsl.so.25", "libgsl.dylib")
MODES = {"importance": 1, "importance-only": 0}
BINS = 50  # an axis of the grid of vegas, at most
DEFAULTS: dict[str, dict[str, Any]] = {
    "plain": {},
    "miser": {"alpha": 2, "dither": 0, "estimate_frac": 0.1, "min_calls": 32, "min_calls_per_bisection": 1024},
    "vegas": {"alpha": 1.5, "iterations": 5, "mode": "importance", "weighted": 1},
}
CHECKS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "alpha": (lambda v: _real(v) and v >= 0, "give a number from 0 up"),
    "iterations": (lambda v: _whole(v) and v >= 1, "give a whole number from 1 up"),
    "mode": (lambda v: v in MODES, "GSL has importance and importance-only, and becomes stratified by itself"),
    "weighted": (lambda v: v in (0, 1), "write 1 for GSL's own mean of the iterations, 0 for the plain one"),
    "dither": (lambda v: _real(v) and 0 <= v < 0.5, "give a number in [0, 0.5)"),
    "estimate_frac": (lambda v: _real(v) and 0 <= v <= 0.5, "give a number in [0, 0.5]"),
    "min_calls": (lambda v: _whole(v) and v >= 8, "give a whole number from 8 up"),
    "min_calls_per_bisection": (lambda v: _whole(v) and v >= 32, "give a whole number from 32 up"),
}


class Gsl(SceneIntegrator):
    """The integral of a pixel of a scene by ``method`` plain, miser or vegas, a replicate by ``gsl_rng_set(seed + 1)``.

    In GSL's own words and with its defaults: ``alpha`` 2, ``dither`` 0, ``estimate_frac`` 0.1, ``min_calls`` 32 and
    ``min_calls_per_bisection`` 1024 for miser; ``iterations`` 5, ``alpha`` 1.5 and ``mode`` importance for vegas, which by
    itself becomes stratified from 1250 ``calls`` on, or importance-only, which has one box. ``weighted`` 1 is its own
    mean of the iterations, 0 their plain mean. MissingExtra without GSL, InputError for what GSL has no use for.
    """

    name = "gsl"
    seed_bits = 32

    def __init__(
        self,
        scene: Any = "tile",
        method: str = "vegas",
        calls: Number = 500,
        # Of vegas, miser or both.
        alpha: Number | None = None,
        iterations: Number | None = None,
        mode: str | None = None,
        weighted: Number | None = None,
        dither: Number | None = None,
        estimate_frac: Number | None = None,
        min_calls: Number | None = None,
        min_calls_per_bisection: Number | None = None,
    ) -> None:
        found = installed()
        if found is None:
            raise MissingExtra("libgsl, the GNU Scientific Library, can't be loaded: apt-get install libgsl27")
        super().__init__(scene)
        self.notes = untested("GSL", found, TESTED)
        if method not in DEFAULTS:
            raise InputError(f"method={method!r}: GSL has plain, miser and vegas")
        self.method, self.calls = method, read_count("calls", calls)
        if self.calls < 2 and method != "plain":
            raise InputError(f"calls={calls!r} are too few for {method}: give 2 or more")
        # Options.
        asked = {"alpha": alpha, "iterations": iterations, "mode": mode, "weighted": weighted, "dither": dither}
        asked |= {"estimate_frac": estimate_frac, "min_calls": min_calls}
        asked |= {"min_calls_per_bisection": min_calls_per_bisection}
        self.options = _options(method, {name: value for name, value in asked.items() if value is not None})
        if method == "vegas" and self.options["iterations"] > 1:
            self._magnify(_magnification(self.calls, self.options["mode"]))

    @property
    def versions(self) -> dict[str, str]:
        """The version of the library."""
        return {"gsl": installed() or "missing"}

    @property
    def declares(self) -> tuple[str, dict[str, int]] | None:
        """Independent samples: plain, miser that does not bisect, one iteration without boxes; else None."""
        own = self.options
        independent = (
            self.method == "plain"
            or (self.method == "miser" and self.calls < own["min_calls_per_bisection"])
            or (self.method == "vegas" and own["iterations"] == 1 and own["mode"] == "importance-only")
        )
        return ("fixed", {"n": self.calls}) if independent else None

    @property
    def predicts(self) -> Callable[[PixelLike], Mapping[str, Any]] | None:
        """The true mean; None for vegas where it weights iterations."""
        if self.method == "vegas" and self.options["weighted"] and self.options["iterations"] > 1:
            return None
        return lambda pixel: {"mean": true_mean(pixel)}

    def integrate(self, function: Integrand, seeds: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """Estimates and samples drawn ``[seeds]``."""
        with _running(self.method, function.at_one()) as run:
            rows = [(self._estimate(run, seed), run.drawn()) for seed in map(int, seeds)]
        estimates, totals = np.array(rows, dtype=float).reshape(-1, 2).T
        return estimates, np.diff(totals, prepend=-1.0) - 1

    def _estimate(self, run: _Run, seed: int) -> float:
        run.start(seed + 1)  # 0 would stand for 4357
        if self.method == "miser":
            run.set(_MiserParams(**self.options))
        if self.method != "vegas":
            return run.integral(self.calls)
        own = self.options
        weighted_by_gsl, alone = (own["iterations"], 1) if own["weighted"] else (1, own["iterations"])
        total = 0.0
        for done in range(alone):  # by stage 1 GSL keeps the grid and forgets the estimates
            run.set(_VegasParams(own["alpha"], weighted_by_gsl, min(done, 1), MODES[own["mode"]], -1))
            total += run.integral(self.calls)
        return total / alone


def installed() -> str | None:
    """The version of the GSL that is found, None where there is none."""
    library = _library()
    if library is None:
        return None
    text = c.c_char_p.in_dll(library, "gsl_version").value
    return None if text is None else text.decode()


def _options(method: str, given: dict[str, Any]) -> dict[str, Any]:
    own = DEFAULTS[method]
    for name, value in given.items():
        if name not in own:
            raise InputError(f"{name}={value!r} means nothing to {method}: it takes {', '.join(own) or 'calls only'}")
    options = {name: read_number(value) for name, value in (own | given).items()}
    for name, value in options.items():
        fits, way_out = CHECKS[name]
        if not fits(value):
            raise InputError(f"{name}={given.get(name, value)!r} is not for GSL: {way_out}")
    if method == "miser" and options["min_calls_per_bisection"] < 4 * options["min_calls"]:
        raise InputError(
            f"min_calls_per_bisection={options['min_calls_per_bisection']} would leave halves fewer than "
            f"min_calls={options['min_calls']}: give 4 times that or more"
        )
    return options


def _magnification(calls: int, mode: str) -> Fraction:
    """How many times the largest value an iteration of vegas may reach."""
    boxes = int((calls / 2) ** 0.5) if mode == "importance" else 1
    if 2 * boxes >= BINS:
        return Fraction(1)
    straddled = 1 if BINS % boxes == 0 else 2
    return min(Fraction(straddled * BINS, boxes), Fraction(BINS)) ** 2


def _real(value: Any) -> bool:
    return isinstance(value, int | float) and abs(value) < 1e9


def _whole(value: Any) -> bool:
    return isinstance(value, int) and value < 2**31


class _MiserParams(c.Structure):
    _fields_ = (
        ("estimate_frac", c.c_double),
        ("min_calls", c.c_size_t),
        ("min_calls_per_bisection", c.c_size_t),
        ("alpha", c.c_double),
        ("dither", c.c_double),
    )


class _VegasParams(c.Structure):
    _fields_ = (
        ("alpha", c.c_double),
        ("iterations", c.c_size_t),
        ("stage", c.c_int),
        ("mode", c.c_int),
        ("verbose", c.c_int),
        ("ostream", c.c_void_p),
    )


_Each = c.CFUNCTYPE(c.c_double, c.POINTER(c.c_double), c.c_size_t, c.c_void_p)


class _Function(c.Structure):
    _fields_ = (("f", _Each), ("dim", c.c_size_t), ("params", c.c_void_p))


@dataclass(frozen=True, slots=True)
class _Run:
    """One method at work on one integrand: the library, and its generator, workspace and function."""

    library: Any
    method: str
    generator: c.c_void_p
    workspace: c.c_void_p
    function: _Function
    drawn: Callable[[], int]
    stopped: list[KeyboardInterrupt]

    def start(self, seed: int) -> None:
        """The start of a stream of random numbers, and of a workspace."""
        self.library.gsl_rng_set(self.generator, c.c_ulong(seed))
        getattr(self.library, f"gsl_monte_{self.method}_init")(self.workspace)

    def set(self, params: c.Structure) -> None:
        """The parameters of miser or vegas."""
        getattr(self.library, f"gsl_monte_{self.method}_params_set")(self.workspace, c.byref(params))

    def integral(self, calls: int) -> float:
        """The integral over the unit square; SubjectError in GSL's words."""
        corners = [(c.c_double * 2)(end, end) for end in (0.0, 1.0)]
        result, error = c.c_double(), c.c_double()
        status = getattr(self.library, f"gsl_monte_{self.method}_integrate")(
            *(c.byref(self.function), *corners, c.c_size_t(2), c.c_size_t(calls), self.generator, self.workspace),
            *(c.byref(result), c.byref(error)),
        )
        if self.stopped:
            raise self.stopped[0]
        if status:
            raise SubjectError(
                f"gsl_monte_{self.method}_integrate failed: {self.library.gsl_strerror(status).decode()}"
            )
        return result.value


@contextmanager
def _running(method: str, at: Callable[[float, float], float]) -> Iterator[_Run]:
    """``method`` on the integrand ``at``; GSL's errors are returned meanwhile, where by default they end the process."""
    library = _library()
    tick = count().__next__
    stopped: list[KeyboardInterrupt] = []

    def each(place: Any, _dim: int, _params: Any) -> float:
        try:
            tick()
            return at(place[0], place[1])
        except KeyboardInterrupt as interrupt:  # nothing may be raised through C
            stopped.append(interrupt)
            return 0.0

    free = getattr(library, f"gsl_monte_{method}_free")
    handler = library.gsl_set_error_handler_off()
    generator = c.c_void_p(library.gsl_rng_alloc(c.c_void_p.in_dll(library, "gsl_rng_mt19937")))
    workspace = c.c_void_p(getattr(library, f"gsl_monte_{method}_alloc")(c.c_size_t(2)))
    try:
        yield _Run(library, method, generator, workspace, _Function(_Each(each), 2, None), tick, stopped)
    finally:
        free(workspace)
        library.gsl_rng_free(generator)
        library.gsl_set_error_handler(c.c_void_p(handler))


@cache
def _library() -> Any:
    for name in filter(None, (*LIBRARIES, find_library("gsl"))):
        try:
            library = c.CDLL(name)
        except OSError:
            continue
        addresses = ("gsl_rng_alloc", "gsl_set_error_handler_off", "gsl_set_error_handler")
        for function in (*addresses, *(f"gsl_monte_{method}_alloc" for method in DEFAULTS)):
            getattr(library, function).restype = c.c_void_p
        library.gsl_strerror.restype = c.c_char_p
        return library
    return None
