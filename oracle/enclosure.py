"""Enclosures: two multi-precision numbers with the exact one between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal, localcontext
from fractions import Fraction
from typing import Any

from truemean.errors import NotExact
from truemean.oracle.float64 import Approx, rounded

__all__ = ["Ball", "Enclosure", "closer"]


_DIGITS_TRIED = (20, 60, 200, 600)
_MOST_DIGITS = 80  # of an exact bound that is written out


@dataclass(frozen=True, slots=True)
class Enclosure:
    """An interval of mpmath numbers that contains the exact number; a point where that is known.

    >>> third = Enclosure.around(Fraction(1, 3), Fraction(1, 3), digits=5)
    >>> Fraction(1, 3) in third, third
    (True, Enclosure(0.33333333302, 0.33333333349))
    """

    lower: Any
    upper: Any

    @classmethod
    def around(cls, low: Fraction, high: Fraction, digits: int) -> Enclosure:
        """Bounds rounded outwards, with a few digits more than asked for."""
        from mpmath import mp
        from mpmath.libmp import dps_to_prec, from_rational

        precision = dps_to_prec(digits + 3)
        ends = ((low, "f"), (high, "c"))
        bounds = [mp.make_mpf(from_rational(x.numerator, x.denominator, precision, way)) for x, way in ends]
        return cls(*bounds)

    def __contains__(self, number: Any) -> bool:
        low, high = self.fractions
        return bool(low <= number <= high)

    @property
    def fractions(self) -> tuple[Fraction, Fraction]:
        """Both bounds as exact rationals."""
        return _exact(self.lower), _exact(self.upper)

    @property
    def texts(self) -> tuple[str, str]:
        """Both bounds in decimal, rounded outwards, one digit beyond where they differ."""
        low, high = self.fractions
        width, size = high - low, max(abs(low), abs(high))
        digits = _MOST_DIGITS if not width else max(2, min(_MOST_DIGITS, 2 + len(str(int(size / width)))))
        return _decimal(low, digits, ROUND_FLOOR), _decimal(high, digits, ROUND_CEILING)

    def __repr__(self) -> str:
        return f"Enclosure({', '.join(self.texts)})"


@dataclass(frozen=True, slots=True)
class Ball:
    """A rational centre and how far the exact number can be from it."""

    centre: Fraction
    radius: Fraction = Fraction(0)

    @classmethod
    def of(cls, number: Any) -> Ball:
        """A ball as it is, an exact number as a point."""
        return number if isinstance(number, Ball) else cls(Fraction(number))

    def enclosure(self, digits: int) -> Enclosure:
        """Its ends as multi-precision numbers."""
        return Enclosure.around(self.centre - self.radius, self.centre + self.radius, digits)

    def __add__(self, other: Any) -> Ball:
        right = Ball.of(other)
        return Ball(self.centre + right.centre, self.radius + right.radius)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Ball:
        right = Ball.of(other)
        return Ball(self.centre - right.centre, self.radius + right.radius)

    def __mul__(self, other: Any) -> Ball:
        right = Ball.of(other)
        radius = abs(self.centre) * right.radius + self.radius * (abs(right.centre) + right.radius)
        return Ball(self.centre * right.centre, radius)

    def __truediv__(self, other: Fraction) -> Ball:
        return Ball(self.centre / other, self.radius / abs(other))


def closer(again: Callable[[int, int], list[Any]], rtol: float) -> list[Approx]:
    """A result in floats to a relative tolerance: rounded from exact numbers, or from balls where it is irrational.

    ``again`` computes it to so many digits with so many bits, exactly for 0. NotExact where no ball is small enough.
    """
    try:
        return list(map(rounded, again(0, 0)))
    except NotExact:
        pass
    for digits in _DIGITS_TRIED:
        ends = [enclosure.fractions for enclosure in again(digits, 64 + 4 * digits)]
        if all(high - low <= Fraction(rtol) / 2 * min(abs(low), abs(high)) for low, high in ends):
            nearest = [(rounded(low), float(high - low)) for low, high in ends]
            return [Approx(number.value, (number.error + width) * (1 + 1e-15)) for number, width in nearest]
    raise NotExact(
        f"the result is 0 or too small for rtol={rtol} within {digits} decimal places: use arithmetic='ball'"
    )


def _decimal(number: Fraction, digits: int, rounding: str) -> str:
    with localcontext(prec=digits, rounding=rounding, Emax=10**9, Emin=-(10**9)):
        rounded = Decimal(number.numerator) / Decimal(number.denominator)
        return f"{rounded:f}" if not rounded or abs(rounded.adjusted()) < 2 * digits else str(rounded).lower()


def _exact(number: Any) -> Fraction:
    sign, mantissa, exponent, _ = number._mpf_
    whole: Fraction = Fraction(int(mantissa)) * Fraction(2) ** exponent
    return -whole if sign else whole
