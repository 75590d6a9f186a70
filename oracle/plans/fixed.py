"""No adaptation at all: the control of every comparison."""

from __future__ import annotations

from typing import Any

from truemean.oracle.plan import plan
from truemean.oracle.population import Population


@plan(source="naive Monte Carlo", unbiased=True, why="nothing is decided")
def fixed(X: Population, n: Any = 4) -> Any:
    """The mean of n samples."""
    return X.draw(n).mean()
