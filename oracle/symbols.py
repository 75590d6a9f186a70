"""Symbols: numbers that are rational functions of what a user left open.

A `Ratio` is a quotient of two polynomials with integer coefficients, in lowest terms, so that
equal numbers are equal objects. Columns and vectors hold Ratios where they would hold integers,
and nothing else in the engine knows of symbols. What is no rational function becomes one by a
*generator* of its own: W^n for a symbolic n, the largest of some values, and the 0/1 factor of a
comparison that a symbol decides.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from numbers import Integral
from typing import Any

from flint import fmpz_mpoly, fmpz_mpoly_ctx

from truemean.errors import NoClosedForm

__all__ = ["HOLDS", "Field", "Generator", "Ratio", "root_relation"]

_FIRST_WIDTH = 16
_MOST_CONDITIONS = 400
HOLDS: dict[str, Callable[[Any], Any]] = {
    "<": lambda s: s < 0,
    "<=": lambda s: s <= 0,
    ">": lambda s: s > 0,
    ">=": lambda s: s >= 0,
    "==": lambda s: s == 0,
    "!=": lambda s: s != 0,
}


@dataclass(frozen=True, slots=True)
class Generator:
    """What stands behind a generator, and what is known of it.

    ``kind`` is one of symbol, size, value, weight, power, condition, opaque. It equals
    ``base + sign * t`` with t > 0 (or t >= 0 where not ``strict``); ``sign`` 0 says nothing.
    """

    expression: Any
    kind: str
    base: Any = 0
    sign: int = 0
    strict: bool = True


class Field:
    """The rational functions of the symbols of one derivation; symbols are known by name."""

    def __init__(self) -> None:
        self.generators: list[Generator] = []
        self.requirements: dict[str, None] = {}
        self.origins: dict[str, Any] = {}  # what sizes were as symbols before they were read as sizes
        self.simplices: dict[tuple[int, ...], None] = {}  # generators that are weights and sum to 1
        self.index: Any = None  # (i, k) where the pixel has k values, k a symbol
        self._place: dict[Any, int] = {}
        self._widen(_FIRST_WIDTH)

    def _widen(self, width: int) -> None:
        self.width = width
        self.context = fmpz_mpoly_ctx.get([f"x{i}" for i in range(width)], "lex")
        self._gens: tuple[fmpz_mpoly, ...] = self.context.gens()
        self.one = self.context.constant(1)

    # -- numbers of the field -----------------------------------------------------------------

    def generator(self, key: Any, made: Generator) -> Ratio:
        """The generator with a key; made at its first mention."""
        place = self._place.get(key)
        if place is None:
            place = self._place[key] = len(self.generators)
            self.generators.append(made)
            if place == len(self._gens):
                self._widen(2 * place)
        return Ratio(self, self._gens[place])

    def know(self, key: Any, made: Generator) -> None:
        """Say more of a generator that there is already, such as that a symbol is a size."""
        self.generators[self._place[key]] = made

    def place(self, key: Any) -> int | None:
        """The number of a generator, None if it was never mentioned."""
        return self._place.get(key)

    def number(self, value: Any) -> Ratio:
        """An integer, a Fraction or a Ratio as a Ratio."""
        if isinstance(value, Ratio):
            return value
        num, den = int(value.numerator), int(value.denominator)
        return Ratio(self, self.context.constant(num), None if den == 1 else self.context.constant(den))

    def power(self, base: Any, exponent: Ratio) -> Ratio:
        """``base ** exponent`` for an exponent that is a polynomial in symbols, such as 2 n + 1."""
        base = self.number(base)
        total = self.number(1)
        if base == 1:
            return total
        for powers, coefficient in exponent.lifted()[0].to_dict().items():
            times, used = int(coefficient), [i for i, e in enumerate(powers) if e]
            if not used:
                total = total * base**times
                continue
            symbol = Ratio(self, self.context.from_dict({powers: 1}))
            made = Generator((base, symbol), "power", sign=1)
            total = total * self.generator(("power", base, symbol), made) ** times
        return total

    def condition(self, difference: Ratio, op: str) -> Any:
        """The truth of ``difference op 0``: True, False, or a 0/1 generator where a symbol decides it."""
        from truemean.oracle.assumptions import possible_signs

        signs = possible_signs(difference)
        truths = {HOLDS[op](sign) for sign in signs}
        if len(truths) == 1:
            return truths.pop()
        if op in (">", ">=", "!="):
            return 1 - self.condition(difference, _NEGATED[op])
        if difference.num.leading_coefficient() < 0 and op != "==":
            return 1 - self.condition(-difference, _FLIPPED[op])
        if difference.num.leading_coefficient() < 0:
            difference = -difference
        self._check_conditions()
        return self.generator((op, difference), Generator((difference, op), "condition"))

    def indicator(self, relation: Any) -> Ratio:
        """The 0/1 generator of any other relation, a SymPy one."""
        self._check_conditions()
        return self.generator(("relation", relation), Generator((relation, "relation"), "condition"))

    def _check_conditions(self) -> None:
        if sum(g.kind == "condition" for g in self.generators) > _MOST_CONDITIONS:
            names = ", ".join(str(g.expression) for g in self.generators if g.kind in ("symbol", "value"))
            raise NoClosedForm(
                f"more than {_MOST_CONDITIONS} comparisons are decided by symbols: make some of {names} numbers"
            )

    def once(self, value: Any) -> Any:
        """A number with the squares of 0/1 generators taken back to themselves: 0 where conditions exclude each other."""
        if not isinstance(value, Ratio):
            return value
        truths = [i for i, g in enumerate(self.generators) if g.kind == "condition"]
        num, den = value.lifted()
        reduced: dict[tuple[int, ...], int] = {}
        for powers, coefficient in num.to_dict().items():
            key = tuple(min(int(e), 1) if i in truths else int(e) for i, e in enumerate(powers)) if truths else powers
            reduced[key] = reduced.get(key, 0) + int(coefficient)
        return Ratio.reduced(self, self.context.from_dict({k: c for k, c in reduced.items() if c}), den)

    def require(self, text: str) -> None:
        """Note a condition under which the formulas hold, such as ``n >= 2``."""
        self.requirements[text] = None


_NEGATED = {">": "<=", ">=": "<", "!=": "=="}
_FLIPPED = {"<=": "<", "<": "<="}  # x <= 0 unless -x < 0


class Ratio:
    """A rational function in lowest terms; ``den`` is None for 1, its leading coefficient positive.

    It divides and compares like a number, but has no order: what decides a sign is `Field.condition`.
    """

    __slots__ = ("den", "field", "num")

    def __init__(self, field: Field, num: fmpz_mpoly, den: fmpz_mpoly | None = None) -> None:
        self.field, self.num, self.den = field, num, den

    @classmethod
    def reduced(cls, field: Field, num: fmpz_mpoly, den: fmpz_mpoly) -> Ratio:
        """A quotient brought to lowest terms."""
        common = num.gcd(den)
        if not common.is_one():
            num, den = num // common, den // common
        if den.leading_coefficient() < 0:
            num, den = -num, -den
        return cls(field, num, None if den.is_one() else den)

    @property
    def numerator(self) -> Ratio:
        """Itself: seen from columns a Ratio is an integer of a larger ring."""
        return self

    @property
    def denominator(self) -> int:
        """1, see `numerator`."""
        return 1

    def lifted(self) -> tuple[fmpz_mpoly, fmpz_mpoly]:
        """Numerator and denominator in the field's present context."""
        context = self.field.context
        if self.num.context() is not context:
            self.num = self.num.project_to_context(context)
            self.den = None if self.den is None else self.den.project_to_context(context)
        return self.num, self.field.one if self.den is None else self.den

    def _pair(self, other: Any) -> tuple[Any, Any]:
        """Another number as ``(num, den)``; den None for 1."""
        if type(other) is Ratio:
            if self.num.context() is not other.num.context():
                self.lifted()
                other.lifted()
            return other.num, other.den
        if isinstance(other, int):
            return int(other), None
        if isinstance(other, Fraction):
            den = other.denominator
            return other.numerator, None if den == 1 else self.num.context().constant(den)
        if isinstance(other, Integral):  # NumPy's
            return int(other), None
        return NotImplemented, None

    # -- arithmetic ---------------------------------------------------------------------------

    def __add__(self, other: Any) -> Any:
        num, den = self._pair(other)
        if num is NotImplemented:
            return NotImplemented
        if self.den is None and den is None:
            return Ratio(self.field, self.num + num)
        one = self.num.context().constant(1)
        mine, theirs = one if self.den is None else self.den, one if den is None else den
        return Ratio.reduced(self.field, self.num * theirs + num * mine, mine * theirs)

    __radd__ = __add__

    def __neg__(self) -> Ratio:
        return Ratio(self.field, -self.num, self.den)

    def __sub__(self, other: Any) -> Any:
        return NotImplemented if self._pair(other)[0] is NotImplemented else self + -other

    def __rsub__(self, other: Any) -> Any:
        return -self + other

    def __mul__(self, other: Any) -> Any:
        num, den = self._pair(other)
        if num is NotImplemented:
            return NotImplemented
        if self.den is None and den is None:
            return Ratio(self.field, self.num * num)
        one = self.num.context().constant(1)
        mine, theirs = one if self.den is None else self.den, one if den is None else den
        return Ratio.reduced(self.field, self.num * num, mine * theirs)

    __rmul__ = __mul__

    def inverse(self) -> Ratio:
        """1 / self; NoClosedForm where a comparison decided by a symbol would be divided by."""
        num, den = self.lifted()
        if num.is_zero():
            raise ZeroDivisionError("division by a Ratio that is 0")
        if any(self.field.generators[i].kind == "condition" for i in self.places):
            raise NoClosedForm(
                f"{self} is divided by, and a symbol decides which number it is: "
                f"write the comparison as an if instead of np.where"
            )
        return Ratio.reduced(self.field, den, num)

    def __truediv__(self, other: Any) -> Any:
        if isinstance(other, Ratio):
            return self * other.inverse()
        if self._pair(other)[0] is NotImplemented:
            return NotImplemented
        return self * (1 / Fraction(other) if isinstance(other, Fraction) else Fraction(1, int(other)))

    def __rtruediv__(self, other: Any) -> Any:
        return self.inverse() * other

    def __pow__(self, exponent: Any) -> Any:
        if isinstance(exponent, Ratio):
            return self.field.power(self, exponent)
        if exponent < 0:
            return self.inverse() ** -exponent
        return Ratio(self.field, self.num ** int(exponent), None if self.den is None else self.den ** int(exponent))

    def __rpow__(self, base: Any) -> Ratio:
        return self.field.power(base, self)

    # -- comparing ----------------------------------------------------------------------------

    def __bool__(self) -> bool:
        return not self.num.is_zero()

    def __eq__(self, other: object) -> bool:
        num, den = self._pair(other)
        if num is NotImplemented:
            return False
        if self.den is None or den is None:
            return bool(self.den is None and den is None and self.num == num)
        return bool(self.num == num and self.den == den)

    def __hash__(self) -> int:
        if self.is_constant:
            return hash(self.constant)
        return hash((_sparse(self.num), None if self.den is None else _sparse(self.den)))

    def total(self) -> Ratio:
        """The sum over the index i of what mentions it; itself where there is no index."""
        if self.field.index is None:
            return self
        from truemean.oracle.formulas import summed

        return summed(self)

    @property
    def places(self) -> set[int]:
        """The numbers of the generators in its numerator."""
        return {i for i, degree in enumerate(self.lifted()[0].degrees()) if degree > 0}

    @property
    def is_constant(self) -> bool:
        """Whether it is just a number."""
        return bool(self.num.is_constant() and (self.den is None or self.den.is_constant()))

    @property
    def constant(self) -> Fraction:
        """The number that it is."""
        num = 0 if self.num.is_zero() else int(self.num.leading_coefficient())
        return Fraction(num, 1 if self.den is None else int(self.den.leading_coefficient()))

    def __str__(self) -> str:
        return str(self.expression())

    def __repr__(self) -> str:
        return f"Ratio({self})"

    def expression(self) -> Any:
        """The SymPy expression."""
        from truemean.oracle.formulas import expression

        return expression(self)


def root_relation(a: Any, b: Any, c: Any, op: str) -> Any:
    """The truth of ``a + b sqrt(c) op 0``, squared where the signs of a and b are known."""
    if not b or not c:
        return _decided(a, op)
    first, second = (_decided(x, "<=") for x in (a, -b))
    if op in ("<", "<=") and first is True and second is True:  # b sqrt(c) against -a, both >= 0
        return _decided(b * b * c - a * a, op)
    if op in (">", ">="):
        return 1 - root_relation(a, b, c, _NEGATED[op])
    field = next(x.field for x in (a, b, c) if isinstance(x, Ratio))
    from truemean.oracle.formulas import root_condition

    relation = root_condition(field.number(a), field.number(b), field.number(c), op)
    return relation if isinstance(relation, bool) else field.indicator(relation)


def _decided(number: Any, op: str) -> Any:
    return number.field.condition(number, op) if isinstance(number, Ratio) else HOLDS[op](number)


def _sparse(polynomial: fmpz_mpoly) -> frozenset[Any]:
    """A polynomial as a set that does not depend on the width of its context."""
    return frozenset(
        (tuple((i, int(e)) for i, e in enumerate(powers) if e), int(coefficient))
        for powers, coefficient in polynomial.to_dict().items()
    )
