"""One channel of one pixel on trial: the evidence so far, and the verdict once there is one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction

import numpy as np

from truemean.conformance.declared import Declared
from truemean.conformance.evidence import (
    EProcess,
    Evidence,
    FloatArray,
    Outcomes,
    best_fraction,
    growth,
    hybrid,
    lower_end,
    variance_fraction,
)
from truemean.conformance.fit import LawFit, MeanFit
from truemean.conformance.target import Target
from truemean.conformance.verdict import Case, PlanCheck, Verdict

__all__ = ["Levels", "Trial"]

EVIDENCE = ("above", "below", "not_above", "not_below", "fit")


@dataclass(frozen=True, slots=True)
class Levels:
    """Error rates of one case: ``biased`` for both signs together, ``deviates``, ``conforms`` per edge."""

    biased: float
    deviates: float
    conforms: float
    budget: int


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """The evidence on one case, a value: `observe` returns the trial after one more look."""

    target: Target
    levels: Levels
    above: Evidence
    below: Evidence
    not_above: Evidence
    not_below: Evidence
    declared: Declared | None = None
    fit: EProcess | None = None
    outcomes: Outcomes = field(default_factory=Outcomes)
    cost: float | None = None
    verdict: Verdict | None = None
    reason: str = ""

    @classmethod
    def open(cls, target: Target, levels: Levels, declared: Declared | None = None) -> Trial:
        """No replicates drawn: every bet is placed here, before the run."""
        edges = [target.edge(sign, target.tolerance + target.slack) for sign in (1, -1)]
        above, below = (Evidence.against(edge, hybrid(edge, levels.biased / 2, levels.budget)) for edge in edges)
        not_below, not_above = (_within(target, levels, declared, sign) for sign in (1, -1))
        fit = _fit(target, levels, declared) if declared else None
        return cls(target, levels, above, below, not_above, not_below, declared, fit)

    @property
    def log_biased(self) -> float:
        """The current evidence for a bias of either sign: the average of both e-values."""
        return float(np.logaddexp(self.above.log_evidence, self.below.log_evidence)) - math.log(2)

    @property
    def plan_check(self) -> PlanCheck | None:
        """Whether the declared plan is followed, so far; None when nothing could be compared."""
        if self.fit is None or not self.outcomes.total:
            return None
        deviates = self.fit.peak >= -math.log(self.levels.deviates)
        return PlanCheck.DEVIATES if deviates else PlanCheck.FOLLOWS

    def broken(self, reason: str) -> Trial:
        """The trial of an estimator that broke here; the evidence is kept."""
        return replace(self, verdict=Verdict.BROKEN, reason=reason)

    def observe(self, estimates: FloatArray, cost: float | None = None) -> Trial:
        """The trial after one more look at more estimates, of total ``cost``."""
        y, counts = np.unique(self.target.outcomes(estimates), return_counts=True)
        number = counts.astype(float)
        return _decide(
            replace(
                self,
                above=self.above.update(y, number),
                below=self.below.update(1 - y, number),
                not_above=self.not_above.update(1 - y, number),
                not_below=self.not_below.update(y, number),
                fit=self.fit and self.fit.update(y, number),
                outcomes=self.outcomes.update(y, number),
                cost=None if cost is None else (self.cost or 0.0) + cost,
            )
        )

    def interval(self) -> tuple[float, float]:
        """The anytime interval of E[ξ] - I at 1 - 2 beta, cut at the edges that were once ruled out."""
        target, asked = self.target, -math.log(self.levels.conforms)
        low, high = 0.0, 1.0
        if self.outcomes.total:
            low = lower_end(self.outcomes, self.not_below.bets, self.levels.conforms)
            high = 1 - lower_end(self.outcomes.mirrored(), self.not_above.bets, self.levels.conforms)
        width, slack, tolerance = float(target.width), float(target.slack), float(target.tolerance)
        centre = target.scaled(target.true_mean)
        high = min(high, target.scaled(target.high))
        lower, upper = width * (low - centre) - slack, width * (high - centre) + slack
        return (
            max(lower, -tolerance) if self.not_below.peak >= asked else lower,
            min(upper, tolerance) if self.not_above.peak >= asked else upper,
        )

    def predicted(self) -> int | None:
        """How many replicates a verdict would take, from the declared law or else from the outcomes."""
        y, law = self.outcomes.values, self.outcomes.counts / max(1, self.outcomes.total)
        if self.declared and self.declared.law:
            y, law = _scaled_law(self.target, self.declared.law)
        if not y.size:
            return None
        within = min(growth(y, law, self.not_below.mean), growth(1 - y, law, self.not_above.mean))
        beyond = max(growth(y, law, self.above.mean), growth(1 - y, law, self.below.mean))
        needs = ((-math.log(self.levels.conforms), within), (-math.log(self.levels.biased / 2), beyond))
        counts = [math.ceil(1.3 * nats / rate) for nats, rate in needs if rate > 0]
        return max(min(counts), self.outcomes.total + 1) if counts else None

    def case(self, ended: str) -> Case:
        """What the report says; ``ended`` is why an undecided trial drew no more replicates."""
        target, declared, total = self.target, self.declared, self.outcomes.total
        width = float(target.width)
        lower, upper = self.interval()
        predicted = None if self.verdict else self.predicted()
        return Case(
            pixel=target.pixel,
            channel=target.channel,
            verdict=self.verdict or Verdict.INCONCLUSIVE,
            reason="; ".join(self._reasons(ended, (lower, upper), predicted)),
            plan_check=self.plan_check,
            true_mean=target.true_mean,
            tolerance=target.tolerance,
            declared_bias=declared.bias if declared else None,
            range=(target.low, target.high),
            mean=float(target.low) + width * self.outcomes.mean if total else None,
            bias_interval=(lower, upper),
            bias_bound=max(-lower, upper),
            std=width * math.sqrt(self.outcomes.squares / (total - 1)) if total > 1 else None,
            cost=None if self.cost is None else self.cost / total,
            replicates=total,
            predicted=predicted,
            evidence={name: e.log_evidence for name in EVIDENCE if (e := getattr(self, name)) is not None},
        )

    def _reasons(self, ended: str, interval: tuple[float, float], predicted: int | None) -> Iterator[str]:
        if self.verdict:
            yield self.reason
        elif not self.outcomes.total:
            yield f"{ended} before a replicate was drawn"
        else:
            yield f"{ended}, E[ξ] - I lies in [{interval[0]:.4g}, {interval[1]:.4g}]"
            yield f"the smallest tolerance certifiable is {max(-interval[0], interval[1]):.4g}"
            yield (
                f"about {predicted} replicates would decide"
                if predicted
                else "no number of replicates is likely to decide"
            )
        if self.plan_check is PlanCheck.DEVIATES:
            yield "the estimates do not have the law of the declared plan"
        if self.declared and self.declared.note:
            yield f"declared plan: {self.declared.note}"


def _decide(trial: Trial) -> Trial:
    """The trial with the first verdict that its evidence allows."""
    tolerance = float(trial.target.tolerance)
    asked = -math.log(trial.levels.biased / 2)
    for side, sign, now in (("above", "+", trial.above.log_evidence), ("below", "-", trial.below.log_evidence)):
        if now >= asked:
            reason = f"E[ξ] lies {side} I {sign} {tolerance:.6g}: evidence e^{now:.1f} where e^{asked:.1f} is asked"
            return replace(trial, verdict=Verdict.BIASED, reason=reason)
    if min(trial.not_above.peak, trial.not_below.peak) >= -math.log(trial.levels.conforms):
        return replace(trial, verdict=Verdict.CONFORMS, reason=f"E[ξ] lies within {tolerance:.6g} of I")
    return trial


def _within(target: Target, levels: Levels, declared: Declared | None, sign: int) -> Evidence:
    """The evidence that E[ξ] >= I - tolerance (``sign`` 1), or <= I + tolerance (-1).

    Where the range itself implies it nothing can speak against it; where the tolerance is no larger
    than the slack nothing can show it.
    """
    reached = (sign * target.true_mean) - target.tolerance <= (target.low if sign > 0 else -target.high)
    edge = target.edge(sign, target.slack - target.tolerance)
    bets = hybrid(edge, levels.conforms, levels.budget).favouring(_oracle_fraction(target, declared, sign, edge), 0.8)
    shown = -math.inf if reached else edge if target.tolerance > target.slack else math.inf
    return Evidence.against(shown, bets)


def _oracle_fraction(target: Target, declared: Declared | None, sign: int, edge: float) -> float:
    """The bet that the declared plan suggests: knowledge goes into bets, never into validity."""
    if declared is None or edge <= 0:
        return 0.0
    if declared.law is not None:
        y, law = _scaled_law(target, declared.law)
        return best_fraction(y if sign > 0 else 1 - y, law, edge)
    if declared.bias is not None and declared.variance is not None:
        distance = target.edge(sign, sign * declared.bias) - edge
        return variance_fraction(distance, float(declared.variance / target.width**2), edge)
    return 0.0


def _fit(target: Target, levels: Levels, declared: Declared) -> LawFit | MeanFit | None:
    slack = float(target.slack / target.width)
    if declared.law is not None:
        law = {(atom - target.low) / target.width: mass for atom, mass in declared.law.items()}
        return LawFit.to(law, slack, levels.deviates, levels.budget)
    if declared.bias is not None:
        return MeanFit.to(target.scaled(target.true_mean + declared.bias), slack, levels.deviates, levels.budget)
    return None


def _scaled_law(target: Target, law: Mapping[Fraction, Fraction]) -> tuple[FloatArray, FloatArray]:
    atoms = np.array([target.scaled(atom) for atom in law])
    return np.clip(atoms, 0.0, 1.0), np.array([float(mass) for mass in law.values()])
