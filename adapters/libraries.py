"""``lib:PATH:SYMBOL``: a function of a shared library, as adapters/c/truemean.h declares it.

The library is loaded in a process of its own, so that a crash there is a verdict and no end of the run.
"""

from __future__ import annotations

import ctypes
import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truemean.adapters.answers import LONGEST, Answers, odds_of
from truemean.adapters.child import read_seconds
from truemean.adapters.exhaustive import Asking, exact_law
from truemean.adapters.host import Host
from truemean.errors import InputError, SubjectError, TooManyPaths, Unsupported
from truemean.subject import Exact, PixelLike, PlainPixel

__all__ = ["HEADER", "AskingFunction", "Library", "SeededFunction", "load_library"]

Floats = NDArray[np.float64]
HEADER = Path(__file__).parent / "c" / "truemean.h"
UNSUPPORTED = 1
CHUNK, AGAIN, MOST_VALUES = 1 << 15, 1 << 12, 63  # of the compiled loop, whose keys have a bit a value at least

FORMS = {"None": None, "0": False, "1": True, "False": False, "True": True}  # what asks= may be


class Library:
    """A function of a library, run in a process of its own; of seeds."""

    def __init__(self, host: Host, name: str) -> None:
        self.host, self.name = host, name
        self._last: tuple[Any, ...] = ()

    def run(self, pixel: PixelLike, seeds: ArrayLike) -> Floats:
        """Estimates ``[seeds]`` or ``[seeds, channels]``; SubjectError with the seed at which it crashes or hangs."""
        return self._run(pixel, np.asarray(seeds, dtype=np.int64))[0]

    def costs(self, pixel: PixelLike, seeds: ArrayLike) -> Floats | None:
        """Samples drawn ``[seeds]``, None where the function does not say."""
        return self._run(pixel, np.asarray(seeds, dtype=np.int64))[1]

    def _run(self, pixel: PixelLike, seeds: NDArray[np.int64]) -> tuple[Floats, Floats | None]:
        if not (self._last and self._last[0] is pixel and np.array_equal(self._last[1], seeds)):
            self._last = (pixel, seeds, self.host.replicates("replicates", seeds, PlainPixel.of(pixel)))
        found: tuple[Floats, Floats | None] = self._last[2]
        return found


class AskingLibrary(Library):
    """The same for a function of answers: its law is exact."""

    def exact(self, pixel: PixelLike) -> Exact:
        """The law over all answers; TooManyPaths beyond the budget, SubjectError where a path breaks."""
        found: Exact = self.host.call("exact", PlainPixel.of(pixel))
        return found


def load_library(
    target: str,
    /,
    asks: Any = None,
    timeout: Any = 60,
    total: Any = None,
    paths: Any = 300_000,
    order: str = "sequence",
) -> Library:
    """The estimator that a function of a shared library is, ``target`` being ``path:symbol``.

    ``asks=1`` says that it is a function of answers, which TRUEMEAN_ASKS says by itself; ``paths`` and ``order`` are
    those of such functions. ``timeout`` is in seconds for each batch, ``total`` for all. InputError where there is no such file,
    SubjectError for one that is no library or has no such function.
    """
    place, _, symbol = target.rpartition(":")
    if not (place and symbol):
        raise InputError(f"lib subject {target!r} is not PATH:SYMBOL: write lib:./libmine.so:my_estimator")
    if not Path(place).is_file():
        raise InputError(f"there is no file {place!r} in {Path.cwd()}: write lib:path/to/libmine.so:{symbol}")
    limits = read_seconds("timeout", timeout), None if total is None else read_seconds("total", total)
    if str(asks) not in FORMS:
        raise InputError(f"asks={asks!r}: say 1 for a function that asks for its samples, 0 for one of seeds")
    Asking(lambda pixel, answers: 0.0, paths=paths, order=order)  # these options are read here, before any run
    file = str(Path(place).resolve())
    host = Host("truemean.adapters.libraries:open_function", (file, symbol, FORMS[str(asks)], paths, order), *limits)
    return AskingLibrary(host, symbol) if host.call("asks") else Library(host, symbol)


# -- in the process of the library ----------------------------------------------------------------


class _Pixel(ctypes.Structure):
    _fields_ = (
        ("count", ctypes.c_int32),
        ("channels", ctypes.c_int32),
        ("values", ctypes.c_void_p),
        ("weights", ctypes.c_void_p),
    )


_DRAW = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p)
_PICK = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_int32, ctypes.POINTER(ctypes.c_double))


class _Source(ctypes.Structure):
    _fields_ = (("draw", _DRAW), ("pick", _PICK))


class _Walk(ctypes.Structure):
    _fields_ = (
        ("source", _Source),
        ("given", ctypes.c_void_p),
        ("stride", ctypes.c_void_p),
        ("values", ctypes.c_int32),
        ("capacity", ctypes.c_int32),
        ("length", ctypes.c_int32),
        ("used", ctypes.c_int32),
        ("key", ctypes.c_uint64),
        ("failed", ctypes.c_int32),
    )


