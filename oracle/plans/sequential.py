"""Sampling until the standard error is small: the sample decides when it is believed."""

from __future__ import annotations

from typing import Any

from truemean.oracle.plan import plan
from truemean.oracle.population import Population


@plan(
    source="the stopping rule of Purgathofer 1986, as Kirk & Arvo 1991, section 3, describe it",
    unbiased=False,
    why="samples that happen to agree early stop early and count whole",
)
def sequential(X: Population, start: Any = 4, step: Any = 1, most: Any = 64, eps: Any = "1/20") -> Any:
    """Grow until s / sqrt(n) <= eps, or n = most."""
    S = X.draw_until(lambda S: (S.std_error() <= eps).all(), start=start, step=step, most=most)
    return S.mean()
