"""Exact numbers of the brute-force twin: sums of square roots, decided exactly, alone or by channel."""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import cache
from math import isqrt
from numbers import Rational
from typing import Any

import numpy as np

from truemean.errors import NotExact, PlanError, UndefinedValue


@cache
def square_part(number: int) -> tuple[int, int]:
    """``(s, r)`` with number = s^2 r and r square-free."""
    square, free, factor = 1, 1, 2
    while factor**3 <= number:
        while number % factor**2 == 0:
            square, number = square * factor, number // factor**2
        if number % factor == 0:
            free, number = free * factor, number // factor
        factor += 1
    # What is left is 1, a prime, or a product of two
    root = isqrt(number)
    return (square * root, free) if root * root == number else (square, free * number)


class NumPyMixin:
    """NumPy's functions, applied number by number: to scalars, to channels, to arrays."""

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **kwargs: Any) -> Any:
        if method != "__call__" or kwargs or ufunc.__name__ not in UFUNCS:
            return NotImplemented
        return lift(UFUNCS[ufunc.__name__], *inputs)

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> Any:
        if function.__name__ not in FUNCTIONS:
            return NotImplemented
        return FUNCTIONS[function.__name__](*args, **kwargs)


class Truth(NumPyMixin):
    """A decision that has been taken: a bool with ``all`` and ``any``, and 0 or 1 in arithmetic."""

    __hash__ = None  # type: ignore[assignment]

    def __init__(self, value: Any) -> None:
        self.value = bool(value)

    def __bool__(self) -> bool:
        return self.value

    def all(self) -> Truth:
        return self

    def any(self) -> Truth:
        return self

    def __invert__(self) -> Truth:
        return Truth(not self.value)

    def __and__(self, other: Any) -> Any:
        return lift(lambda a, b: Truth(a and b), self, other)

    def __or__(self, other: Any) -> Any:
        return lift(lambda a, b: Truth(a or b), self, other)

    def __xor__(self, other: Any) -> Any:
        return lift(lambda a, b: Truth(bool(a) != bool(b)), self, other)

    def __add__(self, other: Any) -> Any:
        return number(self) + other

    def __mul__(self, other: Any) -> Any:
        return number(self) * other

    __rand__, __ror__, __rxor__, __radd__, __rmul__ = __and__, __or__, __xor__, __add__, __mul__


def arithmetic(name: str) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """The method of an operator and its reflection, by way of `lift`."""

    def method(self: Any, other: Any) -> Any:
        return lift(SCALAR[name], self, other)

    def reflected(self: Any, other: Any) -> Any:
        return lift(SCALAR[name], other, self)

    return method, reflected


class Quantity(NumPyMixin):
    """What Num and Vec share: the operators."""

    __hash__ = None  # type: ignore[assignment]
    __add__, __radd__ = arithmetic("add")
    __sub__, __rsub__ = arithmetic("subtract")
    __mul__, __rmul__ = arithmetic("multiply")
    __truediv__, __rtruediv__ = arithmetic("divide")
    __pow__, _ = arithmetic("power")
    __lt__, _ = arithmetic("less")
    __le__, _ = arithmetic("less_equal")
    __gt__, _ = arithmetic("greater")
    __ge__, _ = arithmetic("greater_equal")
    __eq__, _ = arithmetic("equal")
    __ne__, _ = arithmetic("not_equal")

    def __neg__(self) -> Any:
        return 0 - self

    def __pos__(self) -> Any:
        return self

    def __abs__(self) -> Any:
        return lift(UFUNCS["absolute"], self)

    def __floor__(self) -> Any:
        return lift(UFUNCS["floor"], self)

    def __ceil__(self) -> Any:
        return lift(UFUNCS["ceil"], self)

    def __round__(self, digits: int = 0) -> Any:
        return lift(lambda a: Num(round(a.rational(), digits)), self)


