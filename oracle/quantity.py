"""What a plan computes with: lazy expressions over draws that nobody has looked at yet.

A `Quantity` is a node of an expression whose leaves are statistics of samples; a `Decision` is a
comparison of two. Nothing is computed when they are made. Only ``bool(decision)`` asks the
current path to split its rows, and only the estimate that a plan returns is ever evaluated.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from fractions import Fraction
from numbers import Number
from typing import Any, NoReturn, Protocol

import numpy as np

from truemean.errors import PlanError
from truemean.oracle.exact import exact_number, is_symbolic
from truemean.oracle.symbols import Ratio
from truemean.oracle.wording import text

__all__ = [
    "CURRENT",
    "Deciding",
    "Decision",
    "Node",
    "Quantity",
    "Vector",
    "by_channel",
    "constant",
    "decision",
    "quantity",
]


class Deciding(Protocol):
    """The path that is being run: the only one who can answer a decision."""

    def decide(self, decision: Decision) -> bool: ...

    def enumerate(self, quantity: Quantity) -> int: ...

    def symbol(self, expression: Any) -> Ratio: ...


CURRENT: ContextVar[Deciding | None] = ContextVar("truemean_path", default=None)


class NumPyMixin:
    """NumPy's functions on whatever has it make expressions; see `truemean.oracle.ufuncs`."""

    __slots__ = ()

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        return _numpy().apply_ufunc(ufunc, method, inputs, options)

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> Any:
        return _numpy().apply_function(function, args, kwargs)


class Node(NumPyMixin):
    """An immutable expression: an operation, its arguments, and a key that identifies both."""

    __slots__ = ("args", "key", "op")

    def __init__(self, op: str, *args: Any) -> None:
        self.op: str = op
        self.args: tuple[Any, ...] = args
        self.key: int = hash((op, *[a.key if isinstance(a, Node) else a for a in args]))

    def __repr__(self) -> str:
        return text(self)

    __hash__ = None  # type: ignore[assignment]  # == makes a decision, so nothing here is hashable


class Quantity(Node):
    """A number that depends on the draws; arithmetic and NumPy functions give further quantities."""

    __slots__ = ()

    # -- arithmetic --------------------------------------------------------------------------

    def __add__(self, other: Any) -> Any:
        return combine("+", self, other)

    def __radd__(self, other: Any) -> Any:
        return combine("+", other, self)

    def __sub__(self, other: Any) -> Any:
        return combine("-", self, other)

    def __rsub__(self, other: Any) -> Any:
        return combine("-", other, self)

    def __mul__(self, other: Any) -> Any:
        return combine("*", self, other)

    def __rmul__(self, other: Any) -> Any:
        return combine("*", other, self)

    def __truediv__(self, other: Any) -> Any:
        return combine("/", self, other)

    def __rtruediv__(self, other: Any) -> Any:
        return combine("/", other, self)

    def __floordiv__(self, other: Any) -> Any:
        return (self / other).__floor__()

    def __mod__(self, other: Any) -> Any:
        return self - other * (self / other).__floor__()

    def __pow__(self, other: Any) -> Any:
        return combine("**", self, other)

    def __rpow__(self, other: Any) -> Any:
        return combine("**", other, self)

    def __neg__(self) -> Quantity:
        return Quantity("*", constant(-1), self)

    def __pos__(self) -> Quantity:
        return self

    def __abs__(self) -> Quantity:
        return Quantity("abs", self)

    def __round__(self, digits: int = 0) -> Any:
        scale = Fraction(10) ** digits
        return Quantity("round", self * scale) / scale

    def __floor__(self) -> Quantity:
        return Quantity("floor", self)

    def __ceil__(self) -> Quantity:
        return Quantity("ceil", self)

    # -- decisions ---------------------------------------------------------------------------

    def __lt__(self, other: Any) -> Any:
        return _compare("<", self, other)

    def __le__(self, other: Any) -> Any:
        return _compare("<=", self, other)

    def __gt__(self, other: Any) -> Any:
        return _compare(">", self, other)

    def __ge__(self, other: Any) -> Any:
        return _compare(">=", self, other)

    def __eq__(self, other: object) -> Any:
        return _compare("==", self, other)

    def __ne__(self, other: object) -> Any:
        return _compare("!=", self, other)

    __hash__ = None

    # -- what Python would make a single number of --------------------------------------------

    def __int__(self) -> int:
        return _path(self).enumerate(self)

    __index__ = __int__

    def __bool__(self) -> NoReturn:
        raise PlanError(f"the truth of {self!r} is not defined: compare it with something, e.g. {self!r} > 0")

    def _sympy_(self) -> NoReturn:
        from sympy import SympifyError

        raise SympifyError(f"{self!r} has many values")  # so that symbol * quantity is a quantity

    def __float__(self) -> NoReturn:
        raise PlanError(f"{self!r} has many values and is no float: use np.sqrt and the like instead of math.sqrt")

    def __format__(self, spec: str) -> str:
        if spec:
            raise PlanError(f"{self!r} has many values: format it without {spec!r}, its text is its formula")
        return repr(self)


