"""Measures the error rates and the power of every kind of evidence, and writes them to a page.

python -m tests.quality.publish --repetitions 2000 --out docs/error-rates.md
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.progress import track
from tests.quality.rates import (
    BIASED,
    EVERY,
    FAR,
    FLOOR,
    HORIZON,
    LAWS,
    LOOK_GROWTH,
    NOMINAL,
    POWER,
    SEED,
    conforming,
    delays,
    false_alarms,
    fixed_alarms,
    fixed_power,
    limit,
    looks,
    within_bound,
    wrong_conforms,
)

from truemean.conformance.evidence import METHODS, FloatArray

SHARES = {"focus": 1.0, "mixture": 1.0, "klinf": 0.05}  # of the repetitions; a quarter for the others
HOURS = "half an hour to an hour of one core"
BEYOND = 0.001  # how often a rate of exactly NOMINAL would be marked
MOST = 12  # multiples of the bound after which no more is drawn
TWICE = 2  # the multiple of the bound that power is measured at
CERTIFIED = ("mean of 16, w = 1/8", "Kirk-Arvo, w = 3/4, n = 8, about its own mean", "0.5 ± 0.001", "uniform")
VALID = tuple(name for name, method in METHODS.items() if method.valid)


@dataclass(frozen=True)
class Run:
    """What the command was asked for."""

    repetitions: int
    seed: int

    def of(self, method: str) -> int:
        """Repetitions of one method; slow ones get fewer."""
        return max(1, round(self.repetitions * SHARES.get(method, 0.25)))

    @property
    def for_power(self) -> int:
        return max(1, self.repetitions // 20)


@dataclass(frozen=True)
class Table:
    """One table of the page: ``cell(run, row, column)`` measures a cell, ``foot(run)`` are rows below."""

    title: str
    text: str
    corner: str
    rows: tuple[str, ...]
    columns: tuple[str, ...]
    cell: Callable[[Run, str, str], str]
    foot: Callable[[Run], dict[str, list[str]]] = lambda run: {}


def percent(count: int, repetitions: int) -> str:
    """A rate; bold if a rate of NOMINAL would hardly show it."""
    text = f"{100 * count / repetitions:.1f}"
    return f"**{text}**" if count > limit(repetitions, BEYOND) else text


def error_cell(measure: Callable[..., int], signs: tuple[int, ...], run: Run, row: str, column: str) -> str:
    """Errors of one method on one law, at each edge."""
    n = run.of(column)
    return " / ".join(percent(measure(column, row, sign, repetitions=n, seed=run.seed), n) for sign in signs)


def error_foot(methods: tuple[str, ...], run: Run) -> dict[str, list[str]]:
    """How many repetitions each column has, and what they can tell."""
    counts = [run.of(method) for method in methods]
    return {
        "*repetitions*": [str(n) for n in counts],
        f"*{100 * (1 - BEYOND):.1f} % limit of {100 * NOMINAL:.0f} %*": [
            f"{100 * limit(n, BEYOND) / n:.1f}" for n in counts
        ],
    }


FIXED: dict[str, tuple[float, int]] = {
    "t, every look": (0.0, 0),
    "t, once at N = 16": (0.0, 16),
    "t, once at N = 1000": (0.0, 1000),
    "z, every look": (FLOOR, 0),
    "z, once at N = 1000": (FLOOR, 1000),
}


def fixed_cell(run: Run, row: str, column: str) -> str:
    """False alarms of a test that is valid once."""
    floor, once = FIXED[column]
    sizes = [once] if once else looks(LAWS[row].horizon)
    n = run.of("welch")
    return percent(fixed_alarms(row, sizes, floor=floor, repetitions=n, seed=run.seed), n)


def median_cell(measure: Callable[..., FloatArray], run: Run, row: str, column: str) -> str:
    """The median of a number of outcomes, in multiples of the bound."""
    middle = float(np.median(measure(column, row, most=MOST, repetitions=run.for_power, seed=run.seed)))
    return f"{middle:.2f}" if middle <= MOST else f"> {MOST}"


def biased_cell(run: Run, row: str, column: str) -> str:
    """How soon a bias is found."""
    return f"{BIASED[row].bound:.0f}" if column == "bound" else median_cell(delays, run, row, column)


def within_cell(run: Run, row: str, column: str) -> str:
    """How soon a mean is certified."""
    return f"{within_bound(row):.0f}" if column == "bound" else median_cell(conforming, run, row, column)


def power_cell(run: Run, row: str, column: str) -> str:
    """How often a bias is found within twice the bound."""
    n = run.for_power
    if column in METHODS:
        found = int(np.isfinite(delays(column, row, most=TWICE, repetitions=n, seed=run.seed)).sum())
    else:
        floor = FLOOR if column == "z, once" else 0.0
        found = fixed_power(row, multiple=TWICE, floor=floor, repetitions=n, seed=run.seed)
    return f"{100 * found / n:.0f}"


TABLES = (
    Table(
        "False alarms: BIASED though E = I",
        "Tolerance 0, in percent.",
        "law",
        tuple(LAWS),
        tuple(METHODS),
        partial(error_cell, false_alarms, (0,)),
        partial(error_foot, tuple(METHODS)),
    ),
    Table(
        "False alarms: BIASED though |E - I| is the tolerance",
        "E on the upper / on the lower edge, in percent. The tolerance is 1/50, or half the mean if that is less.",
        "law",
        tuple(LAWS),
        tuple(METHODS),
        partial(error_cell, false_alarms, (1, -1)),
        partial(error_foot, tuple(METHODS)),
    ),
    Table(
        "Wrong CONFORMS: |E - I| is the tolerance",
        "E on the upper / on the lower edge, in percent: how often just that edge is ruled out. "
        "CONFORMS needs the other edge ruled out too, so it is no more often wrong.",
        "law",
        tuple(LAWS),
        tuple(METHODS),
        partial(error_cell, wrong_conforms, (1, -1)),
        partial(error_foot, tuple(METHODS)),
    ),
    Table(
        "Tests that are valid once, at best",
        "BIASED though E = I, tolerance 0, in percent: the t test (`welch` with one look, or with all of them), and a z "
        f"test that believes no variance below {FLOOR:g}, the rule of Mitsuba 3. N is the number of outcomes.",
        "law",
        tuple(LAWS),
        tuple(FIXED),
        fixed_cell,
        partial(error_foot, ("welch",) * len(FIXED)),
    ),
    Table(
        "Power: outcomes until BIASED",
        f"Tolerance 0, alpha = {POWER}: the median number of outcomes in multiples of the bound log(1/alpha)/KL_inf. "
        "No test that is valid for every law in the range has an average much below 1.",
        "biased law",
        tuple(BIASED),
        ("bound", *VALID),
        biased_cell,
    ),
    Table(
        "Power: BIASED within twice the bound",
        f"Tolerance 0, alpha = {POWER}, in percent: with looks, and by one look at the end. "
        "`welch` with looks has an error rate of its own choosing, see above; one look is worth it only if N was known.",
        "biased law",
        tuple(BIASED),
        ("focus", "mixture", "welch", "t, once", "z, once"),
        power_cell,
    ),
    Table(
        "Power: outcomes until CONFORMS",
        f"E = I, the tolerance as above, beta = {POWER}, no plan declared: the median number of outcomes in multiples "
        "of the bound log(1/beta)/KL_inf of the harder edge.",
        "law",
        CERTIFIED,
        ("bound", *VALID),
        within_cell,
    ),
)


def intro(run: Run) -> str:
    """What is measured, how, and how to do it again."""
    guarantees = "\n".join(f"- `{name}`: {method.guarantee}." for name, method in METHODS.items())
    most = limit(run.repetitions, BEYOND) / run.repetitions
    return f"""# Error rates of the judge, measured

