"""Plots of a derivation: a result over one of its symbols, one curve for each value of another."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from truemean.errors import InputError
from truemean.oracle.display import called

if TYPE_CHECKING:
    from truemean.oracle.derivation import Derivation
    from truemean.oracle.worst_case import WorstCase

__all__ = ["draw_worst_case", "plot"]

_COVERAGES = (1 / 8, 1 / 4, 3 / 8, 1 / 2, 5 / 8, 3 / 4, 7 / 8)
_SIZES = (2, 4, 8, 16)
_MOST_CURVES = 12


def plot(
    derivation: Derivation,
    over: Any = None,
    *,
    between: Sequence[float] | None = None,
    result: str = "bias",
    **fixed: Any,
) -> Any:
    """A result over a symbol: the sample size as in Fig. 3 if there is one, else the first weight.

    ``between`` bounds the axis; ``fixed`` gives other symbols a number, or a list of numbers for one
    curve each. Weights default to the paper's coverages, sizes to 2, 4, 8, 16, values to 0..1 evenly.
    Returns Matplotlib axes. InputError for a symbol that is not there or has no default.
    """
    import matplotlib.pyplot as plt

    kinds = {str(s): kind_of(derivation, s) for s in derivation.symbols}
    if not kinds:
        raise InputError(f"{derivation!r} has no symbol to plot over: derive with n=Symbol('n') or symbolic weights")
    order = ("size", "weight", "parameter", "value")
    name = str(over) if over is not None else min(kinds, key=lambda s: order.index(kinds[s]))
    unknown = sorted({name, *fixed} - set(kinds))
    if unknown:
        raise InputError(f"{', '.join(unknown)} is no symbol of the result: there are {', '.join(kinds)}")
    axis = _axis(name, kinds[name], between)
    others = {s: _values(derivation, s, kinds, fixed) for s in kinds if s != name}
    function = derivation.lambdify(name, *others, result=result)
    curves = list(itertools.product(*others.values()))
    if len(curves) > _MOST_CURVES:
        raise InputError(f"{len(curves)} curves are too many to read: fix some of {', '.join(others)} to one number")
    _, axes = plt.subplots(layout="constrained")
    for numbers in curves:
        varying = [f"{s}={x:g}" for (s, listed), x in zip(others.items(), numbers, strict=True) if len(listed) > 1]
        axes.plot(axis, function(axis, *numbers), label=", ".join(varying), marker="." if kinds[name] == "size" else "")
    axes.axhline(0, color="0.6", linewidth=0.8)
    axes.set(xlabel=name, ylabel=result.replace("_", " "), title=called(derivation))
    if len(curves) > 1:
        axes.legend(fontsize="small")
    return axes


def kind_of(derivation: Derivation, symbol: Any) -> str:
    """What a symbol is: a weight, a value, a sample size, or another parameter."""
    X = derivation.pixel
    for kind, numbers in (("weight", X.weights), ("value", X.values)):
        if any(symbol in getattr(x, "free_symbols", ()) for x in numbers):
            return kind
    _ = derivation.biases
    place = derivation.field.place(symbol.name)
    return "size" if place is not None and derivation.field.generators[place].kind == "size" else "parameter"


def _axis(name: str, kind: str, between: Sequence[float] | None) -> Any:
    if kind == "size":
        low, high = between or (1, 32)
        return np.arange(int(low), int(high) + 1)
    if between is None and kind != "weight":
        raise InputError(f"{name} can be any number: give between=(low, high)")
    low, high = between or (0, 1)
    return np.linspace(low, high, 259)[1:-1] if kind == "weight" else np.linspace(low, high, 257)


def _values(derivation: Derivation, name: str, kinds: dict[str, str], fixed: dict[str, Any]) -> list[float]:
    """The numbers that a symbol takes, one curve each."""
    given = fixed.get(name)
    if given is not None:
        return [float(x) for x in given] if isinstance(given, Sequence | np.ndarray) else [float(given)]
    weights = [s for s, kind in kinds.items() if kind == "weight"]
    if kinds[name] == "weight" and len(weights) == 1:
        return list(_COVERAGES)
    if kinds[name] == "size":
        return list(_SIZES) if "weight" in kinds.values() else [4.0]
    if kinds[name] == "value":
        values = [str(v) for v in derivation.pixel.values]
        return [values.index(name) / max(1, len(values) - 1)]
    raise InputError(f"{name} has no usual value: give {name}=0.5, or a list for one curve each")


def draw_worst_case(worst: WorstCase, file: Any) -> None:
    """The objective over the weight of the larger of two values, its worst pixel marked, into a file."""
    from matplotlib.figure import Figure

    weights, numbers = worst.curve()
    figure = Figure(layout="constrained")
    axes = figure.subplots()
    axes.plot(weights, numbers)
    axes.axhline(0, color="0.6", linewidth=0.8)
    high = max(worst.pixel.values)
    at = float(worst.pixel.law[high])
    sign = -1.0 if worst.bias < 0 and worst.objective != "mse" else 1.0
    axes.plot(
        [at], [sign * float(worst.value.lower)], "o", label=f"|{worst.objective}| = {float(worst.value.lower):.6g}"
    )
    axes.set(xlabel=f"weight of {high}", ylabel=worst.objective, title=f"{worst.plan.name}: the worst pixel")
    axes.legend()
    figure.savefig(file)
