"""What a plan is worth on a pixel: its exact expectation, bias, variance, cost and law."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np

from truemean.errors import InputError, InputTypeError, PlanError, UnknownName
from truemean.oracle.distribution import joined_law
from truemean.oracle.features import Level
from truemean.oracle.forms import Form, prepare
from truemean.oracle.law import SubLaw
from truemean.oracle.paths import Exploration, Path
from truemean.oracle.pixel import Pixel
from truemean.oracle.plan import Plan, as_plan
from truemean.oracle.quantity import Quantity
from truemean.oracle.rings import Approx, Batch, Exact, Float64, Ring

__all__ = ["Derivation", "DerivedPath", "derive"]

ROWS = 2_000_000
_RINGS: dict[str, type[Exact] | type[Float64]] = {"exact": Exact, "float64": Float64}


@dataclass(frozen=True, slots=True)
class DerivedPath:
    """One path of a plan: its decisions in words, how likely it is, and what it adds to the bias."""

    decisions: tuple[str, ...]
    probability: Any
    bias: Any


class Derivation:
    """Results of `derive`, each computed when first asked for, at the level that it needs.

    Numbers are Fractions for ``arithmetic="exact"``, `Approx` for ``"float64"``; on colour pixels
    ``expectation bias relative_bias variance mse`` and ``path.bias`` are tuples by channel.
    """

    def __init__(self, plan: Plan, pixel: Pixel, ring: Ring, exploration: Exploration, rtol: float | None) -> None:
        self.plan, self.pixel = plan, pixel
        self._ring, self._exploration, self._rtol = ring, exploration, rtol

    # -- results -----------------------------------------------------------------------------

    @cached_property
    def bias(self) -> Any:
        """E[xi] - I, summed over the paths and never formed as a difference."""
        return self._by_channel(lambda c: self._total([f.mean(self._ring) for f in self._forms[c]], self._slack(c)))

    @cached_property
    def expectation(self) -> Any:
        """E[xi]."""
        return self._by_channel(lambda c: self._channel(self.bias, c) + self._truth(c))

    @cached_property
    def relative_bias(self) -> Any:
        """Bias divided by the true mean."""

        def channel(c: int) -> Any:
            if not self._law.mean(c):
                raise InputError("relative_bias has no meaning at true mean 0: use bias")
            return self._channel(self.bias, c) / self._truth(c)

        return self._by_channel(channel)

    @cached_property
    def mse(self) -> Any:
        """E[(xi - I)^2]."""

        def channel(c: int) -> Any:
            forms = self._exploration.prepared(lambda p: self._form(p, c, order=2))
            return self._total([f.moments(self._ring, 2)[2] for f in forms], max(f.slack for f in forms))

        return self._by_channel(channel)

    @cached_property
    def variance(self) -> Any:
        """E[(xi - E[xi])^2]."""
        mse, bias = self.mse, self.bias
        return self._by_channel(
            lambda c: self._channel(mse, c) - self._channel(bias, c) * self._channel(bias, c)
        )

    @cached_property
    def cost(self) -> Any:
        """E[number of samples drawn], those of sub-estimates included."""
        forms = self._exploration.prepared(lambda p: prepare(p, p.cost, None, 1))
        return self._total([f.mean(self._ring) for f in forms])

    @cached_property
    def oracle_calls(self) -> Any:
        """E[number of true_mean() calls]."""
        paths = zip(self._exploration.paths, self._forms[0], strict=True)
        calls = [self._ring.number(p.calls) * f.probability(self._ring) for p, f in paths if p.calls]
        return self._total(calls)

    def distribution(self) -> dict[Any, Any]:
        """The law of xi: ``{value: probability}``, values ascending, exact.

        >>> derive(lambda X: X.draw(2).mean(), Pixel.two("1/2")).distribution()[Fraction(1, 2)]
        Fraction(1, 2)
        """
        return joined_law(self._exploration, self._ring, self.pixel.channels is not None)

    @cached_property
    def paths(self) -> tuple[DerivedPath, ...]:
        """The decomposition of the bias by path; probabilities sum to 1, biases to the bias."""
        found = []
        for number, path in enumerate(self._exploration.paths):
            forms = [self._forms[c][number] for c in range(self._law.channels)]
            bias = self._by_channel(lambda c, forms=forms: forms[c].mean(self._ring))
            found.append(DerivedPath(tuple(path.decisions), forms[0].probability(self._ring), bias))
        return tuple(found)

    @cached_property
    def level(self) -> dict[str, Level]:
        """What was modelled of each sample for the bias; prints as in the table of levels."""
        found: dict[str, Level] = {}
        for number, path in enumerate(self._exploration.paths):
            for sample in path.samples:
                seen = [e.table.level for e in self._forms[0][number].rows.entries_of(sample)]
                found[sample.name] = Level(set().union(found.get(sample.name, Level()), *seen))
        return found

    @cached_property
    def rows(self) -> int:
        """How many rows the bias is a sum of."""
        return sum(max(1, sum(b.size for b in form.rows.blocks)) for form in self._forms[0])

    def at(self, weights: Any) -> Any:
        """The same plan on the same values with other weights.

        A mapping value -> weight gives another derivation; arrays ``[k, ...]`` in the order of
        ``X.values`` give results that are float64 arrays ``[...]``, the paths being derived once.
        """
        if isinstance(weights, Mapping):
            pixel = Pixel(weights)
            if set(pixel.values) != set(self.pixel.values):
                raise InputError(f"weights for {list(weights)} are not weights for the values {list(self.pixel.values)}")
            return derive(self.plan, pixel, **self._exploration.params)
        return _at_arrays(self, np.asarray(weights, dtype=float))

    def __repr__(self) -> str:
        return f"<derivation of {self.plan.name} on {self.pixel!r}>"

    # -- parts -------------------------------------------------------------------------------

    @property
    def _law(self) -> Any:
        return self._exploration.law_of(self.pixel)

    @property
    def _forms(self) -> list[list[Form]]:
        """By channel and path; made anew when a later result has sent the paths round again."""
        paths = self._exploration.paths
        if self._cache[0] is not paths:
            channels = range(self._law.channels)
            forms = self._exploration.prepared(lambda p: [self._form(p, c, order=1) for c in channels])
            self._cache = (self._exploration.paths, [list(column) for column in zip(*forms, strict=True)])
        return self._cache[1]

    _cache: tuple[list[Path], list[list[Form]]] = ([], [])

    def _form(self, path: Path, channel: int, order: int) -> Form:
        approximate = not isinstance(self._ring, Exact)
        return prepare(path, path.result[channel], (self._law, channel), order, approximate)

    def _slack(self, channel: int) -> Fraction:
        return max(form.slack for form in self._forms[channel])

    def _truth(self, channel: int) -> Any:
        return self._ring.mean(self._law, channel)

    def _total(self, terms: list[Any], slack: Fraction = Fraction(0)) -> Any:
        total = self._ring.number(Fraction(0))
        for term in terms:
            total = total + term
        if not isinstance(total, Approx):
            return total
        total = Approx(total.value, total.error + float(slack) * (1 + 1e-9)) if slack else total
        return self._held(total)

    def _held(self, found: Approx) -> Approx:
        return found

    def _by_channel(self, function: Any) -> Any:
        found = tuple(function(c) for c in range(self._law.channels))
        return found if self.pixel.channels is not None else found[0]

    def _channel(self, value: Any, channel: int) -> Any:
        return value[channel] if self.pixel.channels is not None else value


def derive(
    plan: Any,
    X: Pixel,
    *,
    arithmetic: str = "exact",
    rtol: float | None = None,
    rows: int | str = ROWS,
    runs: int = 100_000,
    seed: int = 0,
    **params: Any,
) -> Any:
    """What a plan (or an undecorated function of X) is worth on a pixel, exactly.

    ``arithmetic`` is ``"exact"`` (Fractions) or ``"float64"`` (`Approx` with an error bound, exact
    where ``rtol`` can't be held otherwise); ``rows`` bounds what may be told apart, or is
    ``"sampled"`` for an interval from ``runs`` sampled rows. Raises PlanError and its kin.

    >>> from truemean.oracle.plans import catalogue
    >>> d = derive(catalogue["kirk-arvo"], Pixel({0: "7/8", 1: "1/8"}), n=4)
    >>> d.expectation, d.bias
    (Fraction(851, 16384), Fraction(-1197, 16384))
    """
    declared = as_plan(plan)
    if not isinstance(X, Pixel):
        raise InputTypeError(f"X={X!r} (type={type(X).__name__}) is not a Pixel: write Pixel({{0: '7/8', 1: '1/8'}})")
    if arithmetic not in _RINGS:
        raise UnknownName("arithmetic", str(arithmetic), _RINGS)
    if rows == "sampled":
        from truemean.oracle.simulate import sampled

        return sampled(declared, X, runs, seed, params)
    if not isinstance(rows, int) or rows < 1:
        raise InputError(f"rows={rows!r}: give the largest number of rows allowed, or 'sampled'")
    exploration = Exploration(declared.function, X, declared.bind(params), rows, declared.undefined == "nan")
    found = Derivation(declared, X, _RINGS[arithmetic](), exploration, rtol)
    _ = exploration.paths  # errors of the plan show here, not at the first result
    return found


def sub_law(parent: Exploration, plan: Any, pixel: Pixel, params: dict[str, Any]) -> SubLaw:
    """The law of a sub-estimate; equal laws of the pixel share one derivation."""
    declared = as_plan(plan)
    bound = declared.bind(params)
    constant = len(pixel.law) == 1
    place = (pixel.geometry is not None, tuple(pixel.regions)) if constant else (id(pixel.geometry), _parts(pixel))
    key = (declared.function, pixel.values, pixel.weights, place, repr(sorted(bound.items())))
    if key not in parent.subplans:
        exploration = Exploration(
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
