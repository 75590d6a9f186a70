"""What a plan is worth on a pixel: its exact expectation, bias, variance, cost and law."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, partial
from typing import Any

from truemean.errors import InputError, InputTypeError, NoClosedForm, NotExact, UnknownName
from truemean.oracle.batch import Batch, checked_weights
from truemean.oracle.columns import NotRational
from truemean.oracle.distribution import joined_law, observed
from truemean.oracle.enclosure import Ball, closer
from truemean.oracle.evaluate import check_closed
from truemean.oracle.exact import is_symbolic
from truemean.oracle.exploration import Exploration
from truemean.oracle.features import Level
from truemean.oracle.float64 import Approx, Float64
from truemean.oracle.forms import prepare
from truemean.oracle.formulas import formula
from truemean.oracle.law import Law
from truemean.oracle.moments import Form
from truemean.oracle.observing import Replay
from truemean.oracle.paths import Path
from truemean.oracle.pixel import Pixel
from truemean.oracle.plan import Plan, as_plan
from truemean.oracle.rings import Exact, Ring
from truemean.oracle.shown import Shown
from truemean.oracle.symbols import Field

__all__ = ["Derivation", "DerivedPath", "derive"]

ROWS = 2_000_000
_RINGS: dict[str, type[Exact | Float64]] = {"exact": Exact, "symbolic": Exact, "ball": Exact, "float64": Float64}
_FLOAT_BITS = 160  # of irrational coefficients, before they are rounded


@dataclass(frozen=True, slots=True)
class DerivedPath:
    """One path of a plan: its decisions in words, how likely it is, and what it adds to the bias."""

    decisions: tuple[str, ...]
    probability: Any
    bias: Any


class Derivation(Shown):
    """Results of `derive`, each computed when first asked for, at the level that it needs.

    Numbers are Fractions for ``arithmetic="exact"``, SymPy expressions for ``"symbolic"``, `Approx`
    for ``"float64"``; on colour pixels ``expectation bias relative_bias variance mse`` and ``path.bias`` are tuples by channel.
    """

    def __init__(
        self,
        plan: Plan,
        pixel: Pixel,
        ring: Ring,
        exploration: Exploration,
        rtol: float | None,
        symbolic: bool = False,
        digits: int = 0,
        bits: int = 0,
    ) -> None:
        self.plan, self.pixel, self.symbolic = plan, pixel, symbolic
        self._ring, self._exploration, self._rtol = ring, exploration, rtol
        self._digits, self._bits = digits, bits

    # -- results -----------------------------------------------------------------------------

    @cached_property
    def bias(self) -> Any:
        """E[xi] - I, summed over the paths and never formed as a difference."""
        return self._result("bias", self.biases)

    @cached_property
    def expectation(self) -> Any:
        """E[xi]."""
        return self._result("expectation", [b + t for b, t in zip(self.biases, self.truths, strict=True)])

    @cached_property
    def relative_bias(self) -> Any:
        """Bias divided by the true mean; InputError where that is 0."""
        if not self._exploration.weightless and not all(self.law.mean(c) for c in range(self.law.channels)):
            raise InputError("relative_bias has no meaning at true mean 0: use bias")
        return self._result("relative_bias", [b / t for b, t in zip(self.biases, self.truths, strict=True)])

    @cached_property
    def mse(self) -> Any:
        """E[(xi - I)^2]."""
        return self._result("mse", self.mean_squared_errors)

    @cached_property
    def variance(self) -> Any:
        """E[(xi - E[xi])^2]."""
        return self._result("variance", self.variances)

    @cached_property
    def cost(self) -> Any:
        """E[number of samples drawn], those of sub-estimates included."""
        forms = self._beyond(lambda p: prepare(p, p.cost, None, 1))
        return self._held("cost", [self._total([f.mean(self._ring) for f in forms], forms)])[0]

    @cached_property
    def oracle_calls(self) -> Any:
        """E[number of true_mean() calls]."""
        paths = [p for p in self._exploration.paths if p.calls]
        calls = [self._ring.number(p.calls) * p.rows.probability(self._ring) for p in paths]
        return self._held("oracle_calls", [self._total(calls, [])])[0]

    def distribution(self) -> dict[Any, Any]:
        """The law of xi: ``{value: probability}``, exact; values ascend where they are numbers.

        >>> derive(lambda X: X.draw(2).mean(), Pixel.two("1/2")).distribution()[Fraction(1, 2)]
        Fraction(1, 2)
        """
        check_closed(self.law, "its whole law")
        if self.law.indexed:
            raise NoClosedForm(f"the law of xi for k={self.pixel.count} values has no formula: make k concrete")
        try:
            law = joined_law(self._beyond(observed), self._ring, self._exploration.lenient, self.colour)
        except NotRational as error:
            raise NotExact(f"the values of the estimate are irrational: {error}; its moments have enclosures") from None
        if not self.symbolic:
            return law
        return {self._finished(value): self._finished(probability) for value, probability in law.items()}

    @cached_property
    def paths(self) -> tuple[DerivedPath, ...]:
        """The decomposition of the bias by path; probabilities sum to 1, biases to the bias."""
        found = []
        _ = self._forms  # which may look closer, and find other paths
        for path, *biases in zip(self._exploration.paths, *self.path_biases, strict=True):
            bias = [self._finished(b) for b in biases]
            probability = self._finished(path.rows.probability(self._ring))
            found.append(DerivedPath(tuple(path.decisions), probability, tuple(bias) if self.colour else bias[0]))
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
                raise InputError(
                    f"weights for {list(weights)} are not weights for the values {list(self.pixel.values)}"
                )
            e, arithmetic = self._exploration, "exact" if isinstance(self._ring, Exact) else "float64"
            return derive(self.plan, pixel, arithmetic=arithmetic, rtol=self._rtol, rows=e.budget, **e.params)
        pixel = self.pixel
        if self.symbolic:
            raise InputError(f"{self!r} is a formula: use .lambdify() for arrays of numbers")
        if pixel.regions:
            raise InputError("the pixel has regions, so its weights don't say it all: derive it for each pixel")
        array = checked_weights(weights, len(pixel.values))
        open_pixel = Pixel(dict.fromkeys(pixel.values, Fraction(1, len(pixel.values))))
        e = self._exploration
        exploration = Exploration(e.function, open_pixel, e.params, e.budget, e.lenient, weightless=True)
        law = exploration.law_of(open_pixel)
        place = {v if isinstance(v, tuple) else (v,): number for number, v in enumerate(pixel.values)}
        ring = Batch(law, array[[place[v] for v in law.values]])
        return Derivation(self.plan, open_pixel, ring, exploration, None)

    def __repr__(self) -> str:
        return f"<derivation of {self.plan.name} on {self.pixel!r}>"

    # -- parts -------------------------------------------------------------------------------

    @property
    def law(self) -> Law:
        """The law of one draw, in the ring's numbers."""
        return self._exploration.law_of(self.pixel)

    @property
    def arithmetic(self) -> str:
        """The number system of the results."""
        if isinstance(self._ring, Exact):
            return "symbolic" if self.symbolic else "ball" if self._digits else "exact"
        return "float64"

    @property
    def params(self) -> dict[str, Any]:
        """The plan's parameters, defaults filled in."""
        return self._exploration.params

    @property
    def requirements(self) -> list[str]:
        """What a symbolic sample size must be for the formulas to hold, such as ``n >= 2``."""
        _ = self._forms
        return list(self.field.requirements)

    @property
    def field(self) -> Field:
        """The rational functions of the symbols that the numbers are made of."""
        return self._exploration.field

    @property
    def decisions(self) -> list[list[str]]:
        """What each path decided, in words."""
        _ = self._forms
        return [path.decisions for path in self._exploration.paths]

    @property
    def colour(self) -> bool:
        """Whether results are tuples by channel."""
        return self.pixel.channels is not None

    @property
    def truths(self) -> list[Any]:
        """The true mean by channel, in the ring's numbers."""
        return [self._ring.mean(self.law, c) for c in range(self.law.channels)]

    @cached_property
    def biases(self) -> list[Any]:
        """The bias by channel, in the ring's numbers."""
        return [self._total(*pair) for pair in zip(self.path_biases, self._forms, strict=True)]

    @cached_property
    def variances(self) -> list[Any]:
        """The variance by channel, in the ring's numbers."""
        pairs = zip(self.mean_squared_errors, self.biases, strict=True)
        return [mse - bias * bias for mse, bias in pairs]

    @cached_property
    def path_biases(self) -> list[list[Any]]:
        """What each path adds to the bias, by channel and path, in the ring's numbers."""
        found = [[form.mean(self._ring) for form in forms] for forms in self._forms]
        if not self._digits:
            return found
        pairs = zip(found, self._forms, strict=True)
        return [[Ball(b, form.slack) for b, form in zip(biases, forms, strict=True)] for biases, forms in pairs]

    @cached_property
    def mean_squared_errors(self) -> list[Any]:
        """The mean squared error by channel, in the ring's numbers."""
        forms = self._by_channel(self._beyond(self._forms_of(2)))
        return [self._total([f.moments(self._ring, 2)[2] for f in fs], fs, 2) for fs in forms]

    @cached_property
    def _forms(self) -> list[list[Form]]:
        """The forms of the bias by channel and path."""
        return self._by_channel(self._exploration.prepared(self._forms_of(1)))

    def _forms_of(self, order: int) -> Callable[[Path], list[Form]]:
        """What makes the forms of a path by channel, good for moments up to an order."""
        truths = [(self.law, channel) for channel in range(self.law.channels)]
        return lambda path: [prepare(path, path.result[t[1]], t, order, self._bits) for t in truths]

    def _by_channel(self, by_path: list[list[Form]]) -> list[list[Form]]:
        return [list(forms) for forms in zip(*by_path, strict=True)]

    def _beyond(self, prepare_path: Callable[[Path], Any]) -> list[Any]:
        """What the bias did not need: on its own paths if these were seen finely enough, else on new ones."""
        _ = self._forms
        try:
            return [prepare_path(path) for path in self._exploration.paths]
        except Replay:
            return self._finer.prepared(prepare_path)

    @cached_property
    def _finer(self) -> Exploration:
        e = self._exploration
        return Exploration(e.function, e.pixel, e.params, e.budget, e.lenient, parent=e, weightless=e.weightless)

    def _total(self, terms: list[Any], forms: list[Form], order: int = 1) -> Any:
        """The sum over the paths, with the error that irrational coefficients bring into a moment."""
        total = self._ring.number(Fraction(0))
        for term in terms:
            total = total + term
        slack = Fraction(0) if isinstance(total, Ball) else max((form.slack for form in forms), default=Fraction(0))
        if order == 2 and slack:  # E|(v + d)^2 - v^2| <= 2 |d| E|v| + d^2, and 2 E|v| <= 1 + E v^2
            centre = Fraction(total.value) if isinstance(total, Approx) else total
            slack = slack * (1 + abs(centre)) + slack * slack
        if slack and isinstance(total, Approx):
            return Approx(total.value, total.error + float(slack) * (1 + 1e-9))
        return Ball.of(total) + Ball(Fraction(0), slack) if self._digits else total

    def _finished(self, value: Any) -> Any:
        """A number of the ring as the caller gets it."""
        if isinstance(self._ring, Batch):
            return value.reshape(self._ring.shape)
        if self._digits:
            return Ball.of(value).enclosure(self._digits)
        return formula(value) if self.symbolic else value

    def _result(self, name: str, by_channel: list[Any]) -> Any:
        finished = self._held(name, by_channel)
        return tuple(finished) if self.colour else finished[0]

    def _held(self, name: str, numbers: list[Any]) -> list[Any]:
        """Numbers as the caller gets them, computed again where they don't hold the precision asked for."""
        if self._digits and any(Ball.of(v).radius * 10**self._digits > self.pixel.scale for v in numbers):
            return self._again(name, self._digits, 2 * self._bits)
        if self._rtol is not None and not all(v.error <= self._rtol * abs(v.value) for v in numbers):
            return closer(partial(self._again, name), self._rtol)
        return [self._finished(v) for v in numbers]

    def _again(self, name: str, digits: int, bits: int) -> list[Any]:
        """A result by channel in exact numbers (0 digits), or in balls of other precision."""
        again = Derivation(self.plan, self.pixel, Exact(), self._exploration, None, digits=digits, bits=bits)
        found = getattr(again, name)
        return list(found) if isinstance(found, tuple) else [found]


