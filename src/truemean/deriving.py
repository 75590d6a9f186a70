"""The commands that need no estimator: derive, prove, worst-case, repl."""

from __future__ import annotations

from typing import Any

from truemean import options
from truemean.commands import command

__all__ = ["derive", "prove", "repl", "worst_case"]


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
