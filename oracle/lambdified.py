"""A result as a NumPy function of its symbols, without the cancellation of an expanded polynomial.

The formula is not evaluated. For each distinct value of what is no weight (sample sizes, thresholds,
values) the plan is derived once, decisions exact, and its rows are evaluated for all weights at once:
probabilities are products of positive numbers, deviations are taken from the true mean.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from truemean.errors import InputError
from truemean.oracle.exact import is_symbolic
from truemean.oracle.pixel import Pixel

if TYPE_CHECKING:
    from truemean.oracle.derivation import Derivation

__all__ = ["lambdified"]

RESULTS = ("bias", "expectation", "relative_bias", "variance", "mse", "cost", "oracle_calls")
_MOST_WEIGHTS_AT_ONCE = 1 << 16


def lambdified(derivation: Derivation, symbols: Sequence[Any], result: str) -> Callable[..., NDArray[np.float64]]:
    """A function of arrays, one per symbol in the order given, that broadcasts them like a ufunc."""
    if result not in RESULTS:
        raise InputError(f"result={result!r} has no function: choose one of {', '.join(RESULTS)}")
    X = derivation.pixel
    if X.regions or X.count is not None or X.channels is not None:
        raise InputError(f"{X!r} has regions, colours or an open number of values: substitute numbers and derive again")
    names = [str(s) for s in symbols] or [str(s) for s in derivation.symbols]
    open_ = {str(s) for s in derivation.symbols}
    if (
        len(set(names)) < len(names)
        or not set(names) >= open_
        or not set(names) <= {str(s) for s in derivation.all_symbols}
    ):
        raise InputError(f"symbols {', '.join(names)} are not the symbols of the result: {', '.join(sorted(open_))}")
    weights = _weights_of(X, names)
    others = sorted({str(s) for s in derivation.all_symbols} - {str(s) for w in X.weights for s in _free(w)})

    def function(*arrays: Any) -> NDArray[np.float64]:
        if len(arrays) != len(names):
            raise InputError(f"{len(arrays)} arrays given: give one for each of {', '.join(names)}")
        spread = np.broadcast_arrays(*(np.asarray(a, dtype=float) for a in arrays))
        given = dict(zip(names, (a.ravel() for a in spread), strict=True))
        shape = spread[0].shape if spread else ()
        found = np.empty(int(np.prod(shape)))
        keys = np.stack([given[name] for name in others], axis=-1) if others else np.zeros((len(found), 0))
        distinct, which = np.unique(keys, axis=0, return_inverse=True)
        w = weights(given, len(found))
        for number, key in enumerate(distinct):
            places = np.flatnonzero(which.reshape(-1) == number)
            found[places] = _evaluated(derivation, dict(zip(others, key, strict=True)), w[:, places], result)
        return found.reshape(shape)

    return function


def _evaluated(derivation: Derivation, numbers: dict[str, float], w: NDArray[np.float64], result: str) -> Any:
    """The result at many weights, all else being fixed numbers."""
    from truemean.oracle.derivation import derive

    values = [_number(v, numbers) for v in derivation.pixel.values]
    params = {name: _number(value, numbers) for name, value in derivation.params.items()}
    if len(set(values)) < len(values):
        raise InputError(f"values {', '.join(map(str, values))} coincide: the formula holds for distinct values")
    X = Pixel(dict.fromkeys(values, Fraction(1, len(values))))
    found = derive(derivation.plan, X, **params)
    parts = [
        getattr(found.at(w[:, start : start + _MOST_WEIGHTS_AT_ONCE]), result)
        for start in range(0, w.shape[1], _MOST_WEIGHTS_AT_ONCE)
    ]
    return np.concatenate(parts)


def _number(value: Any, numbers: dict[str, float]) -> Any:
    """A parameter or value with its symbols replaced by the exact value of floats."""
    from sympy import Integer, Rational

    if not is_symbolic(value):
        return value
    exact = {s: Fraction(numbers[str(s)]) for s in value.free_symbols}
    put = value.subs({s: Rational(x.numerator, x.denominator) for s, x in exact.items()})
    number = Fraction(int(put.p), int(put.q)) if put.is_Rational else Fraction(float(put))
    return int(number) if isinstance(put, Integer) else number


def _free(weight: Any) -> set[Any]:
    return set(weight.free_symbols) if is_symbolic(weight) else set()


def _weights_of(X: Pixel, names: list[str]) -> Callable[[dict[str, Any], int], NDArray[np.float64]]:
    """Weights ``[k, points]`` from the arrays of their symbols; the last one by the simplex if it is not given."""
    from sympy import lambdify

    missing = {s for w in X.weights for s in _free(w) if str(s) not in names}
    put = {s: e for s, e in X.simplex.items() if s in missing}
    if missing - set(put):
        raise InputError(f"weights {', '.join(sorted(map(str, missing)))} are not given: list them among the symbols")
    formulas = [w.subs(put) if is_symbolic(w) else float(w) for w in X.weights]
    symbols = sorted({s for f in formulas for s in _free(f)}, key=str)
    functions = [lambdify(symbols, f, "numpy") for f in formulas]

    def weights(given: dict[str, Any], points: int) -> NDArray[np.float64]:
        arguments = [given[str(s)] for s in symbols]
        return np.array([np.broadcast_to(np.asarray(f(*arguments), dtype=float), (points,)) for f in functions])

    return weights
