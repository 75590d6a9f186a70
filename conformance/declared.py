"""What the oracle knows about the plan that an estimator declares: its exact law, bias and variance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from traceback import walk_tb
from typing import Any

from truemean.errors import InputTypeError, NeedsScene, NotExact, PlanError, RowBudgetExceeded, TruemeanError, raised
from truemean.oracle import Pixel, derive
from truemean.oracle.plan import Plan, as_plan
from truemean.oracle.plans import find_plan

__all__ = ["Declaration", "Declared", "derive_declared", "plan_errors", "read_declaration"]


@dataclass(frozen=True, slots=True)
class Declaration:
    """The plan that an estimator says it follows."""

    name: str
    plan: Plan
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

    A name is one of the catalogue, ``file.py:function`` or ``module:function``. Raises UnknownName, InputError
    or PlanError for one that can't be used, InputTypeError for anything else.
    """
    if declares is None:
        return None
    plan, params = declares if isinstance(declares, tuple) and len(declares) == 2 else (declares, {})
    if not (isinstance(plan, str) or callable(plan)) or not isinstance(params, Mapping):
        raise InputTypeError(f"declares={declares!r}: write ('kirk-arvo', {{'n': 4}}), or (function, params)")
    found = find_plan(plan) if isinstance(plan, str) else as_plan(plan)
    return Declaration(plan if isinstance(plan, str) else found.name, found, dict(params))


def derive_declared(declaration: Declaration, pixel: Pixel) -> tuple[Declared, ...]:
    """What the oracle derives for each channel of ``pixel``, as far as it can be done exactly."""
    channels = range(pixel.channels or 1)
    bias: Any = None
    variance: Any = None
    try:
        with plan_errors(declaration.plan):
            derivation = derive(declaration.plan, pixel, **declaration.params)
            bias = derivation.bias
            variance = derivation.variance
            law = derivation.distribution()
    except (RowBudgetExceeded, NotExact, NeedsScene) as why:
        return tuple(Declared(_channel(bias, c), _channel(variance, c), None, str(why)) for c in channels)
    return tuple(Declared(_channel(bias, c), _channel(variance, c), _marginal(law, c)) for c in channels)


@contextmanager
def plan_errors(plan: Plan) -> Iterator[None]:
    """What the reader's own plan raises becomes a PlanError with its line; truemean's own faults pass."""
    own = None if plan.function.__module__.startswith("truemean.") else getattr(plan.function, "__code__", None)
    try:
        yield
    except TruemeanError:
        raise
    except Exception as error:
        files = {frame.f_code.co_filename for frame, _ in walk_tb(error.__traceback__)}
        if own is None or own.co_filename not in files:
            raise
        raise PlanError(f"plan {plan.name!r} raised {raised(error)}") from error


def _channel(value: Any, channel: int) -> Any:
    return value[channel] if isinstance(value, tuple) else value


def _marginal(law: Mapping[Any, Fraction], channel: int) -> dict[Fraction, Fraction]:
    marginal: dict[Fraction, Fraction] = {}
    for outcome, probability in law.items():
        atom = _channel(outcome, channel)
        marginal[atom] = marginal.get(atom, Fraction(0)) + probability
    return marginal
