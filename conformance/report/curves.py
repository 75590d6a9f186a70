"""The paper's Figs. 3 and 4, recomputed exactly."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from typing import Any

from matplotlib.figure import Figure

from truemean.conformance.plain import plain
from truemean.conformance.report.charts import DIVERGING, panels, styled, zero_line
from truemean.conformance.report.document import Cell, Chart, Section, Table
from truemean.conformance.report.wording import exact, signed
from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue

__all__ = ["absolute", "percent", "section"]

COVERAGES = tuple(Fraction(i, 8) for i in range(1, 8))
TABLED = (1, 2, 3, 4, 8, 16, 32)
LEAD = (
    "A pilot of n samples is kept if all agree, else the true mean is computed. The pixel has value 0 on the "
    "fractional area ω₁ and 1 on the rest. Every point is an exact rational number: no sampling took place."
)


@dataclass(frozen=True, slots=True)
class Curve:
    """The bias of Fig. 1 on a pixel of I_1 = 0 and I_2 = 1, for n = 1, 2, ..."""

    omega_1: Fraction
    bias: tuple[Fraction, ...]
    relative: tuple[Fraction, ...]


@cache
def curves(most: int) -> tuple[Curve, ...]:
    """A curve for each fractional area, n up to ``most``."""
    plan, found = catalogue["kirk-arvo"], []
    for omega_1 in COVERAGES:
        pixel = Pixel({0: omega_1, 1: 1 - omega_1})
        derived = [derive(plan, pixel, n=n, eps=0) for n in range(1, most + 1)]
        found.append(Curve(omega_1, tuple(d.bias for d in derived), tuple(d.relative_bias for d in derived)))
    return tuple(found)


def absolute(most: int = 32) -> Figure:
    """Fig. 3: bias over the size n of the pilot."""
    lines = [(curve.omega_1, curve.bias) for curve in curves(most)]
    return _draw(lines, "bias E[ξ] − I", most)


def percent(most: int = 32) -> Figure:
    """Fig. 4: bias in percent of the true mean over the size n of the pilot."""
    lines = [(curve.omega_1, tuple(100 * r for r in curve.relative)) for curve in curves(most)]
    return _draw(lines, "bias in % of the true mean", most)


@styled
def _draw(lines: list[tuple[Fraction, tuple[Fraction, ...]]], label: str, most: int) -> Figure:
    figure, (axes,) = panels(10, 3.8)
    zero_line(axes)
    for (omega_1, values), colour in zip(lines, reversed(DIVERGING), strict=True):
        axes.plot(range(1, most + 1), [float(v) for v in values], "o-", color=colour, ms=2.4, label=f"{omega_1}")
    axes.set(xlabel="size n of the pilot", ylabel=label, xlim=(0.5, most + 0.5))
    axes.set_xticks([n for n in (1, 2, 4, 8, 12, 16, 20, 24, 28, 32) if n <= most] if most <= 40 else axes.get_xticks())
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(handles[::-1], labels[::-1], title="ω₁", loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def section(most: int = 32) -> Section:
    """Figs. 3 and 4 with a table of the exact values."""
    found = curves(most)
    points = [(bias, curve.omega_1, n) for curve in found for n, bias in enumerate(curve.bias, 1)]
    worst, omega_1, pilot = max(points, key=lambda point: abs(point[0]))
    return Section(
        "bias",
        "How biased is the paper’s Fig. 1?",
        (
            LEAD,
            Chart(
                "figure-3",
                "The paper’s Fig. 3, recomputed: absolute bias",
                f"The bias is symmetric about zero and fades as the pilot grows; it is worst, "
                f"{signed(worst)}, at ω₁ = {omega_1} with n = {pilot}.",
                absolute(most),
            ),
            Chart(
                "figure-4",
                "The paper’s Fig. 4, recomputed: percent bias",
                "In percent of the true mean the curves are no longer symmetric: the darker the pixel, the larger the "
                "share of its light that is lost.",
                percent(most),
            ),
            _table(found),
        ),
        {
            "omega_1": [str(c.omega_1) for c in found],
            "n": list(range(1, most + 1)),
            "curves": [_json(c) for c in found],
        },
    )


def _table(found: tuple[Curve, ...]) -> Table:
    tabled = [n for n in TABLED if n <= len(found[0].bias)]
    return Table(
        "figure-3-values",
        "Some points of Fig. 3, with the exact number where it is short (all of them are in report.json).",
        ("ω₁", *(f"n = {n}" for n in tabled)),
        tuple(
            (Cell(str(c.omega_1)), *(Cell(signed(c.bias[n - 1]), exact(c.bias[n - 1]), "number") for n in tabled))
            for c in found
        ),
    )


def _json(curve: Curve) -> dict[str, Any]:
    return {
        "omega_1": plain(curve.omega_1),
        "true_mean": plain(1 - curve.omega_1),
        "bias": [plain(value) for value in curve.bias],
        "percent": [plain(100 * value) for value in curve.relative],
    }
