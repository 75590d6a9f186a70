"""The evidence that is opened on a case, before its run: every bet is placed here, from what is declared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from truemean.conformance.declared import Declared
from truemean.conformance.evidence import (
    METHODS,
    Bets,
    Blend,
    Bounded,
    EProcess,
    FloatArray,
    Heavy,
    Mixture,
    Question,
    Spread,
    best_fraction,
    heavy,
    hybrid,
    scales,
    variance_fraction,
)
from truemean.conformance.fit import LawFit
from truemean.conformance.target import Target

__all__ = ["Levels", "end_bets", "open_biased", "open_fit", "open_within", "scaled_law"]

DECLARED, SUSPECTED = 0.8, 0.5  # the share of the money that follows the declared plan, or the suspects


@dataclass(frozen=True, slots=True)
class Levels:
    """Error rates of one case: ``biased`` for both signs together, ``deviates``, ``conforms`` per edge."""

    biased: float
    deviates: float
    conforms: float
    budget: int


def open_biased(target: Target, levels: Levels, method: str, suspects: Mapping[str, Declared]) -> EProcess:
    """Evidence against |E[ξ] - I| <= tolerance: part of the money on what each suspect would do."""
    margin = target.tolerance + target.slack
    above, below = (target.side(sign, margin) for sign in (1, -1))
    base = _open((above, below), levels.biased, levels.budget, method)
    bets = {}
    for name, suspect in suspects.items():
        side = above if (suspect.bias or 0) > 0 else below
        fraction = _fraction(target, suspect, side)
        if fraction and abs(suspect.bias or Fraction(0)) > margin:
            bets[name] = Mixture.open(side, _single(fraction))
    if not bets or not METHODS[method].valid:
        return base
    shares = {name: (SUSPECTED / len(bets), bet) for name, bet in bets.items()}
    return Blend.of(rest=(1 - SUSPECTED, base), **shares)


def open_within(target: Target, levels: Levels, method: str, declared: Declared | None, sign: int) -> EProcess:
    """Evidence that E[ξ] >= I - tolerance (``sign`` 1), or <= I + tolerance (-1).

    Where the range itself implies it nothing can speak against it; where the tolerance is no larger than
    the slack nothing can show it.
    """
    side = target.side(sign, target.slack - target.tolerance)
    if target.range is not None:
        room = target.true_mean - target.range[0] if sign > 0 else target.range[1] - target.true_mean
        if room <= target.tolerance:
            return Mixture.open(Bounded(sign, -np.inf), _single(0.5))
    if target.tolerance <= target.slack:
        return Mixture.open(Bounded(sign, np.inf), _single(0.5))
    distance = float((target.tolerance - target.slack) / target.width)
    base = _open((side,), levels.conforms, levels.budget, method, distance)
    fraction = _fraction(target, declared, side) if declared and METHODS[method].valid else 0.0
    if not fraction:
        return base
    return Blend.of(declared=(DECLARED, Mixture.open(side, _single(fraction))), rest=(1 - DECLARED, base))


def open_fit(target: Target, declared: Declared, levels: Levels, method: str = "focus") -> EProcess | None:
    """Evidence against the declared law; where that is unknown, against its mean, by a method, and its spread."""
    slack = float(target.slack / target.width)
    if declared.law is not None:
        law = {(atom - target.origin) / target.width: mass for atom, mass in declared.law.items()}
        return LawFit.to(law, slack, levels.deviates, levels.budget)
    if declared.bias is None:
        return None
    centre = declared.bias
    sides = (target.side(1, centre + target.slack), target.side(-1, target.slack - centre))
    mean = _open(sides, levels.deviates, levels.budget, method)
    if declared.variance is None:
        return mean
    # Rounding moves an outcome by a slack, and the centre is known.
    spread = (float(declared.variance) ** 0.5 / float(target.width) + slack) ** 2
    noisier = Spread(target.scaled(target.true_mean + centre), max(spread, 1e-300))
    bets = hybrid(min(spread, 0.5), levels.deviates, levels.budget)
    return Blend.of(mean=(0.5, mean), noisier=(0.5, Mixture.open(noisier, bets)))


def end_bets(target: Target, levels: Levels, declared: Declared | None, sign: int) -> Bets:
    """The constant bets that the interval's lower (``sign`` 1) or upper end (-1) is made with."""
    side = target.side(sign, target.slack - target.tolerance)
    if isinstance(side, Heavy):
        return scales(levels.conforms / 2, levels.budget)
    bets = hybrid(side.mean, levels.conforms / 2, levels.budget)
    return bets.favouring(_fraction(target, declared, side) if declared else 0.0, DECLARED)


def scaled_law(target: Target, law: Mapping[Fraction, Fraction]) -> tuple[FloatArray, FloatArray]:
    """Outcomes y and their probabilities."""
    atoms = np.array([target.scaled(atom) for atom in law])
    inside = atoms if target.range is None else np.clip(atoms, 0.0, 1.0)
    return inside, np.array([float(mass) for mass in law.values()])


def _open(
    sides: tuple[Bounded | Heavy, ...], level: float, budget: int, method: str, distance: float = 0.0
) -> EProcess:
    bounded = tuple(side for side in sides if isinstance(side, Bounded))
    if bounded:
        return METHODS[method].open(Question(bounded, level, budget, distance))
    return heavy(tuple(side for side in sides if isinstance(side, Heavy)), level, budget)


def _fraction(target: Target, declared: Declared | None, side: Bounded | Heavy) -> float:
    """The bet that a declared plan suggests: knowledge goes into bets, never into validity."""
    if declared is None or isinstance(side, Heavy) or not 0 < side.mean < 1:
        return 0.0
    if declared.law is not None:
        y, law = scaled_law(target, declared.law)
        return best_fraction(side.oriented(y), law, side.mean)
    if declared.bias is not None and declared.variance is not None:
        centre = Bounded.at(side.sign, (target.true_mean + declared.bias - target.origin) / target.width).mean
        return variance_fraction(centre - side.mean, float(declared.variance / target.width**2), side.mean)
    return 0.0


def _single(fraction: float) -> Bets:
    return Bets.equal(np.array([fraction]))
