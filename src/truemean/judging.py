"""The commands that run an estimator, or plan to: judge, plan-run, report."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from truemean import options
from truemean.commands import command
from truemean.exits import BROKEN, judged_code

if TYPE_CHECKING:
    from truemean.conformance import Report

__all__ = ["check", "judge", "plan_run", "report"]


@command(
    "judge",
    "truemean judge python:my_sampler.py:estimate --tolerance 1%",
    'truemean judge "plan:kirk-arvo?n=4" --tolerance 1% --tolerance thin=5%',
    'truemean judge python:my_sampler.py:estimate --tolerance 1% --suspect "kirk-arvo?n=4" --pixels hard',
    "truemean judge exec:./my_estimator --tolerance 1% --timeout 60",
    'truemean judge "raysect?min_samples=4" --tolerance 1% --budget 2000 --jobs 2 --html verdict.html',
)
def judge(
    subject: options.Subject,
    tolerance: options.Tolerances,
    pixels: options.PixelTexts = None,
    # How strictly, and how long.
    alpha: options.Alpha = 0.01,
    beta: options.Beta = 0.01,
    budget: options.Budget = 100_000,
    seed: options.Seed = 0,
    timeout: options.Timeout = None,
    method: options.Method = "focus",
    # What is known of the subject, and of the pixels.
    range_: options.Range = None,
    declares: options.Declares = None,
    suspects: options.Suspects = None,
    variance: options.Variance = None,
    tiles: options.Tiles = None,
    independent: options.Independent = False,
    deterministic: options.Deterministic = False,
    jobs: options.Jobs = 0,
    # Where it goes.
    json: options.Json = None,
    html: options.Html = None,
    markdown: options.Markdown = None,
) -> int:
    """Judge whether a SUBJECT has the true mean of each pixel.

    The subject is your own sampler, a plan or a renderer, run as often as it takes. BIASED and CONFORMS
    are wrong with probability alpha and beta at most; INCONCLUSIVE says how many replicates would probably
    decide. Ctrl-C stops the run and shows the evidence so far.

    Exit codes: 0 CONFORMS everywhere; 1 BIASED, or DEVIATES from the plan declared; 3 INCONCLUSIVE;
    4 BROKEN: the subject crashed, or left its range.
    """
    from truemean.adapters import load
    from truemean.arguments import check_destination, read_pixels, read_plan, read_range, read_tolerances
    from truemean.conformance import judge as judge_estimator
    from truemean.conformance.planning import planned
    from truemean.output import working

    for option, file in (("--json", json), ("--html", html), ("--markdown", markdown)):
        check_destination(option, file)
    # Read what is asked.
    strictness: dict[str, Any] = {"alpha": alpha, "beta": beta, "budget": budget, "seed": seed, "timeout": timeout}
    plan = read_plan(declares) if declares else None
    chosen, bounds = read_pixels(pixels or ()), read_range(range_)
    # Judge.
    with working("loading") as show:
        estimator = load(subject, jobs=jobs)
        found = judge_estimator(
            estimator,
            tolerance=read_tolerances(tolerance),
            pixels=chosen,
            declares=plan,
            range=bounds,
            variance=variance,
            method=method,
            suspects=[read_plan(suspect) for suspect in suspects or ()],
            regions=tiles,
            independent=independent,
            deterministic=deterministic or None,
            **strictness,
            progress=lambda pixel, drawn, left: show(f"{pixel}: {drawn} replicates; {left} undecided"),
        )
        # A page has room for the plan too.
        report = replace(found, subject=subject)
        if html or markdown:
            report = planned(report, estimator, chosen, plan, bounds)
    _write_judgement(report, json, html, markdown)
    return judged_code(report.verdict, deviates=report.plan_check == "DEVIATES", interrupted=report.interrupted)


@command("check", "truemean check python:my_sampler.py:estimate", 'truemean check "raysect?min_samples=4"')
def check(
    subject: options.Subject,
    pixels: options.PixelTexts = None,
    replicates: options.Replicates = 64,
    json: options.Json = None,
) -> int:
    """Check that a SUBJECT keeps the promises of an estimator, before it is judged.

    The same seed gives the same estimate, whatever it is run with; different seeds give different ones, without
    correlation; shapes, ranges and costs are right; a pixel of one value has it. For who writes an adapter.

    Exit codes: 0 every promise is kept; 4 one is broken.
    """
    from truemean.adapters import load
    from truemean.arguments import check_destination, read_pixels
    from truemean.conformance import check_subject
    from truemean.judgements import print_checks
    from truemean.output import working, write_json

    check_destination("--json", json)
    with working("loading") as show:
        estimator = load(subject)
        show("checking")
        checks = check_subject(estimator, pixels=read_pixels(pixels or ()), replicates=replicates, strict=False)
    if json is not None:
        found = [{"promise": each.promise, "kept": each.kept, "seen": each.seen} for each in checks]
        write_json(json, {"schema": "truemean-check/1", "subject": subject, "checks": found})
    if json != "-":
        print_checks(subject, checks)
    return BROKEN if any(each.kept is False for each in checks) else 0


@command(
    "plan-run",
    'truemean plan-run "plan:two-stage-pooled?n=4&m=12" --tolerance 1%',
    "truemean plan-run python:my_sampler.py:estimate --declares fixed?n=8 --tolerance 1% --budget 20000",
)
def plan_run(
    subject: options.Subject,
    tolerance: options.Tolerances,
    pixels: options.PixelTexts = None,
    alpha: options.Alpha = 0.01,
    beta: options.Beta = 0.01,
    budget: options.Budget = 100_000,
    range_: options.Range = None,
    declares: options.Declares = None,
    json: options.Json = None,
) -> int:
    """Plan a run of judge: how many replicates it will take, and which bias it would miss.

    From the exact law of the plan that the SUBJECT declares; nothing is run. The exit code is 0 whatever is
    to be expected.
    """
    from truemean.adapters import load
    from truemean.arguments import check_destination, read_pixels, read_plan, read_range, read_tolerances
    from truemean.conformance import plan_run as plan
    from truemean.judgements import print_run_plan
    from truemean.output import working, write_json

    check_destination("--json", json)
    with working("planning"):
        planned = plan(
            load(subject),
            tolerance=read_tolerances(tolerance),
            alpha=alpha,
            beta=beta,
            budget=budget,
            pixels=read_pixels(pixels or ()),
            declares=read_plan(declares) if declares else None,
            range=read_range(range_),
        )
    if json is not None:
        write_json(json, {**planned.to_json(), "subject": subject})
    if json != "-":
        print_run_plan(planned)
    return 0


def _write_judgement(report: Report, json: str | None, html: str | None, markdown: str | None) -> None:
    from truemean.judgements import print_judgement
    from truemean.output import write_json, write_text

    if "-" not in (json, html, markdown):
        print_judgement(report)
    if json is not None:
        write_json(json, report.to_json())
    if html is not None or markdown is not None:
        from truemean.conformance.report import judged_html, judged_markdown

        for file, render in ((html, judged_html), (markdown, judged_markdown)):
            if file is not None:
                write_text(file, render(report))


@command("report", "truemean report", "truemean report --renderers none --out plans-only")
def report(
    out: options.Directory = Path("truemean-report"),
    renderers: options.Renderers = "all",
    seed: options.Seed = 0,
    jobs: options.Together = 0,
) -> int:
    """Write the reference report: plans and renderers compared.

    The figures of the paper are recomputed, plans compared, implementations judged. The directory holds
    report.html (one file, no network), report.md, report.json, and a page for each renderer. It takes a minute
    or two, and one more for each renderer; it says what it skipped because a renderer is not installed.
    """
    from truemean.adapters import load
    from truemean.output import command_line, console, replaced, working
    from truemean.reporting import CODE, about, chosen, judged

    with replaced(out, "report.json") as directory, working("starting") as show:
        from truemean.conformance.report import build

        entries, skipped = chosen(renderers)
        pages, failed = judged(entries, seed, jobs or os.cpu_count() or 1, show)
        skipped |= failed
        summary = build(
            directory,
            {name: (text, load(text)) for name, text in CODE.items()},
            command=command_line(),
            seed=seed,
            skipped=skipped,
            progress=lambda text, done: show(f"{done:4.0%} {text}"),
            pages=pages,
            about={page: about(page) for page in pages},
        )
    lines = [f"{name} skipped: {why}" for name, why in skipped.items()]
    lines.append(f"written: {out / 'report.html'}, report.md and report.json beside it{_beside(pages)}")
    console().print(summary["headline"], *lines, sep="\n", soft_wrap=True)
    return 0


def _beside(pages: Mapping[str, Any]) -> str:
    return f", and {', '.join(f'{page}.html' for page in pages)}" if pages else ""
