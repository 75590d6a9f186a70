"""Which implementations the reference report judges, and judging several of them at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import replace
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from truemean.errors import MissingExtra, TruemeanError, UnknownName

if TYPE_CHECKING:
    from truemean.conformance import Report

__all__ = ["CODE", "RENDERERS", "Bench", "Entry", "about", "chosen", "judged"]

HOUR, LOOKED = 3600.0, 16
CODE = MappingProxyType(
    {
        "Fig. 1 in NumPy": "python:truemean.adapters.reference:KirkArvo",
        "Fig. 2 in NumPy": "python:truemean.adapters.reference:KirkArvoUnbiased",
    }
)
RENDERERS: Mapping[str, tuple[int, Mapping[str, str]]] = MappingProxyType(
    {
        "raysect": (
            10_000,
            {
                "raysect, not adaptive": "raysect?pixel_samples=4",
                "raysect, adaptive (pilot 4)": "raysect?min_samples=4&cutoff=0&ratio=1e9",
                "raysect, adaptive on colours": "raysect?sampler=rgb&min_samples=4&cutoff=0&ratio=1e9",
                "raysect, adaptive (pilot 16)": "raysect?min_samples=16&pixel_samples=8&passes=8",
                "raysect, its own ratio and fraction": "raysect?min_samples=16&cutoff=0.1&ratio=10&fraction=0.2&passes=8",
            },
        ),
        "mitsuba": (
            30_000,
            {
                "mitsuba, independent": "mitsuba?sampler=independent",
                "mitsuba, stratified": "mitsuba?sampler=stratified",
                "mitsuba, multijitter": "mitsuba?sampler=multijitter",
                "mitsuba, orthogonal": "mitsuba?sampler=orthogonal&sample_count=25",
                "mitsuba, ldsampler": "mitsuba?sampler=ldsampler&sample_count=16",
                "two stages on mitsuba, pilot pooled": "mitsuba?pilot=4&sample_count=12",
                "two stages on mitsuba, pilot discarded": "mitsuba?pilot=4&sample_count=12&pooled=0",
            },
        ),
        "povray": (
            20_000,
            {
                "POV-Ray, no anti-aliasing": "povray?method=0",
                "POV-Ray, method 1": "povray?method=1",
                "POV-Ray, method 1 without jitter": "povray?method=1&jitter=0",
                "POV-Ray, method 1, depth 8": "povray?method=1&depth=8",
                "POV-Ray, method 2": "povray?method=2",
            },
        ),
        "cycles": (
            10_000,
            {
                "Cycles, not adaptive": "cycles?samples=4",
                "Cycles, not adaptive, first sample skipped": "cycles?samples=4&sample_offset=1",
                "Cycles, threshold 0.1": "cycles:isolated-pixel?samples=256&adaptive_threshold=0.1&adaptive_min_samples=1",
                "Cycles, threshold 0.01": "cycles:isolated-pixel?samples=256&adaptive_threshold=0.01&adaptive_min_samples=1",
                "Cycles, threshold 0.01, its own minimum": "cycles:isolated-pixel?samples=256&adaptive_threshold=0.01",
                "Cycles, threshold 0.01, first sample skipped": "cycles:isolated-pixel?samples=256&adaptive_threshold=0.01"
                "&adaptive_min_samples=1&sample_offset=1",
                "Cycles on an edge, threshold 0.1": "cycles?samples=256&adaptive_threshold=0.1",
            },
        ),
        "vegas": (
            3_000,
            {
                "vegas, 5 times 20 points": "vegas?nitn=5&neval=20",
                "vegas, 5 times 100 points, plain mean": "vegas?nitn=5&neval=100&weighted=0",
                "vegas, neither adaptive nor stratified": "vegas?nitn=2&neval=20&alpha=0&beta=0&nstrat=1,1",
            },
        ),
        "gsl": (
            2_000,
            {
                "GSL PLAIN": "gsl?method=plain&calls=500",
                "GSL MISER": "gsl?method=miser&calls=2000",
                "GSL VEGAS": "gsl?method=vegas&calls=1250",
            },
        ),
    }
)


class Entry(NamedTuple):
    """A configuration to judge: the page it is on, its name, SUBJECT as it is typed, and replicates for each pixel."""

    page: str
    name: str
    subject: str
    budget: int


def chosen(renderers: str) -> tuple[list[Entry], dict[str, str]]:
    """What of ``renderers`` (all, none, or names) can be judged here, and what not, and why.

    MissingExtra for a missing one that was asked for by its name.
    """
    from truemean.adapters import load

    asked = {"all": list(RENDERERS), "none": []}.get(renderers, renderers.split(","))
    entries: list[Entry] = []
    skipped: dict[str, str] = {}
    for renderer in asked:
        if renderer not in RENDERERS:
            raise UnknownName("renderer", renderer, ["all", "none", *RENDERERS])
        budget, subjects = RENDERERS[renderer]
        try:
            load(next(iter(subjects.values())))
        except MissingExtra as error:
            if renderers != "all":
                raise
            skipped[renderer] = str(error)
        else:
            entries += [Entry(renderer, name, subject, budget) for name, subject in subjects.items()]
    return entries, skipped


def about(page: str) -> str:
    """How a renderer decides, what is declared for it and what was found: the text of its adapter."""
    from truemean.adapters.registry import ADAPTERS

    return import_module(ADAPTERS[page].factory.partition(":")[0]).__doc__ or ""


class Bench:
    """What judges in a process of its own."""

    def judge(self, subject: str, budget: int, seed: int) -> Report:
        """The judgement of a SUBJECT at the tolerance of the report."""
        from truemean.adapters import load
        from truemean.conformance import check_subject
        from truemean.conformance.report import TOLERANCE, judge_one

        estimator = load(subject)
        checks = check_subject(estimator, replicates=LOOKED, strict=False)
        broken = [f"{subject}: {check.promise}: NO, {check.seen}" for check in checks if check.kept is False]
        report = judge_one(subject, estimator, TOLERANCE, seed, budget)
        kept = "looked at first: seeds act as they should, and pixels of one value have it, in every configuration"
        return replace(report, notes=(*report.notes, *(broken or [kept])))


def judged(
    entries: list[Entry], seed: int, jobs: int, tell: Callable[[str], None]
) -> tuple[dict[str, dict[str, Report]], dict[str, str]]:
    """The judgements by page and name, and what could not be judged, and why; ``jobs`` at a time, in processes of their own.

    An interrupt ends them all; those that are done are kept.
    """
    found: dict[str, Report] = {}
    failed: dict[str, str] = {}
    with _benches(jobs) as benches, ThreadPoolExecutor(max(1, jobs)) as pool:
        waiting = {pool.submit(_one, benches, entry, seed): entry for entry in entries}
        try:
            for number, done in enumerate(as_completed(waiting), 1):
                entry = waiting[done]
                try:
                    found[entry.name] = done.result()
                except TruemeanError as error:
                    failed[entry.name] = str(error)
                tell(f"{number} of {len(entries)} judged, the last one {entry.name}")
        except KeyboardInterrupt:
            for future in waiting:
                future.cancel()
            for bench in benches:
                bench.child.stop()
    pages: dict[str, dict[str, Report]] = {}
    for entry in entries:
        if entry.name in found:
            pages.setdefault(entry.page, {})[entry.name] = found[entry.name]
    return pages, failed


def _one(benches: list[Any], entry: Entry, seed: int) -> Report:
    bench = benches.pop()
    try:
        report: Report = bench.call("judge", entry.subject, entry.budget, seed)
    finally:
        benches.append(bench)
    return report


@contextmanager
def _benches(jobs: int) -> Iterator[list[Any]]:
    from truemean.adapters.host import Host

    benches = [Host("truemean.reporting:Bench", (), HOUR) for _ in range(max(1, jobs))]
    every = list(benches)
    try:
        yield benches
    finally:
        for bench in every:
            bench.child.stop()
