"""What the command line shows: a derivation, a proof, and what there is to choose from."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from decimal import Decimal
from fractions import Fraction
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from truemean.adapters import Available
from truemean.conformance.evidence import METHODS
from truemean.conformance.pixels import SETS
from truemean.conformance.plain import plain
from truemean.oracle import Approx, Enclosure, Proof, WorstCase
from truemean.oracle.derivation import Derivation, DerivedPath
from truemean.oracle.pixel import Pixel, Value
from truemean.oracle.plan import Plan
from truemean.oracle.scene import load_scene, shipped_scenes
from truemean.output import console, decimal, shortened

__all__ = [
    "RESULTS",
    "call",
    "derivation_json",
    "print_adapters",
    "print_derivation",
    "print_latex",
    "print_methods",
    "print_pixels",
    "print_plans",
    "print_proof",
    "print_worst_case",
    "proof_json",
    "show",
    "table_of",
    "worst_case_json",
]

RESULTS = ("expectation", "bias", "relative_bias", "variance", "std", "mse", "cost", "oracle_calls")
MOST_PATHS = 20
MOST_VALUES = 16
SHORT = 20  # characters of a ratio beside its decimal


def call(plan: Plan, params: Mapping[str, Any] | None = None) -> str:
    """The plan with its parameters, or with their defaults, written as for --set."""
    if params is None:
        params = {n: "..." if p.default is p.empty else p.default for n, p in plan.signature.parameters.items()}
    written = (
        f"{name}={shortened(value) if isinstance(value, int | Fraction) else value}" for name, value in params.items()
    )
    return f"{plan.name}({', '.join(written)})"


# -- a derivation ---------------------------------------------------------------------------------


def results(derivation: Derivation) -> dict[str, Any]:
    """Every result by name; a relative bias is None at true mean 0."""
    X = derivation.pixel
    undefined = not all(X.mean if isinstance(X.mean, tuple) else (X.mean,))
    found = {name: getattr(derivation, name) for name in RESULTS if name not in ("relative_bias", "std")}
    found["relative_bias"] = None if undefined else derivation.relative_bias
    variances = found["variance"]
    found["std"] = tuple(map(_root, variances)) if isinstance(variances, tuple) else _root(variances)
    return {name: found[name] for name in RESULTS}


def derivation_json(derivation: Derivation, params: Mapping[str, Any]) -> dict[str, Any]:
    """A derivation for ``json.dumps``, as `plain` writes it."""
    plan, X = derivation.plan, derivation.pixel
    paths = [
        {"decisions": path.decisions, "probability": path.probability, "bias": path.bias} for path in derivation.paths
    ]
    data: dict[str, Any] = plain(
        {
            "schema": "truemean-derive/1",
            "plan": {name: getattr(plan, name) for name in ("name", "source", "unbiased", "why")} | {"params": params},
            "pixel": {"values": X.values, "weights": X.weights, "true_mean": X.mean},
            "arithmetic": derivation.arithmetic,
            **results(derivation),
            "paths": paths,
            "level": {sample: str(level) for sample, level in derivation.level.items()},
            "rows": derivation.rows,
        }
    )
    return data


def print_derivation(derivation: Derivation, params: Mapping[str, Any]) -> None:
    """The results, the paths that the bias is a sum of, and what was modelled for it."""
    if derivation.symbolic:
        show(str(derivation))
        return
    plan, X = derivation.plan, derivation.pixel
    show(f"{call(plan, params)} on {_law(X)}; true mean {_inline(X.mean)}")
    show("; ".join(filter(None, (plan.source, _unbiased(plan)))))
    beside = {Fraction: "exactly", Enclosure: "at most"}.get(type(derivation.cost), "error at most")
    table = table_of("result", "decimal" if beside != "at most" else "at least", beside)
    for name, value in results(derivation).items():
        for suffix, part in _channels(value):
            number = part.texts[0] if isinstance(part, Enclosure) else decimal(part)
            table.add_row(name.replace("_", " ") + suffix, number, _beside(part))
    show(table)
    paths = sorted(derivation.paths, key=_size, reverse=True)
    table = table_of("path: what the plan decided", "probability", "contribution to the bias")
    for path in paths[:MOST_PATHS]:
        bias = "\n".join(_both(part) for _, part in _channels(path.bias))
        table.add_row(" and ".join(path.decisions) or "(nothing decided)", _both(path.probability), bias)
    show(table)
    if len(paths) > MOST_PATHS:
        show(f"and {len(paths) - MOST_PATHS} more paths that contribute less: --json has them all")
    modelled = ", ".join(f"{sample} {level}" for sample, level in derivation.level.items()) or "no sample"
    show(f"modelled for the bias: {modelled}; rows: {derivation.rows:,}")


def print_latex(derivation: Derivation) -> None:
    """Every result as an equation, one a line."""
    for name in ("expectation", "bias", "variance", "mse", "cost", "oracle_calls"):
        show(derivation.latex(name))


def proof_json(plan: Plan, params: Mapping[str, Any], proof: Proof) -> dict[str, Any]:
    """A proof for ``json.dumps``, its certificate as `check_certificate` reads it."""
    X = proof.counterexample
    data: dict[str, Any] = plain(
        {
            "schema": "truemean-proof/1",
            "plan": {"name": plan.name, "params": params},
            "status": proof.status,
            "reason": proof.reason,
            "counterexample": None if X is None else {"values": X.values, "weights": X.weights},
            "bias": proof.bias,
        }
    )
    return data | {"certificate": proof.certificate}


def print_proof(plan: Plan, params: Mapping[str, Any], proof: Proof) -> None:
    """The answer, why, and the pixel that shows a bias."""
    show(f"{call(plan, params)}: {proof.status}")
    show(proof.reason)
    if proof.counterexample is not None:
        bias = ", ".join(_both(part) for _, part in _channels(proof.bias))
        show(f"smallest counterexample: {_law(proof.counterexample)}; bias {bias}")


def worst_case_json(worst: WorstCase) -> dict[str, Any]:
    """The worst case for ``json.dumps``."""
    data: dict[str, Any] = plain(
        {
            "schema": "truemean-worst-case/1",
            "plan": {"name": worst.plan.name, "params": worst.params},
            "objective": worst.objective,
            "value": worst.value,
            "attained": worst.attained,
            "complete": worst.complete,
            "pixel": {"values": worst.pixel.values, "weights": worst.pixel.weights},
            "bias": worst.bias,
        }
    )
    return data


def print_worst_case(worst: WorstCase) -> None:
    """The enclosure, and a pixel that is as bad."""
    show(f"{call(worst.plan, worst.params)}: the largest |{worst.objective}| over all weights")
    lower, upper = worst.value.texts
    show(f"{lower} <= |{worst.objective}| <= {upper}" if lower != upper else f"|{worst.objective}| = {lower}")
    how = "attained" if worst.attained else "a limit, which no pixel attains"
    show(how if worst.complete else f"{how}; not all digits could be certified with the work allowed")
    show(f"at {_law(worst.pixel)}, where the bias is {decimal(worst.bias)}")


def _root(variance: Any) -> Any:
    if hasattr(variance, "free_symbols"):
        from sympy import sqrt

        return sqrt(variance)
    if isinstance(variance, Fraction):  # which may be smaller than any float, though its root is none
        return float((Decimal(variance.numerator) / Decimal(variance.denominator)).sqrt())
    return math.sqrt(max(float(variance.upper if isinstance(variance, Enclosure) else variance), 0.0))


def _size(path: DerivedPath) -> Any:
    """How much a path contributes, in the channel where that is most."""
    numbers = (part for _, part in _channels(path.bias))
    return max(
        abs(part.value if isinstance(part, Approx) else part.lower if isinstance(part, Enclosure) else part)
        for part in numbers
    )


def _channels(value: Any) -> Iterable[tuple[str, Any]]:
    if isinstance(value, tuple):
        return [(f"[{channel}]", part) for channel, part in enumerate(value)]
    return [("", value)]


def _inline(value: Value) -> str:
    return f"({', '.join(map(shortened, value))})" if isinstance(value, tuple) else shortened(value)


def _beside(value: Any) -> str:
    match value:
        case Fraction():
            return shortened(value)
        case Approx():
            return decimal(value.error, 2)
        case Enclosure():
            return value.texts[1]
        case None:
            return "undefined where the true mean is 0"
        case _:
            return ""


def _both(value: Any) -> str:
    """The decimal, and p/q where that is short."""
    if isinstance(value, Enclosure):
        return decimal(value.lower, 6)
    rounded, ratio = decimal(value, 6), shortened(value) if isinstance(value, Fraction) else ""
    return f"{rounded} = {ratio}" if "/" in ratio and len(ratio) <= SHORT else rounded


def _unbiased(plan: Plan) -> str:
    word = {True: "unbiased", False: "biased", None: ""}[plan.unbiased]
    return f"{word}: {plan.why}" if plan.why else word


# -- what there is --------------------------------------------------------------------------------


def print_plans(plans: Iterable[Plan]) -> None:
    """Each plan with its parameters, what it does, its source, and whether it is unbiased and why."""
    for plan in plans:
        show(f"{call(plan)}\n    {plan.doc}\n    {_unbiased(plan)}\n    {plan.source}\n")


def print_methods() -> None:
    """The kinds of evidence, with what each guarantees."""
    table = table_of("method", "guarantee")
    for name, method in METHODS.items():
        table.add_row(name, method.guarantee)
    show(table)


def print_pixels() -> None:
    """The pixels of each set with its version and what they stress, and the shipped scenes."""
    table = table_of("pixel", "version", "values and weights", "what it stresses")
    for name, pixels in SETS.items():
        for short, standard in pixels.items():
            table.add_row(f"{name}:{short}", str(pixels.version), _law(standard.pixel), standard.stresses)
    for name in shipped_scenes():
        scene = load_scene(name)
        table.add_row(f"{name}#x,y", "", f"a scene of {scene.width} x {scene.height} pixels", scene.comment)
    show(table)


def print_adapters(adapters: Iterable[Available]) -> None:
    """Each adapter, the version of what it runs, and how to get it."""
    table = table_of("adapter", "version", "how to get it", "SUBJECT: what it runs")
    for adapter in adapters:
        table.add_row(adapter.name, adapter.version or "not installed", adapter.how, adapter.help)
    show(table)


def _law(X: Pixel) -> str:
    parts = [f"{_inline(value)}:{shortened(weight)}".replace(" ", "") for value, weight in X.law.items()]
    if len(parts) > MOST_VALUES:
        parts = [*parts[:2], "...", f"{parts[-1]} ({len(parts)} values)"]
    return ", ".join(parts)


def show(what: str | Text | Table) -> None:
    """A table within the width of the terminal; a sentence on one line, which a terminal folds and grep finds."""
    console().print(what, soft_wrap=not isinstance(what, Table))


def table_of(*columns: str) -> Table:
    """An empty table with these heads."""
    table = Table(box=SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0))
    for column in columns:
        table.add_column(column, overflow="fold")
    return table
