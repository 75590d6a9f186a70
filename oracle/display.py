"""How a derivation shows itself: a table in a terminal, typeset mathematics in a notebook, LaTeX, side by side."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from io import StringIO
from typing import TYPE_CHECKING, Any

from truemean.errors import InputError, TruemeanError
from truemean.oracle.exact import is_symbolic, short_text
from truemean.oracle.float64 import Approx
from truemean.oracle.formulas import formula
from truemean.oracle.symbols import Ratio

if TYPE_CHECKING:
    from truemean.oracle.derivation import Derivation

__all__ = ["Comparison", "as_html", "as_latex", "as_text", "called", "compare"]

RESULTS = ("expectation", "bias", "relative_bias", "variance", "mse", "cost", "oracle_calls")
WORDS = {
    "expectation": ("E[ξ]", r"\mathrm{E}[\xi]"),
    "bias": ("bias E[ξ] - I", r"\mathrm{E}[\xi] - I"),
    "relative_bias": ("relative bias", r"(\mathrm{E}[\xi] - I) / I"),
    "variance": ("variance", r"\mathrm{Var}[\xi]"),
    "mse": ("mean squared error", r"\mathrm{E}[(\xi - I)^2]"),
    "cost": ("cost in samples", r"\mathrm{E}[\text{samples}]"),
    "oracle_calls": ("oracle calls", r"\mathrm{E}[\text{oracle calls}]"),
}
_LONG = 400  # characters of a formula that a table still shows
_MOST_PATHS = 20


def called(derivation: Derivation) -> str:
    """The plan with its parameters."""
    params = (f"{n}={short_text(v) if isinstance(v, int | Fraction) else v}" for n, v in derivation.params.items())
    return f"{derivation.plan.name}({', '.join(params)})"


# -- numbers in the three ways of writing -----------------------------------------------------------


def _plain(value: Any) -> str:
    if isinstance(value, tuple):
        return f"({', '.join(map(_plain, value))})"
    if isinstance(value, Approx):
        return f"{value.value:.10g} ± {value.error:.2g}"
    if isinstance(value, Fraction):
        ratio = short_text(value)
        return ratio if value.denominator == 1 else f"{float(value):.10g} = {ratio}"
    text = str(value)
    return text if len(text) <= _LONG else f"{text[:_LONG]}... ({len(text):,} characters)"


def _tex(value: Any) -> str:
    from sympy import Rational, latex

    if isinstance(value, tuple):
        return rf"\left({', '.join(map(_tex, value))}\right)"
    if isinstance(value, Fraction):
        return str(latex(Rational(value.numerator, value.denominator)))
    if isinstance(value, Approx):
        return f"{value.value:.10g}"
    return str(latex(value))


def numbers_of(derivation: Derivation) -> Iterable[tuple[str, Any]]:
    """Every result by name, formulas in terms of I; what has no meaning here is left out."""
    for name in RESULTS:
        try:
            yield name, derivation.short(name)
        except (TruemeanError, ZeroDivisionError):
            if name != "relative_bias":
                raise


def where(derivation: Derivation) -> list[tuple[Any, Any]]:
    """What the symbols in a display stand for: I, and that the weights sum to 1."""
    from sympy import Integer, Symbol

    if not derivation.symbolic:
        return []
    mean = formula(derivation.law.mean(0))
    found = [(Symbol("I"), mean)] if isinstance(derivation.law.mean(0), Ratio) else []
    if derivation.pixel.simplex:
        found.append((formula(sum(derivation.law.masses)), Integer(1)))
    return found


# -- a derivation -----------------------------------------------------------------------------------


def as_text(derivation: Derivation) -> str:
    """Results and paths as tables of a terminal."""
    lines = [f"{called(derivation)} on {derivation.pixel!r}"]
    lines += [f"{left} = {_plain(right)}" for left, right in where(derivation)]
    lines += [f"for {requirement}" for requirement in derivation.requirements]
    rows = [(WORDS[name][0], _plain(value)) for name, value in numbers_of(derivation)]
    paths = list(derivation.short_paths())[:_MOST_PATHS]
    decided = [(" and ".join(d) or "(nothing decided)", _plain(p), _plain(b)) for d, p, b in paths]
    return "\n".join(
        [*lines, _table(("result", "value"), rows), _table(("path", "probability", "adds to the bias"), decided)]
    )


def _table(columns: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, show_edge=False, pad_edge=False)
    for column in columns:
        table.add_column(column, overflow="fold")
    for row in rows:
        table.add_row(*row)
    stream = StringIO()
    Console(file=stream, width=118, markup=False, highlight=False, emoji=False, color_system=None).print(table)
    return "\n".join(line.rstrip() for line in stream.getvalue().splitlines())


def as_html(derivation: Derivation) -> str:
    """Results and paths for a notebook, formulas typeset."""
    head = f"<b>{html.escape(called(derivation))}</b> on {html.escape(repr(derivation.pixel))}"
    notes = [f"${_tex(a)} = {_tex(b)}$" for a, b in where(derivation)] + list(map(html.escape, derivation.requirements))
    rows = [(f"${WORDS[name][1]}$", _cell(value)) for name, value in numbers_of(derivation)]
    paths = [
        (html.escape(" and ".join(d) or "(nothing decided)"), _cell(p), _cell(b))
        for d, p, b in list(derivation.short_paths())[:_MOST_PATHS]
    ]
    where_ = f"<p>where {', '.join(notes)}</p>" if notes else ""
    return (
        f"<div class='truemean'><p>{head}</p>{where_}{_html_table(('result', ''), rows)}"
        f"{_html_table(('path', 'probability', 'adds to the bias'), paths)}</div>"
    )


def _cell(value: Any) -> str:
    tex = _tex(value)
    if len(tex) > 4 * _LONG:
        return html.escape(_plain(value))
    decimal = f" ≈ {float(value):.6g}" if isinstance(value, Fraction) and value.denominator > 1 else ""
    return rf"$\displaystyle {tex}$" + decimal


def _html_table(columns: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    head = "".join(f"<th style='text-align:left'>{c}</th>" for c in columns)
    body = "".join(
        f"<tr><td style='text-align:left;white-space:nowrap'>{first}</td>"
        + "".join(f"<td style='text-align:left'>{c}</td>" for c in rest)
        + "</tr>"
        for first, *rest in rows
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def as_latex(derivation: Derivation, result: str) -> str:
    """One result as an equation, I explained where it occurs."""
    if result not in WORDS:
        raise InputError(f"result={result!r} has no formula: choose one of {', '.join(WORDS)}")
    value = derivation.short(result)
    text = rf"{WORDS[result][1]} = {_tex(value)}"
    named = {str(s) for v in (value if isinstance(value, tuple) else (value,)) for s in _symbols(v)}
    explained = [rf"{_tex(a)} = {_tex(b)}" for a, b in where(derivation) if str(a) in named or not a.is_Symbol]
    return text + (r",\quad " + r",\ ".join(explained) if explained else "")


def _symbols(value: Any) -> set[Any]:
    return set(value.free_symbols) if is_symbolic(value) else set()


# -- side by side -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Comparison:
    """Derivations side by side; shows itself as a table, in a notebook as typeset mathematics."""

    derivations: tuple[Any, ...]

    def difference(self, result: str = "bias") -> Any:
        """The second's result minus the first's, simplified if it is a formula."""
        first, second = (getattr(d, result) for d in self.derivations[:2])
        if not (is_symbolic(first) or is_symbolic(second)):
            return second - first
        from sympy import simplify

        return simplify(second - first)

    def _rows(self) -> list[tuple[str, list[Any]]]:
        columns = [dict(numbers_of(d)) for d in self.derivations]
        return [(name, [column.get(name, "undefined") for column in columns]) for name in RESULTS]

    def __str__(self) -> str:
        rows = [(WORDS[name][0], *map(_plain, values)) for name, values in self._rows()]
        return _table(("result", *map(called, self.derivations)), rows)

    def _repr_html_(self) -> str:
        rows = [
            (f"${WORDS[name][1]}$", *(v if isinstance(v, str) else _cell(v) for v in values))
            for name, values in self._rows()
        ]
        return _html_table(("result", *(html.escape(called(d)) for d in self.derivations)), rows)


def compare(*derivations: Any) -> Comparison:
    """Two or more derivations side by side.

    >>> from truemean.oracle import Pixel, derive
    >>> from truemean.oracle.plans import catalogue
    >>> X = Pixel.two("1/8")
    >>> both = compare(derive(catalogue["kirk-arvo"], X, n=4), derive(catalogue["fixed"], X, n=4))
    >>> both.difference()
    Fraction(1197, 16384)
    """
    from truemean.oracle.derivation import Derivation

    if len(derivations) < 2 or not all(isinstance(d, Derivation) for d in derivations):
        raise InputError("compare() takes two or more results of derive()")
    return Comparison(derivations)
