"""Cases that need no statistics: the estimator tells the exact law of its own code."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from truemean.conformance.declared import Declared, marginal, read_law
from truemean.conformance.replicates import attribute, blaming
from truemean.conformance.settings import Chosen, Settings
from truemean.conformance.target import Target
from truemean.conformance.verdict import Case, PlanCheck, Verdict
from truemean.errors import InputTypeError, SubjectError, TooManyPaths, Unsupported
from truemean.oracle.exact import exact_text
from truemean.subject import Exact

__all__ = ["ExactCases", "exact_cases"]

READABLE = 10**12


@dataclass(frozen=True, slots=True)
class ExactCases:
    """The cases by pixel, the pixels declined with reasons, and those that must be sampled after all, and why."""

    cases: Mapping[str, list[Case]]
    skipped: Mapping[str, str]
    notes: tuple[str, ...]
    interrupted: bool = False

    @property
    def biased(self) -> list[Case]:
        """The cases that are."""
        return [case for cases in self.cases.values() for case in cases if case.verdict is Verdict.BIASED]


def exact_cases(subject: Any, chosen: Sequence[Chosen], settings: Settings, deadline: float = math.inf) -> ExactCases:
    """The verdicts that the exact laws of an estimator give, where it has such laws, as far as time allows."""
    cases: dict[str, list[Case]] = {}
    skipped: dict[str, str] = {}
    notes: list[str] = []
    exact = attribute(subject, "exact")
    for each in chosen if callable(exact) else ():
        if time.monotonic() > deadline:
            break
        try:
            with blaming("exact(pixel)", TooManyPaths):
                found = exact(each.given)
            cases[each.name] = _cases(subject, each, settings, found)
        except TooManyPaths as why:
            notes.append(f"{each.name}: judged by sampled replicates, not exactly: {why}")
        except Unsupported as declined:
            skipped[each.name] = str(declined)
        except SubjectError as broken:
            cases[each.name] = [_broken(target, str(broken)) for target in settings.targets(None, each)]
        except KeyboardInterrupt:
            return ExactCases(cases, skipped, tuple(notes), interrupted=True)
    return ExactCases(cases, skipped, tuple(notes))


def _cases(subject: Any, chosen: Chosen, settings: Settings, found: Any) -> list[Case]:
    if not isinstance(found, Exact):
        raise InputTypeError(f"exact(pixel) gave {found!r:.80} (type={type(found).__name__}): return an Exact")
    law = read_law(found.law)
    targets = replace(settings, variance=1).targets(subject, chosen)  # no bound is needed where all is known
    declared = settings.declared(subject, chosen) or [None] * len(targets)
    bounded = settings.range is not None or attribute(subject, "range") is not None
    cases = []
    for channel, (target, its) in enumerate(zip(targets, declared, strict=True)):
        own = marginal(law, channel)
        fault = _outside(target, own) if bounded else ""
        cases.append(_broken(target, fault) if fault else _case(target, its, own, found))
    return cases


def _case(target: Target, declared: Declared | None, law: Mapping[Fraction, Fraction], found: Exact) -> Case:
    mean = sum((x * p for x, p in law.items()), Fraction(0))
    variance = sum(((x - mean) ** 2 * p for x, p in law.items()), Fraction(0))
    bias = mean - target.true_mean
    # Sums of floats in another order differ by roundings, which are no bias.
    biased = abs(bias) > target.tolerance + target.slack
    check = _check(target, declared, law, bias, variance) if declared else None
    # An interval of that bias alone; where what is declared is the same but for roundings, it holds that too.
    near = bias if declared is None or declared.bias is None else declared.bias
    low, high = sorted((bias, near if abs(near - bias) <= target.slack else bias))
    reason = f"exactly, over {found.how}: E[ξ] - I = {_told(bias)}"
    if biased and check is PlanCheck.FOLLOWS:
        reason += "; biased as declared"
    if check is PlanCheck.DEVIATES:
        reason += "; the estimates do not have the law of the declared plan"
    return Case(
        pixel=target.pixel,
        channel=target.channel,
        verdict=Verdict.BIASED if biased else Verdict.CONFORMS,
        reason=reason,
        plan_check=check,
        true_mean=target.true_mean,
        tolerance=target.tolerance,
        # What is declared, and what was found.
        declared_bias=declared.bias if declared else None,
        declared_std=math.sqrt(declared.variance) if declared and declared.variance is not None else None,
        declared_cost=declared.cost if declared else None,
        range=(min(law), max(law)),
        mean=float(mean),
        bias_interval=(_rounded(low, -math.inf), _rounded(high, math.inf)),
        bias_bound=abs(float(bias)),
        std=math.sqrt(variance),
        cost=float(found.cost),
        # No replicates were needed.
        replicates=0,
        predicted=None,
        evidence={},
        exact_bias=bias,
    )


def _outside(target: Target, law: Mapping[Fraction, Fraction]) -> str:
    """What is wrong with an outcome beyond the range that is declared."""
    low, high = target.range or (min(law), max(law))
    far = next((x for x in (min(law), max(law)) if not low - target.slack <= x <= high + target.slack), None)
    if far is None:
        return ""
    return f"returns {float(far)!r} on some path, outside its range [{float(low)!r}, {float(high)!r}]"


def _rounded(end: Fraction, towards: float) -> float:
    """The float at or next to a number, on the side of ``towards``."""
    near = float(end)
    return near if near == end or (near > end) == (towards > 0) else math.nextafter(near, towards)


def _told(bias: Fraction) -> str:
    """p/q where that is short, as it is not where floats were rounded."""
    return exact_text(bias) if bias.denominator < READABLE else f"{float(bias):.6g}"


def _broken(target: Target, reason: str) -> Case:
    """The case of code that broke on some path."""
    ends = target.range or target.ends
    lower, upper = (float(end - target.true_mean) for end in ends)
    return Case(
        pixel=target.pixel,
        channel=target.channel,
        verdict=Verdict.BROKEN,
        reason=reason,
        plan_check=None,
        true_mean=target.true_mean,
        tolerance=target.tolerance,
        declared_bias=None,
        declared_std=None,
        declared_cost=None,
        # Nothing was found.
        range=ends,
        mean=None,
        bias_interval=(lower, upper),
        bias_bound=max(-lower, upper),
        std=None,
        cost=None,
        replicates=0,
        predicted=None,
        evidence={},
    )


def _check(
    target: Target, declared: Declared, law: Mapping[Fraction, Fraction], bias: Fraction, variance: Fraction
) -> PlanCheck | None:
    """Whether the law is the one declared, outcomes within a slack of each other being one."""
    if declared.law is not None:
        same = _same_law(law, declared.law, target.slack)
    elif declared.bias is None:
        return None
    else:
        same = abs(bias - declared.bias) <= target.slack
        if declared.variance is not None:
            # Outcomes off by a slack move the variance by so much at most.
            room = target.slack * (2 * (max(law) - min(law)) + target.slack)
            same = same and abs(variance - declared.variance) <= room
    return PlanCheck.FOLLOWS if same else PlanCheck.DEVIATES


def _same_law(one: Mapping[Fraction, Fraction], other: Mapping[Fraction, Fraction], slack: Fraction) -> bool:
    """Whether the outcomes are those of the other but for a slack, and as probable."""
    pairs = [_merged(law, slack) for law in (one, other)]
    return len(pairs[0]) == len(pairs[1]) and all(
        mass == as_much and abs(outcome - near) <= 2 * slack
        for (outcome, mass), (near, as_much) in zip(*pairs, strict=True)
    )


def _merged(law: Mapping[Fraction, Fraction], slack: Fraction) -> list[tuple[Fraction, Fraction]]:
    """Outcomes in ascending order with their probabilities, those within 2 ``slack`` of the one before together."""
    found: list[tuple[Fraction, Fraction]] = []
    for outcome, mass in sorted((x, p) for x, p in law.items() if p):
        if found and outcome - found[-1][0] <= 2 * slack:
            found[-1] = (outcome, found[-1][1] + mass)
        else:
            found.append((outcome, mass))
    return found
