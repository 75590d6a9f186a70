"""Verdicts on implementations, beside what the oracle predicts for the plans they declare."""

from __future__ import annotations

import math
import shlex
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from truemean.conformance.judge import judge
from truemean.conformance.planning import planned
from truemean.conformance.report.charts import INK, MUTED, SERIES, panels, styled, zero_line
from truemean.conformance.report.document import Cell, Chart, Chip, Section, Table
from truemean.conformance.report.expected import expected_parts
from truemean.conformance.report.wording import counted, decimal, exact, listed, signed
from truemean.conformance.verdict import Case, Report, Verdict
from truemean.errors import NeedsScene, PlanError
from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue

__all__ = ["Pages", "declared_plan", "headline", "judge_all", "judge_one", "judged_parts", "replay", "section"]

REPLICATES = 100_000
ALPHA = BETA = 0.01
CURVE = 48
Progress = Callable[[str, float], None]
Pages = Mapping[str, Mapping[str, Report]]
LOOKS = {
    Verdict.BIASED: (SERIES[1], "o"),
    Verdict.CONFORMS: (SERIES[2], "s"),
    Verdict.INCONCLUSIVE: (SERIES[4], "^"),
    Verdict.BROKEN: (SERIES[5], "X"),
}


def judge_all(
    subjects: Mapping[str, tuple[str, Any]], tolerance: str, seed: int, progress: Progress
) -> dict[str, Report]:
    """Each subject, by name with its SUBJECT, judged at ``tolerance``; ``progress(text, share)`` counts subjects.

    An interrupt ends the judging: what it had gathered counts, later subjects are missing.
    """
    found = {}
    for number, (name, (written, subject)) in enumerate(subjects.items()):
        look = partial(_look, progress, f"judging {name}", number, REPLICATES)
        found[name] = judge_one(written, subject, tolerance, seed, REPLICATES, look)
        if found[name].interrupted:
            break
    return found


def judge_one(written: str, subject: Any, tolerance: str, seed: int, budget: int, look: Any = None) -> Report:
    """The judgement of a subject, as it is typed, and what was to be expected of it."""
    report = judge(subject, tolerance=tolerance, alpha=ALPHA, beta=BETA, budget=budget, seed=seed, progress=look)
    return planned(replace(report, subject=written), subject)


def replay(report: Report) -> str:
    """The command that judges this subject alone, with the same replicates."""
    asked = report.arguments
    options = {"--tolerance": asked["tolerance"], "--budget": asked["budget"], "--seed": report.seed}
    return shlex.join(["truemean", "judge", report.subject, *(str(word) for pair in options.items() for word in pair)])


def _look(progress: Progress, text: str, before: int, budget: int, pixel: str, drawn: int, _undecided: int) -> None:
    progress(f"{text}: {pixel}, {counted(drawn, 'replicate')}", before + min(1.0, drawn / budget))


# -- in words -------------------------------------------------------------------------------------


def headline(reports: Mapping[str, Report], tolerance: str, pages: Pages | None = None) -> str:
    """The verdicts in one sentence, those of other pages in a clause."""
    said = [f"{name} {_outcome(report)}" for name, report in reports.items()]
    others = [report for found in (pages or {}).values() for report in found.values()]
    if others and pages:
        counts = Counter(report.verdict for report in others)
        verdicts = listed([f"{counts[verdict]} {verdict}" for verdict in Verdict if counts[verdict]])
        said.append(f"of {counted(len(others), 'configuration')} of {listed(list(pages))}, {verdicts}")
    if not said:
        return "No implementation was judged; the plans are compared below."
    every = [*reports.values(), *others]
    right, known = (sum(each) for each in zip(*map(predicted_right, every), strict=True))
    oracle = f"; the oracle’s prediction lies in {right} of {counted(known, 'measured interval')}" if known else ""
    return f"At a tolerance of {_percent(tolerance)}, {'; '.join(said)}{oracle}."


def _percent(tolerance: str) -> str:
    return f"{tolerance.removesuffix('%')} % of a pixel’s range" if tolerance.endswith("%") else tolerance


def _outcome(report: Report) -> str:
    cases = sum(case.verdict is report.verdict for case in report.cases)
    verb = "" if report.verdict is Verdict.CONFORMS else "is "
    return f"{verb}{report.verdict} in {cases} of {counted(len(report.cases), 'case')}"


def _lead(tolerance: str) -> str:
    return (
        "Each implementation ran its own code and was judged by its replicates alone, at a tolerance of "
        f"{_percent(tolerance)}. The evidence is valid whenever one looks at it: a wrong BIASED anywhere in a run has "
        f"probability at most {ALPHA:.0%}, a wrong CONFORMS at most {BETA:.0%} a case. The oracle’s prediction is shown "
        "beside; it had no vote. INCONCLUSIVE is published as it is: more replicates would decide."
    )


