"""The law of a sub-estimate: mean, variance and cost as derived, its values told apart only if somebody looks."""

from __future__ import annotations

from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING, Any

from truemean.oracle.columns import Ints
from truemean.oracle.law import Atom, Lattice, Law
from truemean.oracle.pixel import Pixel
from truemean.oracle.plan import as_plan
from truemean.oracle.rings import Exact
from truemean.oracle.subsets import Family
from truemean.oracle.symbolic import SymbolicLaw, is_formula

if TYPE_CHECKING:
    from truemean.oracle.exploration import Exploration

__all__ = ["SubLaw", "sub_law"]


class SubLaw(Law):
    """The law of a sub-estimate: mean, variance and cost as derived, its atoms only if somebody looks."""

    def __init__(self, name: str, derivation: Any) -> None:
        self.name, self.ratios, self.open = name, None, False
        self.channels = derivation.pixel.channels or 1
        self._derivation = derivation
        self._colour = derivation.pixel.channels is not None

    @property
    def cost(self) -> Any:
        """Draws that the sub-estimate takes on average."""
        return self._derivation.cost

    @property
    def oracle_calls(self) -> Any:
        """Oracle calls that it takes on average."""
        return self._derivation.oracle_calls

    @cached_property
    def _full(self) -> Law:
        law = self._derivation.distribution()
        if any(is_formula(x) for pair in law.items() for x in pair):
            return SymbolicLaw(self._derivation.field, law)
        return Law([v if self._colour else (v,) for v in law], list(law.values()), self.name)

    @property
    def values(self) -> tuple[Atom, ...]:
        return self._full.values

    @property
    def weights(self) -> tuple[Fraction, ...]:
        return self._full.weights

    def lattice(self, column: int) -> Lattice:
        return self._full.lattice(column)

    @property
    def drawn(self) -> bool:
        return False

    @property
    def symbolic(self) -> bool:
        return self._full.symbolic

    @property
    def symbolic_values(self) -> bool:
        return self._full.symbolic_values

    @property
    def ordered(self) -> bool:
        return self._full.ordered

    @cached_property
    def unit(self) -> int:
        return self._full.unit

    @cached_property
    def masses(self) -> list[Any]:
        return self._full.masses

    def ends(self, support: Ints) -> tuple[Ints, Ints]:
        return self._full.ends(support)

    def family(self, name: str, n: Any) -> Family:
        return self._full.family(name, n)

    def mean(self, column: int) -> Any:
        return self._of_channel(self._derivation.expectation, column)

    def variance(self, column: int) -> Any:
        return self._of_channel(self._derivation.variance, column)

    def _of_channel(self, value: Any, column: int) -> Any:
        return value[column] if self._colour else value


def sub_law(parent: Exploration, plan: Any, pixel: Pixel, params: dict[str, Any]) -> SubLaw:
    """The law of a sub-estimate; equal laws of the pixel share one derivation."""
    from truemean.oracle.derivation import Derivation  # which derives plans that may estimate parts again

    declared = as_plan(plan)
    bound = declared.bind(params)
    constant = len(pixel.law) == 1
    place = (pixel.geometry is not None, tuple(pixel.regions)) if constant else (id(pixel.geometry), _parts(pixel))
    key = (declared.function, pixel.values, pixel.weights, place, repr(sorted(bound.items())))
    if key not in parent.subplans:
        exploration = type(parent)(
            declared.function, pixel, bound, parent.budget, declared.undefined == "nan", parent=parent
        )
        _ = exploration.paths
        inner = Derivation(declared, pixel, Exact(), exploration, None)
        parent.subplans[key] = SubLaw(f"estimate of {declared.name}", inner)
    return parent.subplans[key]


def _parts(pixel: Pixel) -> Any:
    if pixel.geometry is not None:
        return ()
    return tuple((name, part.area, part.values, part.weights, _parts(part)) for name, part in pixel.regions.items())
