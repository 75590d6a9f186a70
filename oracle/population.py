"""The population X as a plan sees it: what can be drawn and what is known.

Nothing here computes; a population notes what is drawn, and the path that is being run keeps the
books.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from truemean.errors import NoClosedForm, UnknownName
from truemean.oracle.evaluate import check_closed
from truemean.oracle.law import Law
from truemean.oracle.pixel import Pixel
from truemean.oracle.quantity import Decision, Quantity, Vector, constant, quantity
from truemean.oracle.sample import Sample

if TYPE_CHECKING:
    from truemean.oracle.paths import Path

__all__ = ["Population"]


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
        self._check_counted("X.values")
        return self._pixel.values

    @property
    def weights(self) -> tuple[Fraction, ...]:
        """omega_1..omega_k, exact; a plan that reads them has no result at other weights."""
        check_closed(self._law, "X.weights")
        self._check_counted("X.weights")
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
    def scale(self) -> Any:
        """Largest minus smallest value, 1 where constant."""
        self._check_counted("X.scale")
        return self._pixel.scale

    def true_mean(self) -> Any:
        """The costly oracle of Fig. 1: the true mean, counted in ``oracle_calls``."""
        self._path.spend(oracle_calls=Fraction(1))
        return self.mean

    def _check_counted(self, asked: str) -> None:
        if self._law.indexed:
            raise NoClosedForm(f"the plan reads {asked}, but k, the number of values, is a symbol: make it a number")

    # -- drawing -----------------------------------------------------------------------------

    def draw(self, n: Any) -> Sample:
        """A sample of ``n`` independent draws; ``n`` may be a quantity."""
        return self._path.sample(self._law, [self._path.segment(self._law, n, least=1)], bool(self._pixel.channels))

    def draw_until(self, stop: Callable[..., Any], *, start: int, step: int = 1, most: int, parts: int = 1) -> Sample:
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
        """The four quarters of a pixel of a scene: top left, top right, bottom left, bottom right."""
        return self._cells(self._pixel.quadrants())

    def grid(self, n: Any) -> tuple[Population, ...]:
        """The ``n`` x ``n`` equal cells of a pixel of a scene, row by row, each of area 1/n^2."""
        return self._cells(self._pixel.grid(n))

    def _cells(self, cells: tuple[Pixel, ...]) -> tuple[Population, ...]:
        return tuple(Population(self._path, cell, f"{self.name}.{i}") for i, cell in enumerate(cells))

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
