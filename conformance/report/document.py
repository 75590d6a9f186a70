"""What a report is made of, and how it becomes HTML and Markdown."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from truemean.conformance.report.charts import inline_svg

__all__ = ["Cell", "Chart", "Code", "Document", "Section", "Table"]


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell: what is read first, smaller lines below it, a tone, the class that colours it, and a page it leads to."""

    text: str
    small: tuple[str, ...] = ()
    tone: str = ""
    page: str = ""
    chip: ClassVar[bool] = False


@dataclass(frozen=True, slots=True)
class Chip(Cell):
    """A verdict: its colour repeats what its text says."""

    chip: ClassVar[bool] = True


@dataclass(frozen=True, slots=True)
class Table:
    """A table; ``name`` is its id, and the first cell of a row is the row's head."""

    name: str
    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    kind: ClassVar[str] = "table"

    def is_numeric(self, column: int) -> bool:
        """Whether a column holds numbers, to be set flush right."""
        return any("number" in row[column].tone for row in self.rows)


@dataclass(frozen=True, slots=True)
class Chart:
    """A chart with one sentence on what to see in it; ``name`` is its id."""

    name: str
    title: str
    caption: str
    figure: Figure
    kind: ClassVar[str] = "chart"

    @property
    def svg(self) -> Markup:
        """The drawing; every text in it was escaped by matplotlib."""
        return Markup(inline_svg(self.figure, self.name))  # noqa: S704 - our own drawing, not a text from outside


@dataclass(frozen=True, slots=True)
class Code:
    """Lines to paste."""

    text: str
    kind: ClassVar[str] = "code"


@dataclass(frozen=True, slots=True)
class Section:
    """A part of the report: paragraphs, tables and charts in order, and what of it goes to JSON."""

    name: str
    title: str
    parts: tuple[str | Table | Chart | Code, ...]
    data: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Document:
    """A report: one sentence that says what was found, verdicts by name, sections, and what made it."""

    title: str
    headline: str
    verdicts: tuple[tuple[str, str], ...]
    sections: tuple[Section, ...]
    made: str

    def html(self) -> str:
        """One page that needs nothing else."""
        environment = Environment(
            loader=FileSystemLoader(Path(__file__).parent),
            autoescape=True,
            trim_blocks=True,
            lstrip_blocks=True,
            undefined=StrictUndefined,
        )
        return environment.get_template("report.html").render(document=self)

    def markdown(self) -> str:
        """The same without the charts."""
        lines = [f"# {_md(self.title)}", f"**{_md(self.headline)}**"]
        for section in self.sections:
            lines += [f"## {_md(section.title)}", *map(_md_part, section.parts)]
        return "\n\n".join([*lines, _md(self.made)]) + "\n"


def _md_part(part: str | Table | Chart | Code) -> str:
    match part:
        case Table():
            rows = [_md_row(part.head), "|" + " --- |" * len(part.head)]
            rows += ["| " + " | ".join(map(_md_cell, row)) + " |" for row in part.rows]
            return "\n".join([f"*{_md(part.caption)}*", "", *rows])
        case Chart():
            return f"*{_md(part.title)}* (chart in the HTML report): {_md(part.caption)}"
        case Code():
            return "\n".join(f"    {line}" for line in part.text.splitlines())
        case _:
            return _md(part)


def _md_cell(cell: Cell) -> str:
    text = _md(", ".join((cell.text, *cell.small)))
    return f"[{text}]({cell.page}.md)" if cell.page else text


def _md_row(texts: Any) -> str:
    return "| " + " | ".join(map(_md, texts)) + " |"


def _md(text: str) -> str:
    """``text`` as it stands, whatever Markdown would read into it."""
    return re.sub(r"([\\`*_\[\]<>|#&])", r"\\\1", " ".join(text.split()))
