"""Recursion over quadrants, with pilots that decide and are discarded."""

from __future__ import annotations

from typing import Any

from truemean.oracle.plan import plan
from truemean.oracle.population import Population


@plan(
    source="Kirk & Arvo 1991, section 4: hierarchical, pilots discarded",
    unbiased=True,
    why="a pilot only decides whether to subdivide; each part is estimated afresh",
)
def hierarchical(X: Population, n: Any = 4, depth: Any = 2, eps: Any = 0) -> Any:
    """Where a pilot of n varies, the mean of the estimates of the four quadrants; else a fresh mean."""
    quadrants = X.quadrants() if depth else ()
    S = X.draw(n)
    if not depth or (S.range() <= eps).all():
        return X.draw(n).mean()
    return sum(Q.area * Q.estimate(hierarchical, n=n, depth=depth - 1, eps=eps) for Q in quadrants)
