"""Whether an estimator's randomness comes from its seeds, looked at before anything is judged."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from truemean.conformance.evidence import FloatArray
from truemean.conformance.replicates import attribute, run
from truemean.conformance.stream import Stream
from truemean.errors import SubjectError, Unsupported

__all__ = ["check_seeds"]

FEW, MOST, PATIENCE = 16, 256, 4096  # replicates spent on finding out, at first, as a rule at most, and if in doubt
CHANCE = 1e-6  # that an estimator drawing a sample or more looks on a pixel as if it ignored its seed


def check_seeds(subject: Any, streams: Sequence[Stream], *, deterministic: bool | None = None) -> None:
    """The same seeds give the same estimates, and different seeds different ones somewhere.

    Looks at the pixels that vary most first, until one shows variety; says nothing where every pixel
    is too still to tell, or where the estimator breaks, which is a case. ``deterministic``, by default the
    estimator's attribute, allows one output. Raises SubjectError.
    """
    still = attribute(subject, "deterministic") if deterministic is None else deterministic
    # Code that asks for its samples has no seed to ignore.
    still = still or attribute(subject, "exact") is not None
    ranked = sorted(streams, key=lambda stream: -_variety(stream))
    if not ranked or any(trial.verdict for trials in ranked[0].trials for trial in trials):
        return
    try:
        # The batch between is for estimators that keep their last one.
        first, _, again = (_first(subject, ranked[0], number) for number in (FEW, 1, FEW))
        _check_same(ranked[0], first, again)
        ignored = not still and all(_are_all_one(subject, stream) for stream in ranked)
    except _Broken:
        return
    if ignored:
        raise SubjectError(
            f"returned one and the same estimate on {ranked[0].chosen[0].name} for every seed: use the seed for every "
            "random number, or declare deterministic = True if the estimate has none"
        )


class _Broken(Exception):
    """The estimator breaks, which the run will tell as a case."""


def _first(subject: Any, stream: Stream, number: int) -> FloatArray:
    """Estimates ``[pixels, channels, seeds]`` at the first seeds of a stream."""
    seeds = stream.seeds.take(0, min(number, stream.seeds.capacity))
    try:
        estimates = run(subject, [each.given for each in stream.chosen], stream.chosen[0].pixel.channels, seeds)[0]
    except (SubjectError, Unsupported) as broken:
        raise _Broken from broken
    if not np.isfinite(estimates).all():
        raise _Broken
    return estimates


def _are_all_one(subject: Any, stream: Stream) -> bool:
    """Whether so many estimates are one that chance can't be why; False where no number of them could tell.

    An estimator that returns the true mean once its samples differ needs patience.
    """
    variety = _variety(stream)
    enough = math.log(CHANCE) / math.log1p(-variety) if variety else math.inf
    if enough > min(MOST, stream.seeds.capacity):
        return False
    targets = [[trial.target for trial in trials] for trials in stream.trials]
    for number in (FEW, max(FEW, math.ceil(enough)), PATIENCE):
        estimates = _first(subject, stream, number)
        if np.any(np.ptp(estimates, axis=-1)):
            return False
        exact = all(
            abs(float(one) - float(target.true_mean)) <= target.slack
            for row, ones in zip(targets, estimates[..., 0], strict=True)
            for target, one in zip(row, ones, strict=True)
        )
        if number >= enough and not exact:
            return True
    return True


def _variety(stream: Stream) -> float:
    """The probability that a sample is not the commonest value, on the pixel where that is largest."""
    return max(float(1 - max(each.pixel.weights)) for each in stream.chosen)


def _check_same(stream: Stream, estimates: FloatArray, again: FloatArray) -> None:
    slack = 2 * max(float(trial.target.slack) for trials in stream.trials for trial in trials)
    differ = np.argwhere(np.abs(estimates - again) > slack)
    if differ.size:
        place, channel, number = differ[0]
        pair = (float(estimates[place, channel, number]), float(again[place, channel, number]))
        raise SubjectError(
            f"returned {pair[0]!r} and then {pair[1]!r} on {stream.chosen[place].name} for the same seed "
            f"{int(stream.seeds.take(0, int(number) + 1)[-1])}: take every random number from the seed"
        )
