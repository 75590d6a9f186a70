"""What a judgement says: a verdict per case with its evidence, and one for the run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import StrEnum
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from truemean.conformance.plain import plain

if TYPE_CHECKING:
    from truemean.conformance.planning import RunPlan

__all__ = ["Case", "PlanCheck", "Region", "Report", "Verdict"]

SCHEMA = "truemean-judge/1"
PARTS = ("cases", "plan", "regions")  # of a report, with a form of their own in JSON


class Verdict(StrEnum):
    """Whether an implementation has the true mean, as far as its replicates show."""

    BROKEN = "BROKEN"
    BIASED = "BIASED"
    INCONCLUSIVE = "INCONCLUSIVE"
    CONFORMS = "CONFORMS"


class PlanCheck(StrEnum):
    """Whether an implementation follows the plan it declares: it may depart, it can only follow so far."""

    FOLLOWS = "FOLLOWS"
    DEVIATES = "DEVIATES"


@dataclass(frozen=True, slots=True)
class Case:
    """One channel of one pixel: the verdict and what it rests on.

    ``bias_interval`` holds E[ξ] - I at every look with probability 1 - 2 beta, ``bias_bound`` is its
    larger end in absolute value, hence the smallest tolerance certifiable; ``predicted`` the number of
    replicates that a verdict would probably take. ``std`` and ``cost`` are measured, beside them those
    declared. ``evidence`` has the natural logarithms of the e-values against |E[ξ] - I| <= tolerance
    ("biased": of either sign, the one named in ``reason`` is a label outside the error rate), against a bias
    above and below it ("not_above", "not_below"), and against what is declared ("fit"). ``exact_bias`` is E[ξ] - I
    itself, where all paths of the code were run: then there are no replicates, and nothing is left to chance.
    """

    pixel: str
    channel: int | None
    verdict: Verdict
    reason: str
    plan_check: PlanCheck | None
    true_mean: Fraction
    tolerance: Fraction
    declared_bias: Fraction | None
    declared_std: float | None
    declared_cost: Fraction | None
    range: tuple[Fraction, Fraction] | tuple[float, float]
    mean: float | None
    bias_interval: tuple[float, float]
    bias_bound: float
    std: float | None
    cost: float | None
    replicates: int
    predicted: int | None
    evidence: Mapping[str, float]
    exact_bias: Fraction | None = None

    @property
    def name(self) -> str:
        """The pixel's name, with the channel on a colour pixel."""
        return self.pixel if self.channel is None else f"{self.pixel}[{self.channel}]"

    def to_json(self) -> dict[str, Any]:
        """This case for ``json.dumps``, as `plain` writes it."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)}


@dataclass(frozen=True, slots=True)
class Region:
    """A tile or a region: the evidence of its cases, combined.

    ``biased`` says whether some pixel of it is, by Holm over all regions; ``visible`` is the size of a bias
    common to all its cases that would be found there as often as not, ``visible_alone`` that of a bias in
    a single one, both beyond the tolerance and from the replicates drawn and the variance measured.
    """

    name: str
    cases: int
    log_evidence: float
    biased: bool
    visible: float | None
    visible_alone: float | None

    def to_json(self) -> dict[str, Any]:
        """This region for ``json.dumps``, as `plain` writes it."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)}


@dataclass(frozen=True, slots=True)
class Report:
    """The verdict of a run, with its cases, the pixels skipped and why, and everything needed to repeat it.

    ``discoveries`` are the cases that e-BH calls biased: of those named, a share of at most alpha is wrong
    on average, where a verdict BIASED anywhere is wrong with probability at most alpha. ``regions`` are the
    same evidence by tile or region; ``somewhere`` the peak of the combined evidence for any bias at all;
    ``runs`` of the subject took ``seconds``, a run being one replicate of one pixel, or of all that are rendered together;
    ``plan`` is what was to be expected, where a report is to print it.
    """

    subject: str
    verdict: Verdict
    reason: str
    plan_check: PlanCheck | None
    cases: tuple[Case, ...]
    skipped: Mapping[str, str]
    arguments: Mapping[str, Any]
    seed: int
    notes: tuple[str, ...]
    versions: Mapping[str, str]
    interrupted: bool = False
    discoveries: tuple[str, ...] = ()
    regions: tuple[Region, ...] = ()
    somewhere: float = 0.0
    seconds: float = 0.0
    runs: int = 0
    plan: RunPlan | None = None

    def to_json(self) -> dict[str, Any]:
        """The report for ``json.dumps``, as `plain` writes it."""
        body = {f.name: plain(getattr(self, f.name)) for f in fields(self) if f.name not in PARTS}
        parts: dict[str, Any] = {
            name: [part.to_json() for part in getattr(self, name)] for name in ("regions", "cases")
        }
        if self.plan is not None:
            parts["plan"] = self.plan.to_json()
        return {"schema": SCHEMA, **body, **parts}