def open_function(file: str, symbol: str, asks: bool | None, paths: Any, order: str) -> Any:
    """The function of a library, one of answers where ``asks`` or its loop over all answers says so."""
    try:
        library = ctypes.CDLL(file)
    except OSError as error:
        raise SubjectError(f"{file!r} is no shared library that can be loaded: {error}") from None
    try:
        function = getattr(library, symbol)
    except AttributeError:
        raise SubjectError(f'{file!r} has no function {symbol!r}: export it, in C++ as extern "C"') from None
    function.restype = ctypes.c_int32
    loop = getattr(library, f"{symbol}_paths", None)
    if asks or (asks is None and loop is not None):
        return AskingFunction(function, loop, symbol, paths, order)
    return SeededFunction(function)


class SeededFunction:
    """A function of seeds."""

    def __init__(self, function: Any) -> None:
        self.function = function

    def asks(self) -> bool:
        """Whether it asks for its samples."""
        return False

    def replicates(self, pixel: PlainPixel, seeds: NDArray[np.int64]) -> tuple[Floats, Floats | None]:
        """Estimates and costs, if it gives any."""
        given = _Given(pixel)
        estimates, costs = np.full((seeds.size, given.channels), np.nan), np.full(seeds.size, np.nan)
        numbers = np.ascontiguousarray(seeds, dtype=np.uint64)
        pointers = [ctypes.c_void_p(array.ctypes.data) for array in (numbers, estimates, costs)]
        _check_status(self.function(given.pointer, ctypes.c_int64(seeds.size), *pointers))
        return estimates if given.coloured else estimates[:, 0], None if np.isnan(costs).all() else costs


