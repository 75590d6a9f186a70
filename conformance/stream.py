"""Drawing replicates: looks on a geometric schedule, and what decided pixels leave goes to the others."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truemean.conformance.declared import derive_declared
from truemean.conformance.replicates import Few, Seeds, attribute, gives_sums, run, run_sums
from truemean.conformance.settings import Chosen, Settings
from truemean.conformance.trial import Trial
from truemean.conformance.verdict import Verdict
from truemean.errors import SubjectError, Unsupported

__all__ = ["Stream", "looks", "open_streams"]

FIRST_LOOK, LOOK_GROWTH = 16, 1.05
SEED_BITS = 53
SUMS = "sums of replicates"


class Stream:
    """Pixels that are rendered together, from the same seeds, with their trials by pixel and channel.

    ``sums``: a seed stands for many replicates, of which only the sums are known.
    """

    def __init__(
        self, chosen: Sequence[Chosen], seeds: Seeds | Few, trials: list[list[Trial]], *, sums: bool = False
    ) -> None:
        self.chosen, self.seeds, self.trials, self.sums = chosen, seeds, trials, sums
        self.drawn, self.skipped, self.seconds = 0, "", 0.0

    @property
    def waiting(self) -> bool:
        """Whether more replicates could still decide something."""
        undecided = any(trial.verdict is None for trials in self.trials for trial in trials)
        return undecided and not self.skipped and self.drawn < self.seeds.capacity

    @property
    def log_biased(self) -> list[float]:
        """The current evidence for a bias of each of its cases."""
        return [trial.biased.log_evidence for trials in self.trials for trial in trials]

    @property
    def named(self) -> int:
        """How many of its cases are BIASED."""
        return sum(trial.verdict is Verdict.BIASED for trials in self.trials for trial in trials)

    def relax(self, level: float) -> None:
        """Ask for less evidence of its undecided cases, as Holm allows once others are BIASED."""
        self.trials = [[trial.relaxed(level) for trial in trials] for trials in self.trials]

    def advance(self, subject: Any, limit: int) -> int:
        """One look: draw the next batch, up to ``limit`` replicates in all; how many were drawn."""
        look = max(FIRST_LOOK, math.ceil(self.drawn * LOOK_GROWTH))
        seeds = self.seeds.take(self.drawn, min(look, limit, self.seeds.capacity))
        begun = time.perf_counter()
        try:
            given = [each.given for each in self.chosen]
            draw = run_sums if self.sums else run
            estimates, costs = draw(subject, given, self.chosen[0].pixel.channels, seeds)
        except Unsupported as declined:
            if not self.drawn:
                self.skipped = str(declined) or "the estimator declines this pixel"
                return 0
            self._break_all(f"declined after {self.drawn} replicates: {declined}")
        except SubjectError as broken:
            self._break_all(str(broken))
        else:
            self.seconds += time.perf_counter() - begun
            for place, columns in enumerate(estimates):
                self._observe(place, columns, seeds, costs[place] if costs else None)
        self.drawn += seeds.size
        return seeds.size

    def _observe(self, place: int, columns: Any, seeds: NDArray[np.int64], cost: float | None) -> None:
        pairs = list(zip(self.trials[place], columns, strict=True))
        if self.sums:
            faults = (trial.target.fault_of_sums(column, seeds) for trial, column in pairs)
        else:
            faults = (trial.target.fault(column, seeds) for trial, column in pairs)
        if fault := next(filter(None, faults), None):
            self._break(place, fault)
        elif self.sums:
            self.trials[place] = [t if t.verdict else t.observe_sums(column, cost) for t, column in pairs]
        else:
            self.trials[place] = [t if t.verdict else t.observe(column, cost) for t, column in pairs]

    def _break_all(self, reason: str) -> None:
        for place in range(len(self.trials)):
            self._break(place, reason)

    def _break(self, place: int, reason: str) -> None:
        self.trials[place] = [t if t.verdict else t.broken(reason) for t in self.trials[place]]


def open_streams(subject: Any, chosen: Sequence[Chosen], settings: Settings) -> tuple[list[Stream], dict[str, str]]:
    """Streams with every bet placed, and the pixels that the subject declines, with its reasons.

    One stream a pixel, or, where the subject renders many at once, one for all of as many channels.
    """
    together = callable(attribute(subject, "run_many"))
    cases = sum(each.channels for each in chosen)
    groups: dict[Any, list[tuple[Chosen, list[Trial]]]] = {}
    skipped = {}
    for each in chosen:
        try:
            trials = _open_trials(subject, each, settings, cases)
        except Unsupported as declined:
            skipped[each.name] = str(declined)
        else:
            groups.setdefault(each.pixel.channels if together else each.name, []).append((each, trials))
    sums = gives_sums(subject)
    few, bits = attribute(subject, "replicates"), attribute(subject, "seed_bits") or SEED_BITS
    streams = []
    for number, group in enumerate(groups.values()):
        members, trials_of = zip(*group, strict=True)
        seeds = (
            Seeds(settings.seed, bits, number, len(groups))
            if few is None
            else Few(settings.seed, few, *([SUMS] * sums))
        )
        streams.append(Stream(members, seeds, list(trials_of), sums=sums))
    return streams, skipped


def _open_trials(subject: Any, chosen: Chosen, settings: Settings, cases: int) -> list[Trial]:
    fault, declared = "", None
    try:
        targets = settings.targets(subject, chosen)
        declared = settings.declared(subject, chosen)
    except SubjectError as broken:
        targets, fault = settings.targets(None, chosen), str(broken)
    suspects = {f"suspect {s.name}": derive_declared(s, chosen.pixel) for s in settings.suspects}
    levels = settings.levels(subject, cases)
    trials = [
        Trial.open(
            target,
            levels,
            declared[i] if declared else None,
            {name: suspect[i] for name, suspect in suspects.items()},
            settings.method,
            sums=gives_sums(subject),
        )
        for i, target in enumerate(targets)
    ]
    return [trial.broken(fault) for trial in trials] if fault else trials


def looks(subject: Any, streams: Sequence[Stream], budget: int) -> Iterator[Stream]:
    """Draw up to ``budget`` replicates per stream, in turns; yields the stream after each of its looks."""
    purse, limit = budget * len(streams), 0
    while (waiting := [s for s in streams if s.waiting]) and purse >= len(waiting):
        limit += purse // len(waiting)
        while turn := [s for s in waiting if s.waiting and s.drawn < limit]:
            for stream in turn:
                purse -= stream.advance(subject, limit)
                yield stream