class Decision(Node):
    """A comparison that the plan may act on; ``bool()`` of it splits the path."""

    __slots__ = ()

    def __bool__(self) -> bool:
        return _path(self).decide(self)

    def __and__(self, other: Any) -> Decision:
        return Decision("and", self, decision(other))

    def __or__(self, other: Any) -> Decision:
        return Decision("or", self, decision(other))

    def __invert__(self) -> Decision:
        return Decision("not", self)

    __rand__ = __and__
    __ror__ = __or__

    def all(self) -> Decision:
        """Itself: a scalar decision holds in all its one channels."""
        return self

    any = all

    def indicator(self) -> Quantity:
        """1 where it holds, 0 elsewhere."""
        return Quantity("where", self, constant(1), constant(0))

    def __mul__(self, other: Any) -> Any:
        return self.indicator() * other

    __rmul__ = __mul__

    def __add__(self, other: Any) -> Any:
        return self.indicator() + other

    __radd__ = __add__

    def __rsub__(self, other: Any) -> Any:
        return other - self.indicator()

    def __int__(self) -> int:
        return int(bool(self))

    __index__ = __int__

    def __eq__(self, other: object) -> Any:
        other = decision(other)
        return Decision("or", Decision("and", self, other), Decision("and", ~self, ~other))

    __hash__ = None


class Vector(NumPyMixin):
    """Quantities (or decisions) by channel, for colours."""

    __slots__ = ("parts",)

    def __init__(self, parts: Any) -> None:
        self.parts = tuple(parts)

    def __len__(self) -> int:
        return len(self.parts)

    def __iter__(self) -> Iterator[Any]:
        return iter(self.parts)

    def __getitem__(self, index: int) -> Any:
        return self.parts[index]

    def __repr__(self) -> str:
        return f"({', '.join(map(repr, self.parts))})"

    def all(self) -> Decision:
        """Holds where every channel holds."""
        flat = self._flat("<=", "==")
        return self._fold("and") if flat is None else flat

    def any(self) -> Decision:
        """Holds where some channel holds."""
        flat = self._flat(">", "!=")
        return self._fold("or") if flat is None else flat

    def _flat(self, *comparisons: str) -> Decision | None:
        """All channels of one sample are constant exactly if its values are."""
        tests = [p.args for p in self.parts if p.op == "flat" and p.args[5] in comparisons]
        if len(tests) < len(self.parts) or len({(args[0], args[1]) for args in tests}) > 1:
            return None
        sample, span, _, *words = tests[0]
        return Decision("flat", sample, span, None, *words)

    def _fold(self, op: str) -> Decision:
        folded = decision(self.parts[0])
        for part in self.parts[1:]:
            folded = Decision(op, folded, decision(part))
        return folded

    def __bool__(self) -> NoReturn:
        raise PlanError(f"the decision {self!r} has one answer per channel: write (...).all() or (...).any()")

    __hash__ = None  # type: ignore[assignment]  # as for Node

    def __neg__(self) -> Vector:
        return Vector(-p for p in self.parts)

    def __abs__(self) -> Vector:
        return Vector(abs(p) for p in self.parts)


