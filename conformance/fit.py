"""Evidence that an estimator departs from the exact law of a declared plan."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from truemean.conformance.evidence import Batch, FloatArray

__all__ = ["LawFit"]


@dataclass(frozen=True, slots=True, eq=False)
class LawFit:
    """An e-process against "the outcomes have this law": half on tilts of it, half on Dirichlet mixtures.

    An outcome off every atom settles it: atoms within 2 ``slack`` are one, outcomes may be ``slack`` off.

    >>> fit = LawFit.to({Fraction(0): Fraction(1, 2), Fraction(1): Fraction(1, 2)}, 1e-9, 0.01, 1000)
    >>> heads = fit.update(Batch(np.array([0.0, 1.0]), np.array([10.0, 40.0])))
    >>> heads.log_evidence > math.log(100), fit.update(Batch.of(np.array([0.5]))).log_evidence
    (True, inf)
    """

    atoms: FloatArray
    log_law: FloatArray
    tilts: FloatArray
    counts: FloatArray
    slack: float
    log_evidence: float = 0.0
    peak: float = 0.0

    @classmethod
    def to(cls, law: Mapping[Fraction, Fraction], slack: float, level: float, budget: int) -> LawFit:
        """No outcomes seen; atoms that ``slack`` can't tell apart are one."""
        atoms: list[float] = []
        masses: list[Fraction] = []
        for atom, mass in sorted((a, m) for a, m in law.items() if m):
            if atoms and float(atom) - atoms[-1] <= 2 * slack:
                masses[-1] += mass
            else:
                atoms.append(float(atom))
                masses.append(mass)
        log_law = np.array([math.log(m.numerator) - math.log(m.denominator) for m in masses])
        places = np.array(atoms)
        return cls(places, log_law, _tilts(places, log_law, level, budget), np.zeros(places.size), slack)

    @property
    def lean(self) -> int:
        """Which way the mean departs."""
        law = np.exp(self.log_law)
        return 1 if self.atoms @ self.counts >= self.counts.sum() * float(self.atoms @ law) else -1

    def update(self, batch: Batch) -> LawFit:
        """The evidence after one more look, at outcomes as they are, not shared out on a grid."""
        nearest = np.searchsorted((self.atoms[1:] + self.atoms[:-1]) / 2, batch.values)
        off = np.any(np.abs(batch.values - self.atoms[nearest]) > 3 * self.slack)
        if off or self.log_evidence == math.inf:
            return replace(self, log_evidence=math.inf, peak=math.inf)
        return self._with(self.counts + np.bincount(nearest, batch.counts, self.atoms.size))

    def merge(self, later: LawFit) -> LawFit:
        """The evidence of both; an outcome off the atoms stays decisive."""
        if math.inf in (self.peak, later.peak):
            return replace(self, log_evidence=math.inf, peak=math.inf)
        return self._with(self.counts + later.counts)

    def _with(self, total: FloatArray) -> LawFit:
        tilted = _log_average(self.tilts @ total)
        now = float(np.logaddexp(tilted, _dirichlet(self.log_law, total))) - math.log(2)
        return replace(self, counts=total, log_evidence=now, peak=max(self.peak, now))


def _tilts(atoms: FloatArray, log_law: FloatArray, level: float, budget: int) -> FloatArray:
    """Log likelihood ratios ``[tilts, atoms]`` of laws tilted in mean and in variance, by +-1, 1/2, 1/4..."""
    law = np.exp(log_law)
    features = []
    centred = atoms - law @ atoms
    for _ in range(2):
        deviation = math.sqrt(law @ centred**2)
        if deviation <= 1e-9 * float(np.abs(centred).max()):
            break
        features.append(centred / deviation)
        centred = features[0] ** 2 - 1
    least = math.sqrt(-2 * math.log(level) / budget) / 1.5
    steps = max(1, math.ceil(-math.log2(least)) + 1)
    sizes = [sign * 2.0**-i for i in range(steps) for sign in (1, -1)]
    rows = [size * feature for feature in features for size in sizes] or [np.zeros_like(atoms)]
    return np.array([row - np.logaddexp.reduce(log_law + row) for row in rows])


def _dirichlet(log_law: FloatArray, counts: FloatArray) -> float:
    """Log evidence of Dirichlet alternatives centred at the law, averaged over eight concentrations."""
    from scipy.special import gammaln

    seen = counts > 0
    number, law = counts[seen], log_law[seen]
    concentrations = counts.size * 4.0 ** np.arange(8)
    priors = concentrations[:, None] * np.exp(law)
    atoms = (gammaln(priors + number) - gammaln(priors) - number * law).sum(axis=1)
    return _log_average(gammaln(concentrations) - gammaln(concentrations + counts.sum()) + atoms)


def _log_average(logs: FloatArray) -> float:
    return float(np.logaddexp.reduce(logs)) - math.log(logs.size)
