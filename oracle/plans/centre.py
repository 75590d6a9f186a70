"""A sample at a fixed place, the centre of the pixel, that counts like the random ones."""

from __future__ import annotations

from typing import Any

from truemean.oracle.plan import plan
from truemean.oracle.population import Population


@plan(
    source="Cycles' kernel: sample 0 of every pixel is shot through the filter centre",
    unbiased=False,
    why="a fixed position has a share of 1/n whatever the coverage of its value is",
)
def centre_first(X: Population, n: Any = 4) -> Any:
    """The mean of one sample at the pixel's centre and n - 1 drawn ones."""
    centre = X.at("1/2", "1/2")
    return centre if n == 1 else (centre + X.draw(n - 1).sum()) / n


@plan(
    source="POV-Ray's anti-aliasing method 1, where it supersamples",
    unbiased=False,
    why="a fixed position counts as much as each cell of the grid",
)
def centre_and_grid(X: Population, grid: Any = 3) -> Any:
    """The mean of one sample at the pixel's centre and one drawn in each of grid x grid equal cells."""
    cells = X.grid(grid)
    return (X.at("1/2", "1/2") + sum(cell.draw(1).mean() for cell in cells)) / (len(cells) + 1)