def predicted_right(report: Report) -> tuple[int, int]:
    """How many of the cases with a prediction hold it in their interval, and how many have one."""
    pairs = [(case.declared_bias, case.bias_interval) for case in report.cases if case.declared_bias is not None]
    return sum(low <= bias <= high for bias, (low, high) in pairs), len(pairs)


def declared_plan(report: Report) -> str:
    """The plan that the subject declares, as a call; "none" without one."""
    plan = report.arguments["declares"]
    if plan is None:
        predicted = any(case.declared_bias is not None for case in report.cases)
        return "predicted by pixel" if predicted else "none"
    return f"{plan['plan']}({', '.join(f'{name}={value}' for name, value in plan['params'].items())})"


def predicted_curve(report: Report) -> list[tuple[float, float]]:
    """Bias of the declared plan over the coverage of black and white pixels; empty where none can be derived."""
    declared = report.arguments["declares"]
    if not declared or declared["plan"] not in catalogue:
        return []
    coverages = [Fraction(i, CURVE) for i in range(1, CURVE)]
    try:
        derived = [derive(catalogue[declared["plan"]], Pixel.two(white), **declared["params"]) for white in coverages]
        return [(float(white), float(d.bias)) for white, d in zip(coverages, derived, strict=True)]
    except (NeedsScene, PlanError):
        return []


# -- tables ---------------------------------------------------------------------------------------


def section(reports: Mapping[str, Report], tolerance: str, pages: Pages | None = None) -> Section:
    """A summary, those of other ``pages`` with it, then chart and table for each subject of this one."""
    parts: list[str | Table | Chart] = [_lead(tolerance)]
    if reports or pages:
        parts.append(_summary(reports, pages or {}))
    for number, (name, report) in enumerate(reports.items(), 1):
        parts += judged_parts(name, report, f"subject-{number}")
    data = {name: report.to_json() for name, report in reports.items()}
    return Section("verdicts", "Do implementations have the true mean?", tuple(parts), data)


def _summary(reports: Mapping[str, Report], pages: Pages) -> Table:
    rows = [_summed(name, report, "") for name, report in reports.items()]
    rows += [_summed(name, report, page) for page, found in pages.items() for name, report in found.items()]
    head = (
        "implementation",
        "verdict",
        "cases",
        "declared plan",
        "intervals that hold the prediction",
        "runs",
    )
    return Table(
        "verdict-summary",
        "The verdict on each implementation is the first of its cases’ in this order: "
        "BROKEN, BIASED, INCONCLUSIVE, CONFORMS. A run is a replicate of one pixel, or of all that are rendered together.",
        head,
        tuple(rows),
    )


def _summed(name: str, report: Report, page: str) -> tuple[Cell, ...]:
    counts = Counter(case.verdict for case in report.cases)
    right, known = predicted_right(report)
    return (
        Cell(name, (report.subject,), "", page),
        _chip(report.verdict),
        Cell(", ".join(f"{counts[verdict]} {verdict}" for verdict in Verdict if counts[verdict]) or "none"),
        Cell(declared_plan(report)),
        Cell(f"{right} of {known}" if known else "–", (), "number"),
        Cell(f"{report.runs:,}", (f"{report.seconds / report.runs * 1000:.3g} ms each",) * bool(report.runs), "number"),
    )


def judged_parts(name: str, report: Report, ident: str) -> list[str | Table | Chart]:
    """What there is to see of one subject: a chart, its cases, and the cases that it skipped."""
    parts: list[str | Table | Chart] = []
    if report.cases:
        parts.append(Chart(f"{ident}-chart", f"{name}: measured bias", _sight(report), bias_over_mean(report)))
        parts.append(_cases(name, report, ident))
    if report.regions:
        parts.append(_regions(name, report, ident))
    if report.plan is not None and report.plan.cases:
        parts += expected_parts(name, report, ident)
    if report.skipped:
        rows = tuple((Cell(pixel), Cell(why)) for pixel, why in report.skipped.items())
        parts.append(Table(f"{ident}-skipped", f"{name}: pixels that it declined.", ("pixel", "why"), rows))
    return parts


def _sight(report: Report) -> str:
    right, known = predicted_right(report)
    line = f"line is what the oracle predicts for {declared_plan(report)}" if report.arguments["declares"] else ""
    plan = f" The {line or 'rings are what the oracle predicts for each pixel'}; " if known else ""
    holds = f"{right} of {counted(known, 'interval')} hold the prediction for their pixel." if known else ""
    by_verdict = Counter(case.verdict for case in report.cases)
    return (
        f"{listed([f'{by_verdict[v]} {v}' for v in Verdict if by_verdict[v]])}: the band is the tolerance.{plan}{holds}"
    )


def _cases(name: str, report: Report, ident: str) -> Table:
    head = (
        "pixel",
        "true mean",
        "measured mean",
        "interval of the bias",
        "predicted bias",
        "std (declared)",
        "cost (declared)",
        "verdict",
        "declared plan",
        "replicates",
    )
    return Table(f"{ident}-cases", f"{name}: {report.reason}.", head, tuple(_row(case) for case in report.cases))


