"""Numbers and names as text: a decimal to read, p/q where it is short."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

__all__ = ["counted", "decimal", "exact", "listed", "signed"]

SHORT = 13


def decimal(value: float | Fraction | None) -> str:
    """``value`` with five decimals, or three digits and a power of ten where those would say little.

    >>> decimal(Fraction(-1197, 16384)), decimal(1e-30), decimal(0), decimal(None)
    ('−0.07306', '1.00e−30', '0', '–')
    """
    if value is None:
        return "–"
    number = float(value)
    text = "0" if number == 0 else f"{number:.5f}" if 1e-4 <= abs(number) < 1e6 else f"{number:.2e}"
    return text.replace("-", "−")


def signed(value: float | Fraction | None) -> str:
    """The same with its sign, unless it is 0.

    >>> signed(0.25), signed(0)
    ('+0.25000', '0')
    """
    return f"+{decimal(value)}" if value is not None and value > 0 else decimal(value)


def exact(value: Fraction | None) -> tuple[str, ...]:
    """``("p/q",)`` where that is short and no integer, else nothing.

    >>> exact(Fraction(-1197, 16384)), exact(Fraction(2)), exact(Fraction(1, 3) ** 40)
    (('−1197/16384',), (), ())
    """
    if value is None or value.denominator == 1 or value.denominator > 10**SHORT:
        return ()
    text = str(value).replace("-", "−")
    return (text,) if len(text) <= SHORT else ()


def counted(number: int, noun: str) -> str:
    """``number`` of something.

    >>> counted(1, "case"), counted(3, "case")
    ('1 case', '3 cases')
    """
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def listed(names: Sequence[str]) -> str:
    """Names as in a sentence.

    >>> listed(["a", "b", "c"])
    'a, b and c'
    """
    *most, last = names
    return f"{', '.join(most)} and {last}" if most else last
