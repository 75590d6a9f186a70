"""A sampling plan: a Python function of the population X that returns an estimate."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, overload

from truemean.errors import InputError, InputTypeError, PlanError, UnknownName
from truemean.oracle.exact import exact_number
from truemean.oracle.population import Population
from truemean.oracle.quantity import Quantity

__all__ = ["Plan", "as_plan", "plan"]

RESERVED = ("arithmetic", "digits", "rtol", "rows", "runs", "seed", "k", "values", "objective")


@dataclass(frozen=True)
class Plan:
    """A plan with what is known about it: its source, whether it is unbiased and why."""

    function: Callable[..., Any]
    source: str = ""
    unbiased: bool | None = None
    why: str = ""
    undefined: str = "error"

    def __post_init__(self) -> None:
        for name, parameter in self.signature.parameters.items():
            if name in RESERVED:
                raise PlanError(f"parameter {name!r} of plan {self.name!r} is reserved for derive(): rename it")
            if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
                raise PlanError(
                    f"plan {self.name!r} takes {parameter}: name its parameters, so that they can be checked"
                )
        if self.undefined not in ("error", "nan"):
            raise InputError(f"undefined={self.undefined!r} of plan {self.name!r}: write 'error' or 'nan'")

    @property
    def name(self) -> str:
        """The function's name, with dashes."""
        return getattr(self.function, "__name__", "plan").replace("_", "-")

    @property
    def __name__(self) -> str:
        return getattr(self.function, "__name__", "plan")

    @property
    def __wrapped__(self) -> Callable[..., Any]:
        return self.function

    @property
    def doc(self) -> str:
        """The first sentence of its docstring."""
        return (inspect.getdoc(self.function) or "").split("\n")[0]

    @cached_property
    def signature(self) -> inspect.Signature:
        """Parameters after X."""
        signature = inspect.signature(self.function)
        if not signature.parameters:
            raise PlanError(f"plan {self.name!r} takes no argument: write def plan(X, n=4): ...")
        return signature.replace(parameters=list(signature.parameters.values())[1:])

    def __call__(self, X: Any, *args: Any, **params: Any) -> Any:
        """Use the plan inside another one; anywhere else it is an error."""
        if isinstance(X, Population):
            return self.function(X, *args, **params)
        raise PlanError(f"plan {self.name!r} was called on {X!r}: call derive(plan, X) or simulate(plan, X) instead")

    def bind(self, params: Mapping[str, Any]) -> dict[str, Any]:
        """Parameters with defaults filled in; strings become numbers unless the default is a string."""
        known = self.signature.parameters
        for name in params:
            if name not in known:
                raise UnknownName(f"parameter of plan {self.name}", name, known)
        missing = [n for n, p in known.items() if p.default is p.empty and n not in params]
        if missing:
            raise InputError(f"plan {self.name!r} needs {', '.join(missing)}: give e.g. {missing[0]}=4")
        bound = {n: p.default for n, p in known.items() if p.default is not p.empty} | dict(params)
        return {name: self._number(name, value) for name, value in bound.items()}

    def _number(self, name: str, value: Any) -> Any:
        if not isinstance(value, str) or isinstance(self.signature.parameters[name].default, str):
            return value
        number = exact_number(value, name)
        return int(number) if number.denominator == 1 else number


@overload
def plan(function: Callable[..., Any], /) -> Plan: ...
@overload
def plan(
    *, source: str = "", unbiased: bool | None = None, why: str = "", undefined: str = "error"
) -> Callable[[Callable[..., Any]], Plan]: ...
def plan(function: Callable[..., Any] | None = None, /, **facts: Any) -> Any:
    """Declare a function of X to be a plan: ``@plan`` or ``@plan(source=..., undefined="nan")``.

    ``undefined="nan"`` lets comparisons with 0/0 be false, as in C; by default they are errors.
    Raises PlanError for a reserved parameter name.

    >>> @plan(source="Kirk & Arvo 1991, Fig. 1")
    ... def estimate_mean(X, n=4, eps=0):
    ...     S = X.draw(n)
    ...     return S.mean() if S.range() <= eps else X.true_mean()
    >>> estimate_mean.source
    'Kirk & Arvo 1991, Fig. 1'
    """
    if function is not None:
        return Plan(function)
    return lambda decorated: Plan(decorated, **facts)


def as_plan(given: Any) -> Plan:
    """A plan as it is, a plain function as a plan; InputTypeError for anything else."""
    if isinstance(given, Plan):
        return given
    if callable(given) and not isinstance(given, Quantity):
        return Plan(given)
    raise InputTypeError(
        f"plan={given!r} (type={type(given).__name__}) is not a function of X: see truemean list plans"
    )
