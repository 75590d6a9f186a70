"""What was to be expected of a run, from the declared law, beside what came."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from truemean.conformance.planning import CasePlan
from truemean.conformance.report.charts import SERIES, panels, styled
from truemean.conformance.report.document import Cell, Chart, Table
from truemean.conformance.report.wording import decimal
from truemean.conformance.verdict import Case, Report

__all__ = ["expected_parts"]

REACH = 4  # tolerances, on both sides of the power curves


def expected_parts(name: str, report: Report, ident: str) -> list[str | Table | Chart]:
    """A table of replicates planned and taken, and the chances of each verdict over the bias."""
    if report.plan is None:
        return []
    plans = report.plan.cases
    by_name = {case.name: case for case in report.cases}
    budget = report.plan.arguments["budget"]
    sure = 1 - float(report.plan.arguments["beta"])
    caption = (
        f"{name}: what was to be expected before the run, if it follows its plan. Replicates are medians; within "
        f"{budget:,} replicates a bias of the size shown is found, and that tolerance certified, with probability {sure:g}."
    )
    head = (
        "pixel",
        "expected",
        "replicates planned",
        "replicates taken",
        "finds a bias of",
        "certifies a tolerance of",
    )
    rows = tuple(_row(plan, by_name[plan.name]) for plan in plans if plan.name in by_name)
    parts: list[str | Table | Chart] = [Table(f"{ident}-expected", caption, head, rows)]
    curved = [plan for plan in plans if plan.tolerance and plan.declared_std]
    if curved:
        seen = (
            f"How likely each verdict is within {budget:,} replicates, over the bias in units of the tolerance, a line a "
            "case: BIASED rises outside of it, CONFORMS inside; between them a bias stays undecided."
        )
        parts.append(Chart(f"{ident}-power", f"{name}: what this run can see", seen, _power(curved)))
    return parts


def _row(plan: CasePlan, case: Case) -> tuple[Cell, ...]:
    needed = plan.conforms if plan.biased is None else plan.biased
    return (
        Cell(plan.name),
        Cell(str(plan.verdict_expected)),
        Cell("–" if needed is None else f"{needed:,}", (), "number"),
        Cell(f"{case.replicates:,}", (), "number"),
        Cell(decimal(plan.detectable), (), "number"),
        Cell(decimal(plan.certifiable), (), "number"),
    )


@styled
def _power(plans: list[CasePlan]) -> Figure:
    figure, (axes,) = panels(10, 3.2)
    for number, plan in enumerate(plans):
        room = [float(plan.outlook.room(sign)) for sign in (-1, 1)]
        unit = float(plan.tolerance)
        biases = np.linspace(max(-room[0], -REACH * unit), min(room[1], REACH * unit), 97)
        budget = plan.outlook.levels.budget
        for found, colour, label in (
            (plan.outlook.biased(biases, budget), SERIES[1], "BIASED"),
            (plan.outlook.conforms(biases, budget), SERIES[2], "CONFORMS"),
        ):
            axes.plot(biases / unit, found, color=colour, alpha=0.6, linewidth=1.2, label=None if number else label)
    axes.set(xlabel="bias in units of the tolerance", ylabel="probability", ylim=(-0.03, 1.03))
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure
