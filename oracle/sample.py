"""Samples: what was drawn, in segments, and the statistics that a plan may ask of them.

Nothing here computes: a sample hands out quantities.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from truemean.errors import InputTypeError, PlanError
from truemean.oracle.exact import exact_number
from truemean.oracle.features import Level
from truemean.oracle.importance import ratio_mean, weighted_columns
from truemean.oracle.law import Law
from truemean.oracle.quantity import Decision, Quantity, Vector, constant
from truemean.oracle.symbols import Ratio
from truemean.oracle.tables import Table

if TYPE_CHECKING:
    from truemean.oracle.loops import Loop
    from truemean.oracle.paths import Path

__all__ = ["Sample", "Segment"]

Size = int | Ratio | Quantity


@dataclass(frozen=True, slots=True)
class Segment:
    """Some draws made at once: their number, and who makes their table (``tables(size, level, asked by)``)."""

    size: Size
    tables: Callable[[Any, Level, str], Table]


class Sample:
    """Draws from one population; statistics are quantities, and `more` grows it in place.

    Where values are colours every statistic is a vector by channel.
    """

    __slots__ = ("_ends", "_hash", "chances", "colour", "label", "law", "loop", "name", "path", "segments", "span")

    def __init__(self, path: Path, law: Law, label: Any, name: str, segments: list[Segment], colour: bool) -> None:
        self.path, self.law, self.label, self.name, self.colour = path, law, label, name, colour
        self.segments = segments
        self._ends: list[Size] = [0]
        self._hash = hash(label)
        self.span: tuple[int, int] | None = None
        self.chances: list[Quantity] | None = None  # of a choice whose probabilities depend on the row
        self.loop: Loop | None = None

    def __hash__(self) -> int:
        return self._hash

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sample) and self.label == other.label and self.span == other.span

    def __repr__(self) -> str:
        return self.name

    # -- size --------------------------------------------------------------------------------

    @property
    def size(self) -> Size:
        """The number of draws: an int, or a quantity where it depends on the row."""
        return self.size_of(*self._now())

    def size_of(self, first: int, last: int) -> Size:
        """The number of draws in some segments."""
        ends = self._ends
        while len(ends) <= last:
            size = self.segments[len(ends) - 1].size
            ends.append(ends[-1] + size if len(ends) > 1 else size)
        return ends[last] if not first else ends[last] - ends[first]

    def more(self, m: Any) -> Sample:
        """Draw ``m`` more (an int or a quantity, 0 allowed); returns the sample itself."""
        self.path.check_alive(self)
        self.segments.append(self.path.segment(self.law, m, least=0))
        return self

    # -- statistics --------------------------------------------------------------------------

    def mean(self, weight: Any = None) -> Any:
        """The sample mean; with ``weight=`` (a mapping or function of the value) that of weight times value."""
        if weight is not None:
            return self._weighted(weight)
        return self._linear("mean")

    def sum(self) -> Any:
        """The sum of the draws; 0 for an empty sample."""
        return self._linear("sum")

    def min(self) -> Any:
        """The smallest value drawn."""
        return self._stat("min")

    def max(self) -> Any:
        """The largest value drawn."""
        return self._stat("max")

    def range(self) -> Any:
        """Largest minus smallest value: the simplest variation."""
        return self._stat("range")

    def contrast(self, undefined: Any = None) -> Any:
        """(max - min) / (max + min); 0/0 is an error unless ``undefined=`` gives its value."""
        return self._stat("contrast", _policy(undefined))

    def variance(self, undefined: Any = None) -> Any:
        """The sample variance (divided by n - 1); of one draw an error unless ``undefined=`` gives its value."""
        return self._stat("variance", _policy(undefined))

    def std_error(self, undefined: Any = None) -> Any:
        """sqrt(variance / n), the standard error of the mean."""
        return self._stat("std_error", _policy(undefined))

    def deviations(self) -> Any:
        """The sum of squared distances from the sample mean."""
        return self._stat("deviations")

    def all_equal(self) -> Decision:
        """Whether all draws have the same value."""
        return Decision("flat", self, self._now(), None, 0, "all_equal", "")

    def statistic(self, function: Callable[[tuple[Any, ...]], Any], *, ordered: bool = False) -> Quantity:
        """Any function of the tuple of drawn values, ascending; ``ordered=True`` gives them as drawn."""
        return Quantity("stat", self, self._now(), "custom", 0, _Function(function, ordered))

    def self_normalised_mean(self) -> Any:
        """Weighted mean with density ratios as weights, divided by their sum (after `Population.from_`)."""
        return ratio_mean(self)

    # -- as a sequence -----------------------------------------------------------------------

    def __len__(self) -> int:
        size = self.size
        if isinstance(size, int):
            return size
        what = "is a formula" if isinstance(size, Ratio) else "depends on the row"
        raise PlanError(f"len({self.name}) {what}: use {self.name}.size")

    def __getitem__(self, index: int) -> Any:
        if isinstance(index, slice):
            raise PlanError(f"{self.name}[{index}] would look at every draw: draw two samples instead")
        size = len(self)
        if not -size <= index < size:
            raise IndexError(f"{self.name} has {size} draws, there is no number {index}")
        return self._stat("item", index % size)

    def __iter__(self) -> Iterator[Any]:
        return iter([self[i] for i in range(len(self))])

    def __bool__(self) -> NoReturn:
        raise PlanError(
            f"the truth of sample {self.name} is not defined: ask a statistic, e.g. {self.name}.range() > 0"
        )

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> Any:
        reduction = _REDUCTIONS.get(function.__name__)
        if reduction is None or args[0] is not self:
            raise PlanError(f"np.{function.__name__} has no meaning on a sample; use {', '.join(_REDUCTIONS)}")
        return reduction(*args, **kwargs)

    def __array_ufunc__(self, *args: Any, **kwargs: Any) -> NoReturn:
        raise PlanError(f"a sample is not a number: take a statistic of {self.name}, e.g. {self.name}.mean()")

    # -- what the engine asks ----------------------------------------------------------------

    def flat_test(self, leaf: Quantity, comparison: str) -> Decision | None:
        """The comparison with 0 as a test for equal draws, if the statistic is zero exactly then."""
        if comparison not in ("<=", "==", ">", "!="):
            return None
        _, span, name, column, option = leaf.args
        option = option.args[0] if isinstance(option, Quantity) else option
        if name == "contrast" and self.law.least_sign < (0 if option == 0 else 1):
            return None
        if name not in ("range", "contrast", "variance", "std_error", "deviations") or option not in (None, 0):
            return None
        least = 2 if option is None and name in ("variance", "std_error") else 0
        return Decision("flat", self, span, column if self.colour else None, least, name, comparison)

    def describe(self, node: Any) -> str:
        """A statistic in words, such as ``range(S1)``."""
        sample, span = node.args[:2]
        comparison = ""
        if node.op == "flat":
            column, name, comparison = node.args[2], node.args[4], node.args[5]
        elif node.op == "stat":
            name, column = node.args[2], node.args[3] if self.colour else None
        else:
            name, column = node.op, node.args[2] if self.colour else None
        if not sample.law.drawn:
            return str(sample.name)
        older = "" if span == (0, len(sample.segments)) else f" at {text_span(sample, span)}"
        if name == "item":
            return f"{sample.name}[{node.args[4]}]"
        if name == "custom":
            name = node.args[4].name
        words = f"{name}({sample.name}{older})" + ("" if column is None else f"[{column}]")
        return f"{words} {comparison} 0" if comparison else words

    def part(self, first: int, last: int, name: str) -> Sample:
        """A view of some segments only."""
        view = Sample(self.path, self.law, self.label, name, self.segments, self.colour)
        view.span = (first, last)
        view._hash = hash((self.label, view.span))
        return view

    def _now(self) -> tuple[int, int]:
        return self.span or (0, len(self.segments))

    def _linear(self, op: str) -> Any:
        span = self._now()
        if not self.colour:
            return Quantity(op, self, span, 0)
        return Vector(Quantity(op, self, span, c) for c in range(self.law.channels))

    def _weighted(self, weight: Any) -> Any:
        columns = weighted_columns(self, weight)
        span = self._now()
        found = [Quantity("mean", self, span, c) for c in columns]
        return Vector(found) if self.colour else found[0]

    def _stat(self, name: str, option: Any = None) -> Any:
        span = self._now()
        if not self.colour:
            return Quantity("stat", self, span, name, 0, option)
        return Vector(Quantity("stat", self, span, name, c, option) for c in range(self.law.channels))


class _Function:
    """A custom statistic; the same code counts as the same function when the plan is run again."""

    __slots__ = ("function", "name", "ordered")

    def __init__(self, function: Callable[..., Any], ordered: bool) -> None:
        if not callable(function):
            raise InputTypeError(f"statistic={function!r} is not a function of the tuple of values")
        self.function, self.ordered = function, ordered
        self.name = getattr(function, "__name__", "statistic")

    def __hash__(self) -> int:
        return hash((getattr(self.function, "__code__", self.function), self.ordered))


def text_span(sample: Sample, span: tuple[int, int]) -> str:
    """How much of a sample a statistic speaks of, in words."""
    size = sample.size_of(*span)
    return f"stage {span[1]}" if isinstance(size, Quantity) else f"n = {size}"


def _policy(undefined: Any) -> Quantity | None:
    return None if undefined is None else constant(exact_number(undefined, "undefined"))


def _spread(sample: Sample, ddof: int, root: bool) -> Any:
    size = sample.size
    variance = sample.deviations() / (size - ddof)
    return np.sqrt(variance) if root else variance


_REDUCTIONS: dict[str, Callable[..., Any]] = {
    "mean": lambda S: S.mean(),
    "sum": lambda S: S.sum(),
    "min": lambda S: S.min(),
    "amin": lambda S: S.min(),
    "max": lambda S: S.max(),
    "amax": lambda S: S.max(),
    "ptp": lambda S: S.range(),
    "var": lambda S, ddof=0: _spread(S, ddof, root=False),
    "std": lambda S, ddof=0: _spread(S, ddof, root=True),
    "median": lambda S: S.statistic(_median),
}


def _median(values: tuple[Fraction, ...]) -> Fraction:
    middle = len(values) // 2
    return values[middle] if len(values) % 2 else (values[middle - 1] + values[middle]) / 2
