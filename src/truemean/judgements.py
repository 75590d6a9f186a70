"""What the command line shows of a judgement, and of a plan for one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.table import Table
from rich.text import Text

from truemean.conformance.checking import Check
from truemean.conformance.planning import RunPlan
from truemean.conformance.verdict import Case, PlanCheck, Report, Verdict
from truemean.output import console, decimal
from truemean.tables import show, table_of

__all__ = ["print_checks", "print_judgement", "print_run_plan"]

ROOMY = 105  # columns that the whole table of a judgement takes
STYLES = {
    Verdict.CONFORMS: "green",
    Verdict.BIASED: "red",
    Verdict.INCONCLUSIVE: "yellow",
    Verdict.BROKEN: "magenta",
    PlanCheck.FOLLOWS: "green",
    PlanCheck.DEVIATES: "red",
}


def print_judgement(report: Report) -> None:
    """A row for each case, then what is not decided, what was skipped, and the verdict in a sentence."""
    told = {"plan": "plan_check", "cost": "cost"}
    hidden = {name for name, field in told.items() if all(getattr(case, field) is None for case in report.cases)}
    if console().width < ROOMY:
        hidden |= {"true mean I", "std", "cost"}
    rows = [{name: text for name, text in _row(case).items() if name not in hidden} for case in report.cases]
    table = table_of(*(rows[0] if rows else ()))
    for row in rows:
        table.add_row(*row.values())
    if rows:
        show(table)
    if report.regions:
        show(_regions(report))
    for case in report.cases:
        if case.verdict in (Verdict.INCONCLUSIVE, Verdict.BROKEN) or case.plan_check is PlanCheck.DEVIATES:
            show(f"{case.name}: {case.reason}")
    for pixel, why in report.skipped.items():
        show(f"{pixel} skipped: {why}")
    for note in report.notes:
        show(f"note: {note}")
    named = {case.name for case in report.cases if case.verdict is Verdict.BIASED}
    if more := [name for name in report.discoveries if name not in named]:
        show(f"probably biased too, by e-BH (a share of alpha may be wrong): {', '.join(more)}")
    at = f" at a tolerance of {_tolerance(report.arguments['tolerance'])}: {report.subject}; {report.reason}"
    show(_verdict(report.verdict).append(at, style="default"))
    if report.plan_check is PlanCheck.DEVIATES:
        show(_verdict(report.plan_check).append(": it does not follow the plan that it declares", style="default"))


def _row(case: Case) -> dict[str, str | Text]:
    seen = None if case.mean is None else case.mean - float(case.true_mean)
    low, high = (decimal(end, 4) for end in case.bias_interval)
    return {
        "pixel": case.name,
        "verdict": _verdict(case.verdict),
        "plan": _verdict(case.plan_check) if case.plan_check else "-",
        "true mean I": decimal(case.true_mean, 4),
        "mean - I": decimal(seen, 4),
        "E[ξ] - I lies in": f"[{low}, {high}]",
        "std": _measured(case.std, case.declared_std, 3),
        "cost": _measured(case.cost, case.declared_cost, 4),
        "runs": str(case.replicates) if case.exact_bias is None else "exact",
    }


def print_checks(subject: str, checks: Sequence[Check]) -> None:
    """A row for each promise, and how many are kept."""
    table = table_of("promise", "kept", "seen")
    looks = {True: Text("yes", "green"), False: Text("NO", "red"), None: Text("-")}
    for check in checks:
        table.add_row(check.promise, looks[check.kept], check.seen)
    show(table)
    show(f"{sum(check.kept is True for check in checks)} of {len(checks)} promises are kept: {subject}")


def print_run_plan(plan: RunPlan) -> None:
    """What to expect of each case, and what can't be planned."""
    table = table_of(
        "pixel", "tolerance", "declared bias", "std", "expected", "after runs", "finds a bias of", "certifies"
    )
    for case in plan.cases:
        expected = case.verdict_expected
        runs = case.conforms if case.biased is None else case.biased
        table.add_row(
            case.name,
            decimal(case.tolerance, 4),
            decimal(case.declared_bias, 4),
            decimal(case.declared_std, 3),
            _verdict(expected) if isinstance(expected, Verdict) else str(expected),
            "-" if runs is None else str(runs),
            decimal(case.detectable, 3),
            decimal(case.certifiable, 3),
        )
    show(table)
    for pixel, why in plan.skipped.items():
        show(f"{pixel} can't be planned: {why}")
    budget, beta = plan.arguments["budget"], plan.arguments["beta"]
    show(
        f"medians, if the subject has the law of its plan; found and certified with probability {1 - float(beta):g} "
        f"within {budget} replicates"
    )


def _measured(measured: Any, declared: Any, digits: int) -> str:
    """What was measured, and what is declared, of one kind."""
    told = "" if declared is None else f" ({decimal(declared, digits)} declared)"
    return decimal(measured, digits) + told


def _regions(report: Report) -> Table:
    """What each tile or region shows, and how large a bias it could have shown."""
    table = table_of("region", "cases", "verdict", "log evidence", "sees a common bias of", "a bias in one pixel of")
    for region in report.regions:
        verdict = _verdict(Verdict.BIASED) if region.biased else "-"
        sizes = (decimal(region.log_evidence, 3), decimal(region.visible, 3), decimal(region.visible_alone, 3))
        table.add_row(region.name, str(region.cases), verdict, *sizes)
    return table


def _tolerance(given: Any) -> str:
    """A tolerance, or those of each pixel, in words."""
    if not isinstance(given, Mapping):
        return str(given)
    return ", ".join(f"{size} on {'all others' if name == '*' else name}" for name, size in given.items())


def _verdict(word: Verdict | PlanCheck) -> Text:
    return Text(str(word), style=STYLES[word])
