"""What a plan works with: the population X and the samples drawn from it.

Nothing here computes; a population notes what is drawn, a sample hands out quantities, and the
path that is being run keeps the books.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from truemean.errors import InputTypeError, PlanError, UnknownName
from truemean.oracle.evaluate import check_closed
from truemean.oracle.exact import exact_number
from truemean.oracle.features import Level
from truemean.oracle.law import Law, SubLaw
from truemean.oracle.pixel import Pixel
from truemean.oracle.quantity import Decision, Quantity, Vector, constant, quantity

from truemean.oracle.tables import Table

if TYPE_CHECKING:
    from truemean.oracle.loops import Loop
    from truemean.oracle.paths import Path

__all__ = ["Population", "Sample", "Segment"]

Size = int | Quantity


@dataclass(frozen=True, slots=True)
class Segment:
    """Some draws made at once: their number, and who makes their table (``tables(size, level)``)."""

    size: Size
    tables: Callable[[int, Level], Table]


class Sample:
    """Draws from one population; statistics are quantities, and `more` grows it in place.

    Where values are colours every statistic is a vector by channel.
    """

    __slots__ = ("_ends", "chances", "colour", "label", "law", "loop", "name", "path", "segments", "span")

    def __init__(self, path: Path, law: Law, label: Any, name: str, segments: list[Segment], colour: bool) -> None:
        self.path, self.law, self.label, self.name, self.colour = path, law, label, name, colour
        self.segments = segments
        self._ends: list[Size] = [0]
        self.span: tuple[int, int] | None = None
        self.chances: list[Quantity] | None = None  # of a choice whose probabilities depend on the row
        self.loop: Loop | None = None

    def __hash__(self) -> int:
        return hash((self.label, self.span))

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
            ends.append(ends[-1] + self.segments[len(ends) - 1].size)
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
        return self.path.ratio_mean(self)

    # -- as a sequence -----------------------------------------------------------------------

    def __len__(self) -> int:
        size = self.size
        if isinstance(size, int):
            return size
        raise PlanError(f"len({self.name}) depends on the row: use {self.name}.size")

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
        raise PlanError(f"the truth of sample {self.name} is not defined: ask a statistic, e.g. {self.name}.range() > 0")

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
        smallest = min(self.law.column(column))
        if name == "contrast" and not (smallest > 0 or (option == 0 and smallest == 0)):
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
        if not sample.law.cost or isinstance(sample.law, SubLaw):
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
        return view

    def _now(self) -> tuple[int, int]:
        return self.span or (0, len(self.segments))

    def _linear(self, op: str) -> Any:
        span = self._now()
        if not self.colour:
            return Quantity(op, self, span, 0)
        return Vector(Quantity(op, self, span, c) for c in range(self.law.channels))

    def _weighted(self, weight: Any) -> Any:
        columns = self.path.weighted_columns(self, weight)
        span = self._now()
        found = [Quantity("mean", self, span, c) for c in columns]
        return Vector(found) if self.colour else found[0]

    def _stat(self, name: str, option: Any = None) -> Any:
        span = self._now()
        if not self.colour:
            return Quantity("stat", self, span, name, 0, option)
        return Vector(Quantity("stat", self, span, name, c, option) for c in range(self.law.channels))


class Population:
    """The pixel X, or a part of it, as a plan sees it: what can be drawn and what is known."""

    def __init__(self, path: Path, pixel: Pixel, name: str = "X", proposal: Law | None = None) -> None:
        self._path, self._pixel, self.name = path, pixel, name
        self._law = proposal or path.law_of(pixel)
        self.area = pixel.area

    def __repr__(self) -> str:
        return self.name

    # -- what is known -----------------------------------------------------------------------

    @property
    def values(self) -> tuple[Any, ...]:
        """I_1..I_k, exact."""
        return self._pixel.values

    @property
    def weights(self) -> tuple[Fraction, ...]:
        """omega_1..omega_k, exact; a plan that reads them has no result at other weights."""
        check_closed(self._law, "X.weights")
        return self._pixel.weights

    @property
    def mean(self) -> Any:
        """The true mean, for free: what a plan compares itself with, not what it may use."""
        law = self._path.law_of(self._pixel)
        found = [Quantity("true mean", law, c) for c in range(law.channels)]
        return Vector(found) if self._pixel.channels else found[0]

    @property
    def variance(self) -> Any:
        """The variance of the population, exact."""
        check_closed(self._law, "X.variance")
        return self._pixel.variance

    @property
    def scale(self) -> Fraction:
        """Largest minus smallest value, 1 where constant."""
        return self._pixel.scale

    def true_mean(self) -> Any:
        """The costly oracle of Fig. 1: the true mean, counted in ``oracle_calls``."""
        self._path.spend(oracle_calls=Fraction(1))
        return self.mean

    # -- drawing -----------------------------------------------------------------------------

    def draw(self, n: Any) -> Sample:
        """A sample of ``n`` independent draws; ``n`` may be a quantity."""
        return self._path.sample(self._law, [self._path.segment(self._law, n, least=1)], bool(self._pixel.channels))

    def draw_until(
        self, stop: Callable[..., Any], *, start: int, step: int = 1, most: int, parts: int = 1
    ) -> Sample:
        """Draw ``start``, then ``step`` more until ``stop(S)`` holds, but no more than ``most``.

        The last step is cut to reach ``most`` exactly, where ``stop`` is not asked any more. With
        ``parts=2`` even and odd draws are kept apart and ``stop(A, B)`` sees both halves.
        """
        return self._path.loop(self._law, bool(self._pixel.channels), stop, start, step, most, parts)

    def from_(self, proposal: Any) -> Population:
        """The same values drawn with other weights (a mapping value -> weight, or a Pixel)."""
        law = self._path.proposal(self._pixel, proposal)
        return Population(self._path, self._pixel, f"{self.name} from a proposal", law)

    def at(self, x: Any, y: Any = None) -> Any:
        """One point sample at a position of the pixel; counts as one draw."""
        position = x if y is None else (x, y)
        self._path.spend(draws=1)
        value = self._pixel.at(*position)
        return Vector(map(constant, value)) if isinstance(value, tuple) else constant(value)

    # -- parts -------------------------------------------------------------------------------

    @property
    def regions(self) -> Mapping[str, Population]:
        """The declared parts by name."""
        return _Regions(self._path, self._pixel, self.name)

    def split(self, area: Any) -> tuple[Population, Population]:
        """Two scattered parts of areas ``area`` and ``1 - area``, each with X's own law."""
        first, second = self._pixel.split(area)
        return Population(self._path, first, "R"), Population(self._path, second, f"{self.name} - R")

    def quadrants(self) -> tuple[Population, ...]:
        """The four quarters of a pixel of a scene."""
        return tuple(Population(self._path, q, f"{self.name}.{i}") for i, q in enumerate(self._pixel.quadrants()))

    def estimate(self, plan: Any, **params: Any) -> Any:
        """A sub-estimate by another plan, with its own law, cost and oracle calls."""
        sample = self._path.sub_estimate(self._pixel, self._law, plan, params, self.name)
        return sample.mean()

    # -- choices of the estimator ---------------------------------------------------------------

    def coin(self, p: Any) -> Decision:
        """A choice of the estimator itself: holds with probability ``p``, a number or a quantity."""
        heads = quantity(p)
        return Decision("==", self._path.choice([1 - heads, heads], f"X.coin({heads!r})", normalise=False), constant(1))

    def pick(self, weights: Sequence[Any]) -> Quantity:
        """A choice 0, 1, ... with probabilities in proportion to ``weights``."""
        return self._path.choice([quantity(w) for w in weights], f"X.pick({list(weights)})", normalise=True)


class _Regions(Mapping[str, Population]):
    def __init__(self, path: Path, pixel: Pixel, name: str) -> None:
        self._path, self._pixel, self._name = path, pixel, name

    def __getitem__(self, key: str) -> Population:
        if key not in self._pixel.regions:
            raise UnknownName("region", key, self._pixel.regions or ["(the pixel has no regions)"])
        return Population(self._path, self._pixel.regions[key], f"{self._name}.{key}")

    def __iter__(self) -> Iterator[str]:
        return iter(self._pixel.regions)

    def __len__(self) -> int:
        return len(self._pixel.regions)


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
    return f"n = {size}" if isinstance(size, int) else f"stage {span[1]}"


def _policy(undefined: Any) -> Fraction | None:
    return None if undefined is None else exact_number(undefined, "undefined")


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


