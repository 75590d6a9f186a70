"""Judging an estimator: whether it has the true mean of every pixel, within a tolerance."""

from __future__ import annotations

import math
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from truemean import __version__
from truemean.conformance.declared import read_declaration
from truemean.conformance.evidence import METHODS
from truemean.conformance.exactly import exact_cases
from truemean.conformance.panel import Panel, read_regions
from truemean.conformance.replicates import attribute, gives_sums
from truemean.conformance.seeding import check_seeds
from truemean.conformance.settings import Chosen, Settings, read_pixels
from truemean.conformance.stream import Stream, looks, open_streams
from truemean.conformance.verdict import Case, PlanCheck, Report, Verdict
from truemean.subject import as_estimator

__all__ = ["judge"]

Progress = Callable[[str, int, int], object]

SUMMED = (
    "only sums of many replicates are known: they count against each side as the replicates of these sums and sums of "
    "squares that would win its bets least, and what is declared is compared by its mean alone"
)
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
    # What is known of the estimator, and of the pixels.
    declares: Any = None,
    range: Any = None,  # noqa: A002 - the word that estimators use too
    variance: Any = None,
    timeout: float | None = None,
    method: str = "focus",
    suspects: Sequence[Any] = (),
    regions: Any = None,
    independent: bool = False,
    deterministic: bool | None = None,
    progress: Progress | None = None,
) -> Report:
    """Whether E[ξ] lies within ``tolerance`` of the true mean I on each pixel, with evidence valid at every look.

    ``tolerance`` is absolute, or ``"1%"`` of the pixel's scale, or a mapping pixel -> tolerance with ``"*"`` for
    the others; ``pixels`` a mapping name -> Pixel, by default those the estimator brings, else the standard
    ones. A wrong BIASED or DEVIATES anywhere in the run has probability at most ``alpha``, a wrong CONFORMS at
    most ``beta`` for each case, and a wrong CONFORMS of the whole run, hence, at most ``beta``.
    ``budget`` counts replicates per pixel; decided pixels leave theirs to the others.

    ``declares = (plan, params)`` and ``range = (lo, hi)`` override what the estimator says of itself. Estimates
    without a finite range need ``variance``, a bound. ``suspects`` are plans that the estimator may secretly
    follow: bets are put on them, the verdict stays as sure. ``method`` is a name of `METHODS`. ``regions`` is a
    mapping region -> pixels, or the side of square tiles. ``independent=True`` says that pixels are, so that
    small biases of many add up faster. ``deterministic=True``: the estimator may ignore its seeds.
    ``timeout`` is in seconds, looked at between batches; ``progress(pixel, replicates, undecided)`` is called after
    each look. An interrupt returns what was gathered. Raises InputError for arguments that can't be meant,
    SubjectError when the seeds do not do what seeds do.

    >>> from truemean.oracle.pixel import Pixel
    >>> def mean_of_four(pixel, seeds):
    ...     values, weights = pixel.arrays()
    ...     return np.array([np.random.default_rng(s).choice(values, 4, p=weights).mean() for s in seeds])
    >>> report = judge(mean_of_four, pixels={"eighth": Pixel.two("1/8")}, tolerance="10%", seed=7)
    >>> str(report.verdict), report.cases[0].replicates < 1000
    ('CONFORMS', True)
    """
    # What is asked.
    subject = as_estimator(estimator)
    plan = read_declaration(attribute(subject, "declares") if declares is None else declares)
    suspected = tuple(filter(None, map(read_declaration, [suspects] if isinstance(suspects, str) else suspects)))
    settings = Settings(
        tolerance, alpha, beta, budget, seed, plan, range, timeout, variance, method, suspected, independent
    )
    settings = settings.for_sums() if gives_sums(subject) else settings
    name, versions = attribute(subject, "name") or type(subject).__name__, _versions(subject)
    chosen = read_pixels(subject, pixels)
    order = [each.name for each in chosen]
    settings.check_tolerances(order)
    groups = read_regions(regions, order)
    deadline = math.inf if timeout is None else time.monotonic() + timeout
    # Where the law of the code itself is known, no replicates are needed; for all else bets are placed before the run.
    exact = exact_cases(subject, chosen, settings, deadline)
    sampled = [each for each in chosen if not {each.name} & {*exact.cases, *exact.skipped}]
    streams, skipped = open_streams(subject, sampled, settings)
    panel = Panel(streams, settings.alpha_biased(subject), sum(each.channels for each in sampled), settings)
    ended = INTERRUPTED if exact.interrupted else _draw(subject, panel, settings, deterministic, progress, deadline)
    cases = _cases(streams, order, ended, exact.cases)
    verdict, reason = _verdict(cases, panel.is_biased)
    # Everything that was found.
    return Report(
        subject=str(name),
        verdict=verdict,
        reason=reason,
        plan_check=_plan_check(cases),
        cases=cases,
        skipped={**exact.skipped, **skipped}
        | {each.name: s.skipped for s in streams if s.skipped for each in s.chosen},
        arguments=settings.arguments() | {"pixels": tuple(order)},
        seed=settings.seed,
        notes=(
            *_notes(settings, chosen, sampled, sums=gives_sums(subject)),
            *exact.notes,
            *map(str, attribute(subject, "notes") or ()),
        ),
        versions=versions,
        interrupted=ended == INTERRUPTED,
        # All cases together, and what the runs took.
        discoveries=(*(case.name for case in exact.biased), *panel.discoveries()),
        regions=panel.regions(groups, {case.pixel for case in exact.biased}),
        somewhere=panel.somewhere,
        seconds=sum(stream.seconds for stream in streams),
        runs=sum(stream.drawn for stream in streams),
    )


