"""Results as plain data, for JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from numbers import Integral, Rational, Real
from typing import Any

from truemean.oracle import Approx, Enclosure
from truemean.oracle.exact import exact_text

__all__ = ["plain"]

SAFE = 2**53  # integers up to here are the same number to every reader of JSON


def plain(value: Any) -> Any:
    """``value`` for ``json.dumps``: an exact number as ``"p/q"`` beside its float, no NaN and no infinity.

    >>> from fractions import Fraction
    >>> plain({"bias": Fraction(1, 8), "interval": (-0.5, math.inf), "n": 4})
    {'bias': {'exact': '1/8', 'value': 0.125}, 'interval': [-0.5, None], 'n': 4}
    """
    match value:
        case None | bool():
            return value
        case Integral() if abs(int(value)) <= SAFE:
            return int(value)
        case Rational():
            return {"exact": exact_text(value), "value": _finite(value)}
        case Real():
            return _finite(value)
        case Approx():
            return {"value": _finite(value.value), "error": _finite(value.error)}
        case Enclosure():
            return dict(zip(("lower", "upper"), map(plain, value.fractions), strict=True))
        case Mapping():
            return {str(key): plain(part) for key, part in value.items()}
        case tuple() | list():
            return [plain(part) for part in value]
        case _:
            return str(value)


def _finite(value: Any) -> float | None:
    """``value`` as a float, None where it is none."""
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None
