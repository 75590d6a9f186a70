"""What the oracle knows about the plan that an estimator declares: its exact law, bias and variance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from truemean.errors import InputTypeError, NeedsScene, NotExact, RowBudgetExceeded, UnknownName
from truemean.oracle.pixel import Pixel

__all__ = ["Declaration", "Declared", "derive_declared", "read_declaration"]


@dataclass(frozen=True, slots=True)
class Declaration:
    """The plan that an estimator says it follows."""

    name: str
    plan: Callable[..., Any]
    params: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Declared:
    """The declared plan on one channel of a pixel; None for what the oracle can't tell, and why."""

    bias: Fraction | None = None
    variance: Fraction | None = None
    law: Mapping[Fraction, Fraction] | None = None
    note: str = ""


def read_declaration(declares: Any) -> Declaration | None:
    """``(plan name or function, params)`` with the name looked up; a bare name or function will do.

    Raises UnknownName for a plan that isn't in the catalogue, InputTypeError for anything else.
    """
    if declares is None:
        return None
    plan, params = declares if isinstance(declares, tuple) and len(declares) == 2 else (declares, {})
    if not (isinstance(plan, str) or callable(plan)) or not isinstance(params, Mapping):
        raise InputTypeError(f"declares={declares!r}: write ('kirk-arvo', {{'n': 4}}), or (function, params)")
    if callable(plan):
        return Declaration(getattr(plan, "__name__", repr(plan)), plan, dict(params))
    from truemean.oracle.plans import catalogue

    if plan not in catalogue:
        raise UnknownName("plan", plan, catalogue)
    return Declaration(plan, catalogue[plan], dict(params))


def derive_declared(declaration: Declaration, pixel: Pixel) -> tuple[Declared, ...]:
    """What the oracle derives for each channel of ``pixel``, as far as it can be done exactly."""
    from truemean.oracle import derive

    channels = range(pixel.channels or 1)
    bias: Any = None
    variance: Any = None
    try:
        derivation = derive(declaration.plan, pixel, **declaration.params)
        bias = derivation.bias
        variance = derivation.variance
        law = derivation.distribution()
    except (RowBudgetExceeded, NotExact, NeedsScene) as why:
        return tuple(Declared(_channel(bias, c), _channel(variance, c), None, str(why)) for c in channels)
    return tuple(Declared(_channel(bias, c), _channel(variance, c), _marginal(law, c)) for c in channels)


def _channel(value: Any, channel: int) -> Any:
    return value[channel] if isinstance(value, tuple) else value


def _marginal(law: Mapping[Any, Fraction], channel: int) -> dict[Fraction, Fraction]:
    marginal: dict[Fraction, Fraction] = {}
    for outcome, probability in law.items():
        atom = _channel(outcome, channel)
        marginal[atom] = marginal.get(atom, Fraction(0)) + probability
    return marginal