def derive(
    plan: Any,
    X: Pixel,
    *,
    arithmetic: str | None = None,
    digits: int | None = None,
    rtol: float | None = None,
    rows: int | str = ROWS,
    runs: int = 100_000,
    seed: int = 0,
    **params: Any,
) -> Any:
    """What a plan (or an undecorated function of X) is worth on a pixel, exactly.

    ``arithmetic`` is ``"exact"`` (Fractions), ``"symbolic"`` (SymPy expressions, the default where a
    symbol is in X or the parameters), ``"ball"`` (`Enclosure` to ``digits`` decimal places of the
    pixel's scale; roots and logarithms in the estimate are allowed) or ``"float64"`` (`Approx` with an
    error bound, exact or from balls where ``rtol`` can't be held otherwise); ``rows`` bounds what may be told apart, or is
    ``"sampled"`` for an interval from ``runs`` sampled rows. Raises PlanError and its kin.

    >>> from truemean.oracle.plans import catalogue
    >>> d = derive(catalogue["kirk-arvo"], Pixel({0: "7/8", 1: "1/8"}), n=4)
    >>> d.expectation, d.bias
    (Fraction(851, 16384), Fraction(-1197, 16384))
    >>> from sympy import Symbol
    >>> derive(catalogue["kirk-arvo"], Pixel.symbolic(2, values=(0, 1)), n=Symbol("n")).bias
    -omega1**n*omega2 + omega2**n*(1 - omega2)
    """
    declared = as_plan(plan)
    if not isinstance(X, Pixel):
        raise InputTypeError(f"X={X!r} (type={type(X).__name__}) is not a Pixel: write Pixel({{0: '7/8', 1: '1/8'}})")
    bound = declared.bind(params)
    symbols = X.symbols.union(*(v.free_symbols for v in bound.values() if is_symbolic(v)))
    arithmetic = arithmetic or ("symbolic" if symbols else "exact")
    if arithmetic not in _RINGS:
        raise UnknownName("arithmetic", str(arithmetic), _RINGS)
    if symbols and (arithmetic != "symbolic" or rows == "sampled"):
        named = ", ".join(sorted(map(str, symbols)))
        raise InputError(f"{named} are symbols, so there is no number: give them values, or arithmetic='symbolic'")
    if rows == "sampled":
        from truemean.oracle.simulate import sampled

        return sampled(declared, X, runs, seed, params)
    if isinstance(rows, bool) or not isinstance(rows, int) or rows < 1:
        raise InputError(f"rows={rows!r}: give the largest number of rows allowed, or 'sampled'")
    exploration = Exploration(declared.function, X, bound, rows, declared.undefined == "nan")
    if rtol is not None and (arithmetic != "float64" or not isinstance(rtol, float | int) or not rtol > 0):
        raise InputError(f"rtol={rtol!r} is a positive relative tolerance for arithmetic='float64'")
    places, bits = _precision(arithmetic, digits)
    found = Derivation(declared, X, _RINGS[arithmetic](), exploration, rtol, arithmetic == "symbolic", places, bits)
    _ = exploration.paths  # errors of the plan show here, not at the first result
    return found


def _precision(arithmetic: str, digits: int | None) -> tuple[int, int]:
    """Digits of enclosures, and the bits that irrational coefficients have at first."""
    if digits is not None and (
        arithmetic != "ball" or isinstance(digits, bool) or not isinstance(digits, int) or digits < 1
    ):
        raise InputError(f"digits={digits!r}: a number of decimal places of at least 1, with arithmetic='ball'")
    if arithmetic == "ball":
        places = 30 if digits is None else digits
        return places, 64 + 4 * places
    return 0, _FLOAT_BITS if arithmetic == "float64" else 0
