"""Is a plan unbiased? By its structure for every pixel, by an identity in the weights, or not at all.

First the rule of Kirk & Arvo 1991, section 4, which needs no pixel. Where it says nothing, the bias
on pixels of two values, then three, is a polynomial in the weights: if it is zero, it is so for all
weights, and a certificate says why; if not, some pixel shows it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from truemean.errors import InputError, NeedsScene, PlanError
from truemean.oracle.certificate import check_certificate
from truemean.oracle.derivation import Derivation, derive
from truemean.oracle.exact import is_symbolic, short_text
from truemean.oracle.pixel import Pixel
from truemean.oracle.plan import Plan, as_plan
from truemean.oracle.structure import structural_proof

__all__ = ["Proof", "prove"]

_MOST_DENOMINATOR = 64
_ROWS = 200_000


@dataclass(frozen=True, slots=True)
class Proof:
    """The answer of `prove`.

    ``status`` is ``"unbiased"`` (for every pixel), ``"unbiased at these values"`` (for all weights),
    ``"biased"`` (``counterexample`` is the pixel found, ``bias`` its exact bias) or ``"unknown"``;
    ``certificate`` is what `check_certificate` checks, None for a proof by structure.
    """

    status: str
    reason: str
    counterexample: Pixel | None = None
    bias: Any = None
    certificate: Mapping[str, Any] | None = field(default=None, repr=False)

    def __str__(self) -> str:
        bias = self.bias if isinstance(self.bias, tuple) else (self.bias,)
        number = ", ".join(short_text(b) for b in bias)
        shown = "" if self.counterexample is None else f"; bias {number} on {self.counterexample!r}"
        return f"{self.status}: {self.reason}{shown}"


def prove(plan: Any, *, k: int = 3, values: Sequence[Any] | None = None, **params: Any) -> Proof:
    """Prove a plan unbiased, or find the smallest pixel that shows its bias (Kirk & Arvo 1991, section 4).

    ``k`` bounds the number of values of the pixels looked at, ``values`` fixes them instead. Raises
    PlanError for what is no plan.

    >>> from truemean.oracle.plans import catalogue
    >>> prove(catalogue["kirk-arvo-unbiased"]).status
    'unbiased'
    >>> proof = prove(catalogue["kirk-arvo"], n=4)
    >>> proof.status, proof.counterexample, proof.bias
    ('biased', Pixel({0: 2/3, 1: 1/3}), Fraction(-14, 243))
    """
    declared = as_plan(plan)
    bound = declared.bind(params)
    if isinstance(k, bool) or not isinstance(k, int) or k < 1:
        raise InputError(f"k={k!r} is no number of values: give an integer of at least 1")
    structure = structural_proof(declared, bound)
    if structure.proved:
        only = "" if structure.pixels == "every pixel" else f" (for {structure.pixels})"
        return Proof("unbiased", structure.reason + only)
    why = structure.reason.removeprefix("not proved: ")
    by_symbol = [name for name, value in bound.items() if is_symbolic(value)]
    if by_symbol:
        return Proof("unknown", f"{why}; give {', '.join(by_symbol)} a number for more than the structure")
    if values is not None:
        return _at_values(declared, bound, list(values), why)
    return _over_pixels(declared, bound, k, why)


def _at_values(plan: Plan, params: dict[str, Any], values: list[Any], why: str) -> Proof:
    """The identity on given values, or a counterexample."""
    X = Pixel.symbolic(len(values), values=values)
    derivation = _derived(plan, params, X)
    if isinstance(derivation, Proof):
        return derivation
    certificate = _certificate(derivation)
    if not check_certificate(certificate):
        return _biased(plan, params, sorted(X.values), certificate, why)
    shown = ", ".join(str(v) if isinstance(v, tuple) else short_text(v) for v in X.values)
    return Proof(
        "unbiased at these values",
        f"the bias on the values {shown} is a polynomial in the weights that is zero for all of them",
        certificate=certificate,
    )


def _over_pixels(plan: Plan, params: dict[str, Any], most: int, why: str) -> Proof:
    """Look for a counterexample on small pixels; without one, prove the identity for symbolic values."""
    tried = 0
    for k in range(2, most + 1):
        for values in _value_sets(k, params):
            found = _at_values(plan, params, values, why)
            if found.status in ("biased", "unknown"):
                return found
            tried += 1
    for ordered in (False, True):
        proved = _for_all_values(plan, params, most, ordered)
        if proved is not None:
            return proved
    return Proof("unknown", f"{why}; no bias on any weights of the {tried} sets of values tried")


def _for_all_values(plan: Plan, params: dict[str, Any], most: int, ordered: bool) -> Proof | None:
    """The identity for pixels of 1..k symbolic values, in their finitely many orders if these decide."""
    certificate = None
    for k in range(1, most + 1):
        derivation = _derived(plan, params, Pixel.symbolic(k, ordered=ordered))
        if isinstance(derivation, Proof) or _open_conditions(derivation):
            return None
        certificate = _certificate(derivation)
        if not check_certificate(certificate):
            return None
    reason = (
        f"on pixels of up to {most} values, whatever they are, the bias is zero as a polynomial in values and weights"
    )
    return Proof("unbiased at these values", reason, certificate=certificate)


def _derived(plan: Plan, params: dict[str, Any], X: Pixel) -> Derivation | Proof:
    try:
        derivation: Derivation = derive(plan, X, arithmetic="symbolic", rows=_ROWS, **params)
        _ = derivation.path_biases
    except NeedsScene as error:
        return Proof("unknown", f"its structure proves nothing, and {error}")
    except PlanError as error:
        return Proof("unknown", f"its structure proves nothing, and its bias has no formula: {error}")
    return derivation


def _open_conditions(derivation: Derivation) -> bool:
    return any(g.kind in ("condition", "opaque") for g in derivation.field.generators)


# -- identities in the weights ------------------------------------------------------------------------


def _certificate(derivation: Derivation) -> dict[str, Any]:
    """Every path's share of the bias as integer terms over one denominator; the last exponent is the channel."""
    law, ring_field = derivation.law, derivation.field
    order = [place for mass in law.masses if (place := ring_field.place(str(mass))) is not None]
    order += [i for i in range(len(ring_field.generators)) if i not in order]
    shares = [[ring_field.number(share) for share in channel] for channel in derivation.path_biases]
    denominator = math.lcm(*(int(s.lifted()[1].leading_coefficient()) for channel in shares for s in channel))
    paths = []
    for channel, by_path in enumerate(shares):
        for decisions, share in zip(derivation.decisions, by_path, strict=True):
            num, den = share.lifted()
            scale = denominator // int(den.leading_coefficient())
            items = num.to_dict().items()
            terms = [[[*(int(powers[i]) for i in order), channel], int(c) * scale] for powers, c in items]
            paths.append({"decisions": decisions, "terms": terms})
    return {"weights": len(law.masses), "denominator": denominator, "paths": paths}


