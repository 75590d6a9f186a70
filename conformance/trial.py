"""One channel of one pixel on trial: the evidence so far, and the verdict once there is one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction

import numpy as np

from truemean.conformance.declared import Declared
from truemean.conformance.evidence import (
    Batch,
    Blend,
    Bounded,
    EProcess,
    FloatArray,
    Mixture,
    Outcomes,
    edge_of,
    growth,
)
from truemean.conformance.fit import LawFit
from truemean.conformance.openings import Levels, end_bets, open_biased, open_fit, open_within, scaled_law
from truemean.conformance.target import Target
from truemean.conformance.verdict import Case, PlanCheck, Verdict
from truemean.errors import InputError

__all__ = ["Trial"]

EVIDENCE = ("biased", "not_above", "not_below", "fit")
LEAST_LOOK, LOOK_GROWTH = 4, 0.05  # evidence looks at so many outcomes, or at this share of those before, at a time


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """The evidence on one case, a value: `observe` returns the trial after more replicates."""

    target: Target
    levels: Levels
    biased: EProcess
    not_above: EProcess
    not_below: EProcess
    declared: Declared | None = None
    fit: EProcess | None = None
    shared: tuple[Mixture, Mixture] | None = None
    outcomes: Outcomes = field(default_factory=Outcomes)
    cost: float | None = None
    verdict: Verdict | None = None
    reason: str = ""

    @classmethod
    def open(
        cls,
        target: Target,
        levels: Levels,
        declared: Declared | None = None,
        suspects: Mapping[str, Declared] | None = None,
        method: str = "focus",
        *,
        sums: bool = False,
    ) -> Trial:
        """No replicates drawn: every bet is placed here, before the run.

        ``sums``: it is to `observe_sums`, so that of what is declared the mean alone can be compared. InputError for
        a target without a range, where sums say nothing.
        """
        if sums and target.range is None:
            raise InputError(
                f"the estimates of pixel {target.pixel!r} have no finite range, and sums of them show nothing without: "
                "declare a range (lo, hi)"
            )
        told = declared and (replace(declared, law=None, variance=None) if sums else declared)
        suspected = {**({"the declared plan": declared} if declared else {}), **(suspects or {})}
        return cls(
            target,
            levels,
            open_biased(target, levels, method, suspected),
            open_within(target, levels, method, declared, -1),
            open_within(target, levels, method, declared, 1),
            declared,
            open_fit(target, told, levels, method if sums else "focus") if told else None,
            outcomes=Outcomes() if target.range else Outcomes(limit=None),
        )

    @property
    def replicates(self) -> int:
        """How many were observed."""
        return int(self.outcomes.moments.total)

    @property
    def plan_check(self) -> PlanCheck | None:
        """Whether what is declared is followed, so far; None when nothing could be compared."""
        if self.fit is None or not self.replicates:
            return None
        deviates = self.fit.peak >= -math.log(self.levels.deviates)
        return PlanCheck.DEVIATES if deviates else PlanCheck.FOLLOWS

    def broken(self, reason: str) -> Trial:
        """The trial of an estimator that broke here; the evidence is kept."""
        return replace(self, verdict=Verdict.BROKEN, reason=reason)

    def relaxed(self, level: float) -> Trial:
        """The trial when more of alpha has become free for it; a verdict is never changed."""
        return _decide(replace(self, levels=replace(self.levels, biased=level)))

    def observe(self, estimates: FloatArray, cost: float | None = None) -> Trial:
        """The trial after more estimates, of total ``cost``; evidence looks at them a few at a time, in their order."""
        trial, y, start = self, self.target.outcomes(estimates), 0
        while start < y.size:
            stop = start + max(LEAST_LOOK, math.ceil((self.replicates + start) * LOOK_GROWTH))
            trial, start = trial._look(Batch.of(y[start:stop])), stop
        return replace(trial, cost=None if cost is None else (self.cost or 0.0) + cost)

    def observe_sums(self, sums: FloatArray, cost: float | None = None) -> Trial:
        """The trial after groups of replicates of which only counts, means and mean squares are known, ``[3, groups]``.

        Evidence looks at one group at a time, at several where they are few beside those before. Constant bets
        gain by them, bets that learn say nothing.
        """
        trial, seen, start = self, self.replicates + np.cumsum(sums[0]), 0
        while start < seen.size:
            before = seen[start - 1] if start else self.replicates
            stop = int(np.searchsorted(seen, before * (1 + LOOK_GROWTH))) + 1
            trial, start = trial._look(self.target.sums(sums[:, start:stop])), stop
        return replace(trial, cost=None if cost is None else (self.cost or 0.0) + cost)

    def _look(self, batch: Batch) -> Trial:
        return _decide(
            replace(
                self,
                biased=self.biased.update(batch),
                not_above=self.not_above.update(batch),
                not_below=self.not_below.update(batch),
                fit=self.fit and self.fit.update(batch),
                outcomes=self.outcomes.update(batch),
                shared=self.shared and (self.shared[0].update(batch), self.shared[1].update(batch)),
            )
        )

    def interval(self) -> tuple[float, float]:
        """The anytime interval of E[ξ] - I at 1 - 2 beta, cut at the edges that were once ruled out.

        Each end is a confidence sequence at beta / 2. A truth beyond an edge that was ruled out has
        probability beta at most, and lies beyond one edge only.
        """
        target, asked = self.target, -math.log(self.levels.conforms)
        ends = [self._end(sign) - float(target.scaled(target.true_mean)) for sign in (1, -1)]
        tolerance, slack = float(target.tolerance), float(target.slack)
        lower, upper = float(target.width) * ends[0] - slack, float(target.width) * ends[1] + slack
        return (
            max(lower, -tolerance) if self.not_below.peak >= asked else lower,
            min(upper, tolerance) if self.not_above.peak >= asked else upper,
        )

    def _end(self, sign: int) -> float:
        target, level, limit = self.target, self.levels.conforms / 2, self.target.limit(sign)
        if not self.replicates:
            return limit
        bets = end_bets(target, self.levels, self.declared, sign)
        return edge_of(self.outcomes, lambda y: target.side_at(sign, y), bets, level, limit)

    def predicted(self) -> int | None:
        """How many replicates a verdict would take, from the declared law or else from the outcomes."""
        target = self.target
        laws = {sign: self.outcomes.law_against(sign) for sign in (1, -1)}
        if self.declared and self.declared.law:
            laws = dict.fromkeys(laws, scaled_law(target, self.declared.law))
        if not laws[1][0].size:
            return None
        inner, outer = target.slack - target.tolerance, target.tolerance + target.slack
        within = min(_growth(target, sign, inner, *law) for sign, law in laws.items())
        beyond = max(_growth(target, sign, outer, *law) for sign, law in laws.items())
        needs = ((-math.log(self.levels.conforms), within), (-math.log(self.levels.biased), beyond))
        counts = [math.ceil(1.3 * nats / rate) for nats, rate in needs if rate > 0]
        return max(min(counts), self.replicates + 1) if counts else None

    def case(self, ended: str) -> Case:
        """What the report says; ``ended`` is why an undecided trial drew no more replicates."""
        target, declared, seen = self.target, self.declared, self.outcomes.moments
        width = float(target.width)
        lower, upper = self.interval()
        predicted = None if self.verdict else self.predicted()
        variance = declared.variance if declared else None
        return Case(
            pixel=target.pixel,
            channel=target.channel,
            verdict=self.verdict or Verdict.INCONCLUSIVE,
            reason="; ".join(self._reasons(ended, (lower, upper), predicted)),
            plan_check=self.plan_check,
            true_mean=target.true_mean,
            tolerance=target.tolerance,
            declared_bias=declared.bias if declared else None,
            declared_std=None if variance is None else math.sqrt(variance),
            declared_cost=declared.cost if declared else None,
            range=target.range or target.ends,
            mean=float(target.origin) + width * seen.mean if seen.total else None,
            bias_interval=(lower, upper),
            bias_bound=max(-lower, upper),
            std=width * math.sqrt(seen.squares / (seen.total - 1)) if seen.total > 1 else None,
            cost=None if self.cost is None else self.cost / seen.total,
            replicates=self.replicates,
            predicted=predicted,
            evidence={name: e.log_evidence for name in EVIDENCE if (e := getattr(self, name)) is not None},
        )

    def _reasons(self, ended: str, interval: tuple[float, float], predicted: int | None) -> Iterator[str]:
        if self.verdict:
            yield self.reason
            yield from self._as_declared(interval)
        elif not self.replicates:
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
            yield self._deviation()
        if self.declared and self.declared.note:
            yield f"declared plan: {self.declared.note}"

    def _as_declared(self, interval: tuple[float, float]) -> Iterator[str]:
        """Whether a bias is the one declared, which reads differently from another."""
        bias = self.declared.bias if self.declared else None
        if self.verdict is not Verdict.BIASED or bias is None:
            return
        follows = self.plan_check is PlanCheck.FOLLOWS
        if follows and interval[0] <= bias <= interval[1] and abs(bias) > self.target.tolerance:
            yield f"biased as declared: its plan has the bias {float(bias):.4g}"
        elif abs(bias) <= self.target.tolerance:
            yield f"not as declared: its plan has the bias {float(bias):.4g}, within the tolerance"

    def _deviation(self) -> str:
        """In which way what is declared is not followed."""
        if isinstance(self.fit, LawFit):
            return "the estimates do not have the law of the declared plan"
        if not (isinstance(self.fit, Blend) and "noisier" in self.fit.names):
            return "the estimates have another mean than declared"
        rather = "noisier" if self.fit.leading == "noisier" else "biased"
        return f"the estimates are biased or noisier than declared, rather {rather}"


def _growth(target: Target, sign: int, margin: Fraction, y: FloatArray, law: FloatArray) -> float:
    """Nats a replicate against E[ξ] <= I + margin (``sign`` 1), or >= I - margin."""
    side = target.side(sign, margin)
    if isinstance(side, Bounded):
        return growth(side.oriented(y), law, side.mean)
    distance = sign * (float(y @ law) - side.edge)
    return distance**2 / 2 if distance > 0 else 0.0


def _decide(trial: Trial) -> Trial:
    """The trial with the first verdict that its evidence allows."""
    if trial.verdict is not None:
        return trial
    tolerance, asked, found = float(trial.target.tolerance), -math.log(trial.levels.biased), trial.biased.peak
    if found >= asked:
        side, sign = ("above", "+") if trial.biased.lean > 0 else ("below", "-")
        reason = f"E[ξ] lies {side} I {sign} {tolerance:.6g}: evidence e^{found:.1f} where e^{asked:.1f} is asked"
        return replace(trial, verdict=Verdict.BIASED, reason=reason)
    if min(trial.not_above.peak, trial.not_below.peak) >= -math.log(trial.levels.conforms):
        return replace(trial, verdict=Verdict.CONFORMS, reason=f"E[ξ] lies within {tolerance:.6g} of I")
    return trial
