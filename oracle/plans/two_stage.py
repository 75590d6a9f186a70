"""Two stages: a pilot decides how many samples follow, and is thrown away or pooled."""

from __future__ import annotations

from typing import Any

from truemean.oracle.plan import plan
from truemean.oracle.population import Population


@plan(
    source="Kirk & Arvo 1991, section 4: Fig. 2 as the area of R shrinks to zero",
    unbiased=True,
    why="the estimate is a fresh sample; the pilot chooses its size and nothing else",
)
def discard_pilot(X: Population, p: Any = 4, n1: Any = 4, n2: Any = 16, eps: Any = 0) -> Any:
    """The pilot chooses the size of a second sample and is discarded."""
    S = X.draw(p)
    return X.draw(n1 if (S.range() <= eps).all() else n2).mean()


@plan(
    source="the common practice that Kirk & Arvo 1991, section 3, describes",
    unbiased=False,
    why="a pilot that looked easy counts whole, one that did not is diluted by the second stage",
)
def two_stage_pooled(X: Population, n: Any = 4, m: Any = 12, eps: Any = 0) -> Any:
    """A pilot of n; where it varies, m more; the mean of all."""
    S = X.draw(n)
    if (S.range() > eps).any():
        S.more(m)
    return S.mean()
