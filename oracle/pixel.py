"""The pixel X: a finite population of values I_1..I_k with weights omega_1..omega_k."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, MutableMapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from truemean.errors import AssumptionError, InputError, InputTypeError, NeedsScene, PlanError
from truemean.oracle.exact import (
    exact_count,
    exact_fraction,
    exact_number,
    exact_or_symbolic,
    exact_weight,
    is_symbolic,
    short_text,
)
from truemean.oracle.law import Law

__all__ = ["Geometry", "Pixel", "Value"]

Value = Any  # a Fraction or a SymPy expression, or a tuple of Fractions for a colour


class Geometry(Protocol):
    """Where a pixel lies in a scene: what its cells and point samples need."""

    def grid(self, n: int) -> tuple[Pixel, ...]:
        """The ``n`` x ``n`` equal cells as pixels of area 1/n^2, row by row; the same ones whenever asked."""
        ...

    def at(self, x: Fraction, y: Fraction) -> Value:
        """The value seen at a position, ``x`` and ``y`` in [0, 1), ``y`` downwards."""
        ...


@dataclass(frozen=True, eq=False)
class Pixel:
    """A finite population: values with weights that sum to 1 (Kirk & Arvo 1991, section 3).

    ``law`` maps value (a number, or a tuple of numbers for colours) to weight (int, Fraction,
    ``"p/q"`` or decimal string); both may be SymPy expressions with symbols. Raises InputError
    for weights that are negative or don't sum to 1, InputTypeError for a float weight.
    ``count`` is k where that is a symbol, ``ordered`` says that values that are symbols ascend as declared, ``on_simplex`` that weights
    that are symbols sum to 1 though they don't show it.

    >>> X = Pixel({0: "7/8", 1: "1/8"})
    >>> X.mean, X.variance
    (Fraction(1, 8), Fraction(7, 64))
    """

    law: Mapping[Any, Any]
    area: Any = Fraction(1)
    regions: Mapping[str, Pixel] = field(default_factory=lambda: MappingProxyType({}))
    geometry: Geometry | None = None
    ordered: bool = False
    on_simplex: bool = False
    count: Any = None

    def __post_init__(self) -> None:
        known = self.count is not None or (self.on_simplex and bool(self.regions))  # whose sum is known to be 1
        merged = dict(self.law) if known else _read_law(self.law, self.on_simplex)
        object.__setattr__(self, "law", MappingProxyType(merged))
        object.__setattr__(self, "area", exact_weight(self.area, "area"))
        if isinstance(self.regions, MutableMapping):
            object.__setattr__(self, "regions", MappingProxyType(dict(self.regions)))

    # -- other ways to make one ---------------------------------------------------------------

    @classmethod
    def two(cls, weight: Any) -> Pixel:
        """Values 0 and 1, ``weight`` being that of 1: the paper's two-intensity pixel.

        >>> Pixel.two("1/8").weights
        (Fraction(7, 8), Fraction(1, 8))
        """
        white = exact_weight(weight, "weight of 1")
        if not is_symbolic(white) and white > 1:
            raise InputError(f"weight of 1={weight!r} is more than 1: give the coverage of the value 1")
        return cls({0: 1 - white, 1: white})

    @classmethod
    def symbolic(cls, k: Any, values: Any = None, weights: Any = None, ordered: bool = False) -> Pixel:
        """Values I1..Ik and weights omega1..omegak, all symbols; ``values`` or ``weights`` make a part concrete.

        Values are distinct, and ascend if ``ordered``; weights lie on the simplex (`simplex`). With a symbol
        for k they are the indexed families I[i] and omega[i], i = 1..k.

        >>> X = Pixel.symbolic(2, values=(0, 1))
        >>> X.mean, X.simplex
        (omega2, {omega2: 1 - omega1})
        """
        from sympy import IndexedBase, Symbol

        if is_symbolic(k):
            if values is not None or weights is not None or ordered or not k.is_Symbol or k.is_positive is False:
                raise AssumptionError(f"k={k}: a symbolic number of values is a positive integer, and all else is open")
            i = Symbol("i", integer=True)
            return cls({IndexedBase("I")[i]: IndexedBase("omega")[i]}, on_simplex=True, count=k)
        if isinstance(k, bool) or not isinstance(k, int) or k < 1:
            raise InputError(f"k={k!r} is no number of values: give an integer of at least 1")
        parts = {}
        for name, given, letter in (("values", values, "I"), ("weights", weights, "omega")):
            listed = [Symbol(f"{letter}{i}") for i in range(1, k + 1)] if given is None else list(given)
            if len(listed) != k:
                raise InputError(f"{name}={given!r} are {len(listed)}, but k={k}: give as many as there are values")
            parts[name] = listed
        read = [_read_value(v) for v in parts["values"]]
        if len(set(read)) < k:
            raise InputError(f"values={values!r} are not distinct: merge equal ones")
        return cls(dict(zip(read, parts["weights"], strict=True)), ordered=ordered, on_simplex=True)

    @classmethod
    def from_regions(cls, regions: Mapping[str, tuple[Any, Pixel]], geometry: Geometry | None = None) -> Pixel:
        """A pixel made of disjoint parts, ``name -> (area, part)``; areas sum to 1.

        >>> X = Pixel.from_regions({"R": ("1/4", Pixel.two(1)), "rest": ("3/4", Pixel.two(0))})
        >>> X.mean, X.regions["R"].area
        (Fraction(1, 4), Fraction(1, 4))
        """
        parts = {}
        for name, pair in regions.items():
            if not (isinstance(pair, tuple) and len(pair) == 2 and isinstance(pair[1], Pixel)):
                raise InputTypeError(f"region {name!r}={pair!r}: write ('area', Pixel(...))")
            parts[name] = pair[1].with_area(exact_weight(pair[0], f"area of region {name!r}"))
        total = _expanded(sum((p.area for p in parts.values()), Fraction(0)))
        if total != 1:
            raise InputError(f"the areas of regions {', '.join(map(repr, parts))} sum to {total}, not to 1")
        law: dict[Any, Any] = {}
        for part in parts.values():
            for value, weight in part.law.items():
                law[value] = _expanded(law.get(value, Fraction(0)) + part.area * weight)
        on_simplex = any(part.on_simplex for part in parts.values())
        return cls(law, regions=parts, geometry=geometry, on_simplex=on_simplex)

    def with_area(self, area: Any) -> Pixel:
        """The same population as a part of the given area of a larger one."""
        return replace(self, area=exact_weight(area, "area"))

    # -- the population ----------------------------------------------------------------------

    @cached_property
    def values(self) -> tuple[Value, ...]:
        """I_1..I_k in declared order, equal ones merged."""
        return tuple(self.law)

    @cached_property
    def weights(self) -> tuple[Any, ...]:
        """omega_1..omega_k, in the order of ``values``."""
        return tuple(self.law.values())

    @cached_property
    def symbols(self) -> frozenset[Any]:
        """The SymPy symbols in its values, weights and areas."""
        if self.geometry is not None:  # a scene is made of numbers, and its parts have parts without end
            return frozenset()
        channels = [v for value in self.values for v in (value if isinstance(value, tuple) else (value,))]
        own = [x.free_symbols for x in (*channels, *self.weights, self.area) if is_symbolic(x)]
        return frozenset().union(*own, *(part.symbols for part in self.regions.values()))

    @cached_property
    def simplex(self) -> dict[Any, Any]:
        """The substitution that says that the weights sum to 1, for the last weight that is a symbol; {} if they show it."""
        if self.count is not None:
            return {}
        if self.regions and self.on_simplex:
            return {s: e for part in self.regions.values() for s, e in part.simplex.items()}
        missing = _expanded(1 - sum(self.weights, Fraction(0)))
        if missing == 0:
            return {}
        last = next(w for w in reversed(self.weights) if getattr(w, "is_Symbol", False))
        return {last: last + missing}

    @property
    def channels(self) -> int | None:
        """Number of channels of a colour, None for scalar values."""
        first = self.values[0]
        return len(first) if isinstance(first, tuple) else None

    @cached_property
    def mean(self) -> Value:
        """The true mean I (Eq. 1), by channel for colours."""
        if self.count is not None:
            return self._summed(self.values[0])
        mean: Value = self._by_channel(lambda values: _dot(self.weights, values))
        return mean

    def _summed(self, term: Any) -> Any:
        from sympy import Sum, Symbol

        (index,) = self.values[0].indices
        j = Symbol("j", integer=True)
        return Sum((self.weights[0] * term).subs(index, j), (j, 1, self.count))

    @cached_property
    def variance(self) -> Value:
        """Sum of omega_i (I_i - I)^2, by channel for colours."""
        if self.count is not None:
            return self._summed(self.values[0] ** 2) - self.mean**2

        def channel(values: tuple[Any, ...]) -> Any:
            mean = _dot(self.weights, values)
            return _dot(self.weights, tuple((v - mean) ** 2 for v in values))

        variance: Value = self._by_channel(channel)
        return variance

    @cached_property
    def scale(self) -> Any:
        """Largest value minus smallest, over all channels; 1 for a constant pixel."""
        flat = [v for value in self.values for v in (value if isinstance(value, tuple) else (value,))]
        if any(map(is_symbolic, flat)):
            return self._symbolic_scale(flat)
        return (max(flat) - min(flat)) or Fraction(1)

    def _symbolic_scale(self, flat: list[Any]) -> Any:
        from sympy import Max, Min

        if len(flat) == 1:
            return Fraction(1)
        return flat[-1] - flat[0] if self.ordered else Max(*flat) - Min(*flat)

    @cached_property
    def one_draw(self) -> Law:
        """The law of one draw, as the engine uses it."""
        return Law([v if isinstance(v, tuple) else (v,) for v in self.values], self.weights)

    def arrays(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """``(values [k] or [k, channels], weights [k])`` in float64."""
        if self.symbols:
            raise InputError(f"{self!r} has symbols, so it has no numbers: substitute {_listed(self.symbols)} first")
        return np.array(self.values, dtype=float), np.array(self.weights, dtype=float)

    # -- its parts ---------------------------------------------------------------------------

    def split(self, area: Any) -> tuple[Pixel, Pixel]:
        """Two scattered parts of areas ``area`` and ``1 - area``, each with X's own law.

        >>> R, rest = Pixel.two("1/8").split("1/4")
        >>> R.area, rest.area, R.mean == rest.mean
        (Fraction(1, 4), Fraction(3, 4), True)
        """
        part = exact_fraction(area, "area")
        return self.with_area(part), self.with_area(1 - part)

    def quadrants(self) -> tuple[Pixel, ...]:
        """The four quarters of a pixel of a scene, each of area 1/4, as ``grid(2)``; NeedsScene without geometry."""
        return self._placed("quadrants()").grid(2)

    def grid(self, n: Any) -> tuple[Pixel, ...]:
        """The ``n`` x ``n`` equal cells of a pixel of a scene, row by row, each of area 1/n^2.

        InputError for an ``n`` that is no integer of at least 1, NeedsScene without geometry.
        """
        return self._placed("grid()").grid(exact_count(n, "n", "number of cells along a side"))

    def at(self, x: Any, y: Any) -> Value:
        """The value seen at a position of the pixel, ``x`` and ``y`` in [0, 1), ``y`` downwards."""
        return self._placed("at()").at(exact_number(x, "x"), exact_number(y, "y"))

    def draw(self, n: Any) -> Any:
        """Only plans draw, while they are derived or simulated: PlanError."""
        raise PlanError(f"X.draw({n!r}) outside a derivation: call derive(plan, X) or simulate(plan, X)")

    def __repr__(self) -> str:
        law = ", ".join(f"{_text(value)}: {short_text(weight)}" for value, weight in self.law.items())
        return f"Pixel({{{law}}})"

    def _placed(self, asked: str) -> Geometry:
        if self.geometry is None:
            raise NeedsScene(f"{asked} needs a scene: {self!r} has no geometry; take a pixel of a scene file")
        return self.geometry

    def _by_channel(self, function: Any) -> Any:
        if self.channels is None:
            return function(self.values)
        return tuple(function(column) for column in zip(*self.values, strict=True))


def _read_law(law: Mapping[Any, Any], on_simplex: bool) -> dict[Value, Any]:
    if not isinstance(law, Mapping):
        raise InputTypeError(f"expected a mapping value -> weight but got {law!r} (type={type(law).__name__})")
    merged: dict[Value, Any] = {}
    for raw, weight in law.items():
        value = _read_value(raw)
        merged[value] = merged.get(value, Fraction(0)) + exact_weight(weight, f"weight of {_text(value)}")
    if not merged:
        raise InputError("a pixel needs at least one value: write Pixel({0: '7/8', 1: '1/8'})")
    if len({len(v) if isinstance(v, tuple) else 0 for v in merged}) > 1:
        raise InputError(
            f"values {', '.join(map(_text, merged))} mix scalars and colours, or colours of different lengths"
        )
    total = _expanded(sum(merged.values()))
    if is_symbolic(total) or total != 1:
        _check_simplex(merged, total, on_simplex)
        if is_symbolic(total):
            return merged
        way_out = f"add the missing {1 - total}" if total < 1 else f"take away {total - 1}"
        raise InputError(
            f"weights {', '.join(map(str, merged.values()))} sum to {total}, not to 1: {way_out}, or scale them"
        )
    return merged


def _check_simplex(law: dict[Value, Any], total: Any, on_simplex: bool) -> None:
    """Weights with symbols must be able to sum to 1, and be declared to."""
    if not is_symbolic(total):
        return
    named = _listed(total.free_symbols)
    if not on_simplex or not any(getattr(w, "is_Symbol", False) for w in law.values()):
        raise AssumptionError(
            f"weights {', '.join(map(str, law.values()))} sum to {total}, not to 1 for every {named}: "
            f"write one of them as 1 minus the others, or use Pixel.symbolic(k, values=, weights=)"
        )
    left = 1 - sum((w for w in law.values() if not is_symbolic(w)), Fraction(0))
    if left <= 0:
        raise AssumptionError(
            f"weights {', '.join(map(str, law.values()))} leave {left} for {named}: no positive weight fits there"
        )


def _expanded(value: Any) -> Any:
    """A formula multiplied out, so that 1 - w + w is 1; a number as it is."""
    if not is_symbolic(value):
        return exact_number(value)
    from sympy import cancel, expand

    expanded = expand(value)
    expanded = cancel(expanded) if is_symbolic(expanded) else expanded
    return expanded if is_symbolic(expanded) else exact_number(expanded)


def _listed(symbols: Iterable[Any]) -> str:
    return ", ".join(sorted(map(str, symbols)))


def _read_value(raw: Any) -> Value:
    if isinstance(raw, tuple):
        if not raw:
            raise InputError("value=() has no channels: a colour is a tuple of numbers such as (1, 0, 0)")
        return tuple(exact_number(channel, "value") for channel in raw)
    return exact_or_symbolic(raw, "value")


def _dot(weights: Iterable[Any], values: Iterable[Any]) -> Any:
    return sum((w * v for w, v in zip(weights, values, strict=True)), Fraction(0))


def _text(value: Value) -> str:
    return f"({', '.join(map(short_text, value))})" if isinstance(value, tuple) else short_text(value)
