"""What a judgement says: a verdict per case with its evidence, and one for the run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import StrEnum
from fractions import Fraction
from typing import Any

from truemean.conformance.plain import plain

__all__ = ["Case", "PlanCheck", "Report", "Verdict"]

SCHEMA = "truemean-judge/1"


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
    replicates that a verdict would probably take; ``evidence`` the natural logarithms of the e-values
    against E[ξ] <= I + tolerance ("above"), >= I - tolerance ("below"), their opposites ("not_above",
    "not_below") and against the declared plan ("fit").
    """

    pixel: str
    channel: int | None
    verdict: Verdict
    reason: str
    plan_check: PlanCheck | None
    true_mean: Fraction
    tolerance: Fraction
    declared_bias: Fraction | None
    range: tuple[Fraction, Fraction]
    mean: float | None
    bias_interval: tuple[float, float]
    bias_bound: float
    std: float | None
    cost: float | None
    replicates: int
    predicted: int | None
    evidence: Mapping[str, float]

    @property
    def name(self) -> str:
        """The pixel's name, with the channel on a colour pixel."""
        return self.pixel if self.channel is None else f"{self.pixel}[{self.channel}]"

    def to_json(self) -> dict[str, Any]:
        """This case for ``json.dumps``, as `plain` writes it."""
        return {f.name: plain(getattr(self, f.name)) for f in fields(self)}


@dataclass(frozen=True, slots=True)
class Report:
    """The verdict of a run, with its cases, the pixels skipped and why, and everything needed to repeat it."""

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

    def to_json(self) -> dict[str, Any]:
        """The report for ``json.dumps``, as `plain` writes it."""
        body = {f.name: plain(getattr(self, f.name)) for f in fields(self) if f.name != "cases"}
        return {"schema": SCHEMA, **body, "cases": [case.to_json() for case in self.cases]}
