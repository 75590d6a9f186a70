"""The conformance test of adapters themselves: whether an estimator keeps the promises of the protocol."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truemean.conformance.declared import marginal, read_declaration, read_law
from truemean.conformance.replicates import Few, Seeds, attribute, blaming, gives_sums, run, run_sums
from truemean.conformance.settings import Chosen, Settings, read_pixels
from truemean.conformance.target import Target
from truemean.errors import InputError, SubjectError, TooManyPaths, TruemeanError, Unsupported
from truemean.subject import as_estimator

__all__ = ["Check", "check_subject"]

FloatArray = NDArray[np.float64]
CHANCE = 1e-7  # that a right estimator looks as if it ignored its seed, or some bits of it
FAR, STRETCHES = (
    3.0,
    4,
)  # standard errors, in each of so many stretches of neighbours: right by chance once in a million
LEAST = 16  # neighbours that tell something
ALONE = 3
NUMBERS = "estimates and costs are numbers, one for each seed"


@dataclass(frozen=True, slots=True)
class Check:
    """One promise: whether it was kept, and what was seen; ``kept`` is None where it could not be looked at."""

    promise: str
    kept: bool | None
    seen: str = ""


def check_subject(subject: Any, *, pixels: Any = None, replicates: int = 64, strict: bool = True) -> tuple[Check, ...]:
    """Whether an estimator is one: estimates of the right shape that depend on their seeds, all of them and nothing else.

    Shapes, numbers, ranges; the same seeds again, alone and in another order; ``run_many`` beside ``run``; variety, and no
    correlation between neighbouring seeds; costs; pixels of one value; what is declared. ``pixels`` as in `judge`.
    Raises SubjectError with every broken promise, unless ``strict=False``; InputError for fewer than 2 ``replicates``.
    A right estimator breaks one by chance with probability 1e-6 at most.

    >>> from truemean.oracle import Pixel
    >>> def half_seeded(pixel, seeds):
    ...     return np.random.default_rng(seeds[0]).random(len(seeds))
    >>> [check.promise for check in check_subject(half_seeded, pixels=Pixel.two("1/2"), strict=False) if not check.kept]
    ['a replicate depends on its own seed alone']
    """
    if not (isinstance(replicates, int) and replicates >= 2):
        raise InputError(f"replicates={replicates!r} are too few to compare: give a whole number from 2 up")
    estimator = as_estimator(subject)
    chosen = read_pixels(estimator, pixels)
    checks = tuple(_checks(estimator, chosen, replicates))
    broken = [f"{check.promise}: {check.seen}" for check in checks if check.kept is False]
    if strict and broken:
        raise SubjectError(f"{len(broken)} of {len(checks)} promises are broken: {'; '.join(broken)}")
    return checks


class _Subject:
    """An estimator with its pixels, and the estimates of any seeds."""

    def __init__(self, subject: Any, chosen: Sequence[Chosen], replicates: int) -> None:
        self.subject, self.chosen = subject, chosen
        few = attribute(subject, "replicates")
        self.bits = 0 if few is not None else attribute(subject, "seed_bits") or 53
        seeds = Seeds(0, self.bits, 0, 1) if few is None else Few(0, few)
        self.capacity = seeds.capacity
        self.seeds = seeds.take(0, min(replicates, seeds.capacity))
        self.together = callable(attribute(subject, "run_many"))
        self.settings = Settings(tolerance=0, declaration=read_declaration(attribute(subject, "declares")))
        self.targets: list[tuple[Target, ...]] = [self.settings.targets(subject, each) for each in chosen]

    def estimates(self, places: Sequence[int], seeds: NDArray[np.int64]) -> FloatArray:
        """Estimates ``[places, channels or 1, seeds]``."""
        if not self.together:
            return np.concatenate([self._of([place], seeds) for place in places])
        return self._of(places, seeds)

    def _of(self, places: Sequence[int], seeds: NDArray[np.int64]) -> FloatArray:
        given = [self.chosen[place].given for place in places]
        return run(self.subject, given, self.chosen[places[0]].pixel.channels, seeds)[0]


def _checks(estimator: Any, chosen: Sequence[Chosen], replicates: int) -> Iterator[Check]:
    try:
        looked = _Subject(estimator, chosen, replicates)
    except (InputError, SubjectError) as broken:
        yield Check("what it says of itself can be read", False, str(broken))
        return
    # Pixels of as many channels are looked at together, those declined are left out.
    groups: dict[Any, list[int]] = {}
    for place, each in enumerate(chosen):
        try:
            looked.estimates([place], looked.seeds[:1])
        except Unsupported:
            continue
        except SubjectError as broken:
            yield Check(NUMBERS, False, f"{each.name}: {broken}")
            return
        groups.setdefault(each.pixel.channels, []).append(place)
    if not groups:
        yield Check("some pixel is supported", False, "every pixel is declined")
    for places in groups.values():
        try:
            yield from _of_group(looked, places)
        except (SubjectError, Unsupported) as broken:
            yield Check(NUMBERS, False, str(broken))
        else:
            yield Check(NUMBERS, True)
    supported = [chosen[place] for places in groups.values() for place in places]
    yield _told("what is declared can be read", lambda: _read_declared(looked, supported))
    yield _told("versions and notes are text", lambda: _read_texts(estimator))


def _of_group(looked: _Subject, places: list[int]) -> Iterator[Check]:
    seeds = looked.seeds
    first = looked.estimates(places, seeds)
    slack = np.array([[2 * float(target.slack) for target in looked.targets[place]] for place in places])[..., None]
    names = [looked.chosen[place].name for place in places]
    yield _within(looked, places, first, seeds)
    if not np.isfinite(first).all():
        return
    # The same seeds: in another order, all at once, and some of them alone; estimators may keep their last batch.
    backwards = looked.estimates(places, seeds[::-1])[..., ::-1]
    again = looked.estimates(places, seeds)
    yield _same("the same seeds give the same estimates", names, seeds, first, again, slack)
    alone = np.concatenate([looked.estimates(places, seeds[i : i + 1]) for i in range(min(ALONE, seeds.size))], axis=-1)
    promise = "a replicate depends on its own seed alone"
    different = _same(promise, names, seeds, first, backwards, slack)
    yield different if not different.kept else _same(promise, names, seeds, first[..., :ALONE], alone, slack)
    if looked.together:
        one = np.concatenate([looked._of([place], seeds) for place in places])  # noqa: SLF001 - one pixel at a time
        yield _same("run_many gives what run gives", names, seeds, first, one, slack)
    yield from _varied(looked, places, first, slack)
    if gives_sums(looked.subject):
        yield _told("sums are those of the estimates", lambda: _read_sums(looked, places, first, slack))
    if callable(attribute(looked.subject, "exact")):
        yield _told("estimates are outcomes of the exact law", lambda: _read_exact(looked, places, first, slack))


def _within(looked: _Subject, places: list[int], estimates: FloatArray, seeds: NDArray[np.int64]) -> Check:
    promise = "estimates are finite and in their range, those of a pixel of one value exact"
    for place, rows in zip(places, estimates, strict=True):
        for target, row in zip(looked.targets[place], rows, strict=True):
            if fault := target.fault(row, seeds):
                return Check(promise, False, f"{target.case} {fault}")
    return Check(promise, True)


def _same(promise: str, names: list[str], seeds: Any, one: FloatArray, other: FloatArray, slack: FloatArray) -> Check:
    apart = np.argwhere(~(np.abs(one - other) <= slack))
    if not apart.size:
        return Check(promise, True)
    place, channel, number = apart[0]
    pair = f"{float(one[place, channel, number])!r} and {float(other[place, channel, number])!r}"
    return Check(promise, False, f"{names[place]}: {pair} for seed {int(seeds[number])}")


def _varied(looked: _Subject, places: list[int], estimates: FloatArray, slack: FloatArray) -> Iterator[Check]:
    """Whether seeds make a difference, near and far ones, on the row of estimates that varies most."""
    spread = (np.ptp(estimates, axis=-1) > slack[..., 0]) * estimates.std(axis=-1)
    best = np.unravel_index(int(spread.argmax()), spread.shape)
    promise = "different seeds give different estimates"
    if spread[best] == 0:
        yield Check(promise, False if _ignores_seeds(looked, places, estimates, slack) else None, "all are one")
        return
    yield Check(promise, True)
    # Chance makes all of so many replicates one, or as many pairs of them equal.
    row, close = estimates[best], float(slack[best].item())
    alike = float((np.abs(row[:, None] - row) <= close).mean()) ** row.size
    place, channel = places[int(best[0])], int(best[1])
    yield _neighbours(looked, place, channel, still=alike > CHANCE)
    if looked.bits > 32:
        yield _all_bits(looked, place, slack[int(best[0])], still=alike > CHANCE)


def _ignores_seeds(looked: _Subject, places: list[int], estimates: FloatArray, slack: FloatArray) -> bool:
    """Whether chance can't be why all estimates are one, nor that they are the true mean."""
    chance = min(float(max(looked.chosen[place].pixel.weights)) ** looked.seeds.size for place in places)
    means = np.array([[float(target.true_mean) for target in looked.targets[place]] for place in places])
    exact = (np.abs(estimates[..., 0] - means) <= slack[..., 0]).all()
    return chance < CHANCE and not exact and not attribute(looked.subject, "deterministic")


