"""The two plans of the paper: Fig. 1, biased for most inputs, and Fig. 2, its unbiased cure."""

from __future__ import annotations

from typing import Any

from truemean.oracle.plan import plan
from truemean.oracle.population import Population


@plan(
    source="Kirk & Arvo 1991, Fig. 1",
    unbiased=False,
    why="the pilot is kept only where it happened to look easy (Eq. 6)",
)
def kirk_arvo(X: Population, n: Any = 4, eps: Any = 0) -> Any:
    """EstimateMean(X, n, eps): the pilot mean if its variation is small, else the true mean."""
    S = X.draw(n)
    if (S.range() <= eps).all():  # the "easy" case
        return S.mean()
    return X.true_mean()  # the "hard" case: the costly oracle


@plan(
    source="Kirk & Arvo 1991, Fig. 2",
    unbiased=True,
    why="the pilot estimates R whatever it shows, and only chooses how often the rest is sampled",
)
def kirk_arvo_unbiased(X: Population, area: Any = "1/4", p: Any = 4, n1: Any = 4, n2: Any = 16, eps: Any = 0) -> Any:
    """UnbiasedEstimateMean(X, R, p, n1, n2, eps): region R by the pilot, the rest by fresh samples."""
    R, rest = _declared(X) or X.split(area)
    S_p = R.draw(p)
    S_n = rest.draw(n1 if (S_p.range() <= eps).all() else n2)
    return S_p.mean() * R.area + S_n.mean() * rest.area


def _declared(X: Population) -> tuple[Population, Population] | None:
    """The regions R and X - R, if the pixel declares them."""
    others = [part for name, part in X.regions.items() if name != "R"]
    return (X.regions["R"], others[0]) if "R" in X.regions and len(others) == 1 else None