def _biased(plan: Plan, params: dict[str, Any], values: list[Any], certificate: Any, why: str) -> Proof:
    """The smallest weights at which the polynomial is not zero."""
    for weights in _small_weights(len(values)):
        if _evaluated(certificate, weights):
            X = Pixel(dict(zip(values, weights, strict=True)))
            return Proof("biased", why, X, derive(plan, X, rows=_ROWS, **params).bias, certificate)
    raise AssertionError("a polynomial that is not zero is zero at all small weights")


def _evaluated(certificate: Any, weights: Sequence[Fraction]) -> bool:
    """Whether the bias is there at some weights, in any channel."""
    total: dict[int, Fraction] = {}
    for path in certificate["paths"]:
        for exponents, coefficient in path["terms"]:
            share = coefficient * math.prod(w**e for w, e in zip(weights, exponents, strict=False))
            total[exponents[-1]] = total.get(exponents[-1], Fraction(0)) + share
    return any(total.values())


def _small_weights(k: int) -> Iterator[tuple[Fraction, ...]]:
    """Weights on the simplex by their common denominator; of equal ones, the smallest last weight first."""
    for unit in range(k, _MOST_DENOMINATOR * k):
        for cuts in itertools.combinations(range(1, unit), k - 1):
            ends = (unit, *reversed(cuts), 0)
            parts = [a - b for a, b in itertools.pairwise(ends)]
            yield tuple(Fraction(part, unit) for part in parts)


def _value_sets(k: int, params: dict[str, Any]) -> Iterator[list[Fraction]]:
    """Small values: 0, 1, ...; not starting at 0; and so far apart that every threshold is crossed."""
    yield [Fraction(i) for i in range(k)]
    yield [Fraction(i + 1) for i in range(k)]
    if k > 2:
        yield [Fraction(i * i) for i in range(k)]
    thresholds = {abs(Fraction(v)) for v in params.values() if isinstance(v, int | Fraction) and v}
    for scale in sorted({2 * t for t in thresholds} | {t / 2 for t in thresholds}):
        yield [scale * i for i in range(k)]
    yield [Fraction(i) - Fraction(k - 1, 2) for i in range(k)]
