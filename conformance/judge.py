"""Judging an estimator: whether it has the true mean of every pixel, within a tolerance."""

from __future__ import annotations

import math
import platform
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from truemean import __version__
from truemean.conformance.declared import read_declaration
from truemean.conformance.replicates import attribute
from truemean.conformance.settings import Chosen, Settings, read_pixels
from truemean.conformance.stream import Stream, looks, open_streams
from truemean.conformance.verdict import Case, PlanCheck, Report, Verdict
from truemean.subject import as_estimator

__all__ = ["judge"]

Progress = Callable[[str, int, int], object]

SPENT, INTERRUPTED = "the budget is spent", "interrupted"


def judge(
    estimator: Any,
    *,
    tolerance: Any,
    pixels: Any = None,
    alpha: float = 1e-2,
    beta: float = 1e-2,
    budget: int = 100_000,
    seed: int = 0,
    declares: Any = None,
    range: Any = None,  # noqa: A002 - the word that estimators use too
    timeout: float | None = None,
    progress: Progress | None = None,
) -> Report:
    """Whether E[ξ] lies within ``tolerance`` of the true mean I on each pixel, with evidence valid at every look.

    ``tolerance`` is absolute, or ``"1%"`` of the pixel's scale; ``pixels`` a mapping name -> Pixel, by
    default those the estimator brings, else the standard ones. A wrong BIASED or DEVIATES anywhere in
    the run has probability at most ``alpha``, a wrong CONFORMS at most ``beta`` for each case.
    ``budget`` counts replicates per pixel; decided pixels leave theirs to the others. ``declares =
    (plan, params)`` and ``range = (lo, hi)`` override what the estimator says of itself; ``timeout`` is
    in seconds, looked at between batches; ``progress(pixel, replicates, undecided)`` is called after
    each look. An interrupt returns what was gathered. Raises InputError for arguments that can't be meant.

    >>> from truemean.oracle.pixel import Pixel
    >>> def mean_of_four(pixel, seeds):
    ...     values, weights = pixel.arrays()
    ...     return np.array([np.random.default_rng(s).choice(values, 4, p=weights).mean() for s in seeds])
    >>> report = judge(mean_of_four, pixels={"eighth": Pixel.two("1/8")}, tolerance="10%", seed=7)
    >>> str(report.verdict), report.cases[0].replicates < 1000
    ('CONFORMS', True)
    """
    subject = as_estimator(estimator)
    plan = read_declaration(attribute(subject, "declares") if declares is None else declares)
    settings = Settings(tolerance, alpha, beta, budget, seed, plan, range, timeout)
    name, versions = attribute(subject, "name") or type(subject).__name__, _versions(subject)
    chosen = read_pixels(subject, pixels)
    streams, skipped = open_streams(subject, chosen, settings)
    ended, peak = _draw(subject, streams, settings, sum(each.channels for each in chosen), progress)
    cases = _cases(streams, [each.name for each in chosen], ended)
    verdict, reason = _verdict(cases, peak >= -math.log(settings.alpha_biased))
    return Report(
        subject=str(name),
        verdict=verdict,
        reason=reason,
        plan_check=_plan_check(cases),
        cases=cases,
        skipped=skipped | {each.name: s.skipped for s in streams if s.skipped for each in s.chosen},
        arguments=settings.arguments() | {"pixels": tuple(each.name for each in chosen)},
        seed=settings.seed,
        notes=_notes(settings, chosen),
        versions=versions,
        interrupted=ended == INTERRUPTED,
    )


def _draw(
    subject: Any, streams: Sequence[Stream], settings: Settings, cases: int, progress: Progress | None
) -> tuple[str, float]:
    """Why the run ended, and the peak of the combined evidence for a bias somewhere.

    That evidence is the average over all cases of the current evidence of each (1 for those skipped),
    whatever they have in common. Its maximum over time is valid; an average of maxima would not be.
    """
    deadline = math.inf if settings.timeout is None else time.monotonic() + settings.timeout
    sums = {id(stream): stream.log_biased for stream in streams}
    declined = cases - sum(len(trials) for stream in streams for trials in stream.trials)
    rest = [math.log(declined)] if declined else []
    peak = 0.0
    try:
        for stream in looks(subject, streams, settings.budget):
            sums[id(stream)] = stream.log_biased
            peak = max(peak, float(np.logaddexp.reduce([*sums.values(), *rest])) - math.log(cases))
            if progress is not None:
                progress(stream.chosen[0].name, stream.drawn, sum(other.waiting for other in streams))
            if time.monotonic() > deadline:
                return f"stopped by timeout={settings.timeout}", peak
    except KeyboardInterrupt:
        return INTERRUPTED, peak
    return SPENT, peak


def _cases(streams: Sequence[Stream], order: Sequence[str], ended: str) -> tuple[Case, ...]:
    """The cases in the order of the pixels."""
    found: dict[str, list[Case]] = {name: [] for name in order}
    for stream in streams:
        why = ended if stream.drawn < stream.seeds.capacity else f"no fresh seed of {stream.seeds.bits} bits is left"
        for each, trials in zip(stream.chosen, stream.trials, strict=True):
            found[each.name] = [] if stream.skipped else [trial.case(why) for trial in trials]
    return tuple(case for cases in found.values() for case in cases)


def _verdict(cases: Sequence[Case], somewhere: bool) -> tuple[Verdict, str]:
    """The verdict of the run: the first that occurs, in the order of `Verdict`, and a sentence why."""
    if not cases:
        return Verdict.INCONCLUSIVE, "every pixel was skipped"
    verdict = min((case.verdict for case in cases), key=list(Verdict).index)
    if somewhere and verdict in (Verdict.INCONCLUSIVE, Verdict.CONFORMS):
        return Verdict.BIASED, "biased somewhere; no single pixel is named at this alpha"
    named = [case for case in cases if case.verdict is verdict]
    return verdict, f"{len(named)} of {len(cases)} cases {verdict}; {named[0].name}: {named[0].reason}"


def _plan_check(cases: Sequence[Case]) -> PlanCheck | None:
    checks = {case.plan_check for case in cases}
    return next((check for check in (PlanCheck.DEVIATES, PlanCheck.FOLLOWS) if check in checks), None)


def _notes(settings: Settings, chosen: Sequence[Chosen]) -> tuple[str, ...]:
    notes = [
        f"if nothing is wrong, a BIASED or DEVIATES anywhere in this run has probability at most {settings.alpha:g}",
    ]
    if all(settings.tolerance_on(each.pixel) == 0 for each in chosen):
        notes.append(
            "tolerance 0 hunts for bias: CONFORMS can't be reached, but where the range leaves no room for bias"
        )
    return tuple(notes)


def _versions(subject: Any) -> dict[str, str]:
    own = {str(name): str(version) for name, version in (attribute(subject, "versions") or {}).items()}
    return {"truemean": __version__, "python": platform.python_version(), "numpy": np.__version__, **own}