def _neighbours(looked: _Subject, place: int, channel: int, *, still: bool) -> Check:
    """Whether estimates of seeds s and s + 1 are correlated: in every stretch of seeds, as skewed ones are by chance in one."""
    promise, found = "neighbouring seeds are not correlated", []
    size = min(looked.seeds.size, looked.capacity // STRETCHES)
    if size < LEAST:
        return Check(promise, None, "too few seeds to tell")
    for start in range(0, STRETCHES * size, size):
        row = looked.estimates([place], np.arange(start, start + size))[0, channel]
        centred = row - row.mean()
        found.append(float(centred[1:] @ centred[:-1] / (centred @ centred)) if np.ptp(row) else float(not still))
        if abs(found[-1]) * math.sqrt(size) <= FAR:
            return Check(promise, True)
    return Check(promise, False, f"{looked.chosen[place].name}: correlation {found[0]:.3f}")


def _all_bits(looked: _Subject, place: int, slack: FloatArray, *, still: bool) -> Check:
    """Whether a bit beyond the 32nd makes a difference."""
    promise, low = "all bits of a seed are used", np.arange(1, looked.seeds.size + 1)
    near, far = (looked.estimates([place], seeds) for seeds in (low, low + (1 << 32)))
    if not (np.abs(near - far)[0] <= slack).all():
        return Check(promise, True)
    if still:
        return Check(promise, None, "too still to tell")
    name = looked.chosen[place].name
    return Check(promise, False, f"{name}: seeds s and s + 2^32 give the same; declare seed_bits = 32")


def _told(promise: str, look: Callable[[], str]) -> Check:
    """The check of what ``look`` finds wrong, if anything."""
    try:
        seen = look()
    except TruemeanError as error:
        seen = str(error)
    return Check(promise, not seen, seen)


def _read_sums(looked: _Subject, places: list[int], estimates: FloatArray, slack: FloatArray) -> str:
    chosen, seeds = [looked.chosen[place] for place in places], looked.seeds
    sums = run_sums(looked.subject, [each.given for each in chosen], chosen[0].pixel.channels, seeds)[0]
    for place, by_channel, rows, room in zip(places, sums, estimates, slack, strict=True):
        for target, parts, row, close in zip(looked.targets[place], by_channel, rows, room, strict=True):
            if fault := "has sums and no range" if target.range is None else target.fault_of_sums(parts, seeds):
                return f"{target.case} {fault}"
            far = np.flatnonzero(np.abs(parts[1] - row) > close)
            if far.size:
                pair = f"mean {float(parts[1, far[0]])!r} and estimate {float(row[far[0]])!r}"
                return f"{target.case}: {pair} for seed {int(seeds[far[0]])}"
    return ""


def _read_exact(looked: _Subject, places: list[int], estimates: FloatArray, slack: FloatArray) -> str:
    exact = attribute(looked.subject, "exact")
    for place, rows, room in zip(places, estimates, slack, strict=True):
        try:
            with blaming("exact(pixel)", TooManyPaths):
                law = read_law(exact(looked.chosen[place].given).law)
        except (TooManyPaths, Unsupported):
            continue
        for channel, (row, close) in enumerate(zip(rows, room, strict=True)):
            outcomes = np.array([float(outcome) for outcome in marginal(law, channel)])
            far = np.flatnonzero(np.abs(row[:, None] - outcomes).min(axis=1) > close)
            if far.size:
                return (
                    f"{looked.chosen[place].name}: {float(row[far[0]])!r} for seed {int(looked.seeds[far[0]])} is none"
                )
    return ""


def _read_declared(looked: _Subject, chosen: Sequence[Chosen]) -> str:
    for each in chosen:
        looked.settings.declared(looked.subject, each)
    return ""


def _read_texts(subject: Any) -> str:
    versions, notes = attribute(subject, "versions") or {}, attribute(subject, "notes") or ()
    if not isinstance(versions, Mapping) or isinstance(notes, str):
        return f"versions={versions!r:.80} is a mapping, notes={notes!r:.80} a tuple of sentences"
    wrong = [each for each in (*versions, *versions.values(), *notes) if not isinstance(each, str)]
    return f"{wrong[0]!r} is no text" if wrong else ""
