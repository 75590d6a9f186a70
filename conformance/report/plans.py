"""The plans of the catalogue beside each other: bias, noise, cost, and how closely each was looked at."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import cycle
from types import MappingProxyType
from typing import Any

from matplotlib.figure import Figure

from truemean.conformance.pixels import standard_pixels
from truemean.conformance.plain import plain
from truemean.conformance.report.charts import MARKERS, MUTED, SERIES, panels, styled
from truemean.conformance.report.document import Cell, Chart, Section, Table
from truemean.conformance.report.wording import decimal, exact, signed
from truemean.errors import NeedsScene, RowBudgetExceeded
from truemean.oracle import Pixel, derive
from truemean.oracle.plans import catalogue
from truemean.oracle.scene import load_scene

__all__ = ["cost_error", "section"]

SCENE_PIXEL = "tile", 4, 1
PILOT, PILOTS = 4, (2, 4, 8, 16, 32)
BOTTOM = 1e-5
LEAD = (
    "Each number is derived from the plan’s own code on the exact pixel; nothing was run. The observation level "
    "is how closely a sample had to be looked at for the bias: unseen and flat samples cost next to nothing, "
    "counts tell every tuple of the paper’s Eq. 3 apart."
)


@dataclass(frozen=True, slots=True)
class Entry:
    """What a plan is worth on one channel of a pixel; ``why`` says why nothing is known."""

    plan: str
    pixel: str
    why: str = ""
    bias: Fraction = Fraction(0)
    variance: Fraction = Fraction(0)
    cost: Fraction = Fraction(0)
    oracle_calls: Fraction = Fraction(0)
    level: str = ""
    rows: int = 0

    def cell(self) -> Cell:
        """Bias, standard deviation, cost and level, in this order."""
        if self.why:
            return Cell(self.why, (), "number missing")
        tone = "minus" if self.bias < 0 else "plus" if self.bias else "zero"
        calls = f" + {float(self.oracle_calls):.2g} oracle" if self.oracle_calls else ""
        spread = f"σ {decimal(math.sqrt(self.variance))}"
        cost = f"{float(self.cost):.3g} samples{calls}"
        return Cell(signed(self.bias), (*exact(self.bias), spread, cost, self.level), f"number {tone}")

    def json(self) -> dict[str, Any]:
        names = {"plan": self.plan, "pixel": self.pixel}
        if self.why:
            return names | {"missing": self.why}
        numbers = {name: plain(getattr(self, name)) for name in ("bias", "variance", "cost", "oracle_calls")}
        spread = {"std": math.sqrt(self.variance), "level": self.level, "rows": self.rows}
        return names | numbers | spread


@cache
def entries() -> tuple[tuple[Entry, ...], ...]:
    """By pixel and channel, then by plan."""
    scene, x, y = SCENE_PIXEL
    pixels = standard_pixels() | {f"{scene}#{x},{y}": load_scene(scene).pixel(x, y)}
    found = []
    for name, pixel in pixels.items():
        by_plan = [_derived(plan, name, pixel) for plan in catalogue]
        found += list(zip(*by_plan, strict=True))
    return tuple(found)


def _derived(plan: str, name: str, pixel: Pixel) -> list[Entry]:
    """An entry for each channel."""
    channels = [name] if pixel.channels is None else [f"{name}[{c}]" for c in range(pixel.channels)]
    try:
        d = derive(catalogue[plan], pixel, **sized(plan, PILOT))
        bias, variance = (v if isinstance(v, tuple) else (v,) for v in (d.bias, d.variance))
    except NeedsScene:
        return [Entry(plan, channel, "needs a scene") for channel in channels]
    except RowBudgetExceeded as why:
        return [Entry(plan, channel, str(why)) for channel in channels]
    level = ", ".join(f"{sample} {seen}" for sample, seen in d.level.items())
    rest = (d.cost, d.oracle_calls, level, d.rows)
    return [Entry(plan, *each, *rest) for each in zip(channels, [""] * len(channels), bias, variance, strict=True)]


# -- cost against error ---------------------------------------------------------------------------


def sized(plan: str, n: int) -> dict[str, Any]:
    """The parameters of a plan with a pilot of ``n`` and up to four times as many samples in a later stage.

    A plan that stops at a standard error is given one that it reaches between the two.
    """
    known = catalogue[plan].signature.parameters
    sizes = {"n": n, "p": n, "start": n, "m": 3 * n, "n1": n, "n2": 4 * n, "most": 4 * n}
    sizes["grid"] = round(math.sqrt(n))
    standard_error = {"eps": Fraction(1, 4 + n // 2)} if "most" in known else {}
    return {name: size for name, size in sizes.items() if name in known} | standard_error


@cache
def sweep() -> dict[str, tuple[tuple[int, Fraction, Fraction, Fraction, Fraction], ...]]:
    """By plan: pilot, bias, variance, cost and oracle calls on the pixel of the scene."""
    scene, x, y = SCENE_PIXEL
    pixel = load_scene(scene).pixel(x, y)
    found = {}
    for plan in catalogue:
        derived = [(n, derive(catalogue[plan], pixel, **sized(plan, n))) for n in PILOTS]
        found[plan] = tuple((n, d.bias, d.variance, d.cost, d.oracle_calls) for n, d in derived)
    return found


@styled
def cost_error() -> Figure:
    """Bias and standard deviation apart, over the expected number of samples."""
    figure, (left, right) = panels(10, 4.2, 1, 2, sharex=True)
    for (plan, points), colour, marker in zip(sweep().items(), cycle(SERIES), MARKERS, strict=False):
        costs = [float(cost) for _, _, _, cost, _ in points]
        biases = [max(BOTTOM, abs(float(bias))) for _, bias, *_ in points]
        line: dict[str, Any] = {"color": colour, "marker": marker, "label": plan, "clip_on": False}
        line["linestyle"] = "--" if any(calls for *_, calls in points) else "-"
        left.plot(costs, biases, **line)
        right.plot(costs, [math.sqrt(variance) for _, _, variance, *_ in points], **line)
    left.set(xscale="log", yscale="log", title="size of the bias", ylabel="|E[ξ] − I|", ylim=(BOTTOM, 1))
    right.set(xscale="log", yscale="log", title="standard deviation", ylabel="σ")
    left.set_yticks([BOTTOM, 1e-4, 1e-3, 1e-2, 1e-1, 1], ["0", "0.0001", "0.001", "0.01", "0.1", "1"])
    left.annotate("unbiased: exactly 0", (1, BOTTOM), (-2, 5), **_IN_CORNER, color=MUTED)
    right.set_yticks([0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.4], ["0.005", "0.01", "0.02", "0.05", "0.1", "0.2", "0.4"])
    for panel in (left, right):
        panel.set_xlabel("expected cost E[samples drawn]")
        panel.set_xticks([2, 4, 8, 16, 32, 64, 128], ["2", "4", "8", "16", "32", "64", "128"])
        panel.minorticks_off()
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


_IN_CORNER: Mapping[str, Any] = MappingProxyType(
    {"xycoords": ("axes fraction", "data"), "textcoords": "offset points", "ha": "right", "fontsize": 8}
)


def section() -> Section:
    """The plans by name, the table plan x pixel, and the chart of cost against error."""
    rows = entries()
    scene, x, y = SCENE_PIXEL
    pixel = load_scene(scene).pixel(x, y)
    return Section(
        "plans",
        "What is each plan worth?",
        (
            LEAD,
            _who(),
            Table(
                "plan-pixel",
                "Signed bias, standard deviation σ, expected cost, and observation level of each sample. "
                "The ground is tinted where a plan is too dark (−) or too bright (+) there.",
                ("pixel", *catalogue),
                tuple((Cell(row[0].pixel), *(entry.cell() for entry in row)) for row in rows),
            ),
            Chart(
                "cost-error",
                "Cost against error",
                f"At equal cost every plan that keeps a pilot which looked easy is biased, and the unbiased ones pay in "
                f"noise or in discarded samples (pixel {scene}#{x},{y}, coverage {pixel.mean}; pilots of "
                f"{', '.join(map(str, PILOTS))}; dashed: calls of the true mean are not counted as samples).",
                cost_error(),
            ),
        ),
        {
            "table": [entry.json() for row in rows for entry in row],
            "cost_error": {
                plan: [
                    {"pilot": n, "bias": plain(bias), "variance": plain(variance), "cost": plain(cost)}
                    for n, bias, variance, cost, _ in points
                ]
                for plan, points in sweep().items()
            },
        },
    )


def _who() -> Table:
    rows = []
    for name, plan in catalogue.items():
        params = ", ".join(f"{key}={value}" for key, value in plan.bind(sized(name, PILOT)).items())
        verdict = Cell("unbiased" if plan.unbiased else "biased", (plan.why,))
        rows.append((Cell(name, (params,)), Cell(plan.doc), verdict, Cell(plan.source)))
    return Table(
        "plan-list",
        "The plans and the parameters used in the table below.",
        ("plan", "what it does", "bias, and why", "source"),
        tuple(rows),
    )
