"""Drawing from a proposal instead of X, and weighting back."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from truemean.errors import NoClosedForm, PlanError
from truemean.oracle.exact import exact_number, is_symbolic
from truemean.oracle.law import Law
from truemean.oracle.pixel import Pixel
from truemean.oracle.quantity import Quantity, Vector
from truemean.oracle.symbols import Ratio

if TYPE_CHECKING:
    from truemean.oracle.sample import Sample

__all__ = ["proposal_law", "ratio_mean", "weighted_columns"]


def proposal_law(pixel: Pixel, proposal: Any, read: Callable[[Any], Ratio]) -> Law:
    """The pixel's values under other weights, with density ratios (formulas are ``read``) to weight them back."""
    if any(map(is_symbolic, pixel.values)):
        raise NoClosedForm(f"a proposal for {pixel!r} is drawn from its values: make these numbers")
    other = proposal if isinstance(proposal, Pixel) else Pixel(proposal)
    if other.symbols:
        raise NoClosedForm(f"the proposal {other!r} has symbols: give its weights numbers")
    weights = [other.law.get(value, Fraction(0)) for value in pixel.values]
    for value, weight, q in zip(pixel.values, pixel.weights, weights, strict=True):
        if weight and not q:
            raise PlanError(f"the proposal never draws {value}, which has weight {weight}: give it some weight")
    if sum(weights) != 1:
        raise PlanError("the proposal draws values that the pixel has not: use the pixel's own values")
    atoms = [v if isinstance(v, tuple) else (v,) for v in pixel.values]
    law = Law(atoms, weights, "X from a proposal")
    known = [read(w) if is_symbolic(w) else w for w in pixel.weights]
    law.ratios = {a: w / q for a, w, q in zip(atoms, known, weights, strict=True) if q}
    return law


def weighted_columns(sample: Sample, weight: Any) -> list[int]:
    """Columns of weight times value, by channel; ``weight="ratio"`` is the density ratio."""
    law, factors = sample.law, _factors(sample.law, weight)
    return [law.add_column([f * v[c] for f, v in zip(factors, law.values, strict=True)]) for c in range(law.channels)]


def ratio_mean(sample: Sample) -> Any:
    """Sum of ratio times value over sum of ratio."""
    span = (0, len(sample.segments))
    below = Quantity("sum", sample, span, sample.law.add_column(_factors(sample.law, "ratio")))
    found = [Quantity("sum", sample, span, c) / below for c in weighted_columns(sample, "ratio")]
    return Vector(found) if sample.colour else found[0]


def _factors(law: Law, weight: Any) -> list[Any]:
    if isinstance(weight, str) and weight == "ratio":
        if law.ratios is None:
            raise PlanError("weight='ratio' needs a sample of X.from_(proposal)")
        return [law.ratios[v] for v in law.values]
    plain = [v if law.channels > 1 else v[0] for v in law.values]
    given = [weight(v) if callable(weight) else weight[v] for v in plain]
    return [w if isinstance(w, Ratio) else exact_number(w, "weight") for w in given]
