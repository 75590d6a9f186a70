"""What an estimator declares: a plan, from which the oracle derives its law, or the law or moments themselves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from traceback import walk_tb
from typing import Any

from truemean.errors import (
    InputError,
    InputTypeError,
    NeedsScene,
    NotExact,
    PlanError,
    RowBudgetExceeded,
    TruemeanError,
    raised,
)
from truemean.oracle import Pixel, derive
from truemean.oracle.exact import exact_number, exact_weight
from truemean.oracle.plan import Plan, as_plan
from truemean.oracle.plans import find_plan

__all__ = [
    "Declaration",
    "Declared",
    "derive_declared",
    "marginal",
    "plan_errors",
    "read_declaration",
    "read_law",
    "read_prediction",
]

PREDICTIONS = ("law", "mean", "variance", "cost")


@dataclass(frozen=True, slots=True)
class Declaration:
    """The plan that an estimator says it follows."""

    name: str
    plan: Plan
    params: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Declared:
    """What is declared on one channel of a pixel; None for what the oracle can't tell, and why."""

    bias: Fraction | None = None
    variance: Fraction | None = None
    cost: Fraction | None = None
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
    found: dict[str, Any] = {}
    note = ""
    try:
        with plan_errors(declaration.plan):
            derivation = derive(declaration.plan, pixel, **declaration.params)
            for name in ("bias", "cost", "variance"):
                found[name] = getattr(derivation, name)
            found["law"] = derivation.distribution()
    except (RowBudgetExceeded, NotExact, NeedsScene) as why:
        note = str(why)
    return tuple(
        Declared(
            _channel(found.get("bias"), c),
            _channel(found.get("variance"), c),
            found.get("cost"),
            marginal(found["law"], c) if "law" in found else None,
            note,
        )
        for c in range(pixel.channels or 1)
    )


def read_prediction(predicted: Any, pixel: Pixel) -> tuple[Declared, ...]:
    """What ``predicts(pixel)`` of an estimator says: a mapping with some of law, mean, variance and cost.

    ``law`` maps outcomes to probabilities, a mean or a variance of a colour pixel has a number a channel.
    Raises InputError for a law that does not sum to 1, InputTypeError for what is no such mapping.

    >>> read_prediction({"law": {0: "1/2", 1: "1/2"}}, Pixel.two("1/4"))[0].bias
    Fraction(1, 4)
    """
    if not isinstance(predicted, Mapping) or not predicted or not set(predicted) <= set(PREDICTIONS):
        raise InputTypeError(f"predicts(pixel) gave {predicted!r:.80}: return a mapping with any of {PREDICTIONS}")
    law = None if predicted.get("law") is None else read_law(predicted["law"])
    return tuple(_predicted(predicted, law, pixel, c) for c in range(pixel.channels or 1))


def read_law(law: Any) -> dict[Any, Fraction]:
    """Outcomes with their probabilities, exact; InputError unless they are a law."""
    if not isinstance(law, Mapping) or not law:
        raise InputTypeError(f"law={law!r:.80}: write a mapping outcome -> probability, such as {{0: '7/8', 1: '1/8'}}")
    found: dict[Any, Fraction] = {}
    for outcome, probability in law.items():
        key = (
            tuple(exact_number(part, "outcome") for part in outcome)
            if isinstance(outcome, tuple)
            else exact_number(outcome, "outcome")
        )
        found[key] = found.get(key, Fraction(0)) + exact_weight(probability, f"probability of {outcome}")
    if sum(found.values()) != 1:
        raise InputError(f"the probabilities of law={law!r:.80} sum to {sum(found.values())}, not to 1: correct them")
    return found


def _predicted(predicted: Mapping[str, Any], law: Any, pixel: Pixel, channel: int) -> Declared:
    true_mean = _channel(pixel.mean, channel)
    mean, variance = (_number(_channel(predicted.get(name), channel), name) for name in ("mean", "variance"))
    own = None
    if law is not None:
        own = marginal(law, channel)
        mean = sum((x * p for x, p in own.items()), Fraction(0))
        variance = sum(((x - mean) ** 2 * p for x, p in own.items()), Fraction(0))
    bias = None if mean is None else mean - true_mean
    return Declared(bias, variance, _number(predicted.get("cost"), "cost"), own)


def _number(value: Any, name: str) -> Fraction | None:
    return None if value is None else Fraction(exact_number(value, name))


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


def marginal(law: Mapping[Any, Fraction], channel: int) -> dict[Fraction, Fraction]:
    """The law of one channel of an outcome.

    >>> marginal({(0, 5): Fraction(1, 2), (0, 6): Fraction(1, 2)}, 0)
    {0: Fraction(1, 1)}
    """
    found: dict[Fraction, Fraction] = {}
    for outcome, probability in law.items():
        atom = _channel(outcome, channel)
        found[atom] = found.get(atom, Fraction(0)) + probability
    return found
