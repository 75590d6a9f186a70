"""Verdicts on implementations, beside what the oracle predicts for the plans they declare."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from truemean.conformance.judge import judge
from truemean.conformance.report.charts import INK, MUTED, SERIES, panels, styled, zero_line
from truemean.conformance.report.document import Cell, Chart, Chip, Section, Table
from truemean.conformance.report.wording import counted, decimal, exact, listed, signed
from truemean.conformance.verdict import Case, Report, Verdict
from truemean.errors import NeedsScene, PlanError
from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue

__all__ = ["headline", "judge_all", "judged_parts", "section"]

REPLICATES, FRAMES = 100_000, 20_000  # a frame renders all pixels of a scene and takes milliseconds
CURVE = 48
LOOKS = {
    Verdict.BIASED: (SERIES[1], "o"),
    Verdict.CONFORMS: (SERIES[2], "s"),
    Verdict.INCONCLUSIVE: (SERIES[4], "^"),
    Verdict.BROKEN: (SERIES[5], "X"),
}


def judge_all(
    subjects: Mapping[str, Any], tolerance: str, seed: int, progress: Callable[[str, float], None]
) -> dict[str, Report]:
    """Each subject judged at ``tolerance``; ``progress(text, share)`` goes from 0 to the number of subjects."""
    found = {}
    for number, (name, subject) in enumerate(subjects.items()):
        budget = FRAMES if callable(getattr(subject, "run_many", None)) else REPLICATES

        def look(pixel: str, drawn: int, waiting: int, before: int = number, of: str = name, most: int = budget) -> None:
            progress(f"judging {of}: {pixel}, {counted(drawn, 'replicate')}", before + min(1.0, drawn / most))

        found[name] = judge(subject, tolerance=tolerance, seed=seed, budget=budget, progress=look)
    return found


# -- in words -------------------------------------------------------------------------------------


def headline(reports: Mapping[str, Report], tolerance: str) -> str:
    """The verdicts in one sentence."""
    said = [f"{name} {_outcome(report)}" for name, report in reports.items()]
    if not said:
        return "No implementation was judged; the plans are compared below."
    return f"At a tolerance of {tolerance.replace('%', ' %')} of a pixel’s range, {'; '.join(said)}."


def _outcome(report: Report) -> str:
    cases = sum(case.verdict is report.verdict for case in report.cases)
    verb = "" if report.verdict is Verdict.CONFORMS else "is "
    return f"{verb}{report.verdict} in {cases} of {counted(len(report.cases), 'case')}"


def predicted_right(report: Report) -> tuple[int, int]:
    """How many of the cases with a prediction hold it in their interval, and how many have one."""
    pairs = [(case.declared_bias, case.bias_interval) for case in report.cases if case.declared_bias is not None]
    return sum(low <= bias <= high for bias, (low, high) in pairs), len(pairs)


def _declared(report: Report) -> str:
    plan = report.arguments["declares"]
    if plan is None:
        return "none"
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


def section(reports: Mapping[str, Report], tolerance: str) -> Section:
    """A summary, then chart and table for each subject."""
    parts: list[str | Table | Chart] = [
        f"Each implementation was run on its own code and judged by its replicates alone, at a tolerance of {tolerance} "
        "of each pixel’s range. The evidence is valid whenever one looks at it: a wrong BIASED anywhere in a run has "
        "probability at most 1 %, a wrong CONFORMS at most 1 % a case. The oracle’s prediction is shown beside; it had "
        "no vote. INCONCLUSIVE is published as it is: more replicates would decide.",
    ]
    if reports:
        parts.append(_summary(reports))
    for number, (name, report) in enumerate(reports.items(), 1):
        parts += judged_parts(name, report, f"subject-{number}")
    data = {name: report.to_json() for name, report in reports.items()}
    return Section("verdicts", "Do implementations have the true mean?", tuple(parts), data)


def _summary(reports: Mapping[str, Report]) -> Table:
    rows = []
    for name, report in reports.items():
        counts = Counter(case.verdict for case in report.cases)
        right, known = predicted_right(report)
        rows.append(
            (
                Cell(name),
                _chip(report.verdict),
                Cell(", ".join(f"{counts[verdict]} {verdict}" for verdict in Verdict if counts[verdict]) or "none"),
                Cell(_declared(report)),
                Cell(f"{right} of {known}" if known else "–", (), "number"),
            )
        )
    head = ("implementation", "verdict", "cases", "declared plan", "intervals that hold the prediction")
    return Table("verdict-summary", "The verdict on each implementation is the first of its cases’ in this order: "
                 "BROKEN, BIASED, INCONCLUSIVE, CONFORMS.", head, tuple(rows))


def judged_parts(name: str, report: Report, ident: str) -> list[str | Table | Chart]:
    """What there is to see of one subject: a chart, its cases, and the cases that it skipped."""
    parts: list[str | Table | Chart] = []
    if report.cases:
        parts.append(Chart(f"{ident}-chart", f"{name}: measured bias", _sight(report), bias_over_mean(report)))
        parts.append(_cases(name, report, ident))
    if report.skipped:
        rows = tuple((Cell(pixel), Cell(why)) for pixel, why in report.skipped.items())
        parts.append(Table(f"{ident}-skipped", f"{name}: pixels that it declined.", ("pixel", "why"), rows))
    return parts


def _sight(report: Report) -> str:
    right, known = predicted_right(report)
    plan = f" The line is what the oracle predicts for {_declared(report)}; " if known else ""
    holds = f"{right} of {counted(known, 'interval')} hold the prediction for their pixel." if known else ""
    by_verdict = Counter(case.verdict for case in report.cases)
    return f"{listed([f'{by_verdict[v]} {v}' for v in Verdict if by_verdict[v]])}: the band is the tolerance.{plan}{holds}"


def _cases(name: str, report: Report, ident: str) -> Table:
    head = ("pixel", "true mean", "measured mean", "interval of the bias", "predicted bias", "verdict", "declared plan", "replicates")
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
        Chip(str(case.verdict), () if decided else (case.reason,), case.verdict.lower()),
        _chip(case.plan_check) if case.plan_check else Cell("–"),
        Cell(f"{case.replicates:,}", (), "number"),
    )


def _chip(word: Any) -> Chip:
    return Chip(str(word), (), str(word).lower())


# -- chart ----------------------------------------------------------------------------------------


@styled
def bias_over_mean(report: Report) -> Figure:
    """The measured bias with its interval over the true mean, both in units of the range, and the prediction."""
    figure, (axes,) = panels(7.2, 3.2)
    cases = [case for case in report.cases if case.mean is not None]
    tolerances = [float(case.tolerance / _width(case)) for case in cases]
    band = max(tolerances, default=0.0)
    axes.axhspan(-band, band, color=MUTED, alpha=0.16, linewidth=0, label="tolerance")
    zero_line(axes)
    _predict(axes, report, cases)
    for verdict, (colour, marker) in LOOKS.items():
        found = [case for case in cases if case.verdict is verdict]
        if found:
            _plot_cases(axes, found, color=colour, marker=marker, label=str(verdict))
    axes.set(xlabel="true mean (coverage, on black and white pixels)", ylabel="bias", xlim=(0, 1))
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _width(case: Case) -> Fraction:
    return (case.range[1] - case.range[0]) or Fraction(1)


def _place(case: Case) -> float:
    return float((case.true_mean - case.range[0]) / _width(case))


def _plot_cases(axes: Axes, cases: Sequence[Case], **look: Any) -> None:
    widths = [float(_width(case)) for case in cases]
    centres = [((case.mean or 0) - float(case.true_mean)) / w for case, w in zip(cases, widths, strict=True)]
    ends = [(case.bias_interval[0] / w, case.bias_interval[1] / w) for case, w in zip(cases, widths, strict=True)]
    reach = np.array([(max(0, c - low), max(0, high - c)) for c, (low, high) in zip(centres, ends, strict=True)]).T
    places = [_place(case) for case in cases]
    axes.errorbar(places, centres, yerr=reach, linestyle="none", capsize=2, elinewidth=1.2, zorder=3, **look)


def _predict(axes: Axes, report: Report, cases: Sequence[Case]) -> None:
    """The bias of the declared plan: a line for black and white pixels, a ring for each case."""
    line = predicted_curve(report)
    if line:
        axes.plot(*zip(*line, strict=True), color=INK, linewidth=1.2, label="predicted, 0 and 1")
    known = [case for case in cases if case.declared_bias is not None]
    places, biases = [_place(c) for c in known], [float((c.declared_bias or 0) / _width(c)) for c in known]
    if known:
        ring = {"linestyle": "none", "marker": "o", "markerfacecolor": "none", "markersize": 9}
        axes.plot(places, biases, color=INK, label="predicted, this pixel", zorder=4, **ring)
