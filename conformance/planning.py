"""What a run will show, before anything runs: replicates to a verdict, and the smallest bias found at a budget."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from fractions import Fraction
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np

from truemean.conformance.declared import read_declaration, read_law
from truemean.conformance.evidence import FloatArray
from truemean.conformance.outlook import Outlook, Unplanned, outlook_of
from truemean.conformance.plain import plain
from truemean.conformance.replicates import attribute
from truemean.conformance.settings import Settings, read_pixels
from truemean.conformance.verdict import Report, Verdict
from truemean.errors import InputError, SubjectError, Unsupported
from truemean.oracle.exact import exact_number
from truemean.oracle.pixel import Pixel
from truemean.subject import as_estimator

__all__ = ["CasePlan", "RunPlan", "plan_run", "planned"]

SCHEMA = "truemean-plan/1"
ARGUMENTS = ("tolerance", "alpha", "beta", "budget", "declares", "range")
MANY = 1e15  # replicates; what takes more is never reached


@dataclass(frozen=True, slots=True, eq=False)
class CasePlan:
    """What to expect on one channel of one pixel, if the estimator has its declared law.

    ``conforms`` and ``biased`` are the replicates until that verdict in the median, None where it is never
    reached; ``verdict_expected`` is what the budget gives in the median, "boundary" where no number of
    replicates gives any. At the budget and with probability 1 - beta, every bias beyond ``detectable`` is
    found (of either sign; None if the range holds one that is not) and ``certifiable`` is the smallest
    tolerance that would be certified (None if none is). Numbers are in units of the pixel.
    """

    pixel: str
    channel: int | None
    tolerance: Fraction
    declared_bias: Fraction
    declared_std: float
    conforms: int | None
    biased: int | None
    verdict_expected: Verdict | Literal["boundary"]
    detectable: float | None
    certifiable: float | None
    outlook: Outlook = field(repr=False)

    @property
    def name(self) -> str:
        """The pixel's name, with the channel on a colour pixel."""
        return self.pixel if self.channel is None else f"{self.pixel}[{self.channel}]"

    def power(self, bias: Any) -> float:
        """P(BIASED at the budget) for a law with this bias; InputError for a bias that the range rules out."""
        number = float(exact_number(bias, "bias"))
        least, most = -self.outlook.room(-1), self.outlook.room(1)
        if not least <= number <= most:
            raise InputError(f"bias={bias!r} is impossible: the range leaves biases in [{least:g}, {most:g}]")
        return float(self.outlook.biased(np.array([number]), self.outlook.levels.budget)[0])

    def power_curve(self, points: int = 25) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Biases, P(BIASED) and P(CONFORMS) at the budget, ``[points]`` each, out to where BIASED is nearly sure."""
        if points < 2:
            raise InputError(f"points={points!r} is no curve: give at least 2")
        far = 1.5 * max(self.detectable or 0.0, float(self.tolerance)) or math.inf
        ends = [sign * min(far, max(0.0, self.outlook.room(sign))) for sign in (-1, 1)]
        biases = np.linspace(ends[0], ends[1], points)
        budget = self.outlook.levels.budget
        return biases, self.outlook.biased(biases, budget), self.outlook.conforms(biases, budget)

    def to_json(self) -> dict[str, Any]:
        """This case for ``json.dumps``, as `plain` writes it."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self) if f.name != "outlook"}


def _case_plan(outlook: Outlook, power: float) -> CasePlan:
    target, budget = outlook.target, outlook.levels.budget
    own = np.array([float(outlook.bias)])

    def median(probability: Callable[[FloatArray, FloatArray], FloatArray]) -> int | None:
        n = _smallest(lambda n: probability(own, n) >= 0.5, 1.0, MANY)
        return None if n is None else math.ceil(n)

    conforms, biased = median(outlook.conforms), median(outlook.biased)
    expected: Verdict | Literal["boundary"] = Verdict.INCONCLUSIVE
    if (conforms or biased or math.inf) <= budget:
        expected = Verdict.CONFORMS if conforms else Verdict.BIASED
    elif not (conforms or biased) and target.tolerance > target.slack:
        expected = "boundary"
    deviation = math.sqrt(outlook.masses @ (outlook.values - outlook.values @ outlook.masses) ** 2)
    return CasePlan(
        pixel=target.pixel,
        channel=target.channel,
        tolerance=target.tolerance,
        declared_bias=outlook.bias,
        declared_std=float(target.width) * deviation,
        conforms=conforms,
        biased=biased,
        verdict_expected=expected,
        detectable=_detectable(outlook, power),
        certifiable=_certifiable(outlook, power),
        outlook=outlook,
    )


def _detectable(outlook: Outlook, power: float) -> float | None:
    """The smallest bias beyond which BIASED is reached at the budget, of the sign that is harder to find."""
    edge, budget = float(outlook.target.tolerance + outlook.target.slack), outlook.levels.budget

    def least(sign: int, beyond: float) -> float | None:
        return _smallest(lambda d: outlook.biased(sign * (edge + d), budget) >= power, 1e-9 * beyond, beyond)

    found = [least(sign, beyond) for sign in (1, -1) if (beyond := outlook.room(sign) - edge) > 0]
    return max((edge + d for d in found if d), default=None) if all(found) else None


