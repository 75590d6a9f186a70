"""The command ``truemean``: derive, prove, worst-case, judge, report, ...; ``--help`` says what each is for.

Nothing heavy is imported before a command runs, so that help costs nothing.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from truemean import __version__, options
from truemean.errors import MissingExtra, UnknownName
from truemean.exits import CODES, exit_code, judged_code

if TYPE_CHECKING:
    from truemean.conformance import Report

__all__ = ["app", "main"]

app = typer.Typer(
    name="truemean",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["--help", "-h"]},
    epilog=CODES,
)


def main() -> None:
    """The program ``truemean``."""
    app(prog_name="truemean")


def command(name: str, *examples: str) -> Callable[[Callable[..., int]], Callable[..., None]]:
    """Register a command that returns its exit code; whatever it raises becomes one line and a code."""

    def register(function: Callable[..., int]) -> Callable[..., None]:
        @functools.wraps(function)
        def run(**arguments: Any) -> None:
            raise typer.Exit(exit_code(functools.partial(function, **arguments)))

        app.command(name, epilog="\b\n" + "\n".join(["Examples:", *(f"  {example}" for example in examples)]))(run)
        return run

    return register


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"truemean {__version__}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """What an adaptive sampling plan is worth exactly, and whether an implementation has the true mean.

    derive computes bias, variance and cost of a PLAN on a pixel, without running it. judge runs a
    SUBJECT (your code, a renderer) and says, with evidence, whether its mean is the pixel's. report
    writes both for everything that is installed. Every command has its own --help with examples.
    """


@command(
    "derive",
    'truemean derive kirk-arvo --pixel "0:7/8,1:1/8" --set n=4',
    'truemean derive my_plans.py:my_plan --pixel "standard:eight-tones" --json -',
    'truemean derive hierarchical --pixel "tile#4,0" --set depth=1',
    "truemean derive kirk-arvo --pixel symbolic:2 --set n=n --latex",
)
def derive(
    plan: options.PlanName,
    pixel: options.PixelText,
    settings: options.Settings = None,
    arithmetic: options.Arithmetic = None,
    digits: options.Digits = None,
    rows: options.Rows = None,
    json: options.Json = None,
    latex: options.Latex = False,
) -> int:
    """Derive what a sampling PLAN is worth on a pixel.

    Its bias, variance and cost are computed, not sampled. The bias is shown path by path: which decisions
    the plan took, how likely that is, and what it adds. Where the pixel or a parameter is a symbol the
    results are formulas.
    """
    from truemean.arguments import check_destination, read_pixel, read_plan
    from truemean.conformance.declared import plan_errors
    from truemean.oracle import derive as derive_plan
    from truemean.output import working, write_json
    from truemean.tables import derivation_json, print_derivation, print_latex

    check_destination("--json", json)
    chosen, params = read_plan(plan, settings or ())
    X = read_pixel(pixel)
    how: dict[str, Any] = {} if rows is None else {"rows": rows}
    how |= {"arithmetic": arithmetic or (None if digits is None else "ball"), "digits": digits}
    with working("deriving"), plan_errors(chosen):
        derivation = derive_plan(chosen, X, **how, **params)
        data = derivation_json(derivation, params)
    if json is not None:
        write_json(json, data)
    if latex and json != "-":
        print_latex(derivation)
    elif json != "-":
        print_derivation(derivation, params)
    return 0


@command(
    "prove",
    "truemean prove kirk-arvo-unbiased",
    "truemean prove my_plans.py:my_plan --set n=8 --json proof.json",
)
def prove(
    plan: options.PlanName,
    settings: options.Settings = None,
    values: options.Values = None,
    json: options.Json = None,
) -> int:
    """Prove a PLAN unbiased, or find the smallest pixel that shows its bias.

    First by the rule of Kirk & Arvo, which needs no pixel; else by the bias as a polynomial in the weights,
    with a certificate in the JSON. The exit code is 0 whatever the answer.
    """
    from truemean.arguments import check_destination, read_plan, read_values
    from truemean.conformance.declared import plan_errors
    from truemean.oracle import prove as prove_plan
    from truemean.output import working, write_json
    from truemean.tables import print_proof, proof_json

    check_destination("--json", json)
    chosen, params = read_plan(plan, settings or ())
    with working("proving"), plan_errors(chosen):
        proof = prove_plan(chosen, values=read_values(values), **params)
    if json is not None:
        write_json(json, proof_json(chosen, params, proof))
    if json != "-":
        print_proof(chosen, params, proof)
    return 0


@command(
    "worst-case",
    "truemean worst-case kirk-arvo --set n=4",
    "truemean worst-case two-stage-pooled --objective relative-bias --out worst.svg",
)
def worst_case(
    plan: options.PlanName,
    settings: options.Settings = None,
    objective: options.Objective = "bias",
    k: options.Count = 2,
    values: options.Values = None,
    digits: options.WorstDigits = 30,
    json: options.Json = None,
    out: options.Curve = None,
) -> int:
    """Find the worst pixel of a PLAN, with a certificate.

    The supremum over all weights of the size of the bias, of the bias relative to the true mean, or of the
    mean squared error, enclosed to so many digits, and a pixel that is as bad.
    """
    from truemean.arguments import check_destination, read_plan, read_values
    from truemean.conformance.declared import plan_errors
    from truemean.oracle import worst_case as find_worst_case
    from truemean.output import working, write_json
    from truemean.tables import print_worst_case, worst_case_json

    check_destination("--json", json)
    check_destination("--out", out)
    chosen, params = read_plan(plan, settings or ())
    asked: dict[str, Any] = {"objective": objective.replace("-", " "), "k": k, "values": read_values(values)}
    with working("searching"), plan_errors(chosen):
        worst = find_worst_case(chosen, digits=digits, **asked, **params)
    if json is not None:
        write_json(json, worst_case_json(worst))
    if out is not None:
        from truemean.oracle.plotting import draw_worst_case

        draw_worst_case(worst, out)
    if json != "-":
        print_worst_case(worst)
    return 0


@command("repl", "truemean repl")
def repl() -> int:
    """Open a Python prompt with the oracle's names imported.

    IPython if it is installed (pip install 'truemean[repl]'), with typeset formulas; else Python's own.
    """
    from truemean.repl import interact

    interact()
    return 0


@command(
    "judge",
    "truemean judge python:my_sampler.py:estimate --tolerance 1%",
    'truemean judge "plan:kirk-arvo?n=4" --tolerance 1% --pixels "0:7/8,1:1/8"',
    'truemean judge "raysect?min_samples=4" --tolerance 1% --budget 2000 --html verdict.html',
)
def judge(
    subject: options.Subject,
    tolerance: options.Tolerance,
    pixels: options.PixelTexts = None,
    alpha: options.Alpha = 0.01,
    beta: options.Beta = 0.01,
    budget: options.Budget = 100_000,
    seed: options.Seed = 0,
    range_: options.Range = None,
    declares: options.Declares = None,
    timeout: options.Timeout = None,
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
    from truemean.arguments import check_destination, read_pixels, read_plan, read_range
    from truemean.conformance import judge as judge_estimator
    from truemean.output import working

    for option, file in (("--json", json), ("--html", html), ("--markdown", markdown)):
        check_destination(option, file)
    plan = read_plan(declares) if declares else None
    chosen, bounds = read_pixels(pixels or ()), read_range(range_)
    with working("loading") as show:
        found = judge_estimator(
            load(subject),
            tolerance=tolerance,
            pixels=chosen,
            alpha=alpha,
            beta=beta,
            budget=budget,
            seed=seed,
            declares=plan,
            range=bounds,
            timeout=timeout,
            progress=lambda pixel, drawn, left: show(f"{pixel}: {drawn} replicates; {left} undecided"),
        )
    report = replace(found, subject=subject)
    _write_judgement(report, json, html, markdown)
    return judged_code(report.verdict, deviates=report.plan_check == "DEVIATES", interrupted=report.interrupted)


def _write_judgement(report: Report, json: str | None, html: str | None, markdown: str | None) -> None:
    from truemean.output import write_json, write_text
    from truemean.tables import print_judgement

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


@command("figure", "truemean figure 3 --out fig3.svg", "truemean figure 5 --scene tile --n 2 --out fig5.png")
def figure(
    name: options.FigureName,
    out: options.Picture,
    most: options.Most = None,
    scene: options.SceneName = None,
    n: options.Pilot = None,
) -> int:
    """Draw one figure of the report into a file."""
    from truemean.arguments import check_destination
    from truemean.output import working

    check_destination("--out", out)
    given = {"most": most, "scene": scene, "n": n}
    with working(f"drawing figure {name}"):
        from truemean.conformance.report import figure as draw

        draw(name, out, **{option: value for option, value in given.items() if value is not None})
    return 0


@command("list", "truemean list plans", "truemean list adapters")
def list_(
    what: options.ListName,
) -> int:
    """List the plans, the pixels or the adapters there are.

    Plans with their parameters and whether they are unbiased, pixels with what they stress, adapters
    (what runs a SUBJECT) with how to get those that are not installed.
    """
    from truemean import tables
    from truemean.adapters import available
    from truemean.oracle.plans import catalogue

    lists: dict[str, Callable[[], None]] = {
        "plans": lambda: tables.print_plans(catalogue.values()),
        "pixels": tables.print_pixels,
        "adapters": lambda: tables.print_adapters(available()),
    }
    if what not in lists:
        raise UnknownName("list", what, lists)
    lists[what]()
    return 0
