"""Evidence that stays valid at every look: e-processes for the mean of outcomes.

`Batch` is one look, an `EProcess` what it updates; `METHODS` are the kinds there are. A `Blend` of
e-processes is one, which is how knowledge gets in: into bets, never into validity. All in logarithms.
"""

from truemean.conformance.evidence.alternatives import EmpiricalBernstein, FixedSample, LikelihoodRatio
from truemean.conformance.evidence.bets import (
    Bets,
    best_fraction,
    growth,
    hybrid,
    scales,
    universal,
    variance_fraction,
)
from truemean.conformance.evidence.focus import Focus, KnownDistance, Learned, PlugIn
from truemean.conformance.evidence.methods import METHODS, Method, Question, heavy
from truemean.conformance.evidence.mixture import Mixture, edge_of
from truemean.conformance.evidence.outcomes import Batch, FloatArray, Moments, Outcomes, Sums
from truemean.conformance.evidence.process import Blend, EProcess, both
from truemean.conformance.evidence.sides import Bounded, Gaussian, Heavy, Side, Spread

__all__ = [
    "METHODS",
    "Batch",
    "Bets",
    "Blend",
    "Bounded",
    "EProcess",
    "EmpiricalBernstein",
    "FixedSample",
    "FloatArray",
    "Focus",
    "Gaussian",
    "Heavy",
    "KnownDistance",
    "Learned",
    "LikelihoodRatio",
    "Method",
    "Mixture",
    "Moments",
    "Outcomes",
    "PlugIn",
    "Question",
    "Side",
    "Spread",
    "Sums",
    "best_fraction",
    "both",
    "edge_of",
    "growth",
    "heavy",
    "hybrid",
    "scales",
    "universal",
    "variance_fraction",
]