def _row(case: Case) -> tuple[Cell, ...]:
    low, high = case.bias_interval
    decided = case.verdict in (Verdict.BIASED, Verdict.CONFORMS)
    return (
        Cell(case.name),
        Cell(decimal(case.true_mean), exact(case.true_mean), "number"),
        Cell(decimal(case.mean), (), "number"),
        Cell(f"{signed(low)} to {signed(high)}", (), "number"),
        Cell(signed(case.declared_bias), exact(case.declared_bias), "number"),
        _beside(case.std, case.declared_std),
        _beside(case.cost, case.declared_cost),
        Chip(str(case.verdict), () if decided else (case.reason,), case.verdict.lower()),
        _chip(case.plan_check) if case.plan_check else Cell("–"),
        Cell(f"{case.replicates:,}", (), "number"),
    )


def _beside(measured: Any, declared: Any) -> Cell:
    """What was measured, and below it what is declared."""
    shown = [f"{float(number):.3g}" if number is not None else "–" for number in (measured, declared)]
    return Cell(shown[0], () if declared is None else (f"({shown[1]})",), "number")


def _regions(name: str, report: Report, ident: str) -> Table:
    head = ("region", "cases", "verdict", "log evidence", "sees a bias common to all of", "sees a bias in one of")
    rows = tuple(
        (
            Cell(region.name),
            Cell(str(region.cases), (), "number"),
            Chip("BIASED", (), "biased") if region.biased else Cell("–"),
            Cell(f"{region.log_evidence:.1f}", (), "number"),
            Cell(decimal(region.visible), (), "number"),
            Cell(decimal(region.visible_alone), (), "number"),
        )
        for region in report.regions
    )
    caption = (
        f"{name}: the same evidence by region, and the size of a bias that it would find there about half the time. "
        "The error rate of these verdicts is alpha too, apart from that of single cases."
    )
    return Table(f"{ident}-regions", caption, head, rows)


def _chip(word: Any) -> Chip:
    return Chip(str(word), (), str(word).lower())


# -- chart ----------------------------------------------------------------------------------------


@styled
def bias_over_mean(report: Report) -> Figure:
    """The measured bias with its interval over the true mean, both in units of the pixel's range, and the prediction."""
    figure, (axes,) = panels(10, 3.6)
    spots = [_spot(case, report.cases) for case in report.cases if case.mean is not None]
    band = max((spot.tolerance for spot in spots), default=0.0)
    axes.axhspan(-band, band, color=MUTED, alpha=0.16, linewidth=0, label="tolerance")
    zero_line(axes)
    line = predicted_curve(report)
    if line:
        axes.plot(*zip(*line, strict=True), color=INK, linewidth=1.2, label="predicted, 0 and 1")
    for verdict, (colour, marker) in LOOKS.items():
        found = [spot for spot in spots if spot.verdict is verdict]
        if found:
            reach = np.array([spot.reach for spot in found]).T
            look: dict[str, Any] = {"color": colour, "marker": marker, "label": str(verdict), "linestyle": "none"}
            x, y = [spot.mean for spot in found], [spot.bias for spot in found]
            axes.errorbar(x, y, yerr=reach, capsize=2.5, elinewidth=1.2, zorder=3, **look)
    rings = [(spot.mean, spot.predicted) for spot in spots if spot.predicted is not None]
    if rings:
        ring: dict[str, Any] = {"linestyle": "none", "marker": "o", "markerfacecolor": "none", "markersize": 9}
        axes.plot(*zip(*rings, strict=True), color=INK, label="predicted, this pixel", zorder=4, **ring)
    axes.set(xlabel="true mean (the coverage, on black and white pixels)", ylabel="bias", xlim=(-0.01, 1.01))
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


@dataclass(frozen=True, slots=True)
class Spot:
    """A case as it is drawn: everything in units of the range of its pixel, over all channels."""

    verdict: Verdict
    mean: float
    bias: float
    reach: tuple[float, float]
    predicted: float | None
    tolerance: float


def _spot(case: Case, cases: Sequence[Case]) -> Spot:
    ranges = [each.range for each in cases if each.pixel == case.pixel]
    low, high = min(low for low, _ in ranges), max(high for _, high in ranges)
    if not math.isfinite(high - low):  # no range: as it is
        low, high = 0, 1
    scale = float(high - low) or 1.0
    bias = (case.mean or 0.0) - float(case.true_mean)
    lower, upper = case.bias_interval
    return Spot(
        case.verdict,
        float(case.true_mean - low) / scale,
        bias / scale,
        (max(0.0, bias - lower) / scale, max(0.0, upper - bias) / scale),
        None if case.declared_bias is None else float(case.declared_bias) / scale,
        float(case.tolerance) / scale,
    )
