"""All cases of a run together: the combined evidence, who may be named, and what regions show."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from truemean.conformance.evidence import Bets, Bounded, FloatArray, Heavy, Mixture
from truemean.conformance.many import (
    aggregate,
    average,
    check_regions,
    common_fractions,
    e_bh,
    fractions_at,
    holm_level,
    least_common,
    sparse_common,
    tiles,
)
from truemean.conformance.settings import Settings
from truemean.conformance.stream import Stream
from truemean.conformance.trial import Trial
from truemean.conformance.verdict import Region
from truemean.errors import InputError

__all__ = ["Panel", "read_regions"]


class Panel:
    """The streams of a run, watched after each look: ``somewhere`` is the peak of the combined evidence.

    That evidence is the average over all cases of the current evidence of each (1 for those skipped),
    whatever they have in common, or, where pixels are declared independent, the sparse common mixture. Its
    maximum over time is valid; an average of maxima would not be.
    """

    def __init__(self, streams: Sequence[Stream], alpha: float, cases: int, settings: Settings) -> None:
        self.streams, self.alpha, self.cases = streams, alpha, cases
        self.somewhere, self.waiting = 0.0, sum(stream.waiting for stream in streams)
        self.shared = settings.independent and _place_common_bets(streams, alpha, settings.budget)
        sizes = np.cumsum([0, *(len(stream.log_biased) for stream in streams)])
        self._places = {id(s): slice(*ends) for s, ends in zip(streams, pairwise(sizes), strict=True)}
        self._logs = np.zeros(cases)  # of the cases in their order, then of those declined
        self._named = {id(stream): 0 for stream in streams}
        self._waiting = {id(stream): stream.waiting for stream in streams}

    def watch(self, stream: Stream) -> None:
        """Take in one look at a stream; name more cases where Holm allows it."""
        self._logs[self._places[id(stream)]] = stream.log_biased
        self.somewhere = max(self.somewhere, self._common() if self.shared else average(self._logs))
        fresh, self._named[id(stream)] = stream.named > self._named[id(stream)], stream.named
        while fresh and (named := sum(self._named.values())) < self.cases:
            for each in self.streams:
                each.relax(holm_level(self.alpha, self.cases, named))
            found = {id(each): each.named for each in self.streams}
            fresh, self._named = found != self._named, found
        self.waiting += stream.waiting - self._waiting[id(stream)]
        self._waiting[id(stream)] = stream.waiting

    @property
    def is_biased(self) -> bool:
        """Whether some case is, at alpha."""
        return self.somewhere >= -math.log(self.alpha)

    def discoveries(self) -> tuple[str, ...]:
        """The cases that e-BH calls biased, by the current evidence of all."""
        trials = list(_trials(self.streams))
        if not trials:
            return ()
        found = e_bh([trial.biased.log_evidence for trial in trials] + [0.0] * (self.cases - len(trials)), self.alpha)
        return tuple(trial.target.case for trial, biased in zip(trials, found, strict=False) if biased)

    def regions(self, groups: Mapping[str, Sequence[str]], known: Collection[str] = ()) -> tuple[Region, ...]:
        """The evidence by group of pixels, and how large a bias it could have seen there; ``known`` ones are biased."""
        by_pixel: dict[str, list[Trial]] = {}
        for trial in _trials(self.streams):
            by_pixel.setdefault(trial.target.pixel, []).append(trial)
        names = {name for members in groups.values() for name in members}
        logs = {name: [t.biased.log_evidence for t in by_pixel.get(name, [])] or [0.0] for name in names}
        found = []
        for group in aggregate(groups, logs, self.alpha):
            members = [trial for name in groups[group.name] for trial in by_pixel.get(name, [])]
            asked = math.log(len(groups) / self.alpha)
            sizes = [_visible(members, asked + extra) for extra in (0.0, math.log(group.cases))]
            biased = group.biased or not set(known).isdisjoint(groups[group.name])
            found.append(Region(group.name, group.cases, group.log_evidence, biased, *sizes))
        return tuple(found)

    def _common(self) -> float:
        """The sparse common mixture over pixels; channels of one depend on each other, and are averaged."""
        wealths = []
        for stream in self.streams:
            shared = [trial.shared for trial in _trials([stream]) if trial.shared]
            if shared:
                logs = np.array([[mixture.log_wealths for mixture in pair] for pair in shared])
                wealths.append(np.logaddexp.reduce(logs, axis=0) - math.log(len(shared)))
        return sparse_common(np.array(wealths)) if wealths else 0.0


def read_regions(regions: Any, names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Groups of pixels by name: a mapping region -> pixels, or a whole number, the side of square tiles."""
    if regions is None:
        return {}
    if isinstance(regions, int) and not isinstance(regions, bool):
        return tiles(names, regions)
    if not isinstance(regions, Mapping):
        raise InputError(f"regions={regions!r:.80}: give a mapping region -> pixel names, or the side of square tiles")
    return check_regions(regions, names)


def _trials(streams: Sequence[Stream]) -> list[Trial]:
    return [trial for stream in streams if not stream.skipped for trials in stream.trials for trial in trials]


def _visible(members: Sequence[Trial], asked: float) -> float | None:
    """The bias beyond the tolerance at which the evidence reaches ``asked`` nats about half the time (Bernstein)."""
    sizes = []
    for trial in members:
        seen = trial.outcomes.moments
        if seen.total > 1:
            variance = seen.squares / (seen.total - 1)
            reach = math.sqrt(2 * variance * asked / seen.total) + asked / seen.total
            sizes.append(float(trial.target.tolerance) + float(trial.target.width) * reach)
    return float(np.median(sizes)) if sizes else None


def _place_common_bets(streams: Sequence[Stream], alpha: float, budget: int) -> bool:
    """Give each case that can vary the bets that all cases make together; whether there are any."""
    for stream in streams:
        if len(stream.chosen) > 1:
            raise InputError(
                f"independent=True, but {stream.chosen[0].name} and {stream.chosen[1].name} are rendered together, "
                "from the same seeds: leave it out"
            )
    sides = [t.target.side(1, t.target.tolerance + t.target.slack) for t in _trials(streams)]
    means = [side.mean for side in sides if isinstance(side, Bounded) and 0 < side.mean < 1]
    if not means:
        return False
    nodes = common_fractions(min(0.99, max(1e-6, least_common(means, alpha, budget))))
    for stream in streams:
        stream.trials = [[_sharing(trial, nodes) for trial in trials] for trials in stream.trials]
    return True


def _sharing(trial: Trial, nodes: FloatArray) -> Trial:
    margin = trial.target.tolerance + trial.target.slack
    above, below = (trial.target.side(sign, margin) for sign in (1, -1))
    if isinstance(above, Heavy) or isinstance(below, Heavy):
        return trial
    pair = [Mixture.open(side, Bets.equal(fractions_at(nodes, min(side.mean, 1.0)))) for side in (above, below)]
    return replace(trial, shared=(pair[0], pair[1]))
