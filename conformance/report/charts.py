"""How charts look, and how matplotlib's figures become files or inline SVG that follows the page."""

from __future__ import annotations

import io
import re
from pathlib import Path
from types import MappingProxyType
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from truemean.errors import InputError

__all__ = ["DIVERGING", "INK", "MARKERS", "MUTED", "SERIES", "inline_svg", "panels", "save", "styled", "zero_line"]

INK, MUTED, RULE = "#1a2027", "#5c6773", "#d5dbe1"
SERIES = ("#0a6ebd", "#c4470f", "#0c7a55", "#7d3fd1", "#96690a", "#b8255f", "#40566b")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", "*")
DIVERGING = ("#c4480e", "#d97a2b", "#b9985a", "#6f7a86", "#5b9aa8", "#2b87c4", "#0a6ebe")
SUFFIXES = (".svg", ".png", ".pdf")

STYLE: Any = MappingProxyType(
    {
        "font.size": 9,
        "axes.titlesize": 9.5,
        "axes.titleweight": "bold",
        "axes.titlelocation": "left",
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "axes.axisbelow": True,
        "axes.edgecolor": MUTED,
        "axes.labelcolor": MUTED,
        "axes.titlecolor": INK,
        "text.color": INK,
        "xtick.color": MUTED,
        "ytick.color": MUTED,
        "grid.color": RULE,
        "grid.linewidth": 0.6,
        "lines.linewidth": 1.6,
        "lines.markersize": 4.5,
        "legend.frameon": False,
        "legend.fontsize": 8.5,
        "svg.fonttype": "none",  # text stays text: readable by machines, in the font of the page
        "svg.hashsalt": "truemean",
        "figure.dpi": 100,
    }
)

styled = rc_context(STYLE)


def panels(width: float, height: float, rows: int = 1, columns: int = 1, **options: Any) -> tuple[Figure, list[Axes]]:
    """A figure of ``width`` x ``height`` inches and its axes, row by row."""
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    return figure, list(axes.flat)


def zero_line(axes: Axes) -> None:
    """The line on which an unbiased plan lies."""
    axes.axhline(0, color=MUTED, linewidth=0.8, zorder=1)


def save(figure: Figure, out: Path) -> None:
    """``figure`` as a file of the kind that its suffix names; InputError for any other suffix."""
    if out.suffix not in SUFFIXES:
        raise InputError(f"out={str(out)!r} has no suffix of a picture: write one of {', '.join(SUFFIXES)}")
    dated = {"CreationDate": None} if out.suffix == ".pdf" else {"Date": None} if out.suffix == ".svg" else {}
    try:
        with rc_context(STYLE):
            figure.savefig(out, dpi=200, facecolor="white", metadata=dated)
    except OSError as error:
        raise InputError(
            f"out={str(out)!r} can't be written ({error.strerror}): name a file in a folder that exists"
        ) from None


def inline_svg(figure: Figure, name: str) -> str:
    """``figure`` as an SVG element whose ids begin with ``name`` and whose colours are those of the page.

    The element points to nothing outside, and the figure's caption, of id ``name-caption``, names it.
    """
    buffer = io.StringIO()
    with rc_context(STYLE | {"svg.hashsalt": name}):
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    drawing = buffer.getvalue()
    width = figure.get_figwidth()
    drawing = drawing[drawing.index("<svg") :]
    # Leave out what belongs to a file of its own.
    drawing = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>", "", drawing, flags=re.DOTALL)
    drawing = drawing.replace("xlink:href", "href")
    box = re.search(r'viewBox="[^"]*"', drawing)
    root = f'<svg role="img" aria-labelledby="{name}-caption" {box and box[0]} style="width: {width:g}in">'
    drawing = re.sub(r"<svg.*?>", root, drawing, count=1, flags=re.DOTALL)
    # Give the ids a prefix.
    drawing = re.sub(r'\bid="', f'id="{name}-', drawing)
    drawing = re.sub(r'(href="|url\()#', rf"\g<1>#{name}-", drawing)
    # Let the page choose the colours.
    colours = {INK: "ink", MUTED: "muted", RULE: "rule"}
    colours |= {colour: f"series-{i}" for i, colour in enumerate(SERIES)}
    colours |= {colour: f"diverging-{i}" for i, colour in enumerate(DIVERGING)}
    for colour, variable in colours.items():
        drawing = drawing.replace(colour, f"var(--{variable})")
    return drawing.strip()
