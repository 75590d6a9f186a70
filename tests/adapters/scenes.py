"""Scenes that every renderer is tried on, and how its means are compared."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from truemean.oracle.scene import Scene

# Three polygons on top of each other, concave, of both orientations, reaching out of a frame of 3 x 2.
ARROW = [["1/4", "1/4"], ["11/4", 1], ["1/4", "7/4"], ["5/4", 1]]
STRIP = [["3/2", "-1/2"], ["5/3", "5/2"], [2, "5/2"]]
WEDGE = [[1, "1/2"], ["5/2", 1], [1, 2]]


def scene(width: int, height: int, *polygons: tuple[Any, Any], background: Any = 0) -> Scene:
    """A scene of polygons, each a value and its vertices."""
    layers = [{"value": value, "vertices": vertices} for value, vertices in polygons]
    return Scene.from_dict(
        {"schema": "truemean-scene/1", "width": width, "height": height, "background": background, "polygons": layers}
    )


def assert_means(estimates: NDArray[np.float64], expected: Any, slack: float = 1e-6) -> None:
    """The means over the first axis are those expected, within 4.5 standard errors."""
    error = estimates.std(axis=0) / np.sqrt(len(estimates))
    assert (np.abs(estimates.mean(axis=0) - np.array(expected, dtype=float)) <= 4.5 * error + slack).all()