def _channelwise(function: Callable[..., Any]) -> Callable[[Vector, Any], Any]:
    def method(self: Vector, other: Any) -> Any:
        return by_channel(function, self, other)

    return method


for _name in ("add", "sub", "mul", "truediv", "pow", "lt", "le", "gt", "ge", "eq", "ne", "and_", "or_"):
    _function = getattr(operator, _name)
    setattr(Vector, f"__{_name.strip('_')}__", _channelwise(_function))
for _name in ("add", "sub", "mul", "truediv"):
    _function = getattr(operator, _name)
    setattr(Vector, f"__r{_name}__", _channelwise(lambda a, b, f=_function: f(b, a)))


def quantity(value: Any) -> Quantity:
    """``value`` as a node: quantities stay, decisions become 0/1, numbers become exact constants."""
    if isinstance(value, Quantity):
        return value
    if type(value) is int or type(value) is Fraction:
        return constant(value)
    if isinstance(value, Decision):
        return value.indicator()
    if isinstance(value, Ratio):
        return constant(value)
    if is_symbolic(value):
        return constant(_path(value).symbol(value))
    if isinstance(value, Number | str | np.generic) or hasattr(value, "numerator"):
        return constant(exact_number(value, "a number in the plan"))
    raise PlanError(f"{value!r} (type={type(value).__name__}) is not a number: use numbers and statistics of samples")


def constant(value: Any) -> Quantity:
    """A node for an exact number."""
    node = Quantity.__new__(Quantity)
    node.op = "const"
    if type(value) is Ratio:
        node.args, node.key = (value,), hash(("const", value))
        return node
    node.args = (value if type(value) is Fraction else Fraction(value),)
    node.key = hash(("const", 2 * value.numerator + 1, value.denominator))  # Python hashes -1 and -2 alike
    return node


def decision(value: Any) -> Decision:
    """``value`` as a decision: decisions stay, Python's and NumPy's truth values become constant."""
    if isinstance(value, Decision):
        return value
    if isinstance(value, bool | np.bool_):
        return Decision("truth", bool(value))
    raise PlanError(f"{value!r} is not a decision: compare quantities, e.g. S.range() <= eps")


def _numpy() -> Any:
    from truemean.oracle import ufuncs  # it makes nodes of this module, so it can't be imported above

    return ufuncs


def _path(asked: Any) -> Deciding:
    current = CURRENT.get()
    if current is None:
        raise PlanError(
            f"the decision {asked!r} can only be taken while a plan runs: use derive(plan, X) or simulate(plan, X)"
        )
    return current


def combine(op: str, left: Any, right: Any) -> Any:
    if isinstance(left, Vector) or isinstance(right, Vector):
        return by_channel(lambda a, b: combine(op, quantity(a), quantity(b)), left, right)
    if isinstance(left, np.ndarray) or isinstance(right, np.ndarray):
        return _numpy().elementwise(lambda a, b: combine(op, a, b), left, right)
    return Quantity(op, quantity(left), quantity(right))


def _compare(op: str, left: Any, right: Any) -> Any:
    if isinstance(right, Vector):
        return by_channel(lambda a, b: _compare(op, quantity(a), b), left, right)
    if right is None and op in ("==", "!="):
        return NotImplemented
    right = quantity(right)
    if _is_zero(right) and left.op == "stat":
        flat = left.args[0].flat_test(left, op)
        if flat is not None:
            return flat
    return Decision(op, left, right)


def _is_zero(node: Quantity) -> bool:
    return node.op == "const" and node.args[0] == 0


def by_channel(function: Callable[..., Any], *args: Any) -> Vector:
    """A function applied channel by channel; what is no colour goes to every channel."""
    lengths = {len(a) for a in args if isinstance(a, Vector | tuple | list)}
    if len(lengths) != 1:
        raise PlanError(f"colours of {' and '.join(map(str, sorted(lengths)))} channels can't be combined")
    (channels,) = lengths
    spread = [a if isinstance(a, Vector | tuple | list) else (a,) * channels for a in args]
    return Vector(function(*parts) for parts in zip(*spread, strict=True))