class Num(Quantity):
    """A sum of c_r sqrt(r) over square-free integers r; without terms at all, an undefined number.

    Roots of different square-free integers are linearly independent over the rationals, so a
    sum is 0 only when every c_r is: enclosures of growing precision always end.
    """

    lenient = False  # what the plan's policy says about 0/0: comparisons with it are False

    def __init__(self, terms: dict[int, Fraction] | Fraction | int | None) -> None:
        if isinstance(terms, int | Fraction):
            terms = {1: Fraction(terms)}
        self.terms = terms if terms is None else {r: c for r, c in terms.items() if c}

    def sign(self) -> int:
        assert self.terms is not None
        if set(self.terms) <= {1}:
            value = self.terms.get(1, Fraction(0))
            return (value > 0) - (value < 0)
        bits = 32
        while True:
            lower = upper = Fraction(0)
            for r, c in self.terms.items():
                root = isqrt(r << 2 * bits)
                ends = sorted((c * root, c * (root + 1)))
                lower, upper = lower + ends[0], upper + ends[1]
            if lower > 0 or upper < 0:
                return 1 if lower > 0 else -1
            bits *= 2

    def rational(self) -> Fraction:
        if self.terms is None:
            raise UndefinedValue("0/0 reaches the estimate or the size of a sample")
        if not set(self.terms) <= {1}:
            raise NotExact(f"{self!r} is irrational")
        return self.terms.get(1, Fraction(0))

    def __index__(self) -> int:
        value = self.rational()
        if value.denominator != 1:
            raise PlanError(f"{value} is no integer")
        return int(value)

    __int__ = __index__

    def sqrt(self) -> Num:
        if self.terms is None:
            return self
        value = self.rational()
        if value < 0:
            return Num(None)
        square, rest = square_part(value.numerator * value.denominator)
        return Num({rest: Fraction(square, value.denominator)})

    def __repr__(self) -> str:
        if self.terms is None:
            return "undefined"
        return " + ".join(str(c) if r == 1 else f"{c}*sqrt({r})" for r, c in self.terms.items()) or "0"


class Vec(Quantity):
    """One number, or one decision, by channel."""

    def __init__(self, channels: Sequence[Any]) -> None:
        self.channels = tuple(channels)

    def __bool__(self) -> bool:
        raise PlanError("a decision by channel has no single truth value: use .all() or .any()")

    def __iter__(self) -> Any:
        return iter(self.channels)

    def __len__(self) -> int:
        return len(self.channels)

    def __getitem__(self, channel: int) -> Any:
        return self.channels[channel]

    def all(self) -> Truth:
        return Truth(all(self.channels))

    def any(self) -> Truth:
        return Truth(any(self.channels))

    def __invert__(self) -> Vec:
        return Vec([~c for c in self.channels])

    def __and__(self, other: Any) -> Any:
        return lift(lambda a, b: Truth(a and b), self, other)

    def __or__(self, other: Any) -> Any:
        return lift(lambda a, b: Truth(a or b), self, other)

    def __repr__(self) -> str:
        return f"Vec({', '.join(map(repr, self.channels))})"


def number(value: Any) -> Num:
    """Any scalar as a Num; Python floats at their exact binary value."""
    if isinstance(value, Num):
        return value
    if isinstance(value, Truth | bool | np.bool_):
        return Num(int(bool(value)))
    if isinstance(value, str):
        return Num(Fraction(value))
    if isinstance(value, Rational):
        return Num(Fraction(int(value.numerator), int(value.denominator)))
    if isinstance(value, float | np.floating):
        return Num(Fraction(float(value)))
    raise TypeError(f"{value!r} (type={type(value).__name__}) is no number")


def wrap(value: Any) -> Any:
    """A value of a pixel, or the result of a custom statistic, as the plan sees it."""
    return Vec([number(v) for v in value]) if isinstance(value, tuple | Vec) else number(value)


def lift(function: Callable[..., Any], *args: Any) -> Any:
    """``function`` applied number by number; scalars are repeated along channels and arrays."""
    for arg in args:
        if isinstance(arg, np.ndarray):
            rows = [np.broadcast_to(a, arg.shape) if isinstance(a, np.ndarray) else None for a in args]
            out = np.empty(arg.shape, dtype=object)
            for i in np.ndindex(arg.shape):
                out[i] = lift(function, *(a if r is None else r[i] for a, r in zip(args, rows, strict=True)))
            return out
    lengths = {len(arg) for arg in args if isinstance(arg, Vec | tuple)}
    if not lengths:
        return function(*(arg if isinstance(arg, Truth | bool) else number(arg) for arg in args))
    (length,) = lengths
    columns = [tuple(arg) if isinstance(arg, Vec | tuple) else (arg,) * length for arg in args]
    return Vec([lift(function, *column) for column in zip(*columns, strict=True)])


