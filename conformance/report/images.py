"""Images in the manner of the paper's Fig. 5: what two plans show on average."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from truemean.conformance.plain import plain
from truemean.conformance.report.charts import DIVERGING, panels, styled
from truemean.conformance.report.document import Chart, Section
from truemean.conformance.report.wording import counted, decimal, exact, signed
from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue
from truemean.oracle.scene import Scene, load_scene

__all__ = ["expected", "section"]

Place = tuple[int, int]
DARK_BRIGHT = LinearSegmentedColormap.from_list("dark-bright", [DIVERGING[0], "#ffffff", DIVERGING[-1]])


@dataclass(frozen=True, slots=True)
class Images:
    """The bias of both plans in every pixel of a scene, by (column, row)."""

    scene: Scene
    true_mean: dict[Place, Fraction]
    unbiased: dict[Place, Fraction]
    biased: dict[Place, Fraction]

    def array(self, values: dict[Place, Fraction]) -> NDArray[np.float64]:
        """``[rows, columns]``."""
        size = range(self.scene.height), range(self.scene.width)
        return np.array([[float(values[x, y]) for x in size[1]] for y in size[0]])


@cache
def images(scene: str, n: int) -> Images:
    """The expected images of Fig. 2 and Fig. 1 with pilots of ``n``; pixels of equal law are derived once."""
    loaded = load_scene(scene)
    pixels: dict[Place, Any] = loaded.pixels()
    laws = {frozenset(X.law.items()): Pixel(X.law) for X in pixels.values()}
    plans: tuple[tuple[str, dict[str, Any]], ...] = (("kirk-arvo-unbiased", {"p": n}), ("kirk-arvo", {"n": n}))
    unbiased, biased = (
        {law: derive(catalogue[name], X, **params).bias for law, X in laws.items()} for name, params in plans
    )
    law_of = {place: frozenset(X.law.items()) for place, X in pixels.items()}
    return Images(
        loaded,
        {place: X.mean for place, X in pixels.items()},
        {place: unbiased[law] for place, law in law_of.items()},
        {place: biased[law] for place, law in law_of.items()},
    )


@styled
def expected(scene: str = "fig5", n: int = 4) -> Figure:
    """The expected images of Fig. 2 (unbiased) and Fig. 1 (biased) side by side, and their difference."""
    found = images(scene, n)
    truth, unbiased, biased = map(found.array, (found.true_mean, found.unbiased, found.biased))
    figure, axes = panels(10, 4.4, 1, 3)
    figure.set_layout_engine("compressed")
    grey: dict[str, Any] = {
        "cmap": "gray",
        "vmin": min(0, truth.min()),
        "vmax": max(1, truth.max()),
        "interpolation": "nearest",
    }
    axes[0].imshow(truth + unbiased, **grey)
    shown = axes[1].imshow(truth + biased, **grey)
    figure.colorbar(shown, ax=axes[:2], location="bottom", shrink=0.5, aspect=30, label="expected value E[ξ]")
    limit = float(np.abs(biased - unbiased).max()) or 1.0
    difference = axes[2].imshow(biased - unbiased, cmap=DARK_BRIGHT, vmin=-limit, vmax=limit, interpolation="nearest")
    bar = figure.colorbar(difference, ax=axes[2], location="bottom", aspect=15, label="← too dark · too bright →")
    bar.set_ticks([-limit, 0, limit], labels=[signed(-limit), "0", signed(limit)])
    titles = ("a  unbiased (Fig. 2)", f"c  biased (Fig. 1, n = {n})", "c − a")
    for panel, title in zip(axes, titles, strict=True):
        panel.set_title(title)
        panel.set(xticks=[], yticks=[])
        panel.grid(visible=False)
        panel.spines[["top", "right"]].set_visible(True)
    return figure


def section(scene: str = "fig5", n: int = 4) -> Section:
    """Fig. 5 with its worst pixel."""
    found = images(scene, n)
    place = max(found.biased, key=lambda at: (abs(found.biased[at]), at))
    touched = [at for at, bias in found.biased.items() if bias]
    worst = f"{decimal(found.biased[place])} ({', '.join(exact(found.biased[place])) or 'exact in report.json'})"
    return Section(
        "images",
        "What does that do to an image?",
        (
            _lead(found.scene),
            Chart(
                "figure-5",
                "In the manner of the paper’s Fig. 5",
                f"The biased plan makes little covered pixels darker and largely covered ones brighter, so the "
                f"roping of edges gets worse; it is wrong in {counted(len(touched), 'pixel')}, most of all by {worst} in column {place[0]} "
                f"of row {place[1]}.",
                expected(scene, n),
            ),
        ),
        {
            "scene": found.scene.to_dict(),
            "n": n,
            "largest_unbiased_bias": plain(max(map(abs, found.unbiased.values()))),
            "biased_pixels": [
                {"x": x, "y": y, "true_mean": plain(found.true_mean[x, y]), "bias": plain(found.biased[x, y])}
                for x, y in touched
            ],
        },
    )


def _lead(scene: Scene) -> str:
    return (
        f"A black and white edge and a thin white polygon at {scene.width}×{scene.height} pixels under a box filter, with "
        "exact coverages. The images are expected values, so they show the tendencies of the plans and no noise. The paper "
        "does not give its vertices; these are truemean’s own."
    )
