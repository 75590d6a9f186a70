"""The arguments and options of the command line, each with the sentence that ``--help`` shows."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

# -- what is derived, judged, drawn or listed -----------------------------------------------------

PlanName = Annotated[
    str,
    typer.Argument(metavar="PLAN", help="A name from 'truemean list plans', FILE.py:FUNCTION or MODULE:FUNCTION."),
]
Subject = Annotated[
    str,
    typer.Argument(
        metavar="SUBJECT",
        help="What to run: python:FILE.py:NAME, exec:COMMAND, lib:PATH:SYMBOL, images:DIR, plan:NAME?n=4 or a renderer; "
        "see 'truemean list adapters'. Quote it where it has a ? or &.",
    ),
]
FigureName = Annotated[
    str,
    typer.Argument(
        metavar="3|4|5|speed-accuracy",
        help="3, 4: the paper's bias over n; 5: images in its manner; speed-accuracy: of the engine itself.",
    ),
]
ListName = Annotated[str, typer.Argument(metavar="plans|pixels|adapters|methods", help="What to list.")]
Renderers = Annotated[
    str, typer.Option(metavar="all|none|NAME,...", help="Which renderers to judge; all: those installed.")
]

# -- pixels and plans -----------------------------------------------------------------------------

PixelText = Annotated[
    str,
    typer.Option(
        metavar="PIXEL",
        help="Values with their weights, 0:7/8,1:1/8 or (1,0,0):1/2,(0,1,0):1/2; one of 'truemean list pixels', "
        "standard:thin; FILE.json:NAME; column and row of a scene, scene.json#12,7; or symbols, symbolic:2, symbolic:values=0,1.",
    ),
]
PixelTexts = Annotated[
    list[str] | None,
    typer.Option(
        metavar="standard|hard|scenes|FILE.json|SCENE#*|PIXEL",
        help="On which pixels: a set, a file of your own, all of a scene, or one written as for derive. Repeatable. "
        "[default: those that the subject brings, else standard]",
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="A parameter of the plan, exact: 4, 1/3, 0.05; a word is a symbol: n=n. Repeatable.",
    ),
]
Declares = Annotated[
    str | None, typer.Option(metavar="PLAN?n=4", help="The plan that the subject should follow: is that so, too?")
]

# -- how it is computed ---------------------------------------------------------------------------

Arithmetic = Annotated[
    str | None,
    typer.Option(
        metavar="exact|symbolic|ball|float64",
        help="Rational numbers, formulas, enclosures, or floats with an error bound. "
        "[default: exact, symbolic where a symbol is given]",
    ),
]
Digits = Annotated[
    int | None,
    typer.Option(min=1, metavar="N", help="Enclose each result to so many decimal places (arithmetic ball)."),
]
Latex = Annotated[bool, typer.Option("--latex", help="Print each result as a LaTeX equation, and nothing else.")]
Objective = Annotated[str, typer.Option(metavar="bias|relative-bias|mse", help="What is to be as bad as possible.")]
Count = Annotated[
    int, typer.Option("-k", "--k", min=2, metavar="K", help="How many values the pixel has, evenly spaced.")
]
Values = Annotated[str | None, typer.Option(metavar="V,...", help="The values of the pixel, instead of 0 to 1 evenly.")]
WorstDigits = Annotated[int, typer.Option("--digits", min=1, metavar="N", help="Decimal digits to certify.")]
Curve = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Draw the curve over the weight of 1; the suffix is the format.")
]
Rows = Annotated[int | None, typer.Option(min=1, metavar="N", help="The most rows that may be told apart.")]
Tolerances = Annotated[
    list[str],
    typer.Option(
        "--tolerance",
        metavar="SIZE|PIXEL=SIZE",
        help="The bias that you can live with: in percent of the pixel's range, 1%, or absolute, 0.005. "
        "0 hunts for any bias at all. Repeatable, with other sizes for some pixels.",
    ),
]
Suspects = Annotated[
    list[str] | None,
    typer.Option(
        "--suspect",
        metavar="PLAN?n=4",
        help="A plan that the subject may secretly follow: found sooner if so, and no verdict is less sure. Repeatable.",
    ),
]
Variance = Annotated[
    str | None,
    typer.Option(metavar="V", help="A bound on the variance of the estimates, for those of no finite --range."),
]
Method = Annotated[
    str, typer.Option(metavar="NAME", help="The kind of evidence, of 'truemean list methods'; focus needs least.")
]
Tiles = Annotated[
    int | None,
    typer.Option(min=1, metavar="N", help="Show the evidence by tile of N x N pixels, of pixels named scene#x,y."),
]
Independent = Annotated[
    bool,
    typer.Option("--independent", help="The pixels are independent, so that small biases of many add up faster."),
]
Deterministic = Annotated[
    bool, typer.Option("--deterministic", help="The subject has no random numbers: it may ignore its seeds.")
]
Alpha = Annotated[float, typer.Option(metavar="P", help="The risk of a wrong BIASED or DEVIATES anywhere in the run.")]
Beta = Annotated[float, typer.Option(metavar="P", help="The risk of a wrong CONFORMS, for each pixel and channel.")]
Budget = Annotated[int, typer.Option(metavar="N", help="The most replicates (runs of the subject) for each pixel.")]
Seed = Annotated[int, typer.Option(metavar="N", min=0, help="Which random numbers: the same seed, the same results.")]
Range = Annotated[
    str | None,
    typer.Option(
        "--range",
        metavar="LO,HI",
        help="Bounds of every estimate, for subjects that leave the pixel's own values; -inf,inf for none, with "
        "--variance. [default: those values]",
    ),
]
Timeout = Annotated[
    float | None, typer.Option(metavar="SECONDS", help="Stop after this time with what is known by then.")
]
Jobs = Annotated[
    int,
    typer.Option(
        min=0,
        metavar="N",
        help="Run the subject in so many processes of its own, where it may crash or hang without harm. "
        "[default: in this process; exec: and lib: always have one]",
        show_default=False,
    ),
]
Together = Annotated[
    int,
    typer.Option(
        "--jobs",
        min=0,
        metavar="N",
        help="How many are judged at once. [default: as many as there are cores]",
        show_default=False,
    ),
]
Replicates = Annotated[int, typer.Option(min=2, metavar="N", help="How many seeds to look at on each pixel.")]
Most = Annotated[
    int | None,
    typer.Option(min=1, metavar="N", help="The largest n, of 3, 4 and speed-accuracy. [default: 32, 32, 4096]"),
]
SceneName = Annotated[
    str | None, typer.Option(metavar="SCENE", help="Which scene, of 5: a shipped one or a file. [default: fig5]")
]
Pilot = Annotated[int | None, typer.Option(min=1, metavar="N", help="The size of the pilot, of 5. [default: 4]")]

# -- where it goes --------------------------------------------------------------------------------

Json = Annotated[
    str | None, typer.Option("--json", metavar="FILE", help="Write everything as JSON; - is standard output.")
]
Html = Annotated[str | None, typer.Option(metavar="FILE", help="Write the verdicts as a page.")]
Markdown = Annotated[str | None, typer.Option(metavar="FILE", help="Write the verdicts as Markdown.")]
Directory = Annotated[
    Path, typer.Option(metavar="DIR", help="Where it goes; a former report there is replaced as a whole.")
]
Picture = Annotated[Path, typer.Option(metavar="FILE", help="Where it goes; the suffix (svg, pdf, png) is the format.")]
