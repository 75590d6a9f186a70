"""Putting a report together: its sections in order, and its three files."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Any

from matplotlib.figure import Figure

from truemean.conformance.provenance import commit, versions
from truemean.conformance.report import curves, images, plans, speed, verdicts
from truemean.conformance.report.charts import save
from truemean.conformance.report.document import Cell, Code, Document, Section, Table
from truemean.conformance.verdict import Report
from truemean.errors import UnknownName

__all__ = ["build", "figure", "judged_html", "judged_markdown"]

SCHEMA = "truemean-report/1"
TOLERANCE = "1%"
FIGURES: Mapping[str, Callable[..., Figure]] = MappingProxyType(
    {
        "3": curves.absolute,
        "4": curves.percent,
        "5": images.expected,
        "speed-accuracy": speed.speed_accuracy,
    }
)
CHAPTERS: tuple[tuple[str, Callable[[], Section], float], ...] = (
    ("the paper’s Figs. 3 and 4", curves.section, 1),
    ("images in the manner of Fig. 5", images.section, 1),
    ("plans on the standard pixels", plans.section, 5),
    ("speed against accuracy", speed.section, 3),
)
JUDGING, WRITING = 8, 2  # seconds for a subject and for the files, about; the chapters have theirs beside them

Progress = Callable[[str, float], None]


def figure(name: str, out: Path, **options: Any) -> None:
    """Draw one of the figures 3, 4, 5 and speed-accuracy into a file, of the kind that its suffix names.

    ``options`` are ``most`` (the largest n) of 3, 4 and speed-accuracy, ``scene`` and ``n`` of 5.
    UnknownName for any other figure or option, InputError for a file that can't be written.
    """
    if name not in FIGURES:
        raise UnknownName("figure", name, FIGURES)
    known = inspect.signature(FIGURES[name]).parameters
    for option in options:
        if option not in known:
            raise UnknownName(f"option of figure {name}", option, known)
    save(FIGURES[name](**options), Path(out))


def build(
    out: Path,
    subjects: Mapping[str, tuple[str, Any]],
    *,
    command: str,
    seed: int,
    skipped: Mapping[str, str],
    progress: Progress | None = None,
    pages: verdicts.Pages | None = None,
    about: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Write report.html, report.json and report.md into the directory ``out``; returns what report.json holds.

    ``subjects`` is what to judge by name: SUBJECT as it is typed, and the estimator; ``pages`` what was judged already,
    by renderer and name, for a page each beside, that begins with what ``about`` says; ``skipped`` what was not run, with the line that installs it;
    ``command`` and ``seed`` are how to replay; ``progress(text, fraction)`` is called often.
    """
    # What is computed, and what is run.
    tell = _rising(progress or (lambda text, fraction: None))
    total = sum(seconds for _, _, seconds in CHAPTERS) + JUDGING * len(subjects) + WRITING
    done, sections = 0.0, []
    for text, chapter, seconds in CHAPTERS:
        tell(text, done / total)
        sections.append(chapter())
        done += seconds
    reports = verdicts.judge_all(subjects, TOLERANCE, seed, lambda text, n: tell(text, (done + JUDGING * n) / total))
    tell("writing the files", 1 - WRITING / total)
    # What was found, as data.
    data: dict[str, Any] = {
        "schema": SCHEMA,
        **_outcome(reports, pages or {}),
        "skipped": dict(skipped) | {name: "interrupted before its turn" for name in subjects if name not in reports},
        "command": command,
        "seed": seed,
        "commit": commit(),
    }
    sections = [verdicts.section(reports, TOLERANCE, pages), *sections, _replay(data)]
    data["sections"] = {section.name: section.data for section in sections if section.data}
    data["pages"] = {
        page: {name: report.to_json() for name, report in found.items()} for page, found in (pages or {}).items()
    }
    # The pages.
    made = f"Made on {datetime.now(UTC):%Y-%m-%d}."
    chips = tuple((name, str(report.verdict)) for name, report in reports.items())
    document = Document("truemean: the reference report", data["headline"], chips, tuple(sections), made)
    _write(Path(out), document, data)
    for page, found in (pages or {}).items():
        _write_page(Path(out), page, found, data, (about or {}).get(page, ""))
    tell("done", 1.0)
    return data