This page is written by a command, of which every number is fixed by the seed. It takes {HOURS}, which `--jobs` divides:

    python -m tests.quality.publish --repetitions {run.repetitions} --seed {run.seed} --out docs/error-rates.md

A rate is the share of repetitions that raise an alarm at any of their looks, at a nominal level of {100 * NOMINAL:.0f} %.
A repetition draws {HORIZON:,} outcomes ({FAR:,} where something happens once in 10,000), with a look after each of
the first {EVERY}, then whenever there are {100 * LOOK_GROWTH:.0f} % more: {len(looks(HORIZON))} looks ({len(looks(FAR))}). The guarantee holds however often one looks.
On one law all methods see the same outcomes.

{run.repetitions} repetitions are made for the default, `focus`, and for `mixture`, fewer for the others: the tables say how many.
If the true rate is {100 * NOMINAL:.0f} %, {run.repetitions} repetitions show more than {100 * most:.2f} % with a probability of less than {100 * BEYOND:.1f} %.
Rates beyond that limit for their number of repetitions are **bold**; only methods without a guarantee, marked †,
may have any. Power is measured with {run.for_power} repetitions.

The methods:

{guarantees}
"""


def heading(column: str) -> str:
    """The name of a column; a method without a guarantee is marked."""
    if column not in METHODS:
        return column
    return f"`{column}`" if METHODS[column].valid else f"`{column}` †"


def shown(table: Table, run: Run, cells: Iterator[str]) -> str:
    """A table as Markdown; ``cells`` come row by row."""
    lines = [[table.corner, *map(heading, table.columns)], ["---", *["---:"] * len(table.columns)]]
    lines += [[row, *(next(cells) for _ in table.columns)] for row in table.rows]
    lines += [[name, *numbers] for name, numbers in table.foot(run).items()]
    rows = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    return f"## {table.title}\n\n{table.text}\n\n{rows}\n"


def measured(run: Run, place: tuple[int, str, str]) -> str:
    """One cell, of the table with that number."""
    return TABLES[place[0]].cell(run, *place[1:])


def page(run: Run, jobs: int) -> str:
    """The whole page."""
    places = [(i, row, column) for i, t in enumerate(TABLES) for row in t.rows for column in t.columns]
    with ExitStack() as stack:
        each: Callable[..., Iterable[str]] = map
        if jobs > 1:
            each = stack.enter_context(ProcessPoolExecutor(jobs)).map
        cells = iter(list(track(each(partial(measured, run), places), "Measuring", len(places))))
    return "\n".join([intro(run), *(shown(table, run, cells) for table in TABLES)])


def main(
    out: Annotated[Path, typer.Option(help="the page to write")],
    repetitions: Annotated[int, typer.Option(help="for the default method, on each law", min=10)] = 2000,
    seed: Annotated[int, typer.Option(help="fixes every number")] = SEED,
    jobs: Annotated[int, typer.Option(help="processes", min=1)] = 1,
) -> None:
    """Measure the error rates of every kind of evidence and write them to a page."""
    out.write_text(page(Run(repetitions, seed), jobs), encoding="utf-8")


if __name__ == "__main__":
    typer.run(main)
