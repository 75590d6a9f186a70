"""The kinds of evidence by name, with what each guarantees: against both sides for BIASED, one for CONFORMS."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from truemean.conformance.evidence.alternatives import EmpiricalBernstein, FixedSample, LikelihoodRatio
from truemean.conformance.evidence.bets import Bets, hybrid, scales, universal
from truemean.conformance.evidence.focus import Focus, KnownDistance, Learned, PlugIn
from truemean.conformance.evidence.mixture import Mixture
from truemean.conformance.evidence.process import Blend, EProcess, both
from truemean.conformance.evidence.sides import Bounded, Gaussian, Heavy

__all__ = ["METHODS", "Method", "Question", "heavy"]

RESERVE = 0.15  # the share of the static mixture: it bounds what an unlucky order costs, by log(1/0.15) = 1.9 nats


@dataclass(frozen=True, slots=True)
class Question:
    """What evidence is asked to speak against, at which level, within how many replicates.

    ``distance`` is how far beyond each edge the mean is thought to lie, 0 where nothing is thought.
    """

    sides: tuple[Bounded, ...]
    level: float
    budget: int
    distance: float = 0.0


@dataclass(frozen=True, slots=True)
class Method:
    """A kind of evidence, and what it guarantees in one line; ``valid`` at every look, or not.

    ``constant``: all its bets are, so that the sums of many outcomes will do.
    """

    open: Callable[[Question], EProcess]
    guarantee: str
    valid: bool = True
    constant: bool = False


def _by_side(open_side: Callable[[Bounded, Question], EProcess]) -> Callable[[Question], EProcess]:
    """Against one side with all of the money, against two with half of it each."""

    def open_question(question: Question) -> EProcess:
        if len(question.sides) == 1:
            return open_side(question.sides[0], question)
        by_sign = {side.sign: side for side in question.sides}
        return both(lambda sign: open_side(by_sign[sign], question))

    return open_question


def _static(side: Bounded, question: Question) -> Mixture:
    return Mixture.open(side, hybrid(side.mean, question.level / len(question.sides), question.budget))


def _focus(question: Question) -> EProcess:
    """Focus and reserve; where the distance is known, plug-in bets that learn the variance alone, and the reserve."""
    if not (question.distance and len(question.sides) == 1):
        focus = Focus.open(question.sides, question.level, question.budget)
        return Blend.of(focus=(1 - RESERVE, focus), reserve=(RESERVE, _by_side(_static)(question)))
    (side,) = question.sides
    return Blend.of(
        near=(0.6, PlugIn(side, KnownDistance(question.distance))),
        half=(0.15, PlugIn(side, KnownDistance(question.distance / 2))),
        rest=(0.25, _static(side, question)),
    )


def _gaussian(side: Bounded, question: Question) -> Mixture:
    edge = side.mean if side.sign > 0 else 1 - side.mean
    least = math.sqrt(-8 * math.log(question.level) / question.budget)
    steps = max(1, math.ceil(math.log2(4 / least)) + 1)
    return Mixture.open(Gaussian(side.sign, edge), Bets.equal(4.0 * 2.0 ** -np.arange(steps)))


METHODS: Mapping[str, Method] = MappingProxyType(
    {
        "focus": Method(
            _focus,
            "valid at every look for any law in the range; learns its bets, so the order of batches matters, by at "
            "most 1.9 nats below the static mixture",
        ),
        "mixture": Method(
            _by_side(_static),
            "valid at every look for any law in the range; the order of outcomes does not matter",
            constant=True,
        ),
        "up": Method(
            _by_side(lambda side, question: Mixture.open(side, universal())),
            "valid at every look for any law in the range; Cover's universal portfolio, the order does not matter",
            constant=True,
        ),
        "agrapa": Method(
            _by_side(lambda side, question: PlugIn(side, Learned())),
            "valid at every look for any law in the range; one learned bet, the order of batches matters without bound",
        ),
        "klinf": Method(
            _by_side(lambda side, question: LikelihoodRatio(side)),
            "valid at every look for any law in the range; slower, an independent check of the others",
        ),
        "hoeffding": Method(
            _by_side(_gaussian),
            "valid at every look for any law in the range; for comparison: blind to a small variance, slower by 10 times",
            constant=True,
        ),
        "empirical-bernstein": Method(
            _by_side(lambda side, question: PlugIn(side, EmpiricalBernstein(question.level))),
            "valid at every look for any law in the range; for comparison: slower by about 2 to 5 times",
        ),
        "welch": Method(
            lambda question: FixedSample.open(question.sides),
            "for comparison only, NOT valid: a t test, right at one look fixed beforehand and about Gaussian means; "
            "alpha and beta are not kept under looks, nor for rare events",
            valid=False,
        ),
    }
)


def heavy(sides: Sequence[Heavy], level: float, budget: int) -> EProcess:
    """Evidence for outcomes of any range with a variance of at most 1, against one side or two."""
    bets = scales(level / len(sides), budget)
    if len(sides) == 1:
        return Mixture.open(sides[0], bets)
    by_sign = {side.sign: side for side in sides}
    return both(lambda sign: Mixture.open(by_sign[sign], bets))