def _draw(
    subject: Any,
    panel: Panel,
    settings: Settings,
    deterministic: bool | None,
    progress: Progress | None,
    deadline: float,
) -> str:
    """Draw until every case is decided or nothing is left; why the run ended."""
    try:
        check_seeds(subject, panel.streams, deterministic=deterministic)
        for stream in looks(subject, panel.streams, settings.budget):
            panel.watch(stream)
            if progress is not None:
                progress(stream.chosen[0].name, stream.drawn, panel.waiting)
            if time.monotonic() > deadline:
                return f"stopped by timeout={settings.timeout}"
    except KeyboardInterrupt:
        return INTERRUPTED
    return SPENT


def _cases(
    streams: Sequence[Stream], order: Sequence[str], ended: str, exact: Mapping[str, list[Case]]
) -> tuple[Case, ...]:
    """The cases in the order of the pixels."""
    found: dict[str, list[Case]] = {name: exact.get(name, []) for name in order}
    for stream in streams:
        why = ended if stream.drawn < stream.seeds.capacity else stream.seeds.spent
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


def _notes(settings: Settings, chosen: Sequence[Chosen], sampled: Sequence[Chosen], *, sums: bool) -> tuple[str, ...]:
    if not sampled:
        return ("all verdicts are exact: every path of the code was run, and nothing is left to chance",)
    alpha, beta, method = settings.alpha, settings.beta, METHODS[settings.method]
    notes = [
        f"if nothing is wrong, a BIASED or DEVIATES anywhere in this run has probability at most {alpha:g}",
        f"if some pixel is biased beyond its tolerance, all of them CONFORM with probability at most {beta:g}",
    ]
    if settings.method != "focus":
        notes.append(f"method {settings.method}: {method.guarantee}")
    if not method.valid:
        notes = notes[2:]
    if sums:
        notes.append(SUMMED)
    if settings.independent:
        notes.append(
            "the pixels are independent by declaration: the combined evidence, with half of alpha, rests on it"
        )
    if all(settings.tolerance_on(each.name, each.pixel) == 0 for each in chosen):
        notes.append(
            "tolerance 0 hunts for bias: CONFORMS can't be reached, but where the range leaves no room for bias"
        )
    return tuple(notes)


def _versions(subject: Any) -> dict[str, str]:
    own = {str(name): str(version) for name, version in (attribute(subject, "versions") or {}).items()}
    return {"truemean": __version__, "python": platform.python_version(), "numpy": np.__version__, **own}
