"""What is known of symbols: reading them, and the signs that follow.

A sign is decided by substitution: every generator is written as what bounds it plus something
positive; a polynomial whose coefficients then agree in sign has that sign itself.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from truemean.errors import AssumptionError, NoClosedForm
from truemean.oracle.symbols import Field, Generator, Ratio

__all__ = ["declare_values", "declare_weight", "possible_signs", "read", "read_size"]

_ANY = frozenset({-1, 0, 1})


def read(field: Field, given: Any) -> Ratio:
    """A SymPy expression as a Ratio; what is no rational function becomes a generator."""
    import sympy

    if isinstance(given, Ratio):
        return given
    if isinstance(given, int | Fraction):
        return field.number(given)
    expression = sympy.sympify(given)
    if expression.is_Rational:
        return field.number(Fraction(int(expression.p), int(expression.q)))
    if expression.is_Symbol:
        return _read_symbol(field, expression)
    if expression.is_Float:
        return field.number(Fraction(float(expression)))
    if expression.is_Add or expression.is_Mul:
        total = field.number(1 if expression.is_Mul else 0)
        for argument in expression.args:
            part = read(field, argument)
            total = total * part if expression.is_Mul else total + part
        return total
    if expression.is_Pow and expression.exp.is_Integer:
        power: Ratio = read(field, expression.base) ** int(expression.exp)
        return power
    if expression.is_Pow and expression.exp.is_integer and expression.base.free_symbols.isdisjoint({expression.exp}):
        return field.power(read(field, expression.base), read_size(field, expression.exp))
    if expression.is_number or expression.free_symbols:
        return field.generator(expression, Generator(expression, "opaque", *_known_sign(expression)))
    raise AssumptionError(f"{given!r} is neither a number nor a formula: use rational functions of symbols")


def _read_symbol(field: Field, symbol: Any) -> Ratio:
    if symbol.is_zero:
        return field.number(0)
    if symbol.is_extended_real is False:
        raise AssumptionError(
            f"symbol {symbol.name} is not real, so nothing can be compared with it: Symbol({symbol.name!r}, real=True)"
        )
    made = Generator(symbol, "symbol", *_known_sign(symbol))
    found = field.generator(symbol.name, made)
    known = field.generators[field.place(symbol.name) or 0]
    if symbol not in (known.expression, field.origins.get(symbol.name)):
        raise AssumptionError(
            f"two symbols are called {symbol.name} but have different assumptions: use one symbol for both"
        )
    return found


def _known_sign(expression: Any) -> tuple[int, int, bool]:
    """``base, sign, strict`` of a generator, from what SymPy knows of it."""
    if expression.is_positive:
        return 0, 1, True
    if expression.is_negative:
        return 0, -1, True
    if expression.is_nonnegative:
        return 0, 1, False
    return (0, -1, False) if expression.is_nonpositive else (0, 0, False)


def read_size(field: Field, given: Any) -> Ratio:
    """A sample size: its symbols are read as positive integers, whatever they were before."""
    import sympy

    size = read(field, given)
    if any(field.generators[place].kind == "condition" for place in size.places):
        raise NoClosedForm(f"the sample size {size} depends on what a symbol decides: write the comparison as an if")
    if size.den is not None:
        raise NoClosedForm(f"the sample size {size} is no integer combination of symbols: use n, m, n + 2")
    for symbol in [field.generators[i].expression for i in size.places if field.generators[i].kind == "symbol"]:
        if symbol.is_integer is False or symbol.is_positive is False or symbol.is_finite is False:
            raise AssumptionError(
                f"n={size} is a sample size, but symbol {symbol.name} is declared otherwise: "
                f"Symbol({symbol.name!r}, integer=True, positive=True)"
            )
        field.origins[symbol.name] = symbol
        whole = sympy.Symbol(symbol.name, integer=True, positive=True)
        field.know(symbol.name, Generator(whole, "size", base=1, sign=1, strict=False))
    return size


def declare_values(field: Field, values: list[Any], ordered: bool) -> list[Ratio]:
    """The values of a pixel as Ratios; if ordered, each symbol is more than what stands before it."""
    found: list[Ratio] = []
    for value in values:
        ratio = read(field, value)
        if ordered and found and 1 not in possible_signs(ratio - found[-1]):
            raise AssumptionError(f"values {', '.join(map(str, values))} are said to ascend, but {value} can't be next")
        if ordered and found and getattr(value, "is_Symbol", False):
            made = Generator(value, "value", base=found[-1], sign=1)
            field.know(value.name, made)
        elif getattr(value, "is_Symbol", False):
            field.know(value.name, Generator(value, "value", *_known_sign(value)))
        found.append(ratio)
    return found


def declare_weight(field: Field, weight: Any) -> Ratio:
    """A weight as a Ratio; a symbol for one is positive."""
    ratio = read(field, weight)
    if 1 not in possible_signs(ratio):
        raise AssumptionError(f"weight {weight} can't be positive: declare its symbols positive=True, or none of them")
    if getattr(weight, "is_Symbol", False):
        field.know(weight.name, Generator(weight, "weight", sign=1))
    return ratio


def possible_signs(ratio: Ratio) -> frozenset[int]:
    """The signs that a number may have, as far as the assumptions tell: a subset of {-1, 0, 1}."""
    if ratio.is_constant:
        return frozenset({(ratio.constant > 0) - (ratio.constant < 0)})
    num, den = ratio.lifted()
    signs = _signs(ratio.field, num)
    below = frozenset({1}) if ratio.den is None else _signs(ratio.field, den)
    if below not in ({1}, {-1}):
        return _ANY
    return signs if below == {1} else frozenset(-s for s in signs)


def _signs(field: Field, polynomial: Any) -> frozenset[int]:
    """Substitute bounds until none is left to substitute, then look at the coefficients."""
    known = field.generators
    spread = _homogeneous(field, polynomial)
    for place in reversed(range(len(known))):
        g = known[place]
        if g.sign and (g.base or g.sign < 0) and spread.degrees()[place]:
            spread = _substituted(field, spread, place, field.number(g.base), g.sign)
    terms = spread.to_dict()
    signs = {1 if int(c) > 0 else -1 for c in terms.values()}
    free = {i for powers in terms for i, e in enumerate(powers) if e and not known[i].sign}
    even = all(not powers[i] % 2 for powers in terms for i in free)
    if len(signs) != 1 or not even:
        return _ANY
    certain = any(all(known[i].strict and known[i].sign for i, e in enumerate(powers) if e) for powers in terms)
    return frozenset(signs if certain else signs | {0})


def _homogeneous(field: Field, polynomial: Any) -> Any:
    """The polynomial with every term brought to the same degree in weights that sum to 1, by factors of that sum."""
    for places in field.simplices:
        by_degree: dict[int, dict[tuple[int, ...], int]] = {}
        for powers, coefficient in polynomial.to_dict().items():
            by_degree.setdefault(sum(int(powers[p]) for p in places), {})[powers] = int(coefficient)
        whole = sum((field.context.gens()[p] for p in places[1:]), field.context.gens()[places[0]])
        parts = [field.context.from_dict(terms) * whole ** (max(by_degree) - d) for d, terms in by_degree.items()]
        polynomial = sum(parts[1:], parts[0])
    return polynomial


def _substituted(field: Field, polynomial: Any, place: int, base: Ratio, sign: int) -> Any:
    """The polynomial with ``base + sign * t`` for a generator, times a positive number that clears denominators."""
    num, den = base.lifted()
    degree = int(polynomial.degrees()[place])
    if base.den is not None:
        scale = int(den.leading_coefficient())
        terms = {powers: int(c) * scale ** (degree - int(powers[place])) for powers, c in polynomial.to_dict().items()}
        polynomial = field.context.from_dict(terms)
    arguments = list(field.context.gens())
    arguments[place] = num + sign * arguments[place]
    return polynomial.compose(*arguments)