def _certifiable(outlook: Outlook, power: float) -> float | None:
    """The smallest tolerance that CONFORMS is reached at within the budget."""
    own, budget = np.array([float(outlook.bias)]), outlook.levels.budget
    most = max(outlook.room(1), outlook.room(-1))
    least = min(most, max(float(outlook.target.slack), 1e-9 * most))
    return _smallest(lambda t: outlook.conforms(own, budget, t) >= power, least, most) if most > 0 else 0.0


def _smallest(holds: Callable[[FloatArray], Any], low: float, high: float) -> float | None:
    """The least x in [low, high] beyond which ``holds``, to about 0.5 %; None if not at ``high``."""
    for points in (40, 20, 12):
        grid = np.geomspace(low, high, points)
        fails = np.flatnonzero(~holds(grid))
        if not fails.size:
            return low
        if fails[-1] == points - 1:
            return None
        low, high = grid[fails[-1]], grid[fails[-1] + 1]
    return float(high)


# -- the run --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class RunPlan:
    """What to expect of a run: its cases, the pixels that can't be planned and why, and the arguments."""

    cases: tuple[CasePlan, ...]
    skipped: Mapping[str, str]
    arguments: Mapping[str, Any]

    def to_json(self) -> dict[str, Any]:
        """The plan for ``json.dumps``, as `plain` writes it."""
        cases = [case.to_json() for case in self.cases]
        return {"schema": SCHEMA, "cases": cases, "skipped": plain(self.skipped), "arguments": plain(self.arguments)}


def plan_run(
    subject: Any,
    *,
    tolerance: Any,
    alpha: float = 1e-2,
    beta: float = 1e-2,
    budget: int = 100_000,
    pixels: Any = None,
    declares: Any = None,
    range: Any = None,  # noqa: A002 - the word that estimators use too
) -> RunPlan:
    """How many replicates `judge` will take, and what it can find at ``budget``, from the law and not from a run.

    ``subject`` is an estimator that declares its plan (None with ``declares``), or the law of its estimates on
    one pixel, a mapping outcome -> probability: of mean I, or on the Pixel given. The other arguments are those
    of `judge`. Replicate numbers are medians, usually right to a factor of 1.5. Raises InputError for a law that
    does not sum to 1, an estimator that declares nothing, and arguments that can't be meant.

    >>> plan = plan_run({0: "1/2", 1: "1/2"}, tolerance="5%")
    >>> 1000 < plan.cases[0].conforms < 1300, str(plan.cases[0].verdict_expected)
    (True, 'CONFORMS')
    >>> biased = plan_run(None, declares=("kirk-arvo", {"n": 8}), pixels=Pixel.two("1/8"), tolerance="1%")
    >>> biased.cases[0].conforms, 100 < biased.cases[0].biased < 400
    (None, True)
    """
    estimator, pixels = _read_subject(subject, pixels)
    plan = read_declaration(attribute(estimator, "declares") if declares is None else declares)
    settings = Settings(tolerance, alpha, beta, budget, declaration=plan, range=range)
    if not settings.declares(estimator):
        raise InputError(f"subject={subject!r} declares no plan: give declares=(plan, params), or a law as subject")
    chosen = read_pixels(estimator, pixels)
    names = tuple(each.name for each in chosen)
    settings.check_tolerances(names)
    levels = settings.levels(estimator, sum(each.channels for each in chosen))
    cases: list[CasePlan] = []
    skipped: dict[str, str] = {}
    for each in chosen:
        try:
            targets, known = settings.targets(estimator, each), settings.declared(estimator, each) or ()
            outlooks = [outlook_of(t, levels, declared) for t, declared in zip(targets, known, strict=True)]
        except (Unsupported, SubjectError, Unplanned) as why:
            skipped[each.name] = str(why)
        else:
            cases += [_case_plan(outlook, 1 - beta) for outlook in outlooks]
    if skipped and isinstance(subject, Mapping):
        raise InputError("; ".join(f"law={subject!r:.80} on pixel {name!r}: {why}" for name, why in skipped.items()))
    arguments = {name: settings.arguments()[name] for name in ARGUMENTS} | {"pixels": names}
    return RunPlan(tuple(cases), skipped, arguments)


def planned(report: Report, subject: Any, pixels: Any = None, declares: Any = None, bounds: Any = None) -> Report:
    """The report with what was to be expected of its run beside; as it is where that can't be said.

    That is so where the subject declares nothing, and for what `plan_run` does not model: another method,
    suspects, and independent pixels.
    """
    if report.arguments["method"] != "focus" or report.arguments["suspects"] or report.arguments["independent"]:
        return report
    asked = {name: report.arguments[name] for name in ("tolerance", "alpha", "beta", "budget")}
    try:
        return replace(report, plan=plan_run(subject, pixels=pixels, declares=declares, range=bounds, **asked))
    except InputError:
        return report


def _read_subject(subject: Any, pixels: Any) -> tuple[Any, Any]:
    """An estimator, and its pixels; a law is one that predicts it, by default on a pixel of that law."""
    if not isinstance(subject, Mapping):
        return None if subject is None else as_estimator(subject), pixels
    law = read_law(subject)
    return SimpleNamespace(predicts=lambda _: {"law": law}), {"law": Pixel(law)} if pixels is None else pixels