# -- operations on two numbers ---------------------------------------------------------------------


def _add(a: Any, b: Any) -> Num:
    a, b = number(a), number(b)
    if a.terms is None or b.terms is None:
        return Num(None)
    return Num({r: a.terms.get(r, Fraction(0)) + b.terms.get(r, Fraction(0)) for r in a.terms | b.terms})


def _multiply(a: Any, b: Any) -> Num:
    a, b = number(a), number(b)
    if a.terms is None or b.terms is None:
        return Num(None)
    total = Num(0)
    for r, c in a.terms.items():
        for s, d in b.terms.items():
            square, rest = square_part(r * s)
            total = _add(total, Num({rest: c * d * square}))
    return total


def _subtract(a: Any, b: Any) -> Num:
    return _add(a, _multiply(-1, b))


def _divide(a: Any, b: Any) -> Num:
    a, b = number(a), number(b)
    if a.terms is None or not b.terms:
        return Num(None)
    if len(b.terms) > 1:
        raise NotImplementedError(f"division by {b!r}")
    ((r, c),) = b.terms.items()
    return _multiply(a, Num({r: 1 / (c * r)}))


def _power(a: Any, exponent: Any) -> Num:
    a, power = number(a), number(exponent).rational()
    if power.denominator == 2:
        return _power(a.sqrt(), power.numerator)
    if power.denominator != 1:
        raise NotImplementedError(f"power {power}")
    result = Num(1)
    for _ in range(abs(power.numerator)):
        result = _multiply(result, a)
    return result if power >= 0 else _divide(1, result)


def _compare(relation: Callable[[int, int], bool]) -> Callable[[Any, Any], Truth]:
    def compare(a: Any, b: Any) -> Truth:
        difference = _subtract(a, b)
        if difference.terms is None:
            if not Num.lenient:
                raise UndefinedValue("0/0 in a decision")
            return Truth(relation is operator.ne)
        return Truth(relation(difference.sign(), 0))

    return compare


SCALAR: dict[str, Callable[..., Any]] = {
    "add": _add,
    "subtract": _subtract,
    "multiply": _multiply,
    "divide": _divide,
    "power": _power,
    "less": _compare(operator.lt),
    "less_equal": _compare(operator.le),
    "greater": _compare(operator.gt),
    "greater_equal": _compare(operator.ge),
    "equal": _compare(operator.eq),
    "not_equal": _compare(operator.ne),
}

UFUNCS: dict[str, Callable[..., Any]] = SCALAR | {
    "minimum": lambda a, b: a if SCALAR["less_equal"](a, b) else b,
    "maximum": lambda a, b: a if SCALAR["greater_equal"](a, b) else b,
    "absolute": lambda a: a if SCALAR["greater_equal"](a, 0) else _multiply(-1, a),
    "negative": lambda a: _multiply(-1, a),
    "sqrt": lambda a: a.sqrt(),
    "square": lambda a: _multiply(a, a),
    "floor": lambda a: Num(a.rational().__floor__()),
    "ceil": lambda a: Num(a.rational().__ceil__()),
    "rint": lambda a: Num(round(a.rational())),
    "logical_and": lambda a, b: Truth(a and b),
    "logical_or": lambda a, b: Truth(a or b),
    "logical_not": lambda a: Truth(not a),
}


def _clip(q: Any, low: Any, high: Any) -> Any:
    return np.minimum(np.maximum(q, low), high)


def _where(condition: Any, yes: Any, no: Any) -> Any:
    return lift(lambda c, a, b: a if c else b, condition, yes, no)


def _round(q: Any, decimals: int = 0) -> Any:
    return round(q, decimals)


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "clip": _clip,
    "where": _where,
    "round": _round,
    "mean": lambda sample: sample.mean(),
    "min": lambda sample: sample.min(),
    "amin": lambda sample: sample.min(),
    "max": lambda sample: sample.max(),
    "amax": lambda sample: sample.max(),
    "ptp": lambda sample: sample.range(),
    "sum": lambda sample: sample.sum(),
    "median": lambda sample: sample.median(),
    "var": lambda sample, ddof=0: sample.squares() / (sample.size - ddof),
    "std": lambda sample, ddof=0: np.sqrt(sample.squares() / (sample.size - ddof)),
}
