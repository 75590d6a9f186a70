"""Reading and writing numbers: strings are decimal rationals, floats are taken at their exact binary value."""

from __future__ import annotations

import math
from decimal import Decimal
from fractions import Fraction
from numbers import Integral, Rational
from typing import Any

from flint import fmpq

from truemean.errors import AssumptionError, InputError, InputTypeError

__all__ = [
    "exact_count",
    "exact_fraction",
    "exact_number",
    "exact_or_symbolic",
    "exact_text",
    "exact_weight",
    "is_symbolic",
    "short_text",
]

_MOST_DIGITS = 100_000


def exact_number(value: Any, name: str = "value") -> Fraction:
    """``value`` as a rational: int, Fraction, Decimal, ``"p/q"``, decimal string, or a float as it stands.

    >>> exact_number("0.1"), exact_number(0.1) == Fraction(1, 10)
    (Fraction(1, 10), False)
    """
    if isinstance(value, Fraction):
        return value
    if isinstance(value, Rational | Integral):
        return Fraction(int(value.numerator), int(value.denominator))
    if isinstance(value, str | Decimal) and _digits(str(value)) > _MOST_DIGITS:
        raise InputError(
            f"{name}={value!r} has more than {_MOST_DIGITS:,} digits when written out: use a smaller exponent"
        )
    if isinstance(value, str):
        try:
            return Fraction(value.strip())
        except (ValueError, ZeroDivisionError):
            raise InputError(
                f"{name}={value!r} is not a number: write an integer, 'p/q' or a decimal such as '0.875'"
            ) from None
    try:
        as_float = value if isinstance(value, Decimal) else float(value)
    except (TypeError, ValueError, OverflowError):
        raise InputTypeError(
            f"{name}={value!r} (type={type(value).__name__}) is not a number: use int, Fraction, float or a string 'p/q'"
        ) from None
    if not math.isfinite(as_float):
        raise InputError(f"{name}={value!r} is not finite: a pixel's numbers must be finite")
    return Fraction(as_float)


def is_symbolic(value: Any) -> bool:
    """Whether a number is a formula: a SymPy expression with symbols in it.

    >>> from sympy import Symbol
    >>> is_symbolic(Symbol("n") + 1), is_symbolic(2)
    (True, False)
    """
    return bool(getattr(value, "free_symbols", None))


def exact_or_symbolic(value: Any, name: str = "value") -> Any:
    """A number as `exact_number` reads it; a formula in symbols stays as it is.

    AssumptionError for a formula that is not real.
    """
    if not is_symbolic(value):
        return exact_number(value, name)
    if value.is_extended_real is False or value.is_finite is False:
        raise AssumptionError(f"{name}={value} is not a real number: declare its symbols with real=True")
    return value


def short_text(value: Any, most: int = 48) -> str:
    """``exact_text`` for a sentence: the middle of a long number is left out; a formula as it is.

    >>> short_text(Fraction(1, 3)), short_text(Fraction(10) ** 5000, most=9)
    ('1/3', '100...00')
    """
    text = exact_text(value) if isinstance(value, Rational) else str(value)
    return text if len(text) <= most else f"{text[: most // 3]}...{text[-(most // 4) :]}"


def exact_weight(value: Any, name: str = "weight") -> Any:
    """``value`` as a weight in [0, 1]; a float is refused, because nobody means its binary value.

    >>> exact_weight("7/8")
    Fraction(7, 8)
    """
    if is_symbolic(value):
        if value.is_negative or value.is_extended_real is False:
            raise AssumptionError(
                f"{name}={value} can't be a coverage: declare its symbols with positive=True, or none of them"
            )
        return value
    if not isinstance(value, str | Integral | Rational | Decimal):
        hint = f"write {str(value)!r}" if _is_real(value) else "write an int, a Fraction or 'p/q'"
        raise InputTypeError(f"{name}={value!r} (type={type(value).__name__}) is not an exact weight: {hint}")
    weight = exact_number(value, name)
    if weight < 0:
        raise InputError(f"{name}={value!r} is negative: weights are coverages between 0 and 1")
    return weight


def exact_fraction(value: Any, name: str) -> Any:
    """A part of a whole: like `exact_weight` (floats taken as they stand), strictly between 0 and 1."""
    part = exact_weight(value, name) if is_symbolic(value) else exact_number(value, name)
    if not is_symbolic(part) and not 0 < part < 1:
        raise InputError(f"{name}={value!r} must lie strictly between 0 and 1")
    return part


def exact_count(value: Any, name: str, what: str) -> int:
    """``value`` as an integer of at least 1; InputError says that it is no ``what``.

    >>> exact_count("3", "n", "number of cells along a side")
    3
    """
    number = exact_number(value, name)
    if isinstance(value, bool) or number.denominator != 1 or number < 1:
        raise InputError(f"{name}={short_text(number)} is no {what}: give an integer of at least 1")
    return int(number)


def exact_text(value: Rational) -> str:
    """``p/q`` in full, however long (Python's own conversion stops at 4300 digits).

    >>> exact_text(Fraction(-1197, 16384)), len(exact_text(Fraction(10**5000, 3)))
    ('-1197/16384', 5003)
    """
    return str(fmpq(int(value.numerator), int(value.denominator)))


def _digits(text: str) -> int:
    """How long a number in exponent notation is when written out."""
    mantissa, _, exponent = text.strip().lower().partition("e")
    try:
        return len(mantissa) + abs(int(exponent or 0))
    except ValueError:
        return 0


def _is_real(value: Any) -> bool:
    try:
        return math.isfinite(float(value))
    except (TypeError, ValueError, OverflowError):
        return False
