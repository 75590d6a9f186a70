"""The commands that run an estimator, or plan to: judge, plan-run, report."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from truemean import options
from truemean.commands import command
from truemean.errors import MissingExtra, UnknownName
from truemean.exits import judged_code

if TYPE_CHECKING:
    from truemean.conformance import Report

__all__ = ["judge", "plan_run", "report"]


@command(
    "judge",
    "truemean judge python:my_sampler.py:estimate --tolerance 1%",
    'truemean judge "plan:kirk-arvo?n=4" --tolerance 1% --tolerance thin=5%',
    'truemean judge python:my_sampler.py:estimate --tolerance 1% --suspect "kirk-arvo?n=4" --pixels hard',
    'truemean judge "raysect?min_samples=4" --tolerance 1% --budget 2000 --html verdict.html',
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
        estimator = load(subject)
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


CODE = {
    "Fig. 1 in NumPy": "python:truemean.adapters.reference:KirkArvo",
    "Fig. 2 in NumPy": "python:truemean.adapters.reference:KirkArvoUnbiased",
}
RENDERERS = {
    "raysect": {
        "raysect, not adaptive": "raysect?pixel_samples=4",
        "raysect, adaptive (pilot 4)": "raysect?min_samples=4&cutoff=0&ratio=1e9",
    }
}


@command("report", "truemean report", "truemean report --renderers none --out plans-only")
def report(
    out: options.Directory = Path("truemean-report"),
    renderers: options.Renderers = "all",
    seed: options.Seed = 0,
) -> int:
    """Write the reference report: plans and renderers compared.

    The figures of the paper are recomputed, plans compared, implementations judged. The directory holds
    report.html (one file, no network), report.md and report.json. It takes a minute or two, and says what
    it skipped because a renderer is not installed.
    """
    from truemean.output import command_line, console, replaced, working

    with replaced(out, "report.json") as directory, working("starting") as show:
        from truemean.conformance.report import build

        subjects, skipped = _reported_subjects(renderers)
        summary = build(
            directory,
            subjects,
            command=command_line(),
            seed=seed,
            skipped=skipped,
            progress=lambda text, done: show(f"{done:4.0%} {text}"),
        )
    lines = [f"{name} skipped: {why}" for name, why in skipped.items()]
    lines.append(f"written: {out / 'report.html'}, report.md and report.json beside it")
    console().print(summary["headline"], *lines, sep="\n", soft_wrap=True)
    return 0


def _reported_subjects(renderers: str) -> tuple[dict[str, tuple[str, Any]], dict[str, str]]:
    """SUBJECT and estimator by name, and which renderers are missing and why.

    MissingExtra for a missing one that was asked for by its name.
    """
    from truemean.adapters import load

    asked = {"all": list(RENDERERS), "none": []}.get(renderers, renderers.split(","))
    subjects, skipped = {name: (text, load(text)) for name, text in CODE.items()}, {}
    for renderer in asked:
        if renderer not in RENDERERS:
            raise UnknownName("renderer", renderer, ["all", "none", *RENDERERS])
        try:
            subjects |= {name: (text, load(text)) for name, text in RENDERERS[renderer].items()}
        except MissingExtra as error:
            if renderers != "all":
                raise
            skipped[renderer] = str(error)
    return subjects, skipped
