"""NumPy on quantities: what each ufunc and function means as an expression.

Clamping, quantising and tone curves are then written as in any renderer, ``np.minimum(S.mean(), 1)``.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

from truemean.errors import PlanError
from truemean.oracle.quantity import Decision, Quantity, Vector, by_channel, constant, decision, quantity

__all__ = ["apply_function", "apply_ufunc", "elementwise"]


def where(condition: Any, yes: Any, no: Any) -> Any:
    """``yes`` on the rows where the decision holds, ``no`` elsewhere, without splitting the path."""
    if any(isinstance(x, Vector) for x in (condition, yes, no)):
        return by_channel(where, condition, yes, no)
    if not isinstance(condition, Decision):
        return yes if condition else no
    return Quantity("where", condition, quantity(yes), quantity(no))


_UFUNCS: dict[str, Callable[..., Any]] = {
    "add": operator.add,
    "subtract": operator.sub,
    "multiply": operator.mul,
    "divide": operator.truediv,
    "true_divide": operator.truediv,
    "floor_divide": operator.floordiv,
    "remainder": operator.mod,
    "power": operator.pow,
    "float_power": operator.pow,
    "negative": operator.neg,
    "positive": operator.pos,
    "less": operator.lt,
    "less_equal": operator.le,
    "greater": operator.gt,
    "greater_equal": operator.ge,
    "equal": operator.eq,
    "not_equal": operator.ne,
    "bitwise_and": operator.and_,
    "bitwise_or": operator.or_,
    "logical_and": lambda a, b: decision(a) & decision(b),
    "logical_or": lambda a, b: decision(a) | decision(b),
    "logical_not": lambda a: ~decision(a),
    "invert": operator.invert,
    "square": lambda x: x * x,
    "reciprocal": lambda x: 1 / x,
    "absolute": lambda x: Quantity("abs", quantity(x)),
    "fabs": lambda x: Quantity("abs", quantity(x)),
    "sign": lambda x: where(x > 0, 1, where(x < 0, -1, 0)),
    "minimum": lambda a, b: Quantity("min", quantity(a), quantity(b)),
    "maximum": lambda a, b: Quantity("max", quantity(a), quantity(b)),
    "fmin": lambda a, b: Quantity("min", quantity(a), quantity(b)),
    "fmax": lambda a, b: Quantity("max", quantity(a), quantity(b)),
    "clip": lambda x, low, high: np.minimum(np.maximum(x, low), high),
    "sqrt": lambda x: Quantity("sqrt", quantity(x)),
    "floor": lambda x: Quantity("floor", quantity(x)),
    "ceil": lambda x: Quantity("ceil", quantity(x)),
    "trunc": lambda x: where(x < 0, np.ceil(x), np.floor(x)),
    "rint": lambda x: Quantity("round", quantity(x)),
    "exp": lambda x: Quantity("exp", quantity(x)),
    "log": lambda x: Quantity("log", quantity(x)),
    "exp2": lambda x: Quantity("**", constant(2), quantity(x)),
    "log2": lambda x: np.log(x) / Quantity("log", constant(2)),
    "log10": lambda x: np.log(x) / Quantity("log", constant(10)),
    "log1p": lambda x: np.log(1 + x),
    "expm1": lambda x: np.exp(x) - 1,
    "cbrt": lambda x: Quantity("**", quantity(x), constant(Fraction(1, 3))),
}

_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "where": where,
    "clip": lambda x, a_min=None, a_max=None, **names: _clip(x, names.get("min", a_min), names.get("max", a_max)),
    "round": lambda x, decimals=0: round(x, decimals),
    "around": lambda x, decimals=0: round(x, decimals),
    "abs": abs,
    "sum": sum,
    "all": lambda x: x.all(),
    "any": lambda x: x.any(),
}


def _clip(x: Any, low: Any, high: Any) -> Any:
    raised = x if low is None else np.maximum(x, low)
    return raised if high is None else np.minimum(raised, high)


def apply_ufunc(ufunc: np.ufunc, method: str, inputs: tuple[Any, ...], options: dict[str, Any]) -> Any:
    """What a ufunc means on quantities; PlanError where it means nothing."""
    maker = _UFUNCS.get(ufunc.__name__)
    if maker is None or method != "__call__" or options:
        known = ", ".join(sorted(_UFUNCS))
        raise PlanError(f"np.{ufunc.__name__} ({method}) has no meaning on a quantity; use one of {known}")
    if any(isinstance(x, np.ndarray) and x.ndim for x in inputs):
        return elementwise(lambda *xs: apply_ufunc(ufunc, method, xs, options), *inputs)
    if any(isinstance(x, Vector) for x in inputs):
        return by_channel(lambda *xs: apply_ufunc(ufunc, method, xs, options), *inputs)
    first, *rest = (x if isinstance(x, Decision) else quantity(x) if not isinstance(x, bool) else x for x in inputs)
    return maker(first, *rest)


def apply_function(function: Any, args: Any, kwargs: Any) -> Any:
    """What another NumPy function means on quantities; PlanError where it means nothing."""
    maker = _FUNCTIONS.get(function.__name__)
    if maker is None:
        known = ", ".join(sorted(_FUNCTIONS))
        raise PlanError(f"np.{function.__name__} has no meaning on a quantity; use arithmetic, ufuncs, or {known}")
    return maker(*args, **kwargs)


def elementwise(function: Callable[..., Any], *inputs: Any) -> Any:
    """``function`` on the broadcast elements of arrays, an array of quantities."""
    arrays = []
    for given in inputs:
        cell = np.empty((), dtype=object)
        cell[()] = given
        arrays.append(given if isinstance(given, np.ndarray) else cell)
    grid = np.broadcast(*arrays)
    result = np.empty(grid.size, dtype=object)
    result[:] = [function(*elements) for elements in grid]
    return result.reshape(grid.shape)
