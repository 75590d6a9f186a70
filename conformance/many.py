"""Many cases at once: which of them are biased, whether any is, and whether they share a bias.

A case is a channel of a pixel. Everything here takes logarithms of e-values; inf is a proof, -inf a lost
bet. Only `sparse_common` needs cases that are independent.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truemean.conformance.evidence.bets import LARGEST
from truemean.errors import InputError, InputTypeError, UnknownName

__all__ = [
    "Group",
    "aggregate",
    "average",
    "check_regions",
    "common_fractions",
    "e_bh",
    "fractions_at",
    "holm",
    "holm_level",
    "least_common",
    "sparse_common",
    "tiles",
]

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

PLACE = re.compile(r"(?:(?P<scene>.*)#)?(?P<x>[0-9]+),(?P<y>[0-9]+)(?:[+][0-9]+)?", re.DOTALL)
ALMOST_OVERFLOW = 700.0  # e^709 is the largest that float64 holds


def average(logs: ArrayLike) -> float:
    """The logarithm of the average of e-values, ``[cases]``: evidence that some case is biased.

    Cases may depend on each other in any way (Vovk & Wang 2021). Over time it is an e-process if it is
    taken of CURRENT e-values: its running maximum is valid, an average of running maxima is not.
    Raises InputError for no case or for NaN.

    >>> round(math.exp(average([-np.inf, np.log(3), 0])), 6)
    1.333333
    """
    read = _read(logs)
    return float(np.logaddexp.reduce(read)) - math.log(read.size)


def holm(peaks: ArrayLike, alpha: float) -> BoolArray:
    """Which cases are biased, ``[cases]``: a wrong one among them has probability at most ``alpha``.

    Holm's step-down test (Holm 1979) of p = min(1, 1/max e), valid under any dependence. ``peaks`` are
    logarithms of running maxima, so a case once rejected stays so. Raises InputError as `average` does,
    and for an ``alpha`` outside (0, 1).

    >>> holm(np.log([100, 30, 10]), 0.05)
    array([ True, False, False])
    """
    logs, level = _read(peaks), _level(alpha)
    order = np.argsort(-logs, kind="stable")
    rejected = np.zeros(logs.size, dtype=bool)
    rejected[order] = np.logical_and.accumulate(logs[order] >= -np.log(level / np.arange(logs.size, 0, -1)))
    return rejected


def holm_level(alpha: float, cases: int, rejected: int) -> float:
    """The level at which an undecided case is tested after ``rejected`` of the ``cases`` were rejected.

    Rejecting whatever has peaked at 1/level, and again when the level has risen, ends with what `holm`
    says, whatever came first: so a case may be named, and stop drawing, as soon as it is rejected.
    Raises InputError when no case is left, and for an ``alpha`` outside (0, 1).

    >>> holm_level(0.05, 5, 0), holm_level(0.05, 5, 4)
    (0.01, 0.05)
    """
    if not 0 <= rejected < cases:
        raise InputError(f"rejected={rejected} of cases={cases}: ask only while a case is undecided")
    return _level(alpha) / (cases - rejected)


def e_bh(logs: ArrayLike, alpha: float) -> BoolArray:
    """Which cases are biased, ``[cases]``: of those named, an expected share of at most ``alpha`` is wrong.

    The e-BH procedure (Wang & Ramdas 2022), valid under any dependence: the k largest are rejected for
    the largest k with k-th e-value >= cases/(k alpha). ``logs`` are CURRENT e-values, read once, at the
    end, or for a case that stopped drawing at its stop; never running maxima, for which the false
    discovery rate is not controlled. Raises InputError as `holm` does.

    >>> e_bh(np.log([100, 30, 10]), 0.05)
    array([ True,  True, False])
    """
    read, level = _read(logs), _level(alpha)
    order = np.argsort(-read, kind="stable")
    ranks = np.arange(1, read.size + 1)
    enough = ranks[read[order] >= np.log(read.size / ranks / level)]
    rejected = np.zeros(read.size, dtype=bool)
    rejected[order[: enough.max(initial=0)]] = True
    return rejected


def least_common(means: ArrayLike, alpha: float, budget: int) -> float:
    """The least bias, as a share of the range, that ``budget`` replicates of each pixel can show if all have it.

    ``means``, ``[pixels]`` in (0, 1), are the null means; each pixel is taken to be as noisy as it can
    be, variance m (1 - m). Raises InputError for other means, and for an ``alpha`` outside (0, 1).

    >>> round(least_common([0.5] * 256, 0.01, 1000), 6)
    0.002999
    """
    m = _read(means, "means")
    if not ((m > 0) & (m < 1)).all():
        raise InputError(f"means={m!r} must lie strictly between 0 and 1: leave out pixels that can't vary")
    return math.sqrt(-2 * math.log(_level(alpha)) / (budget * float((1 / (m * (1 - m))).sum())))


def common_fractions(least: float) -> FloatArray:
    """Nodes ``[nodes]`` of bets that many pixels make together: from 0.99 down by factors of 2 to ``least``.

    Choose ``least`` before the run, as by `least_common`. Raises InputError unless it is in (0, 0.99].

    >>> common_fractions(0.2).tolist()
    [0.99, 0.495, 0.2475, 0.12375]
    """
    if not 0 < least <= LARGEST:
        raise InputError(f"least={least!r} must lie above 0 and be at most {LARGEST}, such as 0.001")
    return np.ldexp(LARGEST, -np.arange(math.ceil(math.log2(LARGEST / least)) + 1))


def fractions_at(nodes: FloatArray, mean: float) -> FloatArray:
    """What a pixel bets at each common node, ``[nodes]``: the fraction of its largest safe bet against E[y] <= ``mean``.

    The node is a bias, the same at every pixel. Against it the best bet is bias/variance, so the fraction
    node/(1 - mean) at variance mean (1 - mean). An estimator that is quieter by some factor everywhere is
    best met by another node, again one for all pixels. Equal fractions would let dark pixels outshout the rest.

    >>> fractions_at(np.array([0.99, 0.1]), 0.5)
    array([0.99, 0.2 ])
    """
    return np.minimum(LARGEST, nodes / max(1 - mean, 1e-12))


def sparse_common(log_wealths: ArrayLike) -> float:
    """Evidence that some pixels are biased, few or all, of INDEPENDENT pixels: the logarithm of an e-value.

    ``log_wealths``, ``[pixels, 2 signs, nodes]``, are the current logarithms of the money of each bet, E+
    and E-; node k means the same bias at each pixel (`fractions_at`). A third each goes to the averages over k of

        prod_p (1 - s + s (E+_pk + E-_pk)/2), averaged over shares s = 1/pixels, 2/pixels, 4/pixels, ... <= 1,
        prod_p E+_pk, and prod_p E-_pk.

    A product of independent fair games is fair, so over time this is an e-process and its running maximum
    is valid, provided that given the past no pixel's next batch says anything about another's: each pixel
    draws from seeds of its own. A lost bet outweighs a proof within a product. Raises InputError for
    another shape, no pixel or NaN.

    >>> round(math.exp(sparse_common(np.log([[[3.0], [1.0]]]))), 6)
    2.0
    """
    logs = _read(log_wealths, "log_wealths", 3)
    if logs.shape[1] != 2:
        raise InputError(f"log_wealths has shape {logs.shape}: give [pixels, 2 signs, nodes]")
    pixels = logs.shape[0]
    either = np.logaddexp(logs[:, 0], logs[:, 1]) - math.log(2)
    gains = np.expm1(np.minimum(either, ALMOST_OVERFLOW))
    beyond = np.maximum(either - ALMOST_OVERFLOW, 0).sum(axis=0)
    mixes = [
        _log_product(either) if share == 1 else np.log1p(share * gains).sum(axis=0) + beyond
        for share in 2.0 ** np.arange(pixels.bit_length()) / pixels
    ]
    signed = _log_product(logs)
    return average([average(np.ravel(mixes)), average(signed[0]), average(signed[1])])


@dataclass(frozen=True, slots=True)
class Group:
    """Cases taken together: how many, the logarithm of their average e-value, and whether one of them is biased."""

    name: str
    cases: int
    log_evidence: float
    biased: bool


def tiles(names: Iterable[str], size: int) -> dict[str, tuple[str, ...]]:
    """The pixels by tile of ``size`` x ``size``, row by row: names ``"12,7"``, ``"scene#12,7"`` or ``"12,8+4"`` hold column and row.

    With several scenes each has tiles of its own, named ``"scene#tile 1,0"``. Raises InputError for a name
    without a place, and for a ``size`` that is no positive integer.

    >>> tiles(["box#9,1", "box#3,0", "box#8,7"], 8)
    {'tile 0,0': ('box#3,0',), 'tile 1,0': ('box#9,1', 'box#8,7')}
    """
    if not (isinstance(size, int) and size > 0):
        raise InputError(f"size={size!r} must be a positive number of pixels, such as 8")
    members: dict[tuple[str, int, int], list[str]] = {}
    for name in dict.fromkeys(names):
        place = PLACE.fullmatch(name)
        if place is None:
            raise InputError(f"pixel {name!r} has no place: tiles need names like '12,7' or 'scene#12,7' (column,row)")
        key = (place["scene"] or "", int(place["y"]) // size, int(place["x"]) // size)
        members.setdefault(key, []).append(name)
    several = len({scene for scene, _, _ in members}) > 1
    return {
        (f"{scene}#" if several else "") + f"tile {column},{row}": tuple(members[scene, row, column])
        for scene, row, column in sorted(members)
    }


def check_regions(regions: Mapping[str, Iterable[str]], names: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """The ``regions``, name -> pixels, each of pixels that are among ``names``, each of them once.

    Raises UnknownName for another pixel, InputError for a region without pixels, InputTypeError for
    one text in place of several.

    >>> check_regions({"eye": ["a", "b", "a"]}, ["a", "b", "c"])
    {'eye': ('a', 'b')}
    """
    known = dict.fromkeys(names)
    read = {}
    for region, pixels in regions.items():
        if isinstance(pixels, str):
            raise InputTypeError(f"region {region!r} is the text {pixels!r}: give a list of pixel names, [{pixels!r}]")
        read[region] = tuple(dict.fromkeys(pixels))
        if not read[region]:
            raise InputError(f"region {region!r} has no pixels: name some, or leave the region out")
        for pixel in read[region]:
            if pixel not in known:
                raise UnknownName("pixel", pixel, known)
    return read


def aggregate(
    groups: Mapping[str, Sequence[str]], logs_by_name: Mapping[str, ArrayLike], alpha: float
) -> tuple[Group, ...]:
    """Each group with the average evidence of its cases, and whether `holm` over all groups finds it biased.

    ``logs_by_name`` holds per pixel the CURRENT log e-value of its case or ``[channels]`` of them, 0 for
    one that was skipped. Groups are chosen before the run and may overlap; a group wrongly called biased
    has probability at most ``alpha``, which is apart from that of any list of single cases. Raises
    UnknownName for a pixel without evidence, InputError as `holm` does and for a group without pixels.

    >>> aggregate({"left": ["a", "b"], "right": ["c"]}, {"a": 9.0, "b": 0.0, "c": [1.0, 2.0]}, 0.01)[0].biased
    True
    """
    if not groups:
        return ()
    for name in (name for members in groups.values() for name in members if name not in logs_by_name):
        raise UnknownName("pixel", name, logs_by_name)
    cases = [np.concatenate([np.empty(0), *(np.ravel(logs_by_name[n]) for n in each)]) for each in groups.values()]
    evidence = [average(logs) for logs in cases]
    found = zip(groups, cases, evidence, holm(evidence, alpha), strict=True)
    return tuple(Group(name, logs.size, now, bool(biased)) for name, logs, now, biased in found)


def _log_product(logs: FloatArray) -> FloatArray:
    """The logarithm of the product over pixels; 0 times infinity is 0."""
    with np.errstate(invalid="ignore"):
        total = logs.sum(axis=0)
    return np.where(np.isnan(total), -np.inf, total)


def _read(given: ArrayLike, what: str = "log e-values", dimensions: int = 1) -> FloatArray:
    read = np.asarray(given, dtype=float)
    if read.ndim != dimensions or not read.size:
        raise InputError(f"{what} of shape {read.shape}: give an array of {dimensions} dimension(s) that isn't empty")
    if np.isnan(read).any():
        raise InputError(f"{what} hold NaN at {np.argwhere(np.isnan(read))[0].tolist()}: no bet wins or loses that")
    return read


def _level(alpha: float) -> float:
    if not 0 < alpha < 1:
        raise InputError(f"alpha={alpha!r} must lie strictly between 0 and 1, such as 0.01")
    return alpha