class AskingFunction:
    """A function of answers, and perhaps its compiled loop over all of them."""

    def __init__(self, function: Any, loop: Any, symbol: str, paths: Any, order: str) -> None:
        self.function, self.loop = function, loop
        self.asking = Asking(self._replay, name=symbol, paths=paths, order=order)
        self._answers = Answers(odds_of([1]))
        self._failure: Exception | None = None
        self._random = Random(0)
        self._pixel: PixelLike | None = None
        self._given: Any = None
        self._source = _Source(_DRAW(self._draw), _PICK(self._pick))
        self._pointer = ctypes.pointer(self._source)

    def asks(self) -> bool:
        """Whether it asks for its samples."""
        return True

    def exact(self, pixel: PlainPixel) -> Exact:
        """The law over all answers: by the compiled loop, where there is one that fits, or else by ours."""
        if self.loop is not None and self.asking.order == "sequence" and all(pixel.weights):
            found = _walked(self.loop, pixel, self.asking.paths)
            if found is not None:
                return found
        return self.asking.enumerate(pixel)

    def replicates(self, pixel: PlainPixel, seeds: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """Estimates and costs with sampled answers."""
        return self.asking.run(pixel, seeds), self.asking.costs(pixel, seeds)

    def _replay(self, pixel: PixelLike, answers: Answers) -> Any:
        if self._pixel is not pixel:
            self._pixel, self._given = pixel, _Given(pixel)
        given = self._given
        self._answers, self._failure = answers, None
        status = self.function(given.pointer, self._pointer, given.estimate)
        if self._failure is not None:
            raise self._failure
        if status:
            _check_status(status)
        return tuple(given.estimate) if given.coloured else given.estimate[0]

    def _draw(self, _source: Any) -> int:
        try:
            return self._answers.one()
        except Exception as error:  # noqa: BLE001 - no error passes through C: it is raised when that has returned
            return self._fail(error, self._answers.draws.places)

    def _pick(self, _source: Any, count: int, weights: Any) -> int:
        try:
            return self._answers.pick(weights[:count])
        except Exception as error:  # noqa: BLE001 - the same
            return self._fail(error, range(max(1, count)))

    def _fail(self, error: Exception, places: Sequence[int]) -> int:
        """Any answer, in no order, so that a loop that waits for one of them ends."""
        self._failure = self._failure or error
        return self._random.choice(places)


class _Given:
    """A pixel as C has it, and room for an estimate."""

    def __init__(self, pixel: PixelLike) -> None:
        self._kept = values, weights = [np.ascontiguousarray(array) for array in pixel.arrays()]
        self.coloured = values.ndim == 2
        self.channels = values.shape[1] if self.coloured else 1
        self._plain = _Pixel(len(weights), self.channels, values.ctypes.data, weights.ctypes.data)
        self.pointer = ctypes.pointer(self._plain)
        self.estimate = (ctypes.c_double * self.channels)()


def _check_status(status: int) -> None:
    if status == UNSUPPORTED:
        raise Unsupported("the function does not support this pixel")
    if status:
        raise SubjectError(f"returned the status {status}: return 0 for success")


class _Loop:
    """The compiled loop over all answers, from the first path on."""

    def __init__(self, function: Any, pixel: PlainPixel) -> None:
        self._function, self._given = function, _Given(pixel)
        function.restype = ctypes.c_int64
        count = len(pixel.weights)
        self.bits = 63 // count
        self._answers = np.zeros(min(LONGEST, (1 << self.bits) - 1), dtype=np.int32)
        self._stride = np.array([1 << (self.bits * i) for i in range(count)], dtype=np.uint64)
        places = {"given": self._answers.ctypes.data, "stride": self._stride.ctypes.data}
        self._walk = _Walk(**places, values=count, capacity=self._answers.size)
        self.paths = 0

    @property
    def ended(self) -> bool:
        """Whether all paths have been run."""
        return self.paths > 0 and not self._walk.length

    def run(self, most: int) -> NDArray[np.uint64] | None:
        """The next paths: key and the bits of the estimate, row by row; None where it can't tell."""
        estimates, keys = np.empty((most, self._given.channels)), np.empty(most, dtype=np.uint64)
        pointers = [ctypes.c_void_p(array.ctypes.data) for array in (estimates, keys)]
        status = ctypes.c_int32()
        walk = ctypes.byref(self._walk)
        ran = self._function(self._given.pointer, walk, ctypes.c_int64(most), *pointers, ctypes.byref(status))
        if not ran or self._walk.failed or status.value or not np.isfinite(estimates[:ran]).all():
            return None
        self.paths += ran
        return np.column_stack([keys[:ran], estimates[:ran].view(np.uint64)])

    def counts(self, keys: NDArray[np.uint64]) -> list[list[int]]:
        """How many samples of each value the keys stand for, ``[keys, values]``."""
        shifts = np.arange(len(self._stride), dtype=np.uint64) * np.uint64(self.bits)
        found: list[list[int]] = ((keys[:, None] >> shifts) & np.uint64((1 << self.bits) - 1)).tolist()
        return found


def _walked(function: Any, pixel: PlainPixel, budget: int) -> Exact | None:
    """The law by the compiled loop; None where it can't tell, and our own has to say why."""
    if len(pixel.weights) > MOST_VALUES:
        return None
    loop, found = _Loop(function, pixel), _Tally()
    while not loop.ended:
        if loop.paths >= budget:
            raise TooManyPaths(f"more than paths={budget} runs would be needed")
        first, rows = not loop.paths, loop.run(min(CHUNK, budget - loop.paths))
        if rows is None:
            return None
        again = _Loop(function, pixel).run(min(len(rows), AGAIN)) if first else rows[:0]
        if again is None or not np.array_equal(again, rows[: len(again)]):
            raise SubjectError(
                "returned different estimates for the same samples: let it depend on nothing but its answers"
            )
        found.add(rows)
    return _weighed(loop, found, pixel)


class _Tally:
    """Distinct rows, with how often each occurs: paths of equal counts and estimate are one."""

    def __init__(self) -> None:
        self._parts: list[tuple[NDArray[np.uint64], NDArray[np.int64]]] = []
        self._enough = 8 * CHUNK

    def add(self, rows: NDArray[np.uint64]) -> None:
        """Each of these rows once more."""
        self._parts.append(_distinct(rows, np.ones(len(rows), dtype=np.int64)))
        if sum(len(part) for part, _ in self._parts) > self._enough:
            self._enough = 8 * CHUNK + 2 * len(self.rows()[0])

    def rows(self) -> tuple[NDArray[np.uint64], NDArray[np.int64]]:
        """The distinct rows, and how often each occurs."""
        rows, times = zip(*self._parts, strict=True)
        self._parts = [_distinct(np.concatenate(rows), np.concatenate(times))]
        return self._parts[0]


def _distinct(rows: NDArray[np.uint64], times: NDArray[np.int64]) -> tuple[NDArray[np.uint64], NDArray[np.int64]]:
    order = np.lexsort(rows.T)
    ordered = rows[order]
    starts = np.flatnonzero(np.r_[True, (ordered[1:] != ordered[:-1]).any(axis=1)])
    return ordered[starts], np.add.reduceat(times[order], starts)


def _weighed(loop: _Loop, found: _Tally, pixel: PlainPixel) -> Exact:
    """The exact law: each path is as probable as the product of the weights of its samples."""
    rows, times = found.rows()
    odds, counts = odds_of(pixel.weights), loop.counts(rows[:, 0])
    numbers = np.ascontiguousarray(rows[:, 1:]).view(np.float64)
    estimates = list(map(tuple, numbers.tolist())) if isinstance(pixel.values[0], tuple) else numbers[:, 0].tolist()
    most = max(map(sum, counts))
    powers = [[mass**drawn for drawn in range(most + 1)] for mass in odds.masses]
    totals = [odds.total**drawn for drawn in range(most + 1)]
    law, spent = Counter[tuple[Any, int]](), Counter[int]()
    for drawn, estimate, number in zip(counts, estimates, times.tolist(), strict=True):
        samples = sum(drawn)
        mass = number * math.prod([power[n] for power, n in zip(powers, drawn, strict=True) if n])
        law[estimate, totals[samples]] += mass
        spent[totals[samples]] += mass * samples
    return exact_law(law, spent, loop.paths)
