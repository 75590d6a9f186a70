"""Formulas: a Ratio as the SymPy expression that a reader would write.

A result is a sum over powers W^n, each with its coefficient in lowest terms and factored where
that is short; terms that hold under a condition are gathered in one Piecewise per condition.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from truemean.errors import NoClosedForm
from truemean.oracle.symbols import Field, Generator, Ratio

__all__ = ["expression", "formula", "relation", "root_condition", "summed"]

_MOST_FACTORED = 60  # terms of a polynomial that is still worth factoring
Key = tuple[tuple[int, int], ...]


def expression(ratio: Ratio, mean: Ratio | None = None) -> Any:
    """The SymPy expression of a Ratio; with ``mean``, the true mean is written as the symbol I where that is shorter."""
    import sympy

    field = ratio.field
    num, den = field.once(ratio).lifted()
    groups: dict[tuple[Key, Key], dict[tuple[int, ...], int]] = {}
    for powers, coefficient in num.to_dict().items():
        conditions, exponentials, rest = _parted(field, powers)
        groups.setdefault((conditions, exponentials), {})[rest] = int(coefficient)
    by_condition: dict[Key, list[Any]] = {}
    for (conditions, exponentials), terms in sorted(groups.items()):
        part = Ratio.reduced(field, field.context.from_dict(terms), den)
        if field.index is not None:
            by_condition.setdefault(conditions, []).append(_gathered(part))
            continue
        product = sympy.Mul(_quotient(part, mean), *(_meaning(field, i) ** e for i, e in exponentials))
        by_condition.setdefault(conditions, []).append(product)
    return sympy.Add(*(_where(field, conditions, sympy.Add(*terms)) for conditions, terms in by_condition.items()))


def formula(number: Any, mean: Any = None) -> Any:
    """A number of the engine as a SymPy expression."""
    import sympy

    if isinstance(number, tuple):
        return tuple(map(formula, number))
    if isinstance(number, Ratio):
        return expression(number, mean if isinstance(mean, Ratio) else None)
    return sympy.Rational(int(number.numerator), int(number.denominator))


def relation(difference: Ratio, op: str) -> Any:
    """``difference op 0`` as a SymPy relation, what is a parameter on the right."""
    import sympy

    field = difference.field
    if difference.den is not None and not difference.den.is_constant():
        return getattr(sympy, _RELATIONS[op])(expression(difference), 0)
    num, den = difference.lifted()
    left: dict[tuple[int, ...], int] = {}
    right: dict[tuple[int, ...], int] = {}
    for powers, coefficient in num.to_dict().items():
        kinds = {field.generators[i].kind for i, e in enumerate(powers) if e}
        side = right if kinds and kinds <= {"symbol", "size"} else left
        side[powers] = -int(coefficient) if side is right else int(coefficient)
    a, b = (_quotient(Ratio.reduced(field, field.context.from_dict(terms), den)) for terms in (left, right))
    if a.could_extract_minus_sign() or a == 0:
        a, b, op = -a, -b, _FLIPPED[op]
    return getattr(sympy, _RELATIONS[op])(a, b)


def root_condition(a: Ratio, b: Ratio, c: Ratio, op: str) -> Any:
    """``a + b sqrt(c) op 0`` as a SymPy relation, or a bool where SymPy knows it."""
    import sympy

    left, right = expression(b) * sympy.sqrt(expression(c)), -expression(a)
    found = getattr(sympy, _RELATIONS[op])(left, right)
    return bool(found) if found in (True, False) else found


_RELATIONS = {"<": "Lt", "<=": "Le", ">": "Gt", ">=": "Ge", "==": "Eq", "!=": "Ne"}
_FLIPPED = {"<": ">", "<=": ">=", "==": "=="}


def summed(ratio: Ratio) -> Ratio:
    """The sum over the index: each monomial in indexed generators becomes a generator of its own, Sum(...)."""
    field = ratio.field
    num, den = ratio.lifted()
    total = field.number(0)
    if any(_mentions_index(field, place) for place, degree in enumerate(den.degrees()) if degree):
        raise NoClosedForm(f"{ratio} can't be summed over its index: make k concrete")
    for powers, coefficient in num.to_dict().items():
        inside = tuple((i, int(e)) for i, e in enumerate(powers) if e and _mentions_index(field, i))
        outside = tuple(0 if _mentions_index(field, i) else int(e) for i, e in enumerate(powers))
        part = Ratio(field, field.context.from_dict({outside: int(coefficient)}))
        total = total + (part * _sum(field, inside) if inside else part)
    found: Ratio = total / Ratio(field, den)
    return found


def _sum(field: Field, inside: Key) -> Any:
    if len(inside) == 1 and inside[0][1] == 1 and field.generators[inside[0][0]].kind == "weight index":
        return 1
    return field.generator(("sum", inside), Generator(inside, "sum"))


def _gathered(part: Ratio) -> Any:
    """A Ratio in sums over the index, sums of like powers brought under one Sum."""
    import sympy

    field = part.field
    num, den = part.lifted()
    bodies: dict[Key, list[Any]] = {}
    others: dict[tuple[int, ...], int] = {}
    for powers, coefficient in num.to_dict().items():
        tails = [i for i, e in enumerate(powers) if e and _is_tail(field, i)]
        if len(tails) != 1 or powers[tails[0]] > 1:
            others[powers] = int(coefficient)
            continue
        inside = field.generators[tails[0]].expression
        values = [(i, e) for i, e in inside if field.generators[i].kind == "index"]
        rest = [(i, int(e)) for i, e in enumerate(powers) if e and i != tails[0]]
        term = sympy.Mul(sympy.Integer(int(coefficient)), *(_meaning(field, i) ** e for i, e in [*values, *rest]))
        bodies.setdefault(tuple(x for x in inside if x not in values), []).append(term)
    sums = []
    for like, terms in bodies.items():
        content, body = sympy.Add(*terms).as_content_primitive()
        shared = (_meaning(field, i) ** e for i, e in like)
        sums.append(content * sympy.Sum(sympy.Mul(*shared, body), _limits(field)))
    total = sympy.Add(*sums, _expanded(field, others.items()))
    return sympy.Mul(total, 1 / _polynomial(field, den))


def _limits(field: Field) -> tuple[Any, int, Any]:
    return field.index[0], 1, field.index[1]


def _is_tail(field: Field, place: int) -> bool:
    """Whether a generator is a sum that is no moment of the pixel."""
    made = field.generators[place] if place < len(field.generators) else None
    if made is None or made.kind != "sum":
        return False
    return [e for i, e in made.expression if field.generators[i].kind != "index"] != [1] or any(
        field.generators[i].kind == "power" for i, _ in made.expression
    )


def _mentions_index(field: Field, place: int) -> bool:
    if place >= len(field.generators):
        return False
    made = field.generators[place]
    if made.kind == "power":
        return any(_mentions_index(field, i) for i in made.expression[0].places)
    return made.kind in ("index", "weight index")


def _parted(field: Field, powers: tuple[int, ...]) -> tuple[Key, Key, tuple[int, ...]]:
    """The conditions, the powers W^n, and the rest of a monomial."""
    conditions, exponentials, rest = [], [], [0] * len(powers)
    for place, exponent in enumerate(map(int, powers)):
        if exponent:
            kind = field.generators[place].kind
            if kind == "condition":
                conditions.append((place, 1))
            elif kind == "power":
                exponentials.append((place, exponent))
            else:
                rest[place] = exponent
    return tuple(conditions), tuple(exponentials), tuple(rest)


def _meaning(field: Field, place: int) -> Any:
    """What stands behind a generator."""
    import sympy

    made = field.generators[place]
    if made.kind == "condition":
        return sympy.Piecewise((1, _condition(made.expression)), (0, True))
    if made.kind == "sum":
        term = sympy.Mul(*(_meaning(field, i) ** e for i, e in made.expression))
        if _is_tail(field, place):
            return sympy.Sum(term, _limits(field))
        j = sympy.Symbol("j", integer=True)  # a moment of the pixel may stand under a sum over i
        return sympy.Sum(term.subs(field.index[0], j), (j, 1, field.index[1]))
    if made.kind == "power":
        base, exponent = made.expression
        return expression(base) ** expression(exponent)
    if made.kind == "opaque":  # whose symbols may since have become sample sizes
        named = {s: field.place(s.name) for s in made.expression.free_symbols}
        return made.expression.xreplace({s: field.generators[i].expression for s, i in named.items() if i is not None})
    return made.expression


def _where(field: Field, conditions: Key, term: Any) -> Any:
    import sympy

    if not conditions:
        return term
    relations = [_condition(field.generators[place].expression) for place, _ in conditions]
    return sympy.Piecewise((term, sympy.And(*relations)), (0, True))


def _condition(made: tuple[Any, str]) -> Any:
    """The relation behind a 0/1 generator."""
    return made[0] if made[1] == "relation" else relation(*made)


def _quotient(part: Ratio, mean: Ratio | None = None) -> Any:
    num, den = part.lifted()
    if mean is not None and mean.den is None and len(mean.num) > 1:
        return _in_mean(part.field, num, mean.lifted()[0]) / _polynomial(part.field, den)
    return _polynomial(part.field, num) / _polynomial(part.field, den)


def _in_mean(field: Field, polynomial: Any, mean: Any) -> Any:
    """A polynomial with the true mean divided out as often as that leaves less to write."""
    import sympy

    whole, rest = divmod(polynomial, mean)
    if whole == 0 or len(whole) + len(rest) >= len(polynomial):
        return _polynomial(field, polynomial)
    return _in_mean(field, whole, mean) * sympy.Symbol("I") + _polynomial(field, rest)


def _polynomial(field: Field, polynomial: Any) -> Any:
    """A polynomial, factored where it is short."""
    import sympy

    if 1 < len(polynomial) <= _MOST_FACTORED:
        content, factors = polynomial.factor()
        odd = [i for i, (factor, times) in enumerate(factors) if len(factor) > 1 and int(times) % 2]
        if int(content) < 0 and odd:  # ω (I - I_1) with its sign inside
            content, flipped = -content, odd[-1]
            factors[flipped] = (-factors[flipped][0], factors[flipped][1])
        parts = [_expanded(field, factor.to_dict().items()) ** int(times) for factor, times in factors]
        return sympy.Mul(sympy.Integer(int(content)), *parts, evaluate=len(parts) != 1 or int(content) == 1)
    return _expanded(field, polynomial.to_dict().items())


def _expanded(field: Field, terms: Iterable[tuple[tuple[int, ...], Any]]) -> Any:
    import sympy

    known: dict[tuple[int, int], Any] = {}
    products = []
    for powers, coefficient in terms:
        used = [(i, int(e)) for i, e in enumerate(powers) if e]
        for factor in used:
            if factor not in known:
                known[factor] = _meaning(field, factor[0]) ** factor[1]
        products.append(sympy.Mul(sympy.Integer(int(coefficient)), *(known[factor] for factor in used)))
    return sympy.Add(*products)