def _outcome(reports: Mapping[str, Report], pages: verdicts.Pages) -> dict[str, Any]:
    """What was found on the implementations, how to judge each of them alone, and what they were run with."""
    every = {**reports, **{name: report for found in pages.values() for name, report in found.items()}}
    return {
        "headline": verdicts.headline(reports, TOLERANCE, pages),
        "tolerance": TOLERANCE,
        "verdicts": {name: str(report.verdict) for name, report in every.items()},
        "interrupted": any(report.interrupted for report in every.values()),
        "alone": {name: verdicts.replay(report) for name, report in every.items()},
        "versions": _all_versions(every),
    }


def _write_page(out: Path, page: str, found: Mapping[str, Report], data: Mapping[str, Any], about: str) -> None:
    """The page of one renderer."""
    notes = tuple(dict.fromkeys(note for report in found.values() for note in report.notes[2:]))
    own = dict(data) | _outcome({}, {page: found}) | {"skipped": {}}
    sections = (
        verdicts.section(found, TOLERANCE),
        Section("about", "How it decides, and what was found", (*_paragraphs(about), *notes)),
        _replay(own),
    )
    chips = tuple(own["verdicts"].items())
    document = Document(f"truemean: {page}", verdicts.headline({}, TOLERANCE, {page: found}), chips, sections, "")
    for suffix, content in (("html", document.html()), ("md", document.markdown())):
        (out / f"{page}.{suffix}").write_text(content, encoding="utf-8")


def _paragraphs(text: str) -> tuple[str, ...]:
    """The paragraphs of a docstring, without its marks."""
    return tuple(" ".join(part.split()).replace("``", "") for part in text.split("\n\n") if part.strip())


def _write(out: Path, document: Document, data: Mapping[str, Any]) -> None:
    files = {
        "report.html": document.html(),
        "report.md": document.markdown(),
        "report.json": json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False),
    }
    for name, content in files.items():
        (out / name).write_text(content, encoding="utf-8")


def _rising(progress: Progress) -> Progress:
    """``progress`` with fractions that never fall: pixels are drawn in turns, and some are ahead of others."""
    highest = 0.0

    def tell(text: str, fraction: float) -> None:
        nonlocal highest
        highest = max(highest, fraction)
        progress(text, highest)

    return tell


def judged_html(report: Report) -> str:
    """One judgement as a page."""
    return _judged(report).html()


def judged_markdown(report: Report) -> str:
    """One judgement as Markdown."""
    return _judged(report).markdown()


def _judged(report: Report) -> Document:
    how = {"verdict": report.reason, "plan check": report.plan_check or "no plan is declared", "seed": report.seed}
    asked = {
        name: value for name, value in report.arguments.items() if value not in (None, False, ()) and name != "pixels"
    }
    settings = how | asked | {"declares": verdicts.declared_plan(report)}
    parts = verdicts.judged_parts(report.subject, report, "subject")
    return Document(
        f"truemean: {report.subject}",
        verdicts.headline({report.subject: report}, str(report.arguments["tolerance"])),
        ((report.subject, str(report.verdict)),),
        (
            Section("cases", "What the replicates show", tuple(parts)),
            Section("how", "How it was judged", (*report.notes, _facts("settings", "Settings and seed.", settings))),
            Section("versions", "Versions", (_facts("judged-with", "What it was judged with.", report.versions),)),
        ),
        "Interrupted before every case was decided." if report.interrupted else "",
    )


def _replay(made: Mapping[str, Any]) -> Section:
    """What was not run, how to get the same report again, and what it was made with."""
    rows = tuple((Cell(name), Cell(why)) for name, why in made["skipped"].items())
    alone = made["alone"].values()
    left_out = Table("not-run", "What was not run, and what would make it run.", ("what", "why"), rows)
    return Section(
        "replay",
        "What was not run, and how to run this again",
        (
            left_out if rows else "Everything that this page knows how to run was run.",
            "The same command with the same seed gives the same numbers; only times differ.",
            Code(made["command"]),
            *(("One implementation alone, with the same replicates:", Code("\n".join(alone))) if alone else ()),
            _facts(
                "made-with",
                "What this report was made with.",
                {"seed": made["seed"], "commit": made["commit"] or "not a checkout"} | made["versions"],
            ),
        ),
    )


def _facts(name: str, caption: str, facts: Mapping[str, Any]) -> Table:
    return Table(name, caption, ("what", "value"), tuple((Cell(key), Cell(str(value))) for key, value in facts.items()))


def _all_versions(reports: Mapping[str, Report]) -> dict[str, str]:
    found = versions()
    for report in reports.values():
        found = dict(report.versions) | found
    return found
