"""What becomes of the bias as samples grow: its limit, its leading term, and whether the plan is consistent.

A closed form is a sum of W^n, W < 1 the weight of some of the values, each with a coefficient that
is rational in n. So the limit is that of the coefficient without a power, and what leads is the
largest W.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from truemean.errors import InputError, NoClosedForm
from truemean.oracle.assumptions import possible_signs
from truemean.oracle.formulas import formula
from truemean.oracle.symbols import Field, Ratio

__all__ = ["Rates", "rates"]


@dataclass(frozen=True, slots=True)
class Rates:
    """What the bias does for n to infinity.

    Its ``limit``; its ``leading`` term, a Piecewise where the weights decide which W is largest; the ``rate`` W
    by which each draw shrinks it (1 for powers of n); and whether the plan is ``consistent``, its bias vanishing
    in the limit (Kirk & Arvo 1991, section 3).
    """

    limit: Any
    leading: Any
    rate: Any
    consistent: bool


Term = tuple[Ratio, Ratio]  # W, and its coefficient


def rates(bias: Any, field: Field, n: Any) -> Rates:
    """Limit and leading term of a bias in the sample size n."""
    place = field.place(str(n))
    if place is None or field.generators[place].kind != "size":
        sizes = ", ".join(str(g.expression) for g in field.generators if g.kind == "size") or "none"
        raise InputError(f"n={n} is no symbol for a sample size (there is {sizes}): derive(plan, X, n=Symbol('n'))")
    terms = _terms(field.number(bias), place)
    still = [c for w, c in terms if w == 1]
    limit, slow = _limit(still[0], place) if still else (formula(Fraction(0)), None)
    consistent = bool(limit == 0)
    if not consistent or slow is not None:
        return Rates(limit, limit if not consistent else slow, formula(Fraction(1)), consistent)
    falling = [(w, c) for w, c in terms if w != 1]
    if not falling:
        return Rates(limit, limit, formula(Fraction(0)), consistent=True)
    return Rates(limit, *_leading(falling, place, field), consistent=True)


def _terms(bias: Ratio, place: int) -> list[Term]:
    """The bias as a sum of coefficients times W^n, by W."""
    field = bias.field
    num, den = field.once(bias).lifted()
    groups: dict[tuple[tuple[int, int], ...], dict[tuple[int, ...], int]] = {}
    for powers, coefficient in num.to_dict().items():
        mine = tuple((i, int(e)) for i, e in enumerate(powers) if e and _is_power_of(field, i, place))
        rest = tuple(0 if _is_power_of(field, i, place) else int(e) for i, e in enumerate(powers))
        groups.setdefault(mine, {})[rest] = int(coefficient)
    if any(degree and _is_power_of(field, i, place) for i, degree in enumerate(den.degrees())):
        raise NoClosedForm("the bias has powers W^n in its denominator, so no leading term is read off it")
    found = []
    for mine, terms in groups.items():
        w = field.number(1)
        for i, exponent in mine:
            w = w * field.generators[i].expression[0] ** exponent
        found.append((w, Ratio.reduced(field, field.context.from_dict(terms), den)))
    return found


def _is_power_of(field: Field, i: int, place: int) -> bool:
    made = field.generators[i] if i < len(field.generators) else None
    return made is not None and made.kind == "power" and place in made.expression[1].places


def _limit(coefficient: Ratio, place: int) -> tuple[Any, Any]:
    """The limit of a rational function of n, and the term that leads if it is 0."""
    lead, degree = _in_n(coefficient, place)
    if degree > 0:
        raise NoClosedForm(f"the bias grows like n^{degree}: {coefficient}")
    if degree == 0:
        return formula(lead), None
    return formula(Fraction(0)), formula(lead * _n(coefficient.field, place) ** degree)


def _in_n(coefficient: Ratio, place: int) -> tuple[Ratio, int]:
    """``(a, p)``: for large n the coefficient is a n^p."""
    field = coefficient.field
    leads, degrees = [], []
    for polynomial in coefficient.lifted():
        degree = int(polynomial.degrees()[place])
        top = {p: int(c) for p, c in polynomial.to_dict().items() if p[place] == degree}
        leads.append(
            Ratio(field, field.context.from_dict({(*p[:place], 0, *p[place + 1 :]): c for p, c in top.items()}))
        )
        degrees.append(degree)
    return leads[0] / leads[1], degrees[0] - degrees[1]


def _n(field: Field, place: int) -> Ratio:
    return field.generator(field.generators[place].expression.name, field.generators[place])


def _leading(terms: list[Term], place: int, field: Field) -> tuple[Any, Any]:
    """The terms whose W may be the largest, each where it is."""
    import sympy

    candidates = [t for t in terms if not any(_smaller(t[0], other[0]) for other in terms)]
    n = _n(field, place)
    shown = []
    for w, coefficient in candidates:
        lead, degree = _in_n(coefficient, place)
        shown.append((formula(w), formula(lead * n**degree) * formula(w) ** formula(n)))
    if len(shown) == 1:
        return shown[0][1], shown[0][0]
    cases = []
    for w, term in shown:
        others = [v for v, _ in shown if v is not w]
        cases.append((term, sympy.And(*(sympy.Gt(w, v) for v in others))))
    return sympy.Piecewise(*cases, (sympy.Add(*(t for _, t in shown)), True)), sympy.Max(*(w for w, _ in shown))


def _smaller(w: Ratio, other: Ratio) -> bool:
    """Whether W is certainly less than another."""
    return possible_signs(other - w) == {1}
